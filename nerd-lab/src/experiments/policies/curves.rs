//! How the shipped policies learned, task by task, beside the released ones.

use std::path::Path;

use plotters::coord::Shift;
use plotters::prelude::*;

use super::Row;
use crate::error::Result;
use crate::paper::{policy_reward, released_curve};
use crate::report::plot::{COLOURS, Picture, failed, save, stroke};
use nerd_train::ppo::folder;
use nerd_train::shipped::root;

/// Columns of panels, and the size of one (px).
const COLUMNS: usize = 2;
const PANEL: (u32, u32) = (600, 280);

/// Whether a policy was trained in a learned simulator, and its million steps and mean reward.
type Run = (bool, Vec<(f64, f64)>);

struct Curves {
    /// Tasks with their runs.
    tasks: Vec<(String, Vec<Run>)>,
}

/// Draws `stem`.svg and `stem`.png from the `curve.csv` of policies' folders; one that has none is left out.
pub fn draw(rows: &[Row], stem: &Path) -> Result<()> {
    let mut tasks: Vec<(String, Vec<Run>)> = nerd_tasks::names().iter().map(|name| (name.to_string(), Vec::new())).collect();
    for row in rows {
        let (folder, runs) = (root().join(&row.policy), tasks.iter_mut().find(|t| t.0 == row.task));
        let (Some((_, runs)), true) = (runs, folder.join("curve.csv").exists()) else { continue };
        // Those of fewer environments learn by another clock.
        if folder::load(&folder)?.0.ppo.environments >= 1024 {
            runs.push((row.trained_in.starts_with("neural"), read(&folder.join("curve.csv"))?));
        }
    }
    tasks.retain(|t| !t.1.is_empty());
    if tasks.is_empty() {
        return Ok(());
    }
    let rows = tasks.len().div_ceil(COLUMNS) as u32;
    save(stem, (PANEL.0 * COLUMNS as u32, PANEL.1 * rows), &Curves { tasks })
}

/// Million steps and mean reward of each line but the first.
fn read(path: &Path) -> Result<Vec<(f64, f64)>> {
    let text = std::fs::read_to_string(path).map_err(crate::error::file(path))?;
    let point = |line: &str| {
        let mut numbers = line.split(',').map(str::parse::<f64>);
        Some((numbers.next()?.ok()? * 1e-6, numbers.next()?.ok()?))
    };
    let points =
        text.lines().skip(1).map(|line| point(line).ok_or_else(|| crate::error::format(path)(format!("no point of a curve: {line}"))));
    points.collect()
}

impl Picture for Curves {
    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Result<()> {
        let failed = failed::<B>;
        area.fill(&WHITE).map_err(failed)?;
        let panels = area.split_evenly((self.tasks.len().div_ceil(COLUMNS), COLUMNS));
        let font = ("sans-serif", 13);
        for (k, (panel, (task, runs))) in panels.iter().zip(&self.tasks).enumerate() {
            let (released, steps) = released_curve(task);
            let released: Vec<_> = released.iter().map(|(k, reward)| (f64::from(*k) * steps * 1e-6, *reward)).collect();
            let all = || runs.iter().flat_map(|r| &r.1).chain(&released);
            let last = all().fold(1e-3, |a: f64, p| a.max(p.0));
            let (low, high) = all().fold((f64::MAX, f64::MIN), |(a, b), p| (a.min(p.1), b.max(p.1)));
            let room = 0.05 * (high - low).max(1.0);
            let mut builder = ChartBuilder::on(panel);
            builder.caption(task, ("sans-serif", 16)).margin(8).x_label_area_size(34).y_label_area_size(64);
            let mut chart = builder.build_cartesian_2d(0.0..last, low - room..high + room).map_err(failed)?;
            let mut mesh = chart.configure_mesh();
            mesh.x_desc("million steps").y_desc("mean reward").label_style(font).light_line_style(TRANSPARENT);
            mesh.x_label_formatter(&|x| format!("{x:.0}")).y_label_formatter(&|y| format!("{y:.0}"));
            mesh.bold_line_style(BLACK.mix(0.12)).draw().map_err(failed)?;
            if let Some([truth, _]) = policy_reward(task) {
                let dashes = DashedLineSeries::new([(0.0, truth), (last, truth)], 6, 4, COLOURS[6].stroke_width(1));
                chart.draw_series(dashes).map_err(failed)?.label("paper, in truth").legend(stroke(COLOURS[6], 1));
            }
            chart.draw_series(released.iter().map(|p| Circle::new(*p, 3, BLACK.filled()))).map_err(failed)?;
            for (learned, colour, label) in [(true, COLOURS[0], "in NeRD, by seed"), (false, COLOURS[1], "in the truth")] {
                // An empty line first, so that the legend has both.
                let named = chart.draw_series(LineSeries::new([], colour.stroke_width(2))).map_err(failed)?;
                named.label(label).legend(stroke(colour, 2));
                for (_, points) in runs.iter().filter(|r| r.0 == learned) {
                    chart.draw_series(LineSeries::new(points.iter().copied(), colour.stroke_width(2))).map_err(failed)?;
                }
            }
            if k == 0 {
                let dot = chart.draw_series([Circle::new((0.0, low - room), 0, BLACK.filled())]).map_err(failed)?;
                dot.label("released, mean of three").legend(|(x, y)| Circle::new((x + 8, y), 3, BLACK.filled()));
                let mut labels = chart.configure_series_labels();
                labels
                    .position(SeriesLabelPosition::LowerRight)
                    .background_style(WHITE.mix(0.8))
                    .label_font(font)
                    .draw()
                    .map_err(failed)?;
            }
        }
        area.present().map_err(failed)
    }
}
