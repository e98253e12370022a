//! Pictures as SVG and PNG; among them log-log ones: series of labelled points, a front, dashed levels.

use std::path::Path;

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{FontStyle, register_font};

pub use super::axis::Log;
use super::axis::Room;
use super::pixels::Canvas;
use super::write;
use crate::error::{Error, Result};

/// Width and height (px), without the legend.
const SIZE: (u32, u32) = (1000, 640);
/// Height of a line of the legend (px).
const ROW: i32 = 22;
/// Okabe and Ito's colours, which the colour-blind tell apart, and for more than seven series black and brown.
pub const COLOURS: [RGBColor; 9] = [
    RGBColor(0, 114, 178),
    RGBColor(230, 159, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(213, 94, 0),
    RGBColor(86, 180, 233),
    RGBColor(120, 120, 120),
    RGBColor(0, 0, 0),
    RGBColor(120, 60, 20),
];

/// Points that belong together, joined by a line.
pub struct Series {
    /// Name in the legend.
    pub name: String,
    /// x, y and a word beside the mark, where there is room for it.
    pub points: Vec<(f64, f64, String)>,
}

/// A picture.
pub struct Figure {
    /// Above it.
    pub title: String,
    /// Under the x axis.
    pub x: String,
    /// Beside the y axis.
    pub y: String,
    /// What is drawn.
    pub series: Vec<Series>,
    /// Points no other point beats in both, by x.
    pub front: Vec<(f64, f64)>,
    /// Heights worth a dashed line, with their names.
    pub levels: Vec<(f64, String)>,
}

/// What can draw itself, on paper or on pixels.
pub trait Picture {
    /// Draws.
    ///
    /// # Errors
    /// If it cannot be drawn.
    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Result<()>;
}

/// Writes a picture as `stem`.svg and, of twice as many pixels each way, `stem`.png.
///
/// # Errors
/// If it cannot be drawn or written.
pub fn save(stem: &Path, size: (u32, u32), picture: &impl Picture) -> Result<()> {
    let unread = || Error::msg("the built-in font cannot be read");
    register_font("sans-serif", FontStyle::Normal, dejavu::sans::regular()).map_err(|_| unread())?;
    let mut svg = String::new();
    picture.draw(&SVGBackend::with_string(&mut svg, size).into_drawing_area())?;
    write(&stem.with_extension("svg"), svg.as_bytes())?;
    let folder = tempfile::tempdir().map_err(crate::error::file(Path::new("a temporary folder")))?;
    let png = folder.path().join("picture.png");
    picture.draw(&Canvas::new(&png, size, dejavu::sans::regular()).map_err(|_| unread())?.into_drawing_area())?;
    write(&stem.with_extension("png"), &std::fs::read(&png).map_err(crate::error::file(&png))?)
}

/// An error of plotters; for `map_err`.
pub fn failed<B: DrawingBackend>(error: DrawingAreaErrorKind<B::ErrorType>) -> Error {
    Error::msg(format!("cannot draw: {error}"))
}

/// A short line for a legend.
pub fn stroke<B: DrawingBackend>(
    colour: impl Color + Copy + 'static,
    width: u32,
) -> impl Fn((i32, i32)) -> DynElement<'static, B, (i32, i32)> {
    move |(x, y)| PathElement::new([(x, y), (x + 16, y)], colour.stroke_width(width)).into_dyn()
}

impl Figure {
    /// Writes `stem`.svg and `stem`.png.
    ///
    /// # Errors
    /// If it cannot be drawn or written.
    pub fn save(&self, stem: &Path) -> Result<()> {
        let rows = self.names().len().div_ceil(2) as u32;
        save(stem, (SIZE.0, SIZE.1 + rows * ROW as u32 + 8), self)
    }

