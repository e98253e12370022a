//! Rows of built-in robots: self-convergence, independence of history, and drives at their limits.

use super::*;
use nerd_sim::prelude::*;
use rand::RngExt;

/// Velocity limit of ANYmal's joints (rad/s).
const SPEED: f64 = 20.0;
const URDF: &str = "speed limit of its URDF";
/// Figures of a PD law with torques held constant over a frame, and of a PD law on the predicted state.
const HELD: &str = "largest joint speed, no armature, PD at 60 Hz, 2 s";
const STABLE_PD: &str = "largest joint speed, no armature, PD that looks a frame ahead, 2nd second";

/// ANYmal's PD law `tau = kp (target - q) - kd qd`.
struct Drives {
    armature: f64,
    kp: f64,
    kd: f64,
    /// Whether the law uses the state predicted for the end of the frame.
    stable_pd: bool,
}

/// No armature, little damping.
const BARE: Drives = Drives { armature: 0.0, kp: 200.0, kd: 0.5, stable_pd: false };

pub(super) static CONSISTENCY: [Row; 3] = [
    Row::new(
        "pendulum self-convergence",
        "against four times the substeps, ground, 1 s, 4 starts",
        "rad",
        1.2e-3,
        |trial| against_finer(trial, "pendulum", "ground1"),
    )
    .source("a tenth of the paper's error of a learned pendulum, 0.012 rad")
    .why("A truth to learn from must be nearer to its own limit than models come to the truth."),
    Row::new(
        "Ant self-convergence",
        "against four times the substeps, dropped, 1 s, 4 starts",
        "rad",
        4.7e-3,
        |trial| against_finer(trial, "ant", "ground"),
    )
    .source("a tenth of the paper's error of a learned Ant, 0.047 rad")
    .why("The same for a walking robot that lands on its feet."),
    Row::new("Markov", "a motion against its second half begun afresh, or after a reset", "rad", 1e-12, markov)
        .source("the next state is a function of the present one")
        .why("A model learns a function of the state: of a solver that remembers more there is none."),
];

pub(super) static ROWS: [Row; 9] = [
    Row::new("driven Ant", "worst violation of a joint limit, full random torques, 5 s", "rad", 0.8, ant)
        .source("2 tau / k, a spring under a sudden load")
        .why("Training data is made by full random torques; limits must hold against them."),
    Row::new("ANYmal kp 85", "largest joint speed, armature 0.06, PD at 60 Hz, 2 s", "rad/s", SPEED, |trial| {
        anymal(trial, Drives { armature: 0.06, kp: 85.0, kd: 2.0, stable_pd: false })
    })
    .source(URDF)
    .why("The robot with its rotors' inertia and moderate gains: it must stand."),
    Row::new("ANYmal kp 200", HELD, "rad/s", SPEED, |trial| anymal(trial, BARE))
        .source(URDF)
        .why("Legs without rotors under a torque held for a frame: unstable by itself, no solver need pass."),
    Row::new("ANYmal kp 2000", HELD, "rad/s", SPEED, |trial| anymal(trial, Drives { kp: 2000.0, ..BARE }))
        .source(URDF)
        .why("The same, ten times stiffer: what each solver makes of an impossible demand."),
    Row::new("ANYmal kp 5000", HELD, "rad/s", SPEED, |trial| anymal(trial, Drives { kp: 5000.0, ..BARE }))
        .source(URDF)
        .why("The same, stiffer still: here some give up, which is better than a wrong answer."),
    Row::new("kp 200 ahead", STABLE_PD, "rad/s", SPEED, |trial| anymal(trial, Drives { stable_pd: true, ..BARE }))
        .source(URDF)
        .why("A drive that looks a frame ahead keeps the same gains stable: solvers must not spoil that."),
    Row::new("kp 2000 ahead", STABLE_PD, "rad/s", SPEED, |trial| {
        anymal(trial, Drives { kp: 2000.0, stable_pd: true, ..BARE })
    })
    .source(URDF)
    .why("The same, ten times stiffer."),
    Row::new("kp 5000 ahead", STABLE_PD, "rad/s", SPEED, |trial| {
        anymal(trial, Drives { kp: 5000.0, stable_pd: true, ..BARE })
    })
    .source(URDF)
    .why("The same, at gains of a position-controlled arm."),
    Row::new("no number", "0 if a state that is not a number is refused, 1 if not", "", 0.0, no_number)
        .source("an error, with its place")
        .why("A state that is not a number must be refused where it stands, before it spreads."),
];

