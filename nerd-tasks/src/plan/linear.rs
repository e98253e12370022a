//! A plan's steps to first order: the state after each by the state before and the action, residuals by the state after.

use nalgebra::{DMatrix, DVector};
use nerd_sim::batch::Batch;
use nerd_sim::solver::{Slopes, StepError};

use crate::{Episodes, View, Work};

/// One step, in the tangent spaces of its states.
pub(super) struct Step {
    pub by_state: DMatrix<f64>,
    pub by_action: DMatrix<f64>,
    pub residuals: DVector<f64>,
    pub residuals_by: DMatrix<f64>,
}

/// Slopes of all frames of rollouts `[env][frame]`, by the solver as one batch, and which frames these are: those of an environment end before
/// one that has none.
fn through(
    episodes: &mut Episodes,
    (present, envs): (&Episodes, &[usize]),
    (states, torques): (&[f64], &[f64]),
    frames: usize,
) -> Result<(Slopes, Vec<(usize, usize)>), StepError> {
    let Batch { system, scenes, .. } = &present.simulation.batch;
    let (d, joints) = (system.robot.state_dim(), system.robot.joint_count());
    let mut known: Vec<(usize, usize)> = (0..envs.len()).flat_map(|env| (0..frames).map(move |frame| (env, frame))).collect();
    while !known.is_empty() {
        let of = |all: &[f64], each: usize, width: usize| -> Vec<f64> {
            known.iter().flat_map(|(env, frame)| &all[(env * each + frame) * width..][..width]).copied().collect()
        };
        let batch = Batch {
            states: of(states, frames + 1, d),
            scenes: known.iter().map(|(env, _)| scenes[envs[*env]].clone()).collect(),
            frames: vec![0; known.len()],
            ..Batch::new(system, &scenes[0], 0)
        };
        let faults = match episodes.simulation.solver.linearise(&batch, &of(torques, frames, joints)) {
            Ok(slopes) => return Ok((slopes, known)),
            Err(error) => error.faults()?,
        };
        let ends: Vec<(usize, usize)> = faults.iter().filter_map(|fault| known.get(fault.env).copied()).collect();
        if ends.is_empty() {
            return Err(StepError::Environments(faults));
        }
        known.retain(|(env, frame)| ends.iter().all(|(other, end)| env != other || frame < end));
    }
    Ok((Slopes::default(), known))
}

/// All steps of plans that were rolled out, of each of the environments `envs`: states `[env][frame][q, qd]`, one more than frames, torques
/// `[env][frame][joint]`, actions `[env][step][action]`. The steps of an environment end before one without finite slopes: beyond it nothing
/// is known.
pub(super) fn linearise(
    episodes: &mut Episodes,
    (present, envs): (&Episodes, &[usize]),
    (states, torques, plans): (&[f64], &[f64], &[f64]),
    steps: usize,
) -> Result<Vec<Vec<Step>>, StepError> {
    let system = present.simulation.batch.system.clone();
    let (robot, width, every) = (&system.robot, episodes.task.action_dim(), episodes.task.frames() as usize);
    let (d, size, joints, frames) = (robot.state_dim(), 2 * robot.nv(), robot.joint_count(), steps * every);
    let (slopes, known) = through(episodes, (present, envs), (states, torques), frames)?;
    let mut work = Work::new(&system);
    let Some(task) = episodes.task.slopes() else { return Err(StepError::Refused("the task has no slopes".into())) };
    let frame = |k: usize, view: View, action: &[f64], work: &mut Work| {
        let (mut by_state, mut by_action) = (DMatrix::zeros(joints, size), DMatrix::zeros(joints, width));
        for joint in 0..joints {
            let (mut by, mut of_state, mut of_action) = (vec![0.0; joints], vec![0.0; size], vec![0.0; width]);
            by[joint] = 1.0;
            task.act_back(view, action, work, &by, &mut of_state, &mut of_action);
            by_state.row_mut(joint).copy_from_slice(&of_state);
            by_action.row_mut(joint).copy_from_slice(&of_action);
        }
        let by_torques = DMatrix::from_row_slice(size, joints, &slopes.torques[k * size * joints..][..size * joints]);
        let held = DMatrix::from_row_slice(size, size, &slopes.states[k * size * size..][..size * size]);
        (held + &by_torques * by_state, by_torques * by_action)
    };
    let (mut all, mut first) = (Vec::with_capacity(envs.len()), 0);
    for (env, states) in states.chunks_exact((frames + 1) * d).enumerate() {
        let at = |frame: usize| View { state: &states[frame * d..][..d], ..present.view(envs[env]) };
        let count = known[first..].iter().take_while(|(own, _)| *own == env).count();
        let mut own = Vec::with_capacity(steps);
        for step in 0..count / every {
            let action = &plans[(env * steps + step) * width..][..width];
            let (mut by_state, mut by_action) = (DMatrix::identity(size, size), DMatrix::zeros(size, width));
            for k in step * every..(step + 1) * every {
                let (a, b) = frame(first + k, at(k), action, &mut work);
                (by_state, by_action) = (&a * by_state, &a * by_action + b);
            }
            let (residuals, residuals_by) = residuals(task, at((step + 1) * every), size, &mut work);
            let numbers = by_state.iter().chain(&by_action).chain(&residuals).chain(&residuals_by);
            if !numbers.copied().all(f64::is_finite) {
                break;
            }
            own.push(Step { by_state, by_action, residuals, residuals_by });
        }
        first += count;
        all.push(own);
    }
    Ok(all)
}

/// Residuals of a state, and their slopes.
fn residuals(task: &dyn crate::Slopes, view: View, size: usize, work: &mut Work) -> (DVector<f64>, DMatrix<f64>) {
    let residuals = task.residuals(view, work);
    let mut slopes = DMatrix::zeros(residuals.len(), size);
    for k in 0..residuals.len() {
        let (mut by, mut slope) = (vec![0.0; residuals.len()], vec![0.0; size]);
        by[k] = 1.0;
        task.residuals_back(view, work, &by, &mut slope);
        slopes.row_mut(k).copy_from_slice(&slope);
    }
    (DVector::from_vec(residuals), slopes)
}
