//! A picture of one model: on the left its errors by frame, on the right one rollout over the truth's.

use std::path::Path;

use nerd_sim::prelude::*;
use nerd_train::Result;
use plotters::coord::Shift;
use plotters::prelude::*;

use super::Horizon;
use crate::plot::{COLOURS, Picture, save, stroke};

/// Height of a row of panels (px).
const ROW: u32 = 260;

/// Name of a quantity of [`nerd_train::evaluate::summary`].
pub fn name(system: &System, k: usize) -> String {
    let (root, joints) = (if system.robot.floating() { 2 } else { 0 }, system.robot.joint_count());
    match k {
        0 if root > 0 => "position (m)".into(),
        1 if root > 0 => "orientation (rad)".into(),
        _ if joints > 2 => "joints, mean (rad)".into(),
        _ => system.robot.joints().nth(k - root).map_or_else(String::new, |j| format!("{} (rad or m)", j.name)),
    }
}

/// Coordinates worth drawing: height, and the first joints; name, place in a state, whether it wraps, and room for two paths.
pub fn paths(system: &System) -> Vec<(String, usize, bool, [Vec<f64>; 2])> {
    let robot = &system.robot;
    let up = (0..3).max_by(|a, b| system.gravity()[*a].abs().total_cmp(&system.gravity()[*b].abs())).unwrap_or(2);
    let height = robot.floating().then(|| ("height of the root (m)".to_string(), up, false, [Vec::new(), Vec::new()]));
    let joints = robot
        .joints()
        .enumerate()
        .map(|(k, j)| (format!("{} (rad or m)", j.name), robot.root_coords() + k, j.wraps(), [Vec::new(), Vec::new()]));
    height.into_iter().chain(joints).take(3).collect()
}

/// Writes `stem`.svg and `stem`.png.
pub fn draw(horizon: &Horizon, stem: &Path) -> Result<()> {
    let rows = horizon.quantities.len().max(horizon.paths.len()) as u32;
    save(stem, (1200, 40 + ROW * rows), horizon)
}

impl Picture for Horizon {
    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> nerd_train::Result<()> {
        let failed = nerd_train::report::plot::failed::<B>;
        area.fill(&WHITE).map_err(failed)?;
        let title = format!("{} ({}) on {}, {} rollouts, {} diverged", self.robot, self.method, self.scene, self.starts, self.diverged);
        let area = area.titled(&title, ("sans-serif", 18)).map_err(failed)?;
        let panels = area.split_evenly((self.quantities.len().max(self.paths.len()), 2));
        let font = ("sans-serif", 13);
        let last = self.frames.last().map_or(1.0, |f| *f as f64).max(2.0);
        for (row, q) in self.quantities.iter().enumerate() {
            let floor = q.bands.iter().flatten().chain(&q.hold).copied().filter(|x| *x > 0.0).fold(f64::MAX, f64::min).max(1e-9);
            let top = q.bands.iter().flatten().chain(&q.hold).copied().fold(floor * 10.0, f64::max);
            let mut builder = ChartBuilder::on(&panels[2 * row]);
            builder.margin(8).x_label_area_size(36).y_label_area_size(64);
            let mut chart = builder.build_cartesian_2d((1.0..last).log_scale(), (floor..top * 1.5).log_scale()).map_err(failed)?;
            let mut mesh = chart.configure_mesh();
            mesh.x_desc("frame").y_desc(&q.name).label_style(font).light_line_style(TRANSPARENT).bold_line_style(BLACK.mix(0.12));
            mesh.y_label_formatter(&|y| format!("{y:.0e}")).draw().map_err(failed)?;
            let line = |k: usize| self.frames.iter().zip(&q.bands).map(move |(f, b)| (*f as f64, b[k].max(floor)));
            let band: Vec<_> = line(0).chain(line(2).collect::<Vec<_>>().into_iter().rev()).collect();
            chart.draw_series([Polygon::new(band, COLOURS[0].mix(0.2))]).map_err(failed)?;
            let held = self.frames.iter().zip(&q.hold).map(|(f, h)| (*f as f64, h.max(floor)));
            for (points, colour, label) in [
                (line(1).collect::<Vec<_>>(), COLOURS[0], "NeRD, median and 10 to 90 %"),
                (held.collect(), COLOURS[6], "repeat the start, median"),
            ] {
                let drawn = chart.draw_series(LineSeries::new(points, colour.stroke_width(2))).map_err(failed)?;
                drawn.label(label).legend(stroke(colour, 2));
            }
            if row == 0 {
                let mut labels = chart.configure_series_labels();
                labels
                    .position(SeriesLabelPosition::LowerRight)
                    .background_style(WHITE.mix(0.8))
                    .label_font(font)
                    .draw()
                    .map_err(failed)?;
            }
        }
        for (row, (name, both)) in self.paths.iter().enumerate() {
            let time = |k: usize| (k + 1) as f64 * self.frame_time;
            let (low, high) = both.iter().flatten().fold((f64::MAX, f64::MIN), |(a, b), x| (a.min(*x), b.max(*x)));
            let room = 0.05 * (high - low).max(1e-3);
            let mut builder = ChartBuilder::on(&panels[2 * row + 1]);
            builder.margin(8).x_label_area_size(36).y_label_area_size(64);
            let mut chart = builder.build_cartesian_2d(0.0..time(both[0].len()), low - room..high + room).map_err(failed)?;
            let mut mesh = chart.configure_mesh();
            mesh.x_desc("s, one rollout").y_desc(name).label_style(font).light_line_style(TRANSPARENT).bold_line_style(BLACK.mix(0.12));
            mesh.draw().map_err(failed)?;
            for (path, colour, width, label) in [(&both[0], COLOURS[7].mix(0.35), 4, "truth"), (&both[1], COLOURS[4].mix(1.0), 1, "NeRD")] {
                let points = path.iter().enumerate().map(|(k, x)| (time(k), *x));
                let drawn = chart.draw_series(LineSeries::new(points, colour.stroke_width(width))).map_err(failed)?;
                drawn.label(label).legend(stroke(colour, width));
            }
            if row == 0 {
                let mut labels = chart.configure_series_labels();
                labels
                    .position(SeriesLabelPosition::UpperRight)
                    .background_style(WHITE.mix(0.8))
                    .label_font(font)
                    .draw()
                    .map_err(failed)?;
            }
        }
        area.present().map_err(failed)
    }
}
