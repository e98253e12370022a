//! Pictures as SVG and PNG; among them log-log ones: series of labelled points, a front, dashed levels.

use std::path::Path;

use anyhow::{Context, Result, anyhow};
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::{FontStyle, register_font};

/// Width and height (px).
const SIZE: (u32, u32) = (1000, 640);
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
    /// x, y and a word beside the mark.
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
    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Result<()>;
}

/// Writes a picture as `stem`.svg and `stem`.png.
pub fn save(stem: &Path, size: (u32, u32), picture: &impl Picture) -> Result<()> {
    register_font("sans-serif", FontStyle::Normal, dejavu::sans::regular()).map_err(|_| anyhow!("the built-in font cannot be read"))?;
    let mut svg = String::new();
    picture.draw(&SVGBackend::with_string(&mut svg, size).into_drawing_area())?;
    crate::files::write(&stem.with_extension("svg"), svg.as_bytes())?;
    let folder = tempfile::tempdir().context("cannot make a temporary folder")?;
    let png = folder.path().join("picture.png");
    picture.draw(&BitMapBackend::new(&png, size).into_drawing_area())?;
    crate::files::write(&stem.with_extension("png"), &std::fs::read(&png).context("cannot read the picture back")?)
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
    pub fn save(&self, stem: &Path) -> Result<()> {
        save(stem, SIZE, self)
    }
}

impl Picture for Figure {
    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Result<()> {
        let failed = |e: DrawingAreaErrorKind<B::ErrorType>| anyhow!("cannot draw: {e}");
        area.fill(&WHITE).map_err(failed)?;
        let all = || self.series.iter().flat_map(|s| &s.points);
        let (x, y) = (decades(all().map(|p| p.0)), decades(all().map(|p| p.1).chain(self.levels.iter().map(|l| l.0))));
        let mut chart = ChartBuilder::on(area)
            .caption(&self.title, ("sans-serif", 20))
            .margin(14)
            .x_label_area_size(46)
            .y_label_area_size(64)
            .build_cartesian_2d((x.0..x.1).log_scale(), (y.0..y.1).log_scale())
            .map_err(failed)?;
        chart
            .configure_mesh()
            .x_desc(&self.x)
            .y_desc(&self.y)
            .label_style(("sans-serif", 14))
            .light_line_style(BLACK.mix(0.04))
            .bold_line_style(BLACK.mix(0.12))
            .x_label_formatter(&|v| power(*v))
            .y_label_formatter(&|v| power(*v))
            .draw()
            .map_err(failed)?;
        // The front is a staircase: to be better one must pay up to the next point.
        if !self.front.is_empty() {
            let stairs = self.front.windows(2).flat_map(|w| [w[0], (w[1].0, w[0].1)]).chain(self.front.last().copied());
            let band = chart.draw_series(LineSeries::new(stairs, BLACK.mix(0.18).stroke_width(7))).map_err(failed)?;
            band.label("Pareto front").legend(|(x, y)| PathElement::new([(x, y), (x + 22, y)], BLACK.mix(0.18).stroke_width(7)));
        }
        for (height, name) in &self.levels {
            chart.draw_series(DashedLineSeries::new([(x.0, *height), (x.1, *height)], 6, 5, BLACK.mix(0.5).into())).map_err(failed)?;
            let style = ("sans-serif", 13).into_font().color(&BLACK.mix(0.7));
            chart.draw_series([Text::new(name.clone(), (x.0 * 1.1, *height * 1.25), style)]).map_err(failed)?;
        }
        for (series, colour) in self.series.iter().zip(COLOURS.iter().cycle()) {
            let line = series.points.iter().map(|p| (p.0, p.1));
            chart.draw_series(LineSeries::new(line, colour.stroke_width(2))).map_err(failed)?;
            let marks = series.points.iter().map(|(x, y, word)| {
                let style = ("sans-serif", 12).into_font().color(colour);
                EmptyElement::at((*x, *y)) + Circle::new((0, 0), 4, colour.filled()) + Text::new(word.clone(), (6, -14), style)
            });
            let drawn = chart.draw_series(marks).map_err(failed)?;
            drawn.label(&series.name).legend(move |(x, y)| Circle::new((x + 11, y), 5, colour.filled()));
        }
        chart
            .configure_series_labels()
            .position(corner(&self.series, x, y))
            .label_font(("sans-serif", 14))
            .background_style(WHITE.mix(0.85))
            .border_style(BLACK.mix(0.2))
            .draw()
            .map_err(failed)?;
        area.present().map_err(failed)
    }
}

/// The range of positive values with a little room.
fn decades(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let (low, high) = values.filter(|v| *v > 0.0).fold((f64::MAX, f64::MIN_POSITIVE), |(a, b), v| (a.min(v), b.max(v)));
    (low / 2.0, high * 4.0)
}

/// The lower or upper corner with the fewest points, for the legend.
fn corner(series: &[Series], x: (f64, f64), y: (f64, f64)) -> SeriesLabelPosition {
    let share = |v: f64, range: (f64, f64)| (v / range.0).ln() / (range.1 / range.0).ln();
    let inside = |left: bool, low: bool| {
        let near = |v: f64, first: bool, room: f64| if first { v < room } else { v > 1.0 - room };
        let points = series.iter().flat_map(|s| &s.points);
        points.filter(|p| near(share(p.0, x), left, 0.4) && near(share(p.1, y), low, 0.33)).count()
    };
    let corners = [
        (inside(true, true), SeriesLabelPosition::LowerLeft),
        (inside(false, false), SeriesLabelPosition::UpperRight),
        (inside(false, true), SeriesLabelPosition::LowerRight),
        (inside(true, false), SeriesLabelPosition::UpperLeft),
    ];
    corners.into_iter().min_by_key(|c| c.0).map_or(SeriesLabelPosition::LowerLeft, |c| c.1)
}

fn power(v: f64) -> String {
    if (0.05..20_000.0).contains(&v) { format!("{}", (v * 100.0).round() / 100.0) } else { format!("{v:.0e}") }
}
