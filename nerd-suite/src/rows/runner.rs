//! Rows of an Ant at running speed under full torques, where PPO exploits energy created by a solver. Under the
//! reference's preset, the fastest policy tumbles at a speed that no accurate solver sustains.

use std::f64::consts::TAU;

use super::*;

/// Forward velocity (m/s) at the start.
const SPEED: f64 = 8.0;
/// Angular velocity (rad/s) at the start, about the horizontal axis across the forward velocity: the robot tumbles.
const TURN: f64 = 10.0;
/// Frequency of the torques (Hz). Each motor applies its torque limit times `sin(TAU (BEAT t + phase / 8))`, where t
/// (s) is the start of the frame.
const BEAT: f64 = 6.0;
/// Phases of the torques (eighths of a period), for hip and ankle of each leg. Among a thousand random choices, these
/// make preset `paper` create most energy.
const PHASES: [f64; 8] = [6.0, 4.0, 4.0, 1.0, 0.0, 3.0, 7.0, 3.0];
const FRAMES: usize = 60;

pub(super) const ROWS: &[Row] = &[
    row(
        "runner's energy",
        "energy out of nothing, Ant at 8 m/s, full torques, 1 s",
        "of the start's kinetic",
        1e-3,
        "contact and limits are passive; a torque held for a frame does tau dq",
        "What a solver invents at speed, with all joints moving, is what a policy learns to live on.",
        energy,
    ),
    row(
        "runner's momentum",
        "change of momentum in the air, Ant at 8 m/s, full torques, 1 s",
        "relative",
        0.01,
        "momentum theorem; 1 % of Newton's tests",
        "A leg thrown about must not push the whole: a mass matrix a frame old forgets where the legs have gone.",
        momentum,
    ),
];

/// Rolls out one second of running; the torso starts at `height` (m) above the ground.
fn run(trial: &Trial, height: f64) -> Result<Motion> {
    let system = trial.robot("ant")?;
    let mut state = system.default_state();
    let nq = system.robot.nq();
    let forward = Vector3::x();
    let up = -system.gravity().normalize();
    let turn = up.cross(&forward) * TURN;
    let place = up * height;
    state[..3].copy_from_slice(place.as_slice());
    state[nq..nq + 3].copy_from_slice(turn.as_slice());
    state[nq + 3..nq + 6].copy_from_slice((forward * SPEED - turn.cross(&place)).as_slice());
    let most = system.joint_specs().map(|joint| joint.gain.unwrap_or(joint.torque)).collect::<Vec<_>>();
    let mut frame = 0;
    let mut drive = |_: &[f64], torques: &mut [f64]| {
        let beats = BEAT * f64::from(frame) * system.frame_time;
        let law = most.iter().zip(PHASES).map(|(most, phase)| most * (TAU * (beats + phase / 8.0)).sin());
        torques.iter_mut().zip(law).for_each(|(torque, given)| *torque = given);
        frame += 1;
    };
    trial.driven(&system, "ground", &state, FRAMES, &mut drive)
}

/// Largest increase of energy over its previous minimum, relative to the start's kinetic energy. Energy includes
/// springs, and the motors' work is subtracted. Returns 1 (a failure) if the robot moved by at most 1 m.
fn energy(trial: &Trial) -> Result<f64> {
    let motion = run(trial, 0.8)?;
    let rise = rise(motion.energies().iter().zip(motion.stored()).zip(&motion.work).map(|((e, s), w)| e + s - w));
    let way = vector(motion.last()) - vector(&motion.states[0]);
    Ok(if way.norm() > 1.0 { rise / motion.totals()[0].kinetic } else { 1.0 })
}

/// Largest change of momentum relative to the start: of linear momentum without gravity's share, and of angular
/// momentum about the centre of mass.
fn momentum(trial: &Trial) -> Result<f64> {
    Ok(momentum_change(&run(trial, 20.0)?, |first| first.momentum.lin.norm()))
}
