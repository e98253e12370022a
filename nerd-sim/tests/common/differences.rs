//! Gradients of a frame against central differences.

use nerd_core::tangent::{difference, moved};
use nerd_sim::prelude::*;

/// Most solves of a substep, and the change of a drag that ends them: differences must not see the iteration's error.
pub const SOLVES: usize = 30_000;
pub const SETTLED: f64 = 1e-13;
/// Largest error of a column of derivatives, relative to its size.
pub const EXACT: f64 = 1e-6;

pub fn norm(x: impl IntoIterator<Item = f64>) -> f64 {
    x.into_iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// The difference of two columns relative to the size of the second.
pub fn apart(a: &[f64], b: &[f64]) -> f64 {
    norm(a.iter().zip(b).map(|(a, b)| a - b)) / norm(b.iter().copied()).max(1e-12)
}

/// The first environment of the batch, alone, at a state.
pub fn only(batch: &Batch, state: &[f64]) -> Batch {
    let mut one = Batch::new(&batch.system, &batch.scenes[0], 1);
    one.drives = batch.drives.iter().take(batch.system.robot.joint_count()).copied().collect();
    one.servo = batch.servo;
    one.reset(0, state);
    one
}

pub fn stepped(solver: &mut dyn Solver, batch: &Batch, state: &[f64], torques: &[f64]) -> Vec<f64> {
    let mut now = only(batch, state);
    solver.step(&mut now, torques).expect("steps");
    now.states
}

/// An articulated solver that iterates each substep until it converges.
pub fn settled(config: ArticulatedConfig) -> Articulated {
    Articulated::new(config).settling(SETTLED, SOLVES)
}

/// Whether another solve of each substep still changes the next state.
pub fn endless(config: ArticulatedConfig, batch: &Batch, state: &[f64], torques: &[f64], next: &[f64]) -> bool {
    let longer = stepped(&mut Articulated::new(config).settling(SETTLED, SOLVES + 1), batch, state, torques);
    apart(&longer, next) > 1e-12
}

pub fn identity(rows: usize) -> Vec<f64> {
    (0..rows * rows).map(|k| f64::from(k % (rows + 1) == 0)).collect()
}

/// Central differences at sizes from `size` down by factors of 4, plain and extrapolated (Richardson). Returns the
/// column that agrees best with its predecessor, and their relative difference. With a kink within reach of all sizes,
/// none agree.
pub fn central(size: f64, mut side: impl FnMut(f64) -> Vec<f64>) -> (Vec<f64>, f64) {
    let mut of =
        |size: f64| side(size).iter().zip(side(-size)).map(|(a, b)| (a - b) / (2.0 * size)).collect::<Vec<f64>>();
    let (mut best, mut last) = ((Vec::new(), f64::INFINITY), [of(size), Vec::new()]);
    for finer in 1..8 {
        let plain = of(size * 0.25f64.powi(finer));
        let extrapolated = plain.iter().zip(&last[0]).map(|(f, c)| f + (f - c) / 15.0).collect();
        let now = [plain, extrapolated];
        for (now, last) in now.iter().zip(&last).filter(|(_, last)| !last.is_empty()) {
            let agrees = apart(now, last);
            if agrees < best.1 {
                best = (now.clone(), agrees);
            }
        }
        last = now;
    }
    best
}

/// Worst errors of a frame's derivatives with respect to state and torque, against differences of these sizes and
/// smaller. Each error is relative to its own column or, for a solver in f32, to the largest column. `None` where
/// differences disagree among themselves by more than `exact`.
pub fn errors(
    solver: &mut dyn Solver,
    batch: &Batch,
    state: &[f64],
    torques: &[f64],
    [by_state, by_torque]: [f64; 2],
    (exact, own_size): (f64, bool),
) -> Option<[f64; 2]> {
    let robot = &batch.system.robot;
    let (rows, joints) = (2 * robot.nv(), robot.joint_count());
    let gradients = solver.vjp(&only(batch, state), torques, rows, &identity(rows)).expect("gradients");
    let mut columns = [Vec::new(), Vec::new()];
    for k in 0..rows + joints {
        let (found, agrees) = central(if k < rows { by_state } else { by_torque }, |by| {
            let (mut from, mut torques) = (state.to_vec(), torques.to_vec());
            if k < rows {
                let change: Vec<f64> = (0..rows).map(|i| if i == k { by } else { 0.0 }).collect();
                moved(robot, state, &change, &mut from);
            } else {
                torques[k - rows] += by;
            }
            difference(robot, &gradients.next, &stepped(solver, batch, &from, &torques))
        });
        let own = |row: usize| {
            if k < rows { gradients.states[row * rows + k] } else { gradients.torques[row * joints + k - rows] }
        };
        let own: Vec<f64> = (0..rows).map(own).collect();
        columns[usize::from(k >= rows)].push((apart(&own, &found), agrees, norm(found)));
    }
    let mut worst = [0.0; 2];
    for (worst, columns) in worst.iter_mut().zip(&columns) {
        let largest = columns.iter().fold(1e-12, |most: f64, (.., size)| most.max(*size));
        for (off, agrees, size) in columns {
            let share = if own_size { 1.0 } else { size / largest };
            if share * agrees > exact {
                return None;
            }
            *worst = f64::max(*worst, share * off);
        }
    }
    Some(worst)
}

/// Prints the errors in one line. Returns whether all are below `exact` and at most one state in twenty was left out.
pub fn told(what: &str, mut errors: Vec<f64>, left_out: usize, exact: f64) -> bool {
    errors.sort_by(f64::total_cmp);
    let (all, worst) = (errors.len() + left_out, errors.last().copied().unwrap_or(f64::NAN));
    let share = 100.0 * left_out as f64 / all as f64;
    let median = errors.get(errors.len() / 2).copied().unwrap_or(f64::NAN);
    println!("{what}: {all} states, {share:.1} % left out, error {median:.1e} (median), {worst:.1e} (worst)");
    worst < exact && 20 * left_out <= all
}
