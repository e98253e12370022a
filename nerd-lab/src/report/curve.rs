//! The learning curve of a run of PPO, drawn.

use std::path::Path;

use plotters::coord::Shift;
use plotters::prelude::*;

use nerd_train::ppo::Iteration;
use nerd_train::ppo::curve::lines;

use super::plot::{COLOURS, Picture, save};
use crate::error::Result;

struct Curve {
    title: String,
    reward: Vec<(f64, f64)>,
    length: Vec<(f64, f64)>,
}

/// Draws `curve.svg` and `curve.png` from `metrics.jsonl` of a run's folder, once an episode has ended.
///
/// # Errors
/// If the record cannot be read or the picture not be written.
pub fn draw(out: &Path, title: &str) -> Result<()> {
    let lines = lines(out)?;
    let points = |f: fn(&Iteration) -> Option<f64>| lines.iter().filter_map(|l| Some((l.frames as f64 / 1e6, f(l)?))).collect();
    let curve = Curve { title: title.into(), reward: points(|l| l.reward), length: points(|l| l.length) };
    if curve.reward.is_empty() { Ok(()) } else { save(&out.join("curve"), (1000, 600), &curve) }
}

impl Picture for Curve {
    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> crate::error::Result<()> {
        let failed = crate::report::plot::failed::<B>;
        area.fill(&WHITE).map_err(failed)?;
        let titled = area.titled(&self.title, ("sans-serif", 18)).map_err(failed)?;
        let halves = titled.split_vertically(360);
        for (part, points, name, colour) in
            [(&halves.0, &self.reward, "mean reward", COLOURS[0]), (&halves.1, &self.length, "mean length (steps)", COLOURS[4])]
        {
            let last = points.last().map_or(1.0, |p| p.0).max(1e-3);
            let (low, high) = points.iter().fold((f64::MAX, f64::MIN), |(a, b), p| (a.min(p.1), b.max(p.1)));
            let room = 0.05 * (high - low).max(1.0);
            let mut chart = ChartBuilder::on(part)
                .margin(10)
                .x_label_area_size(40)
                .y_label_area_size(70)
                .build_cartesian_2d(0.0..last, low - room..high + room)
                .map_err(failed)?;
            let mut mesh = chart.configure_mesh();
            mesh.x_desc("million steps").y_desc(name).label_style(("sans-serif", 14)).light_line_style(TRANSPARENT);
            mesh.bold_line_style(BLACK.mix(0.12)).draw().map_err(failed)?;
            chart.draw_series(LineSeries::new(points.iter().copied(), colour.stroke_width(2))).map_err(failed)?;
        }
        area.present().map_err(failed)
    }
}
