//! Start and end of a frame in every solver: checks inputs, commits new states.

use nerd_core::state::wrap_state;

use super::refusal::Fault;
use crate::prelude::*;

/// Refuses a batch or torques of the wrong length, and a batch that needs more than [`Capabilities::default`]. Adds a
/// fault for every environment with a non-finite state or torque, or an invalid scene.
pub fn check(batch: &Batch, torques: &[f64], faults: &mut Vec<Fault>) -> Result<(), StepError> {
    Capabilities::default().admit(batch)?;
    sound(batch, torques, faults)
}

/// Checks as [`check`] does, for a solver that supports a different robot in each environment, with actuators and
/// sensors.
pub fn check_kin(batch: &Batch, torques: &[f64], faults: &mut Vec<Fault>) -> Result<(), StepError> {
    Capabilities { systems: true, ..Capabilities::default() }.admit(batch)?;
    numbers(batch, torques, faults)
}

/// Checks as [`check`] does, but allows drives and a different robot in each environment.
pub(crate) fn sound(batch: &Batch, torques: &[f64], faults: &mut Vec<Fault>) -> Result<(), StepError> {
    if batch.systems.iter().chain([&batch.system]).any(|own| !own.motors.ideal()) {
        let text = "a robot has motors of its own (vary: delay, strength, zero, top_speed, ripple): put nerd_sim::rig::Rig around this solver";
        return Err(StepError::Refused(text.into()));
    }
    numbers(batch, torques, faults)
}

/// Checks as [`check`] does, except for capabilities and actuator models.
pub(crate) fn numbers(batch: &Batch, torques: &[f64], faults: &mut Vec<Fault>) -> Result<(), StepError> {
    batch.check().map_err(StepError::Solver)?;
    let system = &*batch.system;
    let d = system.robot.state_dim();
    let joints = system.robot.joint_count();
    if torques.len() != batch.len() * joints {
        return Err(StepError::torques(torques.len(), batch.len(), joints));
    }
    faults.clear();
    let mut last: Option<(&Arc<Scene>, bool)> = None;
    for (env, scene) in batch.scenes.iter().enumerate() {
        // Environments mostly share one scene, which is then checked once.
        if last.is_some_and(|(known, sound)| sound && Arc::ptr_eq(known, scene)) {
            continue;
        }
        let checked = scene.check();
        last = Some((scene, checked.is_ok()));
        if let Err(reason) = checked {
            add(faults, batch, env, reason);
        }
    }
    for (at, drive) in batch.drives.iter().enumerate() {
        if let Err(reason) = drive.check() {
            let env = at / joints;
            let joint = system.robot.joints().nth(at % joints).map_or("", |j| &j.name);
            add(faults, batch, env, format!("joint `{joint}`: {reason}"));
        }
    }
    let names = [&system.spec.state_columns, &system.spec.torque_columns];
    for ((numbers, width), names) in [(&*batch.states, d), (torques, joints)].into_iter().zip(names) {
        if numbers.iter().all(|x| x.is_finite()) {
            continue;
        }
        for (at, x) in numbers.iter().enumerate().filter(|(_, x)| !x.is_finite()) {
            let env = at / width;
            add(faults, batch, env, format!("`{}` is {x} before the step", names[at % width]));
        }
    }
    Ok(())
}

/// Ends a frame of a solver without contact forces: copies the states `next` of every environment without a fault,
/// wraps angles, counts the frame. A non-finite state is a fault. [`StepError::Environments`] returns all faults.
pub fn commit(batch: &mut Batch, next: &mut [f64], faults: &mut Vec<Fault>) -> Result<(), StepError> {
    batch.forces.clear();
    finish(batch, next, faults)
}

/// Ends a frame as [`commit`] does, for a solver that has set the batch's contact forces.
pub(crate) fn finish(batch: &mut Batch, next: &mut [f64], faults: &mut Vec<Fault>) -> Result<(), StepError> {
    let system = batch.system.clone();
    let d = system.robot.state_dim();
    if !next.iter().all(|x| x.is_finite()) {
        for (env, state) in next.chunks_exact(d).enumerate() {
            let Some(reason) = gone(&system, state) else { continue };
            add(faults, batch, env, system.source.lost(reason));
        }
    }
    faults.iter().for_each(|f| next[f.env * d..][..d].copy_from_slice(batch.state(f.env)));
    for state in next.chunks_exact_mut(d) {
        wrap_state(&system.robot, state);
    }
    // Copy in place, since nerd-py's arrays may point to this memory.
    batch.states.copy_from_slice(next);
    batch.frames.iter_mut().for_each(|f| *f += 1);
    if faults.is_empty() {
        return Ok(());
    }
    faults.iter().for_each(|f| batch.frames[f.env] = f.frame);
    faults.sort_by_key(|f| f.env);
    Err(StepError::Environments(std::mem::take(faults)))
}

/// Adds a fault of an environment, unless it already has one.
fn add(faults: &mut Vec<Fault>, batch: &Batch, env: usize, reason: String) {
    if faults.iter().all(|f| f.env != env) {
        faults.push(Fault { env, frame: batch.frames[env], reason });
    }
}

/// Describes the first non-finite number of a state (or of a prefix of a state).
pub(crate) fn gone(system: &System, state: &[f64]) -> Option<String> {
    let column = state.iter().position(|x| !x.is_finite())?;
    Some(format!(
        "`{}` is {}; the state before it is the last good one",
        system.spec.state_columns[column], state[column]
    ))
}
