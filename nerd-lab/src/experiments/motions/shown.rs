//! Table and figure of errors along motions.

use super::{MotionErrors, Motions};
use crate::prelude::*;
use nerd_cli::report::Mark;

impl Motions {
    pub fn table(&self, data: &MotionErrors) -> Table {
        let shown = [10, 30, 100, 300, 1000].into_iter().filter(|frame| *frame <= self.frames).collect_vec();
        let millimetres = |x: f64| if x.is_nan() { "-".into() } else { digits(1e3 * x) };
        let rows = data.rows.iter().map(|row| {
            let frames = shown.iter().map(|frame| millimetres(row.curve.get(frame - 1).copied().unwrap_or(f64::NAN)));
            let of = |share: f64| millimetres(percentile(row.motions.clone(), share));
            let first = [
                row.series.clone(),
                or_dash(row.substeps),
                or_dash(row.microseconds.map(digits)),
                millimetres(mean(&row.motions)),
                of(0.95),
                of(1.0),
            ];
            first.into_iter().chain(frames).chain([row.lost.to_string()])
        });
        let frames = shown.iter().map(|frame| format!("frame {frame}"));
        let header = ["solver", "substeps", "us a frame", "mean (mm)", "95 %", "worst"].map(String::from);
        let header = header.into_iter().chain(frames).chain(["lost".into()]);
        let mut note = format!(
            "{}: distance of contact points over {} frames of {} motions that no solver has seen, from {}; 95 % and worst: of the motions' means.",
            data.robot, self.frames, self.trajectories, data.reference
        );
        let lost: usize = data.rows.iter().map(|row| row.lost).sum();
        if lost > 0 {
            note += &format!(" {lost} were lost by some solver, and are in no other figure of its row.");
        }
        Table::new(&self.name(), header).with(rows).noted(note)
    }

    pub(super) fn figure(&self, data: &MotionErrors) -> Figure {
        let marks = data.rows.iter().filter(|row| !row.motions.is_empty()).filter_map(|row| {
            let label = row.substeps.map_or_else(String::new, |n| format!("x{n}"));
            Some(Mark { series: &row.series, cost: row.microseconds?, error: mean(&row.motions), label, front: false })
        });
        let mut levels: Vec<(f64, String)> = Vec::new();
        for row in data.rows.iter().filter(|row| row.microseconds.is_none()) {
            let error = mean(&row.motions);
            // Gives both predictors one line if they agree, as they do for motions from rest.
            match levels.iter_mut().find(|(other, _)| (other / error - 1.0).abs() < 0.02) {
                Some((_, name)) => *name += &format!(", {}", row.series),
                None => levels.push((error, row.series.clone())),
            }
        }
        let x = "microseconds a frame, one environment, one core".into();
        let y = format!("mean distance of contact points over {} frames (m)", self.frames);
        Figure::speed(format!("{}: motions that no solver has seen", data.robot), [x, y], marks, levels)
    }
}
