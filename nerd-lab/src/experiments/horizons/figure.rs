//! A picture of one model: on the left its errors by frame, on the right one rollout over the truth's.

use std::path::Path;

use plotters::coord::Shift;
use plotters::coord::ranged1d::{AsRangedCoord, Ranged, ValueFormatter};
use plotters::prelude::*;

use super::{Horizon, Quantity, Trace};
use crate::error::Result;
use crate::report::plot::{COLOURS, Log, Picture, failed, save, stroke};

/// Height of a row of panels (px).
const ROW: u32 = 260;
/// Of labels.
const FONT: (&str, i32) = ("sans-serif", 13);

type Panel<'a, B> = DrawingArea<B, Shift>;
type Chart<'a, B, X, Y> = ChartContext<'a, B, Cartesian2d<X, Y>>;
/// A line: its points, colour, width and name.
type Line<'a> = (Vec<(f64, f64)>, RGBAColor, u32, &'a str);

/// Writes `stem`.svg and `stem`.png.
pub(super) fn draw(horizon: &Horizon, stem: &Path) -> Result<()> {
    let rows = horizon.quantities.len().max(horizon.paths.len()) as u32;
    save(stem, (1200, 40 + ROW * rows), horizon)
}

impl Picture for Horizon {
    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Result<()> {
        let failed = failed::<B>;
        area.fill(&WHITE).map_err(failed)?;
        let title = format!("{} ({}) on {}, {} rollouts, {} diverged", self.robot, self.method, self.scene, self.starts, self.diverged);
        let area = area.titled(&title, ("sans-serif", 18)).map_err(failed)?;
        let panels = area.split_evenly((self.quantities.len().max(self.paths.len()), 2));
        for (row, q) in self.quantities.iter().enumerate() {
            self.errors(&panels[2 * row], q, row == 0).map_err(failed)?;
        }
        for (row, path) in self.paths.iter().enumerate() {
            self.rollout(&panels[2 * row + 1], path, row == 0).map_err(failed)?;
        }
        area.present().map_err(failed)
    }
}

impl Horizon {
    /// A quantity's median, band and floor by frame.
    fn errors<B: DrawingBackend>(&self, panel: &Panel<B>, q: &Quantity, names: bool) -> Drawn<B> {
        let floor = q.bands.iter().flatten().chain(&q.hold).copied().filter(|x| *x > 0.0).fold(f64::MAX, f64::min).max(1e-9);
        let top = q.bands.iter().flatten().chain(&q.hold).copied().fold(floor * 10.0, f64::max);
        let last = self.frames.last().map_or(1.0, |f| *f as f64).max(2.0);
        let mut chart = axes(panel, Log::new(1.0, 1.001 * last), Log::new(floor, top * 1.5), "frame", &q.name)?;
        let line = |k: usize| self.frames.iter().zip(&q.bands).map(move |(f, b)| (*f as f64, b[k].max(floor)));
        let band: Vec<_> = line(0).chain(line(2).collect::<Vec<_>>().into_iter().rev()).collect();
        chart.draw_series([Polygon::new(band, COLOURS[0].mix(0.2))])?;
        let held = self.frames.iter().zip(&q.hold).map(|(f, h)| (*f as f64, h.max(floor)));
        let median = (line(1).collect(), COLOURS[0].to_rgba(), 2, "NeRD, median and 10 to 90 %");
        lines(&mut chart, vec![median, (held.collect(), COLOURS[6].to_rgba(), 2, "repeat the start, median")])?;
        legend(&mut chart, names, SeriesLabelPosition::LowerRight)
    }

    /// A coordinate of one rollout by time.
    fn rollout<B: DrawingBackend>(&self, panel: &Panel<B>, path: &Trace, names: bool) -> Drawn<B> {
        let time = |k: usize| (k + 1) as f64 * self.frame_time;
        let (low, high) = path.both.iter().flatten().fold((f64::MAX, f64::MIN), |(a, b), x| (a.min(*x), b.max(*x)));
        let room = 0.05 * (high - low).max(1e-3);
        let mut chart = axes(panel, 0.0..time(path.both[0].len()), low - room..high + room, "s, one rollout", &path.name)?;
        let points = |k: usize| path.both[k].iter().enumerate().map(|(k, x)| (time(k), *x)).collect();
        lines(&mut chart, vec![(points(0), COLOURS[7].mix(0.35), 4, "truth"), (points(1), COLOURS[4].to_rgba(), 1, "NeRD")])?;
        legend(&mut chart, names, SeriesLabelPosition::UpperRight)
    }
}

type Drawn<B, T = ()> = Result<T, DrawingAreaErrorKind<<B as DrawingBackend>::ErrorType>>;

/// A panel's axes.
fn axes<'a, B: DrawingBackend, X, Y>(
    panel: &Panel<B>,
    x: X,
    y: Y,
    under: &str,
    beside: &str,
) -> Drawn<B, Chart<'a, B, X::CoordDescType, Y::CoordDescType>>
where
    X: AsRangedCoord<Value = f64>,
    Y: AsRangedCoord<Value = f64>,
    X::CoordDescType: ValueFormatter<f64>,
    Y::CoordDescType: ValueFormatter<f64>,
{
    let mut builder = ChartBuilder::on(panel);
    let mut chart = builder.margin(8).x_label_area_size(36).y_label_area_size(64).build_cartesian_2d(x, y)?;
    let mut mesh = chart.configure_mesh();
    mesh.x_desc(under).y_desc(beside).label_style(FONT).light_line_style(TRANSPARENT).bold_line_style(BLACK.mix(0.12)).draw()?;
    Ok(chart)
}

fn lines<'a, B: DrawingBackend + 'a, X: Ranged<ValueType = f64>, Y: Ranged<ValueType = f64>>(
    chart: &mut Chart<'a, B, X, Y>,
    lines: Vec<Line>,
) -> Drawn<B> {
    for (points, colour, width, name) in lines {
        chart.draw_series(LineSeries::new(points, colour.stroke_width(width)))?.label(name).legend(stroke(colour, width));
    }
    Ok(())
}

fn legend<'a, B: DrawingBackend + 'a, X: Ranged<ValueType = f64>, Y: Ranged<ValueType = f64>>(
    chart: &mut Chart<'a, B, X, Y>,
    names: bool,
    at: SeriesLabelPosition,
) -> Drawn<B> {
    if names {
        chart.configure_series_labels().position(at).background_style(WHITE.mix(0.8)).label_font(FONT).draw()?;
    }
    Ok(())
}
