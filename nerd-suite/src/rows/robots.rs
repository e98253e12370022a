//! Rows of built-in robots: self-convergence, independence of history, and drives at their limits.

use super::*;

/// Velocity limit of ANYmal's joints (rad/s).
const SPEED: f64 = 20.0;
const URDF: &str = "speed limit of its URDF";
/// Figure of rows whose PD torques are held constant over a frame.
const HELD: &str = "largest joint speed, no armature, PD at 60 Hz, 2 s";
/// Figure of rows whose PD law uses the state predicted for the end of the frame.
const STABLE_PD: &str = "largest joint speed, no armature, PD that looks a frame ahead, 2nd second";

/// Parameters of ANYmal's PD law `tau = kp (target - q) - kd qd` (N m).
struct Drives {
    armature: f64,
    kp: f64,
    kd: f64,
    /// Whether the PD law uses the state predicted for the end of the frame.
    stable_pd: bool,
}

/// A PD law without armature and with little damping.
const BARE: Drives = Drives { armature: 0.0, kp: 200.0, kd: 0.5, stable_pd: false };

pub(super) const CONSISTENCY: &[Row] = &[
    row(
        "pendulum self-convergence",
        "against four times the substeps, ground, 1 s, 4 starts",
        "rad",
        1.2e-3,
        "a tenth of the paper's error of a learned pendulum, 0.012 rad",
        "A truth to learn from must be nearer to its own limit than models come to the truth.",
        |trial| against_finer(trial, "pendulum", "ground1"),
    ),
    row(
        "Ant self-convergence",
        "against four times the substeps, dropped, 1 s, 4 starts",
        "rad",
        4.7e-3,
        "a tenth of the paper's error of a learned Ant, 0.047 rad",
        "The same for a walking robot that lands on its feet.",
        |trial| against_finer(trial, "ant", "ground"),
    ),
    row(
        "Markov",
        "a motion against its second half begun afresh, or after a reset",
        "rad",
        1e-12,
        "the next state is a function of the present one",
        "A model learns a function of the state: of a solver that remembers more there is none.",
        markov,
    ),
];

pub(super) const ROWS: &[Row] = &[
    row(
        "driven Ant",
        "worst violation of a joint limit, full random torques, 5 s",
        "rad",
        0.8,
        "2 tau / k, a spring under a sudden load",
        "Training data is made by full random torques; limits must hold against them.",
        ant,
    ),
    row(
        "ANYmal kp 85",
        "largest joint speed, armature 0.06, PD at 60 Hz, 2 s",
        "rad/s",
        SPEED,
        URDF,
        "The robot with its rotors' inertia and moderate gains: it must stand.",
        |trial| anymal(trial, Drives { armature: 0.06, kp: 85.0, kd: 2.0, stable_pd: false }),
    ),
    row(
        "ANYmal kp 200",
        HELD,
        "rad/s",
        SPEED,
        URDF,
        "Legs without rotors under a torque held for a frame: unstable by itself, no solver need pass.",
        |trial| anymal(trial, BARE),
    ),
    row(
        "ANYmal kp 2000",
        HELD,
        "rad/s",
        SPEED,
        URDF,
        "The same, ten times stiffer: what each solver makes of an impossible demand.",
        |trial| anymal(trial, Drives { kp: 2000.0, ..BARE }),
    ),
    row(
        "ANYmal kp 5000",
        HELD,
        "rad/s",
        SPEED,
        URDF,
        "The same, stiffer still: here some give up, which is better than a wrong answer.",
        |trial| anymal(trial, Drives { kp: 5000.0, ..BARE }),
    ),
    row(
        "kp 200 ahead",
        STABLE_PD,
        "rad/s",
        SPEED,
        URDF,
        "A drive that looks a frame ahead keeps the same gains stable: solvers must not spoil that.",
        |trial| anymal(trial, Drives { stable_pd: true, ..BARE }),
    ),
    row("kp 2000 ahead", STABLE_PD, "rad/s", SPEED, URDF, "The same, ten times stiffer.", |trial| {
        anymal(trial, Drives { kp: 2000.0, stable_pd: true, ..BARE })
    }),
    row(
        "kp 5000 ahead",
        STABLE_PD,
        "rad/s",
        SPEED,
        URDF,
        "The same, at gains of a position-controlled arm.",
        |trial| anymal(trial, Drives { kp: 5000.0, stable_pd: true, ..BARE }),
    ),
    row(
        "no number",
        "0 if a state that is not a number is refused, 1 if not",
        "",
        0.0,
        "an error, with its place",
        "A state that is not a number must be refused where it stands, before it spreads.",
        no_number,
    ),
];

