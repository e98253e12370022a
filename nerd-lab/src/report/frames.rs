//! Error against frame: position left, rotation right.

use std::path::Path;

use plotters::coord::Shift;
use plotters::prelude::*;

use crate::error::Result;
use crate::report::plot::{COLOURS, Picture, failed, save};

/// Errors by frame.
pub struct Curve<'a> {
    /// Its name.
    pub name: &'a str,
    /// Position (m) and rotation (rad) by frame.
    pub by_frame: &'a [[f64; 2]],
    /// Whether it is a floor or a bound, which is dashed.
    pub dashed: bool,
}

/// Writes `stem`.svg and `stem`.png; `title` says what moves, `frame` how long a frame is.
///
/// # Errors
/// If they cannot be drawn or written.
pub fn draw(title: &str, frame: &str, curves: &[Curve], stem: &Path) -> Result<()> {
    save(stem, (1200, 600), &Panels { title, frame, curves })
}

struct Panels<'a> {
    title: &'a str,
    frame: &'a str,
    curves: &'a [Curve<'a>],
}

impl Picture for Panels<'_> {
    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Result<()> {
        let failed = failed::<B>;
        area.fill(&WHITE).map_err(failed)?;
        let (body, legend) = area.split_vertically(500);
        for (k, (panel, what)) in
            body.split_evenly((1, 2)).iter().zip(["position: mean |dp| (m)", "rotation: mean angle (rad)"]).enumerate()
        {
            let points = |curve: &Curve| curve.by_frame.iter().enumerate().skip(1).map(move |(i, e)| (i as f64, e[k])).collect::<Vec<_>>();
            let all: Vec<f64> = self.curves.iter().flat_map(points).map(|p| p.1).filter(|e| *e > 0.0).collect();
            let (low, high) = all.iter().fold((f64::MAX, 0.0f64), |(a, b), e| (a.min(*e), b.max(*e)));
            let steps = self.curves.iter().map(|c| c.by_frame.len()).max().unwrap_or(2) as f64;
            let mut chart = ChartBuilder::on(panel)
                .caption(format!("{}, open loop, {what}", self.title), ("sans-serif", 17))
                .margin(12)
                .x_label_area_size(40)
                .y_label_area_size(60)
                .build_cartesian_2d(0.0..steps, (0.8 * low..1.3 * high).log_scale())
                .map_err(failed)?;
            let ticks = |v: &f64| if *v < 0.0095 { format!("{v:.0e}") } else { format!("{}", (v * 1000.0).round() / 1000.0) };
            chart
                .configure_mesh()
                .x_desc(format!("frames after the measured start ({})", self.frame))
                .label_style(("sans-serif", 13))
                .light_line_style(BLACK.mix(0.04))
                .bold_line_style(BLACK.mix(0.12))
                .x_label_formatter(&|v| format!("{v:.0}"))
                .y_label_formatter(&ticks)
                .draw()
                .map_err(failed)?;
            for (curve, colour) in self.curves.iter().zip(COLOURS.iter().cycle()) {
                let style = colour.stroke_width(2);
                if curve.dashed {
                    chart.draw_series(DashedLineSeries::new(points(curve), 6, 5, style)).map_err(failed)?;
                } else {
                    chart.draw_series(LineSeries::new(points(curve), style)).map_err(failed)?;
                }
            }
        }
        for (k, (curve, colour)) in self.curves.iter().zip(COLOURS.iter().cycle()).enumerate() {
            let (x, y) = (70 + 380 * (k as i32 % 3), 16 + 26 * (k as i32 / 3));
            let style = colour.stroke_width(3);
            let parts: &[(i32, i32)] = if curve.dashed { &[(0, 8), (12, 20), (24, 32)] } else { &[(0, 32)] };
            for (from, to) in parts {
                legend.draw(&PathElement::new([(x + from, y), (x + to, y)], style)).map_err(failed)?;
            }
            legend.draw(&Text::new(curve.name.to_string(), (x + 40, y - 8), ("sans-serif", 14))).map_err(failed)?;
        }
        area.present().map_err(failed)
    }
}
