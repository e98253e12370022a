//! Drafts as a base: a network that says nothing leaves the draft as it is, a draft of the truth's own substeps is the truth
//! where contacts are the planes they were at the frame's start, and what cannot be drafted is set aside alone.

mod common;

use std::sync::Arc;

use common::{POSITIONS, gap, model, placed};
use nalgebra::Vector3;
use nerd_core::contact::ContactEvent;
use nerd_core::dynamics::Data;
use nerd_core::state::wrap_state;
use nerd_model::base::Base;
use nerd_model::features::Features;
use nerd_model::neural::Neural;
use nerd_sim::articulated::Draft;
use nerd_sim::batch::contacts;
use nerd_sim::prelude::*;
use nerd_sim::sampling::{Start, start, stream};

/// Robots in scenes: free, on one plane, on a tilted one.
const CASES: [(&str, &str); 6] =
    [("cartpole", "free"), ("pendulum", "ground1"), ("pendulum", "ground2"), ("cube", "ground"), ("ant", "ground"), ("anymal", "ground")];

fn batch(robot: &str, scene: &str, n: usize) -> (Arc<System>, Batch, Vec<f64>) {
    let system = System::named(robot).expect("built in");
    let mut batch = Batch::new(&system, &system.scene(scene).expect("scene"), n);
    (0..n).for_each(|env| batch.reset(env, &start(&system, Start::Reset, &mut stream(71, env as u64))));
    let torques = (0..n * system.robot.joint_count()).map(|i| 5.0 * (i as f64).cos()).collect();
    (system, batch, torques)
}

/// A frame of every environment by drafts alone.
fn drafted(draft: &mut Draft, batch: &mut Batch, torques: &[f64]) {
    let (system, joints) = (batch.system.clone(), batch.system.robot.joint_count());
    let (mut data, mut events) = (Data::new(&system.robot), Vec::new());
    for env in 0..batch.len() {
        let mut state = batch.state(env).to_vec();
        contacts(&system, &batch.scenes[env], &state, &mut data, &mut events);
        let gravity = batch.scenes[env].gravity;
        draft.step(&system, &gravity, &events, &torques[env * joints..][..joints], &mut state).expect("drafted");
        wrap_state(&system.robot, &mut state);
        batch.states[env * state.len()..][..state.len()].copy_from_slice(&state);
        batch.frames[env] += 1;
    }
}

/// What a network says that nothing is to be added: a turn's is a quaternion, so this is not zero.
fn nothing(system: &Arc<System>) -> Vec<f64> {
    let (state, mut target) = (system.default_state(), vec![0.0f32; system.robot.state_dim()]);
    Features::new(system, Base::Draft(1)).target(&state, &state, &state, &mut target);
    target.into_iter().map(f64::from).collect()
}

#[test]
fn a_network_that_says_nothing_leaves_the_draft() {
    for positions in POSITIONS {
        for (robot, scene) in CASES {
            for substeps in [1, 3] {
                let (system, mut learned, torques) = batch(robot, scene, 5);
                let mut raw = learned.clone();
                let mut silent = placed(&system, Base::Draft(substeps), positions);
                silent.weights.flat.fill(0.0);
                silent.normalizer.outputs.mean = nothing(&system);
                let mut solver = Neural::on_cpu(silent, &system);
                let mut draft = Draft::new(&system, substeps).expect("a draft");
                for frame in 0..30 {
                    // From the same state: rounding grows in a landing.
                    raw.states.copy_from_slice(&learned.states);
                    solver.step(&mut learned, &torques).expect("finite");
                    drafted(&mut draft, &mut raw, &torques);
                    let apart = gap(&learned.states, &raw.states);
                    assert!(apart < 1e-12, "{robot} on {scene}, x{substeps}, frame {frame}: {apart:.1e} from the raw draft");
                }
            }
        }
    }
    // And one that speaks is heard, also where nothing can be touched.
    for (robot, scene) in CASES {
        let (system, mut learned, torques) = batch(robot, scene, 5);
        let mut raw = learned.clone();
        Neural::on_cpu(model(&system, Base::Draft(1)), &system).step(&mut learned, &torques).expect("finite");
        drafted(&mut Draft::new(&system, 1).expect("a draft"), &mut raw, &torques);
        let apart: Vec<f64> = (0..5).map(|env| gap(learned.state(env), raw.state(env))).collect();
        assert!(apart.iter().all(|gap| *gap > 1e-6), "{robot} on {scene}: the network is not asked, {apart:?}");
    }
}

