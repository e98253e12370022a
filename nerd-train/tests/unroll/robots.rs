//! Robots with one token a frame: gradients through frames, and rollouts that come nearer to the truth.

use nerd_train::prepare::generate;
use nerd_train::unroll::robot::Robot;

use crate::kernels::{apart, some, worse};
use crate::*;

/// The paper's form, forms with the trapezoid as base, and views with velocities of contact points.
const ROBOTS: [(&str, Base, View); 11] = [
    ("cartpole", Base::Trapezoid, View::Moving),
    ("pendulum", Base::State, View::Own),
    ("pendulum", Base::State, View::Moving),
    ("cube", Base::State, View::Own),
    ("cube", Base::Trapezoid, View::Moving),
    ("franka", Base::State, View::Own),
    ("franka", Base::State, View::Moving),
    ("ant", Base::State, View::Own),
    ("ant", Base::State, View::Moving),
    ("ant", Base::Trapezoid, View::Moving),
    ("anymal", Base::Trapezoid, View::Moving),
];

fn forms() -> impl Iterator<Item = (&'static str, Form)> {
    ROBOTS.into_iter().map(|(robot, base, view)| (robot, Form { base, view, told: false }))
}

fn case(robot: &str, form: Form) -> (Arc<System>, Arc<Trajectories>, Normalizer) {
    let system = System::named(robot).expect("built in");
    let config = GenerateConfig { transitions: 24 * 40, frames: 40, seed: 3, resets: 0.5, ..GenerateConfig::default() };
    let solver = || -> Box<dyn Solver> { Box::new(Articulated::new(ArticulatedConfig::accurate(&system))) };
    let motions = motions(&system, &solver, &config, &|_| ()).expect("motions");
    let windows = generate(&system, &solver, &config, (1, form), &|_| ()).expect("tokens").windows;
    (system, Arc::new(motions), moments(&windows))
}

fn weights(system: &System, form: Form) -> Weights {
    let paper = TransformerConfig::paper(Features::inputs(system, form), Features::outputs(system), 24);
    Weights::init(
        TransformerConfig { layers: 2, heads: 1, block: 1, history: 1, architecture: Architecture::Residual, ..paper },
        5,
    )
}

#[test]
fn the_gradient_of_a_rollout_is_that_of_differences() {
    // Upstream gradients of the other forms are so large that they are clipped.
    for (robot, form) in forms().filter(|(robot, form)| form.base == Base::State && *robot != "franka") {
        let (system, motions, normalizer) = case(robot, form);
        let body = Robot::new(&system, form, &normalizer, &motions);
        let course = Course { body, train: motions.clone(), validation: motions, frames: 4 };
        let off = rollouts::gradient_off(&course, &weights(&system, form), |_| (), 3e-4);
        assert!(off < 2e-3, "{robot}, {form:?}: off by {off:.1e}");
    }
}

#[test]
fn a_gradient_by_outputs_is_that_of_differences() {
    for (robot, form) in forms() {
        let (system, motions, normalizer) = case(robot, form);
        let (body, d, h) = (Robot::new(&system, form, &normalizer, &motions), system.robot.state_dim(), 2e-4f32);
        let (mut scratch, outputs) = (body.memory(), some(d, 0.3).into_iter().map(|x| x as f32).collect::<Vec<_>>());
        let mut off = 0.0f64;
        for i in 0..12 {
            let place = Place { motion: i, frame: i, view: () };
            let (own, truth) = (body.truth(&motions, &place), body.truth(&motions, &Place { frame: i + 1, ..place }));
            let look = body.look(&own, (&motions, &place), &mut scratch, &mut Vec::new());
            let mut cost = |outputs: &[f32]| {
                let (moved, mut gradient) = (body.advance(&own, &look, outputs, &mut scratch), body.level());
                (body.loss([&moved, &truth], 1, 1.0, &mut gradient), gradient)
            };
            let upstream = cost(&outputs).1;
            let expected = (0..d).map(|k| {
                let mut at = |by: f32| {
                    let mut moved = outputs.clone();
                    moved[k] += by;
                    (f64::from(moved[k]), cost(&moved).0)
                };
                let (ahead, behind) = (at(h), at(-h));
                (ahead.1 - behind.1) / (ahead.0 - behind.0)
            });
            let expected: Vec<f64> = expected.collect();
            let found = body.advance_back(&own, &outputs, &upstream, &mut body.level());
            off = worse(off, apart(&found.into_iter().map(f64::from).collect::<Vec<_>>(), &expected));
        }
        assert!(off < 2e-3, "{robot}, {form:?}: {off:.1e} of the largest gradient off");
    }
}

#[test]
fn rollouts_come_nearer_to_the_truth() {
    let form = Base::Trapezoid.into();
    let (system, motions, normalizer) = case("pendulum", form);
    let config = LearnerConfig { batch: 64, clip: 1.0, average: 0.9, seed: 0, huber: None, optimizer: Optimizer::Muon };
    let course = |frames| Course {
        body: Robot::new(&system, form, &normalizer, &motions),
        train: motions.clone(),
        validation: motions.clone(),
        frames,
    };
    let (mut state, mut missed) = (LearnerState::new(weights(&system, form)), Vec::new());
    for (frames, updates) in [(1, 300), (4, 100)] {
        let mut learner = UnrollLearner::new(config, state, course(frames)).expect("a learner");
        missed.push(learner.validate(200).expect("finite"));
        (0..updates).for_each(|_| learner.update(3e-3).expect("finite"));
        missed.push(learner.validate(200).expect("finite"));
        state = learner.state().expect("a state");
    }
    assert!(
        missed[1] < 0.8 * missed[0] && missed[3] < 0.9 * missed[1],
        "shares of a change that are missed: {missed:?}"
    );
}