/// Mean |dq| after one second between a method and itself with four times the substeps. Returns 1 (a failure) if after
/// some start no coordinate moved by 0.3 rad or m. Also if a free robot fell through the ground. A fall moves a
/// coordinate by at least 0.5.
fn against_finer(trial: &Trial, robot: &str, scene: &str) -> Result<f64, Error> {
    let system = trial.robot(robot)?;
    let (nq, starts) = (system.robot.nq(), 4);
    let mut sum = 0.0;
    for seed in 0..starts {
        let state = start(&system, Start::Reset, &mut stream(17, seed));
        let (coarse, finer) = (trial.passive(&system, scene, &state, 60)?, trial.finer(&system, scene, &state, 60)?);
        // A pendulum's base holds it at any ground height.
        if system.robot.floating() && coarse.above(0.0) > 0.0 {
            return Ok(1.0);
        }
        let (coarse, finer) = (&coarse.last()[..nq], &finer.last()[..nq]);
        if largest_gap(coarse, &state) < 0.3 {
            return Ok(1.0);
        }
        sum += coarse.iter().zip(finer).map(|(a, b)| (a - b).abs()).sum::<f64>();
    }
    Ok(sum / (starts as usize * nq) as f64)
}

fn markov(trial: &Trial) -> Result<f64, Error> {
    let system = trial.robot("pendulum")?;
    let whole = trial.passive(&system, "ground1", &[1.0, 0.5, 0.0, 0.0], 80)?;
    let fresh = trial.passive(&system, "ground1", &whole.states[40], 40)?;
    let reset = trial.after_reset(&system, "ground1", &[-1.0, 1.0, 3.0, -2.0], &whole.states[40], 40)?;
    Ok(largest_gap(whole.last(), fresh.last()).max(largest_gap(whole.last(), reset.last())))
}

fn largest_gap(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

fn ant(trial: &Trial) -> Result<f64, Error> {
    let system = trial.robot("ant")?;
    let joints = system.robot.root_coords();
    let mut worst = 0.0f64;
    for seed in 0..4 {
        let state = start(&system, Start::Reset, &mut stream(11, seed));
        let mut rng = stream(12, seed);
        let mut push =
            |_: &[f64], tau: &mut [f64]| tau.iter_mut().for_each(|t| *t = 400.0 * (2.0 * rng.random::<f64>() - 1.0));
        let motion = trial.driven(&system, "ground", &state, 300, &mut push)?;
        for (i, limit) in system.robot.joints().enumerate().filter_map(|(i, j)| j.limit.map(|l| (i, l))) {
            let q = motion.states.iter().map(|s| s[joints + i]);
            worst = q.map(|q| (limit.lower - q).max(q - limit.upper)).fold(worst, f64::max);
        }
    }
    Ok(worst)
}

/// Largest joint velocity (rad/s) in two seconds under a PD law toward the default pose. Infinite if the robot fell
/// through the ground, or if the joints never covered half the distance to the pose: slow joints alone do not prove
/// control.
fn anymal(trial: &Trial, drives: Drives) -> Result<f64, Error> {
    let mut system = (*trial.robot("anymal")?).clone();
    system.robot.joints_mut().for_each(|j| j.armature = drives.armature);
    system.spec.control.iter_mut().for_each(|control| control.stable_pd = drives.stable_pd);
    let system = Arc::new(system);
    let mut controller = Controller::new(&system);
    controller.gains.fill([drives.kp, drives.kd]);
    let state = start(&system, Start::Reset, &mut stream(13, 0));
    let hold = vec![0.0; system.robot.joint_count()];
    let motion =
        trial.driven(&system, "ground", &state, 120, &mut |state, tau| controller.torques(state, &hold, tau))?;
    let (joints, nq) = (system.robot.root_coords(), system.robot.nq());
    // A predictive law closes the initial error in one frame, at any velocity, so only the second second counts.
    let counted = &motion.states[if drives.stable_pd { 60 } else { 0 }..];
    let speed = counted.iter().flat_map(|s| &s[nq + system.robot.root_dofs()..]).fold(0.0f64, |a, b| a.max(b.abs()));
    let gap = |s: &[f64]| {
        s[joints..nq].iter().zip(system.joint_specs()).map(|(q, joint)| (q - joint.default_q).abs()).sum::<f64>()
    };
    let held = motion.states.iter().any(|s| gap(s) < 0.5 * gap(&state));
    Ok(motion.above(if held || speed > SPEED { speed } else { f64::INFINITY }))
}

fn no_number(trial: &Trial) -> Result<f64, Error> {
    let system = trial.robot("pendulum")?;
    trial.passive(&system, "ground1", &[f64::NAN, 0.0, 0.0, 0.0], 1)?;
    Ok(if trial.lost.take().is_some() { 0.0 } else { 1.0 })
}