/// On one plane the contacts of a frame's start are the frame's: a draft of the truth's substeps is the truth to rounding, and
/// coarser ones come nearer with every doubling.
#[test]
fn a_draft_of_the_truths_substeps_is_the_truth_on_a_plane() {
    for (robot, scene) in CASES.into_iter().filter(|(_, scene)| *scene != "free") {
        let (system, first, torques) = batch(robot, scene, 12);
        let own = system.spec.substeps;
        // Down to where something touches, and through it.
        let mut worst = 0.0f64;
        let (mut truth, mut solver) = (first, Truth::Articulated.solver(&system));
        let mut coarse = [0.0f64; 3];
        for _ in 0..60 {
            let mut fine = truth.clone();
            drafted(&mut Draft::new(&system, own).expect("a draft"), &mut fine, &torques);
            let mut rough = [1, 2, own / 2].map(|n| {
                let mut batch = truth.clone();
                drafted(&mut Draft::new(&system, n).expect("a draft"), &mut batch, &torques);
                batch
            });
            solver.step(&mut truth, &torques).expect("finite");
            worst = worst.max(gap(&fine.states, &truth.states));
            for (sum, batch) in coarse.iter_mut().zip(&mut rough) {
                let nq = system.robot.nq();
                let gaps = |env: usize| gap(&batch.state(env)[..nq], &truth.state(env)[..nq]).min(1.0);
                *sum += (0..12).map(gaps).sum::<f64>() / 720.0;
            }
        }
        println!("{robot} on {scene}: x{own} {worst:.1e} from the truth; x1, x2, x{} on average {coarse:?}", own / 2);
        assert!(worst < 1e-9, "{robot} on {scene}: a draft of {own} substeps is {worst:.1e} from the truth");
        assert!(coarse[0] > coarse[1] && coarse[1] > coarse[2] && coarse[2] > 0.0, "{robot} on {scene}: {coarse:?}");
    }
}

/// On an edge the draft goes on on the plane that it met, and differs from the truth by that.
#[test]
fn a_draft_holds_the_planes_it_began_with() {
    let (system, mut truth, _) = batch("cube", "ground", 1);
    truth.scenes[0] = system.scene("steps").expect("steps");
    let mut state = system.default_state();
    // Towards the first step's edge, at x = 0.4 m.
    (state[0], state[2]) = (0.31, 0.06);
    let nq = system.robot.nq();
    state[nq + 3] = 3.0;
    truth.reset(0, &state);
    let mut held = truth.clone();
    let (mut draft, mut solver) = (Draft::new(&system, system.spec.substeps).expect("a draft"), Truth::Articulated.solver(&system));
    for _ in 0..20 {
        solver.step(&mut truth, &[]).expect("finite");
        drafted(&mut draft, &mut held, &[]);
    }
    let apart = gap(&truth.states[..nq], &held.states[..nq]);
    assert!(held.states.iter().all(|x| x.is_finite()) && apart > 1e-6, "against a step the draft is {apart:.1e} from the truth");
}

/// A token's last numbers are what its draft changes, as a target says it; so a network may say it back.
#[test]
fn a_token_says_what_its_draft_changes() {
    for (robot, scene) in CASES {
        let (system, batch, torques) = batch(robot, scene, 8);
        let (d, joints) = (system.robot.state_dim(), system.robot.joint_count());
        let mut after = batch.clone();
        drafted(&mut Draft::new(&system, 1).expect("a draft"), &mut after, &torques);
        let mut features = Features::new(&system, Base::Draft(1));
        let (mut data, mut events) = (Data::new(&system.robot), Vec::<ContactEvent>::new());
        for env in 0..8 {
            let (state, base) = (batch.state(env), after.state(env));
            contacts(&system, &batch.scenes[env], state, &mut data, &mut events);
            let (mut token, mut change) = (vec![0.0f32; Features::inputs(&system, Base::Draft(1))], vec![0.0f32; d]);
            let tau = &torques[env * joints..][..joints];
            features.token(state, base, &events, tau, &batch.scenes[env].gravity, &mut token);
            features.target(state, state, base, &mut change);
            assert_eq!(token[token.len() - d..], change[..], "{robot} on {scene}");
            // Said back, it is the draft.
            let mut made = vec![0.0; d];
            features.apply(state, state, &change.iter().map(|x| f64::from(*x)).collect::<Vec<_>>(), &mut made);
            wrap_state(&system.robot, &mut made);
            let apart = gap(&made, base);
            assert!(apart < 1e-4, "{robot} on {scene}: {apart:.1e}");
        }
    }
}

#[test]
fn drafts_of_no_substeps_or_too_many_are_refused_in_one_line() {
    let system = System::named("cube").expect("built in");
    for substeps in [0, Draft::MOST + 1, usize::MAX] {
        let error = Draft::new(&system, substeps).err().expect("no draft").to_string();
        assert!(error.contains(&substeps.to_string()) && error.contains("`cube`") && !error.contains('\n'), "{error}");
    }
}

#[test]
fn what_cannot_be_drafted_is_set_aside_alone() {
    let (system, mut batch, torques) = batch("pendulum", "ground1", 4);
    let mut solver = Neural::on_cpu(model(&system, Base::Draft(2)), &system);
    let mut whole = batch.clone();
    let mut scene = (*batch.scenes[2]).clone();
    scene.gravity = Vector3::new(0.0, f64::NAN, 0.0);
    batch.scenes[2] = Arc::new(scene);
    let before = batch.state(2).to_vec();
    let faults = solver.step(&mut batch, &torques).expect_err("no gravity").faults().expect("of environments");
    assert_eq!(faults.iter().map(|f| (f.env, f.frame)).collect::<Vec<_>>(), [(2, 0)], "{faults:?}");
    assert_eq!(batch.state(2), before, "what cannot be moved was moved");
    Neural::on_cpu(model(&system, Base::Draft(2)), &system).step(&mut whole, &torques).expect("finite");
    for env in [0, 1, 3] {
        let apart = gap(batch.state(env), whole.state(env));
        assert!(apart < 1e-5, "environment {env} noticed: {apart:.1e}");
    }
}