    /// What the legend says, and in which colour.
    fn names(&self) -> Vec<(&str, RGBAColor)> {
        let front = (!self.front.is_empty()).then(|| ("Pareto front", BLACK.mix(0.3)));
        front.into_iter().chain(self.series.iter().zip(COLOURS.iter().cycle()).map(|(s, c)| (s.name.as_str(), c.to_rgba()))).collect()
    }

    /// Under the picture, where it covers no point: two columns, downwards.
    fn legend<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Result<(), DrawingAreaErrorKind<B::ErrorType>> {
        let names = self.names();
        let down = names.len().div_ceil(2) as i32;
        for (k, (name, colour)) in names.into_iter().enumerate() {
            let (column, row) = (k as i32 / down, k as i32 % down);
            let (x, y) = (90 + column * (SIZE.0 as i32 / 2 - 40), row * ROW + ROW / 2);
            area.draw(&Circle::new((x, y), 5, colour.filled()))?;
            let middle = ("sans-serif", 14).into_font().into_text_style(area).pos(Pos::new(HPos::Left, VPos::Center));
            area.draw(&Text::new(name, (x + 14, y), middle))?;
        }
        Ok(())
    }
}

impl Picture for Figure {
    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Result<()> {
        let failed = failed::<B>;
        area.fill(&WHITE).map_err(failed)?;
        let all = || self.series.iter().flat_map(|s| &s.points);
        let (x, y) = (Log::over(all().map(|p| p.0)), Log::over(all().map(|p| p.1).chain(self.levels.iter().map(|l| l.0))));
        let ends = [x.range().start, x.range().end];
        let (plot, legend) = area.split_vertically(SIZE.1);
        let mut chart = ChartBuilder::on(&plot)
            .caption(&self.title, ("sans-serif", 20))
            .margin(14)
            .x_label_area_size(46)
            .y_label_area_size(64)
            .build_cartesian_2d(x, y)
            .map_err(failed)?;
        chart
            .configure_mesh()
            .x_desc(&self.x)
            .y_desc(&self.y)
            .label_style(("sans-serif", 14))
            .light_line_style(TRANSPARENT)
            .bold_line_style(BLACK.mix(0.12))
            .draw()
            .map_err(failed)?;
        // The front is a staircase: to be better one must pay up to the next point.
        if !self.front.is_empty() {
            let stairs = self.front.windows(2).flat_map(|w| [w[0], (w[1].0, w[0].1)]).chain(self.front.last().copied());
            chart.draw_series(LineSeries::new(stairs, BLACK.mix(0.18).stroke_width(7))).map_err(failed)?;
        }
        for (height, name) in &self.levels {
            chart.draw_series(DashedLineSeries::new(ends.map(|x| (x, *height)), 6, 5, BLACK.mix(0.5).into())).map_err(failed)?;
            let style = ("sans-serif", 13).into_font().color(&BLACK.mix(0.7));
            chart.draw_series([EmptyElement::at((ends[0], *height)) + Text::new(name.clone(), (10, -16), style)]).map_err(failed)?;
        }
        let mut room = Room::default();
        all().for_each(|(x, y, _)| room.mark(chart.backend_coord(&(*x, *y))));
        for (series, colour) in self.series.iter().zip(COLOURS.iter().cycle()) {
            let line = series.points.iter().map(|p| (p.0, p.1));
            chart.draw_series(LineSeries::new(line, colour.stroke_width(2))).map_err(failed)?;
            for (x, y, word) in &series.points {
                let style = ("sans-serif", 12).into_font().color(colour);
                chart.draw_series([EmptyElement::at((*x, *y)) + Circle::new((0, 0), 4, colour.filled())]).map_err(failed)?;
                if let Some(at) = room.place(word, chart.backend_coord(&(*x, *y)), SIZE) {
                    chart.draw_series([EmptyElement::at((*x, *y)) + Text::new(word.clone(), at, style)]).map_err(failed)?;
                }
            }
        }
        self.legend(&legend).map_err(failed)?;
        area.present().map_err(failed)
    }
}
