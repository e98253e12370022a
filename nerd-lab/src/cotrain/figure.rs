//! Gaps against rounds, by task: their mean size, and that of the largest.

use std::path::Path;

use plotters::coord::Shift;
use plotters::prelude::*;

use super::{Rounds, TaskGaps};
use crate::error::Result;
use crate::report::plot::{COLOURS, Log, Picture, failed, save, stroke};

/// Width and height (px).
const SIZE: (u32, u32) = (900, 520);
const FONT: (&str, i32) = ("sans-serif", 14);
/// What is smaller is drawn here (percent).
const SMALLEST: f64 = 0.01;

/// A figure of a task's gaps.
type Size = fn(&TaskGaps) -> f64;

/// Writes `stem`.svg and `stem`.png.
pub(super) fn draw(rounds: &Rounds, stem: &Path) -> Result<()> {
    save(stem, SIZE, rounds)
}

impl Rounds {
    /// A figure of a task by round; what is infinite is left out.
    fn line(&self, task: &str, of: Size) -> Vec<(f64, f64)> {
        let point = |r: &super::Round| {
            let size = r.tasks.iter().find(|t| t.task == task).map(of)?;
            size.is_finite().then_some((r.round as f64, size.max(SMALLEST)))
        };
        self.rounds.iter().filter_map(point).collect()
    }
}

impl Picture for Rounds {
    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Result<()> {
        let failed = failed::<B>;
        area.fill(&WHITE).map_err(failed)?;
        let tasks: Vec<&str> = self.rounds.first().map_or_else(Vec::new, |r| r.tasks.iter().map(|t| t.task.as_str()).collect());
        let kinds: [(Size, &str, u32); 2] = [(TaskGaps::mean, "mean", 3), (TaskGaps::largest, "largest", 1)];
        let heights = tasks.iter().flat_map(|task| kinds.iter().flat_map(|kind| self.line(task, kind.0))).map(|p| p.1);
        let (y, ends) = (Log::over(heights.chain([self.mean, self.most])), [-0.3, self.rounds.len() as f64 - 0.7]);
        let mut builder = ChartBuilder::on(area);
        builder.caption("Policies of new seeds: gap by round", ("sans-serif", 18)).margin(12).x_label_area_size(40).y_label_area_size(60);
        let mut chart = builder.build_cartesian_2d(ends[0]..ends[1], y).map_err(failed)?;
        let mut mesh = chart.configure_mesh();
        mesh.x_desc("round").y_desc("size of the gap of the reward (%)").label_style(FONT).light_line_style(TRANSPARENT);
        // A round is a whole number.
        mesh.x_labels(self.rounds.len().clamp(2, 12)).x_label_formatter(&|x| match x.fract() == 0.0 {
            true => format!("{x:.0}"),
            false => String::new(),
        });
        mesh.bold_line_style(BLACK.mix(0.12)).draw().map_err(failed)?;
        for (height, name) in [(self.mean, "mean allowed"), (self.most, "most allowed")] {
            chart.draw_series(DashedLineSeries::new(ends.map(|x| (x, height)), 6, 5, BLACK.mix(0.5).into())).map_err(failed)?;
            let style = ("sans-serif", 12).into_font().color(&BLACK.mix(0.7));
            chart.draw_series([EmptyElement::at((ends[0], height)) + Text::new(name, (8, -14), style)]).map_err(failed)?;
        }
        for (task, colour) in tasks.iter().zip(COLOURS.iter().cycle()) {
            for (of, name, width) in kinds {
                let points = self.line(task, of);
                let marks = points.iter().map(|p| Circle::new(*p, 2 + width as i32, colour.filled()));
                chart.draw_series(marks).map_err(failed)?;
                let line = chart.draw_series(LineSeries::new(points.iter().copied(), colour.stroke_width(width))).map_err(failed)?;
                line.label(format!("{task}, {name}")).legend(stroke(*colour, width));
            }
        }
        let mut labels = chart.configure_series_labels();
        labels.position(SeriesLabelPosition::UpperRight).background_style(WHITE.mix(0.8)).label_font(FONT).draw().map_err(failed)?;
        area.present().map_err(failed)
    }
}
