//! Pictures as SVG: panels in a grid, and one legend below them all.

use std::ops::Range;
use std::path::Path;

use anyhow::{Result, bail};
use plotters::coord::Shift;
use plotters::coord::ranged1d::{AsRangedCoord, ValueFormatter};
use plotters::prelude::*;

use super::write;

/// Height of a line of the legend, and of the title (px).
const ROW: u32 = 22;
const TITLE: u32 = 34;
const FONT: (&str, i32) = ("sans-serif", 13);
/// Okabe and Ito's colours, which the colour-blind tell apart, and for more than seven series black and brown.
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

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Drawn = std::result::Result<(), DrawingAreaErrorKind<<SVGBackend<'static> as DrawingBackend>::ErrorType>>;

#[derive(Clone, Debug, Default)]
pub struct Figure {
    pub title: String,
    pub columns: usize,
    pub panels: Vec<Panel>,
}

#[derive(Clone, Debug, Default)]
pub struct Panel {
    pub title: String,
    pub x: Axis,
    pub y: Axis,
    /// What is drawn, the first at the back.
    pub series: Vec<Series>,
    /// Heights worth a dashed line, with their names.
    pub levels: Vec<(f64, String)>,
}

#[derive(Clone, Debug, Default)]
pub struct Axis {
    pub label: String,
    pub log: bool,
    /// Names of 0, 1, 2, .. in place of numbers.
    pub names: Vec<String>,
}

/// Points that belong together. Series of one name have one colour and one line in the legend.
#[derive(Clone, Debug)]
pub struct Series {
    /// In the legend; without a name it is not there, and grey.
    pub name: String,
    /// x, y, and a word beside the mark.
    pub points: Vec<(f64, f64, String)>,
    pub style: Style,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Style {
    Line,
    Dashed,
    /// A line with a mark at each point.
    Marked,
    /// Bars beside those of the panel's other series.
    Bars,
}

impl Axis {
    pub fn linear(label: impl Into<String>) -> Self {
        Self { label: label.into(), ..Self::default() }
    }

    /// A logarithmic one; what is not above 0 has no place on it.
    pub fn log(label: impl Into<String>) -> Self {
        Self { label: label.into(), log: true, ..Self::default() }
    }

    pub fn named(names: Vec<String>) -> Self {
        Self { names, ..Self::default() }
    }

    fn shows(&self, value: f64) -> bool {
        value.is_finite() && (!self.log || value > 0.0)
    }

    /// Range of all values that it shows, with a little room.
    fn range(&self, values: impl Iterator<Item = f64>) -> Range<f64> {
        if !self.names.is_empty() {
            return -0.6..self.names.len() as f64 - 0.4;
        }
        let (low, high) = values.filter(|v| self.shows(*v)).fold((f64::MAX, f64::MIN), |(a, b), v| (a.min(v), b.max(v)));
        match (low > high, self.log) {
            (true, true) => 0.1..10.0,
            (true, false) => 0.0..1.0,
            // A decade at least, or there would be no tick.
            (false, true) if high / low < 30.0 => {
                10f64.powf(low.log10().floor())..10f64.powf(high.log10().ceil().max(low.log10().floor() + 1.0))
            }
            (false, true) => low / 1.5..high * 1.5,
            (false, false) => {
                let room = if high > low { 0.04 * (high - low) } else { 0.5 * high.abs().max(1e-3) };
                low - room..high + room
            }
        }
    }

    fn tick(&self, value: f64) -> String {
        if !self.names.is_empty() {
            let near = value.round();
            let name = if (value - near).abs() < 0.01 && near >= 0.0 { self.names.get(near as usize) } else { None };
            return name.cloned().unwrap_or_default();
        }
        let plain = value == 0.0 || (1e-3..1e5).contains(&value.abs());
        if plain { format!("{}", (value * 1e6).round() / 1e6) } else { format!("{value:.0e}") }
    }
}

impl Series {
    pub fn new(name: impl Into<String>, style: Style, points: impl IntoIterator<Item = (f64, f64)>) -> Self {
        Self { name: name.into(), style, points: points.into_iter().map(|(x, y)| (x, y, String::new())).collect() }
    }
}

/// One solver at one setting in a picture of speed against accuracy.
pub struct Mark<'a> {
    pub series: &'a str,
    /// Cost and error.
    pub at: (f64, f64),
    pub word: String,
    pub front: bool,
}

