//! Tables of errors before and after calibration, and of parameters.

use nerd_sim::calibrate::Distance;

use super::split::FITTED;
use super::{Calibrated, CalibratedAll, Modelled, Scored, Split};
use crate::prelude::*;

/// A parameter is not determined if the objective at its bounds exceeds its minimum by less than this fraction.
const FLAT: f64 = 0.01;

impl CalibratedAll {
    pub(super) fn errors(&self) -> Table {
        let joints = self.still.iter().any(|s| s.mean.joints > 0.0);
        let mut rows = vec![line("no motion", joints, &self.still.iter().collect_vec(), None)];
        let none = usize::from(joints) + 2;
        rows.extend(self.published.iter().map(|p| {
            let figures = [format!("{}, as published", p.method), digits(p.position), digits(p.rotation)];
            figures.into_iter().chain(vec!["-".to_string(); none]).collect()
        }));
        for solver in &self.fitted {
            let mut add = |words: &str, of: fn(&Split) -> [&Scored; 2]| {
                let [judged, whole] = [0, 1].map(|k| solver.splits.iter().map(|split| of(split)[k]).collect_vec());
                rows.push(line(&format!("{}, {words}", solver.solver), joints, &judged, Some(&whole)));
            };
            add("as described", |split| [&split.before, &split.whole_before]);
            add(&format!("calibrated by {}", solver.by), |split| [&split.after, &split.whole_after]);
        }
        for Modelled { model, before, shown, withheld, whole } in &self.modelled {
            let [shown, withheld, whole] = [shown, withheld, whole].map(|all| all.iter().collect_vec());
            let none = if *before > 0 { ", shown none" } else { ", sees one frame" };
            if *before > 0 {
                rows.push(line(&format!("{model}, shown up to {before} frames before"), joints, &shown, None));
            }
            rows.push(line(&format!("{model}{none}"), joints, &withheld, Some(&whole)));
        }
        let mut header = vec!["method", "position (m)", "rotation (rad)"];
        header.extend(joints.then_some("joints (rad or m)"));
        header.extend(["other side up (%)", "whole trajectories"]);
        let notes = self.notes.iter().map(|n| format!(" {n}.")).collect::<String>();
        Table::new("errors", header).with(rows).noted(format!(
            "Open loop from measured states, {} rollouts of {} frames from {} trajectories of `{}`. {} splits by trajectory: fitted to {} %, \
             judged on half of the rest. Mean over splits [mean ends of the 95 % intervals from resampling trajectories].{notes}",
            self.sizes[1],
            self.settings.frames,
            self.sizes[0],
            self.robot,
            self.settings.splits,
            FITTED
        ))
    }

    /// Tables the evaluations, wall time, objective and test errors of each fit.
    pub(super) fn fits(&self) -> Table {
        let rows = self.fitted.iter().flat_map(|solver| {
            solver.splits.iter().enumerate().map(|(k, split)| {
                let (fit, apart) = (&split.fit, &split.after.mean);
                let figures = [fit.evaluations, fit.seconds, fit.objective, apart.position, apart.rotation].map(digits);
                [solver.solver.clone(), solver.by.clone(), (k + 1).to_string()].into_iter().chain(figures)
            })
        });
        let header =
            ["solver", "by", "split", "evaluations", "wall clock (s)", "objective", "position (m)", "rotation (rad)"];
        Table::new("fits", header).with(rows).noted(format!(
            "Evaluations of the objective over {} rollouts of the fitted part; one over fewer or shorter ones counts as its share, a round's \
             slopes ten. Objective: mean distances there, in units of those as described. Position and rotation: on the judged part.",
            self.settings.rollouts
        ))
    }

    pub(super) fn parameters(&self) -> Table {
        let rows = self.fitted.iter().flat_map(|solver| {
            solver.parameters.iter().enumerate().map(|(k, (name, [low, nominal, high], unit))| {
                let values = solver.splits.iter().map(|split| split.fit.values[k]).collect_vec();
                let value = mean(&values);
                let squares = values.iter().map(|x| (x - value).powi(2)).sum::<f64>();
                let spread = (squares / (values.len().max(2) - 1) as f64).sqrt();
                let word = match rise(solver, k) {
                    Some((rise, _)) if rise < FLAT => "not determined".into(),
                    Some((rise, true)) => format!("{:+.0} %, from a bound", 100.0 * rise),
                    Some((rise, false)) => format!("{:+.0} %", 100.0 * rise),
                    None => "-".into(),
                };
                let unit = if unit == "1" { String::new() } else { format!(" ({unit})") };
                let bounds = format!("{} .. {}", digits(*low), digits(*high));
                vec![
                    solver.solver.clone(),
                    format!("{name}{unit}"),
                    digits(*nominal),
                    format!("{} ± {}", digits(value), digits(spread)),
                    bounds,
                    word,
                ]
            })
        });
        let header = ["solver", "parameter", "described", "calibrated", "bounds", "objective at a bound"];
        Table::new("parameters", header).with(rows).noted(
            "Calibrated: mean and standard deviation over splits. Last column: how much the objective of the first split rises when this \
             parameter alone is moved to that of its bounds where it rises less; where the fit is at one, to the other. Below 1 % the data \
             do not determine it.",
        )
    }
}

/// Returns the objective's relative rise from its minimum to the bound where it rises less. If the fit lies at a bound,
/// the other bound counts, and the flag is true.
fn rise(solver: &Calibrated, k: usize) -> Option<(f64, bool)> {
    let profile = solver.profiles.get(k)?;
    let fitted = solver.splits.first()?.fit.values[k];
    let best = profile.iter().map(|p| p[1]).fold(f64::INFINITY, f64::min);
    let low = profile.first()?;
    let high = profile.last()?;
    let near = |end: &[f64; 2]| (end[0] - fitted).abs() < 1e-3 * (high[0] - low[0]).abs();
    let rise = match (near(low), near(high)) {
        (true, false) => high[1],
        (false, true) => low[1],
        _ => low[1].min(high[1]),
    };
    Some((rise / best - 1.0, near(low) || near(high)))
}

fn line(name: &str, joints: bool, splits: &[&Scored], whole: Option<&[&Scored]>) -> Vec<String> {
    let over = |splits: &[&Scored], end: fn(&Scored) -> &Distance, field: fn(&Distance) -> f64| {
        mean(&splits.iter().map(|scored| field(end(scored))).collect_vec())
    };
    let of = |field: fn(&Distance) -> f64| {
        listed([over(splits, |s| &s.mean, field), over(splits, |s| &s.low, field), over(splits, |s| &s.high, field)])
    };
    let distances: [fn(&Distance) -> f64; 3] = [|g| g.position, |g| g.rotation, |g| g.joints];
    let distances = &distances[..if joints { 3 } else { 2 }];
    let whole = whole.map(|whole| distances.iter().map(|field| digits(over(whole, |s| &s.mean, *field))).join(" / "));
    let end = [of(|g| 100.0 * g.other_side), or_dash(whole)];
    [name.to_string()].into_iter().chain(distances.iter().map(|field| of(*field))).chain(end).collect()
}

/// Writes a mean with its interval: `mean [low, high]`.
pub(super) fn listed([mean, low, high]: [f64; 3]) -> String {
    format!("{} [{}, {}]", digits(mean), digits(low), digits(high))
}
