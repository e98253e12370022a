//! A verdict in words: a small table, and one line of advice.

use itertools::Itertools;
use std::fmt;

use super::{Row, Verdict};
use crate::words::{digits, markdown, pair};

impl Verdict {
    /// Columns of [`Verdict::cells`]; errors are by quantity.
    pub const HEADER: [&str; 4] = ["solver", "error", "times the model's", "us a frame on one core"];

    /// Rows of a table, one for each solver. Of `articulated`, only the first and the last are shown.
    pub fn cells(&self) -> Vec<Vec<String>> {
        let (first, last) = (self.articulated.first(), self.articulated.last().filter(|_| self.articulated.len() > 1));
        let rows = [Some(&self.model), Some(&self.base), self.hold.as_ref(), Some(&self.linear), first, last];
        let cells = |row: &Row| {
            let times = self.times(row).into_iter().map(short).collect_vec();
            let lost = if row.diverged > 0 { format!(", {} diverged", row.diverged) } else { String::new() };
            let time = if row.microseconds > 0.0 { digits(row.microseconds) } else { "-".into() };
            vec![row.of.clone() + &lost, pair(&row.errors), times.join(" / "), time]
        };
        rows.into_iter().flatten().chain(&self.beside).map(cells).collect()
    }

    /// Advice in one line, with the network's advantage over the baselines.
    pub fn line(&self) -> String {
        let Self { model, base, hold, linear, beside, .. } = self;
        let own = digits(model.microseconds);
        let advice = match self.equal() {
            Some(row) if row.microseconds <= model.microseconds => {
                format!(
                    "use the solver: {} errs no more and takes {} us where the model takes {own}",
                    row.of,
                    digits(row.microseconds)
                )
            }
            _ if model.diverged > 0 => format!("use the solver: {} rollouts of the model diverged", model.diverged),
            _ if [Some(base), hold.as_ref(), Some(linear)]
                .into_iter()
                .flatten()
                .any(|row| row.mean() <= model.mean()) =>
            {
                "use the solver: what has learned nothing, or a linear map, errs no more than the network".into()
            }
            _ if self.shortfall().is_some() => "use the solver: the network adds too little".into(),
            Some(row) => {
                format!(
                    "use the network: {} errs no more but takes {} us where the model takes {own}",
                    row.of,
                    digits(row.microseconds)
                )
            }
            None if self.recorded() && self.articulated.iter().any(|row| row.of.ends_with("calibrated")) => {
                format!("use the network: it takes {own} us and errs less than a calibrated solver")
            }
            None if self.recorded() => {
                format!(
                    "the network takes {own} us and errs less than a solver as described; `evaluate --data` asks a calibrated one, too"
                )
            }
            None => {
                format!("use the network: it takes {own} us, and no number of substeps of `articulated` errs as little")
            }
        };
        let beside = beside.first().map_or_else(String::new, |row| format!("; {} {}", row.of, self.span(row)));
        format!(
            "{advice}; {} errs {} times as much, a {} {}{beside}",
            base.of,
            self.span(base),
            linear.of,
            self.span(linear)
        )
    }

    /// The verdict in a table cell.
    pub fn worth(&self) -> String {
        let equal =
            self.equal().map_or_else(String::new, |row| format!("{} {} us, ", row.of, digits(row.microseconds)));
        let (own, base, linear) = (digits(self.model.microseconds), self.span(&self.base), self.span(&self.linear));
        format!("{equal}model {own} us; base alone x {base}, linear map x {linear}")
    }

    /// Text of the smallest and the largest ratio of a row's error to the model's, over the quantities.
    fn span(&self, row: &Row) -> String {
        let mut times = self.times(row);
        times.sort_by(f64::total_cmp);
        let (least, most) = (short(times[0]), short(times[times.len() - 1]));
        if least == most { least } else { format!("{least} to {most}") }
    }
}

/// A ratio with two decimals, or with none from 10 on.
fn short(x: f64) -> String {
    match x {
        _ if x.is_nan() => "-".into(),
        _ if x >= 1000.0 => "over 1000".into(),
        _ if x > 0.0 && x < 0.01 => "under 0.01".into(),
        _ if x >= 10.0 => format!("{x:.0}"),
        _ => format!("{x:.2}"),
    }
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { robot, scene, truth, protocol, quantities, .. } = self;
        let table = markdown(&Self::HEADER, &self.cells());
        let (starts, steps, seed) = (protocol.starts, protocol.steps, protocol.seed);
        let seed = if self.recorded() { String::new() } else { format!(" of seed {seed}") };
        writeln!(f, "{robot} in {scene}, against {truth}, {starts} starts{seed}, {steps} frames{}:", protocol.action)?;
        write!(f, "{}\n\n{table}\n{}", quantities.join(" / "), self.line())
    }
}
