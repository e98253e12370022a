//! Rollout equals training: along a recorded trajectory, the learned solver makes the predictions of the training pass
//! over tokens of that recording. Weights are random. The bound is the network's f32, in units of the targets'
//! deviations.

use nerd_core::state::wrap_state;
use nerd_sim::rig::Rig;
use nerd_sim::vary::Told;

use crate::*;

const FRAMES: usize = 40;

fn recorded(system: &Arc<System>) -> Trajectories {
    let config = GenerateConfig { frames: FRAMES, resets: 1.0, seed: 3, ..Default::default() };
    let solver = Articulated::new(ArticulatedConfig::paper(system, Friction::Coulomb));
    record(system, &mut Rig::new(solver), &config, 0, 6).expect("recorded")
}

/// A built-in robot; a family gets sensor noise.
fn blurred(robot: &str) -> Arc<System> {
    let mut system = (*System::named(robot).expect("built in")).clone();
    system.spec.vary.iter_mut().for_each(|vary| vary.noise = Some(Range { low: 0.0, high: 0.01 }));
    Arc::new(system)
}

fn model(system: &Arc<System>, base: Form, positions: Positions, windows: &Windows) -> Model {
    let paper = TransformerConfig::paper(windows.inputs, windows.outputs, 24);
    let network = TransformerConfig { layers: 3, heads: 4, history: 6, block: FRAMES, positions, ..paper };
    unlearned(system, base, network, moments(windows))
}

/// Predictions of the training pass `[frame][outputs]` for the normalised tokens of one trajectory.
fn trained(model: &Model, x: &[f32]) -> Vec<f32> {
    let c = model.config.network;
    let network = Loaded::new(c.program(), &model.weights.flat);
    let pass = |x: &[f32]| network.forward(x, &mut Memory::default(), Pass::Kept(x.len() / c.inputs)).clone();
    match c.positions {
        Positions::Rotary => pass(x),
        // Windows of up to `history` tokens; the prediction of the newest counts.
        Positions::Table => (0..FRAMES)
            .flat_map(|frame| {
                let y = pass(&x[(frame + 1).saturating_sub(c.history) * c.inputs..(frame + 1) * c.inputs]);
                y[y.len() - c.outputs..].to_vec()
            })
            .collect(),
    }
}

/// Largest difference over all frames, in deviations of the targets.
fn apart(robot: &str, scene: &str, base: impl Into<Form>, positions: Positions) -> f64 {
    let (system, base) = (blurred(robot), base.into());
    let recording = recorded(&system);
    let mut windows = tokens(&system, &recording, 1, base);
    windows.history = 6;
    let model = model(&system, base, positions, &windows);
    nerd_train::prepare::normalize(&mut windows, &model.normalizer);
    let (d, n) = (system.robot.state_dim(), recording.count);
    let mut solver = Neural::on_cpu(model.clone());
    let mut features = Features::new(&system, base);
    let mut batch = Batch::new(&system, &system.scene(scene).expect("scene"), n);
    if system.spec.vary.is_some() {
        (batch.systems, batch.scenes) = (recording.systems.clone(), recording.scenes.clone());
    }
    let scale: Vec<f64> = model.normalizer.outputs.scale().collect();
    let expected: Vec<Vec<f32>> = windows.x.chunks_exact(FRAMES * windows.inputs).map(|x| trained(&model, x)).collect();
    let mut worst = 0.0f64;
    for frame in 0..FRAMES {
        let before: Vec<f64> = (0..n).flat_map(|t| recording.seen(t, frame)).copied().collect();
        batch.states.copy_from_slice(&before);
        solver.step(&mut batch, &recording.torques_at(frame)).expect("finite");
        for env in 0..n {
            let moments = scale.iter().zip(&model.normalizer.outputs.mean);
            let change = expected[env][frame * d..].iter().zip(moments);
            let change: Vec<f64> = change.map(|(y, (s, m))| f64::from(*y) * s + m).collect();
            let mut wanted = vec![0.0; d];
            features.apply(&before[env * d..][..d], &change, &mut wanted);
            wrap_state(&system.robot, &mut wanted);
            let gaps = wanted.iter().zip(batch.state(env)).zip(&scale);
            worst = gaps.map(|((a, b), s)| (a - b).abs() / s).fold(worst, f64::max);
        }
    }
    worst
}

#[test]
fn a_rollout_predicts_what_the_training_pass_predicts() {
    for positions in [Positions::Table, Positions::Rotary] {
        for (robot, scene, base) in
            [("cartpole", "free", Base::State), ("cube", "ground", Base::State), ("ant", "ground", Base::Trapezoid)]
        {
            let worst = apart(robot, scene, base, positions);
            assert!(
                worst < 5e-4,
                "{robot} on {base:?}, {positions:?}: a rollout is {worst:.1e} deviations from the training pass"
            );
        }
        // Robots of a family, with the model conditioned on the drawn parameters, and without.
        for told in [true, false] {
            let worst = apart("pendulum-family", "free", Form { told, ..Base::Trapezoid.into() }, positions);
            assert!(
                worst < 5e-4,
                "a family, told {told}, {positions:?}: a rollout is {worst:.1e} deviations from the training pass"
            );
        }
    }
}

/// Tokens of a model conditioned on parameters end with the drawn parameters; the rest equals the unconditioned tokens.
#[test]
fn tokens_end_with_what_was_drawn() {
    let system = System::named("pendulum-family").expect("built in");
    let (recording, told) = (recorded(&system), Told::new(&system));
    let [plain, all] =
        [false, true].map(|told| tokens(&system, &recording, 1, Form { told, view: View::Moving, ..Form::default() }));
    assert_eq!(all.inputs, plain.inputs + told.count());
    let drawn = recording.drawn.chunks_exact(recording.drawn.len() / recording.count);
    for (row, (long, short)) in all.x.chunks_exact(all.inputs).zip(plain.x.chunks_exact(plain.inputs)).enumerate() {
        let own = drawn.clone().nth(row / FRAMES).expect("drawn");
        assert_eq!(&long[..plain.inputs], short);
        let expected: Vec<f32> = told.numbers(own).map(|x| x as f32).collect();
        assert!(long[plain.inputs..] == expected[..] && expected.iter().all(|x| x.abs() <= 1.0));
    }
}