/// Mean |dq| after one second between a method and itself with four times the substeps. Returns 1 (a failure) if from
/// some start no coordinate moved by 0.3 rad or m. A fall moves some coordinate by at least 0.5 rad or m. Also returns
/// 1 if a floating robot fell through the ground.
fn against_finer(trial: &Trial, robot: &str, scene: &str) -> Result<f64> {
    let system = trial.robot(robot)?;
    let nq = system.robot.nq();
    let starts = 4;
    let mut sum = 0.0;
    for seed in 0..starts {
        let state = start(&system, Start::Reset, &mut stream(17, seed));
        let coarse = trial.passive(&system, scene, &state, 60)?;
        let finer = trial.under(&mut *trial.method.finer_solver(&system)?, &system, scene, &state, 60, &mut limp)?;
        // Skips robots on a fixed base, which cannot fall through the ground.
        if system.robot.floating() && coarse.above(0.0) > 0.0 {
            return Ok(1.0);
        }
        let coarse = &coarse.last()[..nq];
        let finer = &finer.last()[..nq];
        if largest_gap(coarse, &state) < 0.3 {
            return Ok(1.0);
        }
        sum += coarse.iter().zip(finer).map(|(a, b)| (a - b).abs()).sum::<f64>();
    }
    Ok(sum / (starts as usize * nq) as f64)
}

fn markov(trial: &Trial) -> Result<f64> {
    let system = trial.robot("pendulum")?;
    let whole = trial.passive(&system, "ground1", &[1.0, 0.5, 0.0, 0.0], 80)?;
    let fresh = trial.passive(&system, "ground1", &whole.states[40], 40)?;
    let mut solver = trial.method.solver(&system);
    trial.under(&mut *solver, &system, "ground1", &[-1.0, 1.0, 3.0, -2.0], 10, &mut limp)?;
    solver.reset(0);
    let reset = trial.under(&mut *solver, &system, "ground1", &whole.states[40], 40, &mut limp)?;
    Ok(largest_gap(whole.last(), fresh.last()).max(largest_gap(whole.last(), reset.last())))
}

fn largest_gap(a: &[f64], b: &[f64]) -> f64 {
    most(a.iter().zip(b).map(|(a, b)| (a - b).abs()))
}

fn ant(trial: &Trial) -> Result<f64> {
    let system = trial.robot("ant")?;
    let joints = system.robot.root_coords();
    worst(0..4, |seed| {
        let state = start(&system, Start::Reset, &mut stream(11, seed));
        let motion = trial.driven(&system, "ground", &state, 300, &mut pushes(12, seed, 400.0))?;
        let limits = system.robot.joints().enumerate().filter_map(|(i, joint)| Some((i, joint.limit?)));
        let beyond = |(i, limit): (usize, Limit)| {
            most(motion.states.iter().map(|s| (limit.lower - s[joints + i]).max(s[joints + i] - limit.upper)))
        };
        Ok(most(limits.map(beyond)))
    })
}

/// Largest joint velocity (rad/s) in two seconds under a PD law toward the default pose. Infinite if the robot fell
/// through the ground, or if the joints never covered half the distance to the pose. Slow joints alone do not prove
/// control.
fn anymal(trial: &Trial, drives: Drives) -> Result<f64> {
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
    let joints = system.robot.root_coords();
    let nq = system.robot.nq();
    // Leaves out the first second under a predictive law, which closes the initial error in one frame at any velocity.
    let counted = &motion.states[if drives.stable_pd { 60 } else { 0 }..];
    let speed = most(counted.iter().flat_map(|s| &s[nq + system.robot.root_dofs()..]).map(|rate| rate.abs()));
    let gap = |s: &[f64]| {
        s[joints..nq].iter().zip(system.joint_specs()).map(|(q, joint)| (q - joint.default_q).abs()).sum::<f64>()
    };
    let held = motion.states.iter().any(|s| gap(s) < 0.5 * gap(&state));
    Ok(motion.above(if held || speed > SPEED { speed } else { f64::INFINITY }))
}

fn no_number(trial: &Trial) -> Result<f64> {
    let system = trial.robot("pendulum")?;
    trial.passive(&system, "ground1", &[f64::NAN, 0.0, 0.0, 0.0], 1)?;
    Ok(if trial.lost.take().is_some() { 0.0 } else { 1.0 })
}
