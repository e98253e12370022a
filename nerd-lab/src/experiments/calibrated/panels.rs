//! The objective along each parameter, a panel each; a line where the fit stands.

use std::path::Path;

use plotters::coord::Shift;
use plotters::prelude::*;

use super::Calibrated;
use crate::error::Result;
use crate::report::plot::{COLOURS, Picture, failed, save};

const COLUMNS: usize = 4;
const PANEL: (u32, u32) = (300, 230);

/// Writes `stem`.svg and `stem`.png.
pub fn draw(solver: &Calibrated, stem: &Path) -> Result<()> {
    let rows = solver.profiles.len().div_ceil(COLUMNS) as u32;
    save(stem, (PANEL.0 * COLUMNS as u32, PANEL.1 * rows + 40), &Panels(solver))
}

struct Panels<'a>(&'a Calibrated);

impl Picture for Panels<'_> {
    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Result<()> {
        let (failed, solver) = (failed::<B>, self.0);
        area.fill(&WHITE).map_err(failed)?;
        let title = format!("{}: objective along each parameter, all others as fitted", solver.solver);
        let area = area.titled(&title, ("sans-serif", 18)).map_err(failed)?;
        let panels = area.split_evenly((solver.profiles.len().div_ceil(COLUMNS), COLUMNS));
        let most = solver.profiles.iter().flatten().map(|p| p[1]).filter(|y| y.is_finite()).fold(0.0, f64::max).min(1.5);
        let least = solver.profiles.iter().flatten().map(|p| p[1]).fold(f64::INFINITY, f64::min);
        let (low, high) = (least - 0.05 * (most - least), most + 0.05 * (most - least));
        for (((panel, profile), (name, [from, _, to], unit)), k) in panels.iter().zip(&solver.profiles).zip(&solver.parameters).zip(0..) {
            let mut chart = ChartBuilder::on(panel)
                .caption(if unit == "1" { name.clone() } else { format!("{name} ({unit})") }, ("sans-serif", 14))
                .margin(8)
                .x_label_area_size(24)
                .y_label_area_size(36)
                .build_cartesian_2d(*from..*to, low..high)
                .map_err(failed)?;
            let number = |x: &f64| if x.abs() >= 1e4 { format!("{x:.0e}") } else { format!("{}", (x * 1e4).round() / 1e4) };
            chart
                .configure_mesh()
                .x_labels(4)
                .y_labels(4)
                .label_style(("sans-serif", 11))
                .light_line_style(BLACK.mix(0.03))
                .bold_line_style(BLACK.mix(0.1))
                .x_label_formatter(&number)
                .y_label_formatter(&|y| format!("{y:.2}"))
                .draw()
                .map_err(failed)?;
            let colour = COLOURS[k % COLOURS.len()];
            let points = profile.iter().map(|p| (p[0], p[1].min(high)));
            chart.draw_series(LineSeries::new(points, colour.stroke_width(2))).map_err(failed)?;
            let fitted = solver.splits[0].fit.values[k];
            chart.draw_series(LineSeries::new([(fitted, low), (fitted, high)], BLACK.mix(0.4).stroke_width(1))).map_err(failed)?;
        }
        area.present().map_err(failed)
    }
}
