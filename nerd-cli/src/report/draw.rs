//! Draws a [`Figure`] as SVG: a title, panels in a grid, and one legend below them.

use std::ops::Range;

use plotters::coord::ranged1d::{AsRangedCoord, ValueFormatter};
use plotters::{coord::Shift, prelude::*};

use crate::prelude::*;

/// Height of the title (px).
const TITLE: u32 = 34;
/// Height of a line in the legend (px).
const LEGEND_LINE: u32 = 22;
/// Font of axes, levels and legend, with its size (px).
const FONT: (&str, i32) = ("sans-serif", 13);
/// Colours of named series, in order. They are Okabe and Ito's, which colour-blind readers can tell apart, without
/// yellow, and a grey and a brown.
const COLOURS: [RGBColor; 9] = [
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
/// Colour of series without a name.
const UNNAMED: RGBColor = RGBColor(190, 190, 190);

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Chart<'a, 'b, X, Y> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<X, Y>>;
type Drawn = Result<(), DrawingAreaErrorKind<<SVGBackend<'static> as DrawingBackend>::ErrorType>>;

impl Figure {
    pub fn save(&self, path: &Path) -> Result<()> {
        write(path, self.svg()?.as_bytes())
    }

    pub fn svg(&self) -> Result<String> {
        let columns = self.columns.clamp(1, self.panels.len().max(1));
        let rows = self.panels.len().div_ceil(columns);
        // Sizes of one panel and of all panels (px).
        let (panel_width, panel_height) =
            if self.panels.len() == 1 { (1000, 560) } else { (1200 / columns as u32, 280) };
        let (width, height) = (panel_width * columns as u32, panel_height * rows as u32);
        let names = self.names();
        let legend_height = names.len().div_ceil(2) as u32 * LEGEND_LINE + 10;
        let mut svg = String::new();
        let area = SVGBackend::with_string(&mut svg, (width, TITLE + height + legend_height)).into_drawing_area();
        let draw = || -> Drawn {
            area.fill(&WHITE)?;
            let (title, below) = area.split_vertically(TITLE);
            let (panels, legend) = below.split_vertically(height);
            title.draw(&Text::new(self.title.clone(), (16, 10), ("sans-serif", 18)))?;
            for (panel, area) in self.panels.iter().zip(panels.split_evenly((rows, columns))) {
                panel.draw(&area, &names)?;
            }
            draw_legend(&legend, &names, width)?;
            area.present()
        };
        if let Err(error) = draw() {
            bail!("cannot draw `{}`: {error}", self.title);
        }
        drop(area);
        Ok(svg)
    }
}

/// Draws the series names in two columns, over `width` (px).
fn draw_legend(area: &Area, names: &[&str], width: u32) -> Drawn {
    let lines = names.len().div_ceil(2);
    for (k, name) in names.iter().enumerate() {
        let x = 60 + (k / lines) as i32 * (width as i32 / 2 - 30);
        let y = (k % lines) as i32 * LEGEND_LINE as i32 + 8;
        area.draw(&Circle::new((x, y), 5, colour(names, name).filled()))?;
        area.draw(&Text::new(name.to_string(), (x + 14, y - 5), FONT))?;
    }
    Ok(())
}

/// Colour of the series `name`, by its place in `names`.
fn colour(names: &[&str], name: &str) -> RGBColor {
    names.iter().position(|n| *n == name).map_or(UNNAMED, |k| COLOURS[k % COLOURS.len()])
}

impl Panel {
    fn draw(&self, area: &Area, names: &[&str]) -> Drawn {
        let points = || self.series.iter().flat_map(|s| &s.points);
        let x = self.x.range(points().map(|p| p.x));
        let y = self.y.range(points().map(|p| p.y).chain(self.levels.iter().map(|l| l.0)));
        // Calls `draw_on` for each combination of scales, which has its own type.
        match (self.x.log, self.y.log) {
            (false, false) => self.draw_on(area, names, x.clone(), y, x),
            (false, true) => self.draw_on(area, names, x.clone(), y.log_scale(), x),
            (true, false) => self.draw_on(area, names, x.clone().log_scale(), y, x),
            (true, true) => self.draw_on(area, names, x.clone().log_scale(), y.log_scale(), x),
        }
    }

    /// Draws axes, levels and series. `across` and `up` are the scales of the axes, linear or logarithmic. `x` is the
    /// range of the horizontal axis, over which levels are drawn.
    fn draw_on<X, Y>(&self, area: &Area, names: &[&str], across: X, up: Y, x: Range<f64>) -> Drawn
    where
        X: AsRangedCoord<Value = f64>,
        Y: AsRangedCoord<Value = f64>,
        X::CoordDescType: ValueFormatter<f64>,
        Y::CoordDescType: ValueFormatter<f64>,
    {
        let mut builder = ChartBuilder::on(area);
        builder.margin(10).x_label_area_size(38).y_label_area_size(64);
        let mut chart = builder.build_cartesian_2d(across, up)?;
        let tick_x = |v: &f64| self.x.tick(*v);
        let tick_y = |v: &f64| self.y.tick(*v);
        let mut mesh = chart.configure_mesh();
        mesh.x_desc(&self.x.label)
            .y_desc(&self.y.label)
            .label_style(FONT)
            .x_label_formatter(&tick_x)
            .y_label_formatter(&tick_y);
        mesh.x_labels(8);
        mesh.light_line_style(TRANSPARENT).bold_line_style(BLACK.mix(0.12)).draw()?;
        for (height, name) in &self.levels {
            let ends = [(x.start, *height), (x.end, *height)];
            chart.draw_series(DashedLineSeries::new(ends, 6, 5, BLACK.mix(0.5).into()))?;
            chart
                .draw_series([EmptyElement::at(ends[0])
                    + Text::new(name.clone(), (10, -16), FONT.into_font().color(&BLACK.mix(0.7)))])?;
        }
        self.draw_series(&mut chart, names)
    }

    fn draw_series<X, Y>(&self, chart: &mut Chart<X, Y>, names: &[&str]) -> Drawn
    where
        X: Ranged<ValueType = f64>,
        Y: Ranged<ValueType = f64>,
    {
        for series in &self.series {
            let colour = colour(names, &series.name);
            let shown = || series.points.iter().filter(|p| self.x.shows(p.x) && self.y.shows(p.y));
            let points = shown().map(|p| (p.x, p.y));
            let width = if series.name.is_empty() { 5 } else { 2 };
            if series.style == Style::Dashed {
                chart.draw_series(DashedLineSeries::new(points, 6, 5, colour.stroke_width(2)))?;
            } else {
                chart.draw_series(LineSeries::new(points, colour.stroke_width(width)))?;
            }
            if series.style == Style::Marked {
                for point in shown() {
                    let label = Text::new(point.label.clone(), (6, -14), ("sans-serif", 12).into_font().color(&colour));
                    let mark = EmptyElement::at((point.x, point.y)) + Circle::new((0, 0), 4, colour.filled()) + label;
                    chart.draw_series([mark])?;
                }
            }
        }
        Ok(())
    }
}
