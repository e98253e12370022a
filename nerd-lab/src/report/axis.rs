//! A logarithmic axis whose ticks do not crowd, and labels that do not cover one another.

use std::ops::Range;

use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};

/// Ticks on an axis, at most.
const TICKS: usize = 8;

/// A logarithmic axis.
#[derive(Clone, Debug)]
pub struct Log(Range<f64>);

impl Log {
    /// From one value above 0 to another.
    pub fn new(low: f64, high: f64) -> Self {
        let low = if low > 0.0 { low } else { f64::MIN_POSITIVE };
        Self(low..high.max(1.01 * low))
    }

    /// Over all values above 0, with a little room; over one decade to either side of 1 if there are none.
    pub fn over(values: impl IntoIterator<Item = f64>) -> Self {
        let above = values.into_iter().filter(|v| *v > 0.0 && v.is_finite());
        let (low, high) = above.fold((f64::MAX, 0.0_f64), |(a, b), v| (a.min(v), b.max(v)));
        let room = (high / low).powf(0.07).max(1.25);
        if low > high { Self::new(0.1, 10.0) } else { Self::new(low / room, high * room) }
    }

    /// Ticks: the finest of all digits, of 1, 2 and 5, of decades and of every so many decades that are not too many.
    fn ticks(&self) -> Vec<f64> {
        let Range { start, end } = self.0;
        let decades = start.log10().floor() as i32..=end.log10().ceil() as i32;
        let of = |digits: &[i32], every: i32| -> Vec<f64> {
            let powers = decades.clone().filter(|p| p.rem_euclid(every) == 0);
            let all = powers.flat_map(|p| digits.iter().map(move |d| format!("{d}e{p}").parse().unwrap_or(f64::NAN)));
            all.filter(|v| self.0.contains(v)).collect()
        };
        let digits: [&[i32]; 4] = [&[1, 2, 3, 4, 5, 6, 7, 8, 9], &[1, 2, 5], &[1, 3], &[1]];
        let sets = digits.iter().map(|d| of(d, 1)).chain((2..).map(|every| of(&[1], every)));
        sets.into_iter().find(|ticks| ticks.len() <= TICKS).unwrap_or_default()
    }
}

impl Ranged for Log {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        let Range { start, end } = self.0;
        let along = (value.max(f64::MIN_POSITIVE) / start).ln() / (end / start).ln();
        limit.0 + (along * f64::from(limit.1 - limit.0)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, _hint: Hint) -> Vec<f64> {
        self.ticks()
    }

    fn range(&self) -> Range<f64> {
        self.0.clone()
    }
}

impl ValueFormatter<f64> for Log {
    fn format_ext(&self, v: &f64) -> String {
        let plain = self.0.start >= 1e-3 && self.0.end <= 1e5;
        if plain || *v == 1.0 { format!("{}", (v * 1e4).round() / 1e4) } else { format!("{v:.0e}") }
    }
}

/// Where there is room for labels beside marks (px).
#[derive(Debug, Default)]
pub(super) struct Room(Vec<[i32; 4]>);

impl Room {
    /// Nothing may cover a mark.
    pub(super) fn mark(&mut self, (x, y): (i32, i32)) {
        self.0.push([x - 4, y - 4, x + 4, y + 4]);
    }

    /// Where the upper left corner of `word` may be, from the mark at (x, y), if there is room within a picture of this size.
    pub(super) fn place(&mut self, word: &str, (x, y): (i32, i32), size: (u32, u32)) -> Option<(i32, i32)> {
        let (w, h) = (6 * word.chars().count() as i32 + 2, 11);
        let places = [(6, -14), (-6 - w, -14), (6, 3), (-6 - w, 3), (-w / 2, -19), (-w / 2, 8)];
        let boxed = |(dx, dy): (i32, i32)| [x + dx, y + dy, x + dx + w, y + dy + h];
        let apart = |a: &[i32; 4], b: &[i32; 4]| a[2] <= b[0] || b[2] <= a[0] || a[3] <= b[1] || b[3] <= a[1];
        let fits = |b: &[i32; 4]| b[0] >= 0 && b[1] >= 0 && b[2] <= size.0 as i32 && b[3] <= size.1 as i32;
        let found = places.into_iter().find(|at| fits(&boxed(*at)) && self.0.iter().all(|other| apart(other, &boxed(*at))))?;
        self.0.push(boxed(found));
        Some(found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_axis_has_a_few_ticks_whatever_its_range() {
        for (low, high) in [(1.0, 1.7), (2.0, 900.0), (1e-9, 1e3), (3.0, 40.0), (1e-30, 1e30), (0.05, 0.4)] {
            let ticks = Log::new(low, high).ticks();
            assert!((1..=TICKS).contains(&ticks.len()), "{} ticks from {low} to {high}", ticks.len());
            assert!(ticks.iter().all(|t| (low..high).contains(t)), "{ticks:?} from {low} to {high}");
        }
    }

    #[test]
    fn labels_of_marks_on_one_spot_do_not_cover_one_another() {
        let mut room = Room::default();
        let marks = [(100, 100), (101, 100), (102, 101)];
        marks.into_iter().for_each(|m| room.mark(m));
        let placed: Vec<_> = marks.iter().map(|m| room.place("x64", *m, (400, 400))).collect();
        assert!(placed.iter().all(Option::is_some), "{placed:?}");
        let crowd: Vec<_> = (0..20).filter_map(|_| room.place("x64", (100, 100), (400, 400))).collect();
        assert!(crowd.len() < 20, "twenty more labels at one spot, and none is left out");
    }
}