/// Which of these (cost, error) no other beats in both; none of what is not in the race.
pub fn unbeaten(race: &[Option<(f64, f64)>]) -> Vec<bool> {
    let beats = |a: (f64, f64), b: (f64, f64)| a.0 <= b.0 && a.1 <= b.1 && (a.0 < b.0 || a.1 < b.1);
    race.iter().map(|own| own.is_some_and(|own| !race.iter().flatten().any(|other| beats(*other, own)))).collect()
}

impl Figure {
    pub fn single(title: String, panel: Panel) -> Self {
        Self { title, columns: 1, panels: vec![panel] }
    }

    /// Error over cost, `axes` their labels: a line a series, and the staircase along the front, on which to be better one must pay up to
    /// the next point.
    pub fn speed<'a>(title: String, axes: [String; 2], marks: impl IntoIterator<Item = Mark<'a>>, levels: Vec<(f64, String)>) -> Self {
        let (mut front, mut series): (Vec<(f64, f64)>, Vec<Series>) = (Vec::new(), Vec::new());
        for Mark { series: name, at, word, front: on } in marks {
            front.extend(on.then_some(at));
            let point = (at.0, at.1, word);
            match series.iter_mut().find(|s| s.name == name) {
                Some(s) => s.points.push(point),
                None => series.push(Series { name: name.into(), points: vec![point], style: Style::Marked }),
            }
        }
        front.sort_by(|a, b| a.0.total_cmp(&b.0));
        let stairs = front.windows(2).flat_map(|w| [w[0], (w[1].0, w[0].1)]).chain(front.last().copied());
        series.insert(0, Series::new("", Style::Line, stairs));
        let [x, y] = axes.map(Axis::log);
        Self::single(title, Panel { x, y, series, levels, ..Panel::default() })
    }

    pub fn save(&self, path: &Path) -> Result<()> {
        write(path, self.svg()?.as_bytes())
    }

    pub fn svg(&self) -> Result<String> {
        let columns = self.columns.clamp(1, self.panels.len().max(1));
        let rows = self.panels.len().div_ceil(columns);
        let (wide, high) = if self.panels.len() == 1 { (1000, 560) } else { (1200 / columns as u32, 280) };
        let names = self.names();
        let legend = names.len().div_ceil(2) as u32 * ROW + 10;
        let mut svg = String::new();
        {
            let area = SVGBackend::with_string(&mut svg, (wide * columns as u32, TITLE + high * rows as u32 + legend)).into_drawing_area();
            let drawn = || -> Drawn {
                area.fill(&WHITE)?;
                let (head, rest) = area.split_vertically(TITLE);
                let (body, foot) = rest.split_vertically(high * rows as u32);
                head.draw(&Text::new(self.title.clone(), (16, 10), ("sans-serif", 18)))?;
                for (panel, part) in self.panels.iter().zip(body.split_evenly((rows, columns))) {
                    panel.draw(&part, &names)?;
                }
                let down = names.len().div_ceil(2);
                for (k, name) in names.iter().enumerate() {
                    let (x, y) = (60 + (k / down) as i32 * (wide as i32 * columns as i32 / 2 - 30), (k % down) as i32 * ROW as i32 + 8);
                    foot.draw(&Circle::new((x, y), 5, colour(&names, name).filled()))?;
                    foot.draw(&Text::new(name.to_string(), (x + 14, y - 5), FONT))?;
                }
                area.present()
            };
            if let Err(error) = drawn() {
                bail!("cannot draw `{}`: {error}", self.title);
            }
        }
        Ok(svg)
    }

    fn names(&self) -> Vec<&str> {
        let mut names: Vec<&str> = Vec::new();
        for series in self.panels.iter().flat_map(|p| &p.series) {
            if !series.name.is_empty() && !names.contains(&series.name.as_str()) {
                names.push(&series.name);
            }
        }
        names
    }
}

fn colour(names: &[&str], name: &str) -> RGBColor {
    names.iter().position(|n| *n == name).map_or(RGBColor(190, 190, 190), |k| COLOURS[k % COLOURS.len()])
}

