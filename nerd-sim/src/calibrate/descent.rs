//! Descent by slopes, from short rollouts to long ones: after a few frames the objective is smooth, and what is found there lies in the valley
//! of long rollouts (Levenberg and Marquardt's method within bounds).

use super::bent::Bent;
use super::parameter::{CalibrateError, Parameter};

/// Damping to begin with, and at least.
const DAMPING: [f64; 2] = [1e-2, 1e-4];
/// Share of the mean curvature that the damping adds to what has none of its own.
const RIDGE: f64 = 0.01;
/// Longest step, in shares of the bounds.
const LONGEST: f64 = 0.2;
/// A round that gains a smaller share than this is the last, and there are at most so many.
const LEAST: f64 = 0.001;
const ROUNDS: usize = 12;

/// The values after a step against the slope.
fn moved(parameters: &[Parameter], values: &[f64], bent: &Bent, damping: f64) -> Option<Vec<f64>> {
    let (mut h, mut g, n) = (bent.curvature.clone(), bent.slope.clone(), values.len());
    let ridge = RIDGE * h.trace() / n as f64;
    let x: Vec<f64> = parameters.iter().zip(values).map(|(p, v)| p.place(*v)).collect();
    for k in 0..n {
        h[(k, k)] += damping * (h[(k, k)] + ridge);
        // What would leave its bounds stays.
        if x[k] <= 0.0 && g[k] > 0.0 || x[k] >= 1.0 && g[k] < 0.0 {
            h.row_mut(k).fill(0.0);
            h.column_mut(k).fill(0.0);
            (h[(k, k)], g[k]) = (1.0, 0.0);
        }
    }
    let step = h.cholesky()?.solve(&g);
    let cut = (LONGEST / step.amax()).min(1.0);
    Some(parameters.iter().zip(&x).zip(step.iter()).map(|((p, x), s)| p.at(x - cut * s)).collect())
}

/// Goes down from `values` while it pays, as long as it `may`; returns the objective there, or nothing where there are no slopes.
pub(super) fn descend(
    parameters: &[Parameter],
    values: &mut Vec<f64>,
    may: impl Fn() -> bool,
    worth: impl Fn(&[f64]) -> Result<f64, CalibrateError>,
    bent: impl Fn(&[f64]) -> Result<Option<Bent>, CalibrateError>,
) -> Result<Option<f64>, CalibrateError> {
    let (mut best, mut damping) = (worth(values)?, DAMPING[0]);
    for _ in 0..ROUNDS {
        if !may() {
            break;
        }
        let Some(bent) = bent(values)? else { return Ok(None) };
        let before = best;
        for _ in 0..4 {
            let Some(next) = moved(parameters, values, &bent, damping) else { break };
            let found = worth(&next)?;
            if found < best {
                (best, *values) = (found, next);
                damping = (damping / 4.0).max(DAMPING[1]);
                break;
            }
            damping *= 4.0;
        }
        if before - best < LEAST * before {
            break;
        }
    }
    Ok(Some(best))
}
