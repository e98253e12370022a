//! What the errors of rollouts go along with: rank correlations with what was measured in them.

use nerd_core::dynamics::Data;
use nerd_core::state::{quaternion, vector};
use nerd_sim::batch::contacts;
use nerd_sim::calibrate::{Subject, Trial};
use serde::{Deserialize, Serialize};

/// What errors go along with.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Tie {
    /// What was measured.
    pub what: String,
    /// By method, from -1 to 1.
    pub of: Vec<(String, f64)>,
}

/// Nearer than this (m), something touches.
const TOUCHES: f64 = 2e-3;

/// What can be told of a rollout of a robot that floats from its measurement alone.
const WHATS: [&str; 9] = [
    "frames before the first touch",
    "speed at the first touch",
    "spin at the first touch",
    "second lowest point over the lowest at the first touch",
    "third lowest point over the lowest at the first touch",
    "speed at the start",
    "spin at the start",
    "angle turned through",
    "number of the trajectory, its time in the experiment",
];

/// Rank correlations (Spearman's) of each method's errors, and how much of their variance lies between trajectories.
pub fn ties(subject: &Subject, trials: &[Trial], names: &[&str], errors: &[Vec<f64>]) -> Vec<Tie> {
    if !subject.system.robot.floating() || trials.len() < 3 {
        return Vec::new();
    }
    let told: Vec<[f64; 9]> = trials.iter().map(|trial| tell(subject, trial)).collect();
    let of = |f: &dyn Fn(&[f64]) -> f64| names.iter().zip(errors).map(|(name, e)| (name.to_string(), f(e))).collect::<Vec<_>>();
    let tie = |(k, what): (usize, &&str)| {
        let column: Vec<f64> = told.iter().map(|row| row[k]).collect();
        Tie { what: what.to_string(), of: of(&|errors| spearman(&column, errors)) }
    };
    let between = Tie { what: "share of the variance between trajectories".into(), of: of(&|errors| share(trials, errors)) };
    WHATS.iter().enumerate().map(tie).chain([between]).collect()
}

fn tell(subject: &Subject, trial: &Trial) -> [f64; 9] {
    let (system, q) = (&subject.system, &trial.measured);
    let (mut data, mut events) = (Data::new(&system.robot), Vec::new());
    let mut heights = |q: &[f64]| {
        let state = [q, &vec![0.0; system.robot.nv()]].concat();
        contacts(system, &subject.scene, &state, &mut data, &mut events);
        let mut all: Vec<f64> = events.iter().zip(&system.robot.contact_points).map(|(e, p)| e.distance - p.radius).collect();
        all.sort_by(f64::total_cmp);
        all
    };
    let first = q.iter().position(|q| heights(q).first().is_some_and(|h| *h < TOUCHES));
    let dt = system.frame_time;
    let rate = |k: usize| {
        let k = k.clamp(1, q.len() - 1);
        let turn = quaternion(&q[k][3..7]).angle_to(&quaternion(&q[k - 1][3..7]));
        [(vector(&q[k]) - vector(&q[k - 1])).norm() / dt, turn / dt]
    };
    let (touch, start) = (first.map_or([0.0; 2], rate), rate(1));
    let lowest = heights(&q[first.unwrap_or(0)]);
    let over = |k: usize| lowest.get(k).map_or(0.0, |h| h - lowest[0]);
    let turned = (1..q.len()).map(|k| rate(k)[1] * dt).sum();
    [first.unwrap_or(q.len()) as f64, touch[0], touch[1], over(1), over(2), start[0], start[1], turned, trial.id as f64]
}

/// Spearman's rank correlation; ties have the mean of their ranks.
fn spearman(a: &[f64], b: &[f64]) -> f64 {
    let ranks = |x: &[f64]| {
        let below = |v: &f64| {
            x.iter()
                .map(|w| {
                    if w < v {
                        1.0
                    } else if w == v {
                        0.5
                    } else {
                        0.0
                    }
                })
                .sum::<f64>()
        };
        x.iter().map(below).collect::<Vec<f64>>()
    };
    let (a, b) = (ranks(a), ranks(b));
    let middle = a.len() as f64 / 2.0;
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| (x - middle) * (y - middle)).sum::<f64>();
    let size = (dot(&a, &a) * dot(&b, &b)).sqrt();
    if size > 0.0 { dot(&a, &b) / size } else { 0.0 }
}

/// Share of the variance that lies between the means of trajectories.
fn share(trials: &[Trial], errors: &[f64]) -> f64 {
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    let own = |id: u64| {
        let (sum, n) = trials.iter().zip(errors).filter(|(t, _)| t.id == id).fold((0.0, 0.0), |(s, n), (_, e)| (s + e, n + 1.0));
        sum / n
    };
    let (between, all) =
        trials.iter().zip(errors).fold((0.0, 0.0), |(b, a), (t, e)| (b + (own(t.id) - mean).powi(2), a + (e - mean).powi(2)));
    if all > 0.0 { between / all } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranks_correlate_as_the_textbook_says() {
        // Order alone counts.
        let x = [1.0, 2.0, 3.0, 4.0, 5.0];
        let of = |y: [f64; 5]| spearman(&x, &y);
        assert!((of([1.0, 4.0, 9.0, 16.0, 25.0]) - 1.0).abs() < 1e-12 && (of([5.0, 4.0, 3.0, 2.0, 1.0]) + 1.0).abs() < 1e-12);
        // 1 - 6 sum d^2 / (n (n^2 - 1)): d^2 = 1 + 1 + 0 + 1 + 1.
        let found = of([2.0, 1.0, 3.0, 5.0, 4.0]);
        assert!((found - 0.8).abs() < 1e-12, "{found}, the textbook says 0.8");
        assert_eq!(of([7.0; 5]), 0.0, "nothing goes along with what never changes");
    }
}
