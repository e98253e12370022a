//! Contents of a figure: panels in a grid, each with axes and series. `draw.rs` renders it as SVG.

use std::ops::Range;

use itertools::Itertools;

#[derive(Clone, Debug, Default)]
pub struct Figure {
    pub title: String,
    pub columns: usize,
    pub panels: Vec<Panel>,
}

#[derive(Clone, Debug, Default)]
pub struct Panel {
    pub x: Axis,
    pub y: Axis,
    /// Series in drawing order: later ones cover earlier ones.
    pub series: Vec<Series>,
    /// Dashed horizontal lines, as (y, name).
    pub levels: Vec<(f64, String)>,
}

#[derive(Clone, Debug, Default)]
pub struct Axis {
    pub label: String,
    pub log: bool,
}

/// A line through points. Series with equal names share a colour and a legend entry.
#[derive(Clone, Debug)]
pub struct Series {
    /// An empty name makes a grey series without legend entry.
    pub name: String,
    pub points: Vec<Point>,
    pub style: Style,
}

#[derive(Clone, Debug)]
pub struct Point {
    pub x: f64,
    pub y: f64,
    /// Text beside the point's mark.
    pub label: String,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Style {
    Line,
    Dashed,
    /// A line with a mark and a label at each point.
    Marked,
}

/// Point of a solver at one setting, in a figure of error against cost.
pub struct Mark<'a> {
    pub series: &'a str,
    pub cost: f64,
    pub error: f64,
    pub label: String,
    /// Whether the mark is on the Pareto front ([`unbeaten`]).
    pub front: bool,
}

impl Figure {
    pub fn single(title: String, panel: Panel) -> Self {
        Self { title, columns: 1, panels: vec![panel] }
    }

    pub fn lines(title: String, [x, y]: [Axis; 2], series: Vec<Series>) -> Self {
        Self::single(title, Panel { x, y, series, ..Panel::default() })
    }

    /// Plots error against cost, both logarithmic; `axes` labels them. Each series is a line; a grey staircase connects
    /// the Pareto front.
    pub fn speed<'a>(
        title: String,
        axes: [String; 2],
        marks: impl IntoIterator<Item = Mark<'a>>,
        levels: Vec<(f64, String)>,
    ) -> Self {
        let mut front: Vec<(f64, f64)> = Vec::new();
        let mut series: Vec<Series> = Vec::new();
        for mark in marks {
            front.extend(mark.front.then_some((mark.cost, mark.error)));
            let point = Point { x: mark.cost, y: mark.error, label: mark.label };
            match series.iter_mut().find(|s| s.name == mark.series) {
                Some(s) => s.points.push(point),
                None => series.push(Series { name: mark.series.into(), points: vec![point], style: Style::Marked }),
            }
        }
        front.sort_by(|a, b| a.0.total_cmp(&b.0));
        let steps = front.windows(2).flat_map(|w| [w[0], (w[1].0, w[0].1)]).chain(front.last().copied());
        series.insert(0, Series::new("", Style::Line, steps));
        let [x, y] = axes.map(Axis::log);
        Self::single(title, Panel { x, y, series, levels })
    }

    /// Distinct names of series, for the legend.
    pub(super) fn names(&self) -> Vec<&str> {
        let names = self.panels.iter().flat_map(|panel| &panel.series).map(|series| series.name.as_str());
        names.filter(|name| !name.is_empty()).unique().collect()
    }
}

impl Series {
    pub fn new(name: impl Into<String>, style: Style, points: impl IntoIterator<Item = (f64, f64)>) -> Self {
        let points = points.into_iter().map(|(x, y)| Point { x, y, label: String::new() }).collect();
        Self { name: name.into(), style, points }
    }
}

impl Axis {
    pub fn linear(label: impl Into<String>) -> Self {
        Self { label: label.into(), ..Self::default() }
    }

    /// Makes a logarithmic axis: values not above 0 are omitted.
    pub fn log(label: impl Into<String>) -> Self {
        Self { label: label.into(), log: true }
    }

    pub(super) fn shows(&self, value: f64) -> bool {
        value.is_finite() && (!self.log || value > 0.0)
    }

    /// Returns the range of the shown `values`, with a margin.
    pub(super) fn range(&self, values: impl Iterator<Item = f64>) -> Range<f64> {
        let (low, high) =
            values.filter(|v| self.shows(*v)).fold((f64::MAX, f64::MIN), |(a, b), v| (a.min(v), b.max(v)));
        let none = low > high;
        match (none, self.log) {
            (true, true) => 0.1..10.0,
            (true, false) => 0.0..1.0,
            // Extends a narrow range to whole decades, at least one, since ticks are at powers of ten.
            (false, true) if high / low < 30.0 => {
                10f64.powf(low.log10().floor())..10f64.powf(high.log10().ceil().max(low.log10().floor() + 1.0))
            }
            (false, true) => low / 1.5..high * 1.5,
            (false, false) => {
                let margin = if high > low { 0.04 * (high - low) } else { 0.5 * high.abs().max(1e-3) };
                low - margin..high + margin
            }
        }
    }

    pub(super) fn tick(&self, value: f64) -> String {
        let plain = value == 0.0 || (1e-3..1e5).contains(&value.abs());
        if plain { format!("{}", (value * 1e6).round() / 1e6) } else { format!("{value:.0e}") }
    }
}

/// Marks the Pareto front of (cost, error). An entry is on it if no other is at most as large in both and smaller in
/// one. `None` is never on it.
pub fn unbeaten(race: &[Option<(f64, f64)>]) -> Vec<bool> {
    let beats = |a: (f64, f64), b: (f64, f64)| a.0 <= b.0 && a.1 <= b.1 && (a.0 < b.0 || a.1 < b.1);
    race.iter().map(|own| own.is_some_and(|own| !race.iter().flatten().any(|other| beats(*other, own)))).collect()
}

#[cfg(test)]
mod tests {
    use super::unbeaten;

    #[test]
    fn the_front_is_what_nothing_else_of_the_race_beats() {
        let race = [Some((4.0, 0.1)), Some((1.0, 0.5)), Some((2.0, 0.6)), None, Some((1.0, 0.7))];
        assert_eq!(
            unbeaten(&race),
            [true, true, false, false, false],
            "neither the beaten nor what is not in the race"
        );
    }
}
