//! A plan's steps to first order: the state after each by the state before and the action, residuals by the state after.

use nalgebra::{DMatrix, DVector};
use nerd_sim::batch::Batch;
use nerd_sim::solver::StepError;

use crate::{Episodes, Slopes, View, Work};

/// One step, in the tangent spaces of its states.
pub(super) struct Step {
    pub by_state: DMatrix<f64>,
    pub by_action: DMatrix<f64>,
    pub residuals: DVector<f64>,
    pub residuals_by: DMatrix<f64>,
}

/// All steps `[env][step]` of plans that were rolled out: states `[env][frame][q, qd]`, one more than frames, torques `[env][frame][joint]`,
/// actions `[env][step][action]`. All frames are one batch for the solver that looks ahead in `episodes`.
pub(super) fn linearise(
    episodes: &mut Episodes,
    present: &Episodes,
    (states, torques, plans): (&[f64], &[f64], &[f64]),
    steps: usize,
) -> Result<Vec<Step>, StepError> {
    let (system, n) = (present.simulation.batch.system.clone(), present.len());
    let (robot, width, every) = (&system.robot, episodes.task.action_dim(), episodes.task.frames() as usize);
    let (d, size, joints, frames) = (robot.state_dim(), 2 * robot.nv(), robot.joint_count(), steps * every);
    let rows = states.chunks_exact((frames + 1) * d);
    let scenes = present.simulation.batch.scenes.iter().flat_map(|scene| std::iter::repeat_n(scene.clone(), frames)).collect();
    let before = rows.clone().flat_map(|states| &states[..frames * d]).copied().collect();
    let batch =
        Batch { states: before, scenes, frames: vec![0; n * frames], ..Batch::new(&system, &present.simulation.batch.scenes[0], 0) };
    let identity: Vec<f64> = (0..size * size).map(|k| f64::from(u8::from(k % (size + 1) == 0))).collect();
    let slopes = episodes.simulation.solver.back(&batch, torques, size, &identity.repeat(n * frames))?;
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
    let mut all = Vec::with_capacity(n * steps);
    for (env, states) in rows.enumerate() {
        let at = |frame: usize| View { state: &states[frame * d..][..d], ..present.view(env) };
        for step in 0..steps {
            let action = &plans[(env * steps + step) * width..][..width];
            let (mut by_state, mut by_action) = (DMatrix::identity(size, size), DMatrix::zeros(size, width));
            for k in step * every..(step + 1) * every {
                let (a, b) = frame(env * frames + k, at(k), action, &mut work);
                (by_state, by_action) = (&a * by_state, &a * by_action + b);
            }
            let (residuals, residuals_by) = residuals(task, at((step + 1) * every), size, &mut work);
            all.push(Step { by_state, by_action, residuals, residuals_by });
        }
    }
    Ok(all)
}

/// Residuals of a state, and their slopes.
fn residuals(task: &dyn Slopes, view: View, size: usize, work: &mut Work) -> (DVector<f64>, DMatrix<f64>) {
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
