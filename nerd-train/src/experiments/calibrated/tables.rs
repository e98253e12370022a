//! Errors before and after, and what was found.

use nerd_sim::calibrate::Gap;

use super::{Calibrated, CalibratedAll, Scored, Split};
use crate::report::Table;
use crate::report::table::digits;

/// A parameter along whose bounds the objective rises by less than this share is not determined.
const FLAT: f64 = 0.01;

impl CalibratedAll {
    /// Errors on what nothing was fitted to.
    pub(super) fn errors(&self) -> Table {
        let joints = self.still.iter().any(|s| s.mean.joints > 0.0);
        let mut rows = vec![line("no motion", joints, &self.still.iter().collect::<Vec<_>>(), None)];
        for solver in &self.fitted {
            let of = |field: fn(&Split) -> &Scored| solver.splits.iter().map(field).collect::<Vec<_>>();
            rows.push(line(&format!("{}, as described", solver.solver), joints, &of(|s| &s.before), Some(&of(|s| &s.whole_before))));
            rows.push(line(&format!("{}, calibrated", solver.solver), joints, &of(|s| &s.after), Some(&of(|s| &s.whole_after))));
        }
        let mut header = vec!["method", "position (m)", "rotation (rad)"];
        header.extend(joints.then_some("joints (rad or m)"));
        header.extend(["other side up (%)", "whole trajectories"]);
        let notes = self.notes.iter().map(|n| format!(" {n}.")).collect::<String>();
        Table::new("errors", &header).with(rows).noted(&format!(
            "Open loop from measured states, {} rollouts of {} frames from {} trajectories of `{}`. {} splits by trajectory: fitted to {} %, \
             judged on half of the rest. Mean over splits [mean ends of the 95 % intervals from resampling trajectories].{notes}",
            self.sizes[1],
            self.settings.frames,
            self.sizes[0],
            self.robot,
            self.settings.splits,
            self.settings.train
        ))
    }

    /// What was found, by solver.
    pub(super) fn parameters(&self) -> Table {
        let rows = self.fitted.iter().flat_map(|solver| {
            solver.parameters.iter().enumerate().map(|(k, (name, [low, nominal, high], unit))| {
                let [value, spread] = over_splits(solver, k);
                let rise = rise(solver, k);
                let word = match rise {
                    Some(rise) if rise < FLAT => "not determined".into(),
                    Some(rise) => format!("{:+.0} %", 100.0 * rise),
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
        let header = ["solver", "parameter", "described", "calibrated", "bounds", "objective at its worse bound"];
        Table::new("parameters", &header).with(rows).noted(
            "Calibrated: mean and standard deviation over splits. Last column: how much the objective of the first split rises when this \
             parameter alone is moved to that of its bounds where it rises less; below 1 % the data do not determine it.",
        )
    }
}

/// Mean and standard deviation of a parameter over splits.
fn over_splits(solver: &Calibrated, k: usize) -> [f64; 2] {
    let x: Vec<f64> = solver.splits.iter().map(|s| s.fit.values[k]).collect();
    let mean = x.iter().sum::<f64>() / x.len() as f64;
    [mean, (x.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (x.len().max(2) - 1) as f64).sqrt()]
}

/// How much the objective rises to the nearer of a parameter's bounds, as a share of itself.
fn rise(solver: &Calibrated, k: usize) -> Option<f64> {
    let profile = solver.profiles.get(k)?;
    let best = profile.iter().map(|p| p[1]).fold(f64::INFINITY, f64::min);
    Some(profile.first()?[1].min(profile.last()?[1]) / best - 1.0)
}

fn line(name: &str, joints: bool, splits: &[&Scored], whole: Option<&[&Scored]>) -> Vec<String> {
    let of = |splits: &[&Scored], field: fn(&Gap) -> f64| {
        let mean = |end: fn(&Scored) -> &Gap| splits.iter().map(|s| field(end(s))).sum::<f64>() / splits.len() as f64;
        [mean(|s| &s.mean), mean(|s| &s.low), mean(|s| &s.high)]
    };
    let text = |[mean, low, high]: [f64; 3]| format!("{} [{}, {}]", digits(mean), digits(low), digits(high));
    let mut row = vec![name.to_string(), text(of(splits, |g| g.position)), text(of(splits, |g| g.rotation))];
    row.extend(joints.then(|| text(of(splits, |g| g.joints))));
    row.push(text(of(splits, |g| 100.0 * g.other_side)));
    row.push(whole.map_or("-".into(), |w| format!("{} / {}", digits(of(w, |g| g.position)[0]), digits(of(w, |g| g.rotation)[0]))));
    row
}