impl Panel {
    fn draw(&self, area: &Area, names: &[&str]) -> Drawn {
        let all = || self.series.iter().flat_map(|s| &s.points);
        let (x, y) = (self.x.range(all().map(|p| p.0)), self.y.range(all().map(|p| p.1).chain(self.levels.iter().map(|l| l.0))));
        match (self.x.log, self.y.log) {
            (false, false) => self.on(area, names, x.clone(), y.clone(), (x, y)),
            (false, true) => self.on(area, names, x.clone(), y.clone().log_scale(), (x, y)),
            (true, false) => self.on(area, names, x.clone().log_scale(), y.clone(), (x, y)),
            (true, true) => self.on(area, names, x.clone().log_scale(), y.clone().log_scale(), (x, y)),
        }
    }

    fn on<X, Y>(&self, area: &Area, names: &[&str], across: X, up: Y, (x, y): (Range<f64>, Range<f64>)) -> Drawn
    where
        X: AsRangedCoord<Value = f64>,
        Y: AsRangedCoord<Value = f64>,
        X::CoordDescType: ValueFormatter<f64>,
        Y::CoordDescType: ValueFormatter<f64>,
    {
        let mut builder = ChartBuilder::on(area);
        builder.margin(10).x_label_area_size(38).y_label_area_size(64);
        if !self.title.is_empty() {
            builder.caption(&self.title, ("sans-serif", 14));
        }
        let mut chart = builder.build_cartesian_2d(across, up)?;
        let (tick_x, tick_y) = (|v: &f64| self.x.tick(*v), |v: &f64| self.y.tick(*v));
        let mut mesh = chart.configure_mesh();
        mesh.x_desc(&self.x.label).y_desc(&self.y.label).label_style(FONT).x_label_formatter(&tick_x).y_label_formatter(&tick_y);
        mesh.x_labels(if self.x.names.is_empty() { 8 } else { 2 * self.x.names.len() });
        mesh.light_line_style(TRANSPARENT).bold_line_style(BLACK.mix(0.12)).draw()?;
        for (height, name) in &self.levels {
            let ends = [(x.start, *height), (x.end, *height)];
            chart.draw_series(DashedLineSeries::new(ends, 6, 5, BLACK.mix(0.5).into()))?;
            chart.draw_series([EmptyElement::at(ends[0]) + Text::new(name.clone(), (10, -16), FONT.into_font().color(&BLACK.mix(0.7)))])?;
        }
        let bars = self.series.iter().filter(|s| s.style == Style::Bars).count() as f64;
        let mut bar = 0.0;
        for series in &self.series {
            let colour = colour(names, &series.name);
            let shown = || series.points.iter().filter(|p| self.x.shows(p.0) && self.y.shows(p.1));
            let points: Vec<(f64, f64)> = shown().map(|p| (p.0, p.1)).collect();
            let width = if series.name.is_empty() { 5 } else { 2 };
            match series.style {
                Style::Line | Style::Marked => drop(chart.draw_series(LineSeries::new(points, colour.stroke_width(width)))?),
                Style::Dashed => drop(chart.draw_series(DashedLineSeries::new(points, 6, 5, colour.stroke_width(2)))?),
                Style::Bars => {
                    let left = |x: f64| x - 0.4 + 0.8 * bar / bars;
                    let rectangle =
                        |p: &(f64, f64)| Rectangle::new([(left(p.0), y.start), (left(p.0) + 0.75 / bars, p.1)], colour.filled());
                    chart.draw_series(points.iter().map(rectangle))?;
                    bar += 1.0;
                }
            }
            if series.style == Style::Marked {
                for (x, y, word) in shown() {
                    let text = Text::new(word.clone(), (6, -14), ("sans-serif", 12).into_font().color(&colour));
                    chart.draw_series([EmptyElement::at((*x, *y)) + Circle::new((0, 0), 4, colour.filled()) + text])?;
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::unbeaten;

    #[test]
    fn the_front_is_what_nothing_else_of_the_race_beats() {
        let race = [Some((4.0, 0.1)), Some((1.0, 0.5)), Some((2.0, 0.6)), None, Some((1.0, 0.7))];
        assert_eq!(unbeaten(&race), [true, true, false, false, false], "neither the beaten nor what is not in the race");
    }
}
