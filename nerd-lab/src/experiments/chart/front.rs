//! Which solvers are worth their time: the Pareto front.

use super::Point;

/// Marks the points that no other beats in both. Those with a reference of their own are out of the race.
pub(super) fn mark(points: &mut [Point]) {
    for i in 0..points.len() {
        let Point { microseconds: t, error: e, own, .. } = points[i];
        let beaten = |p: &Point| !p.own && p.microseconds <= t && p.error <= e && (p.microseconds < t || p.error < e);
        points[i].front = !own && !points.iter().any(beaten);
    }
}

/// The marked points by time.
pub(super) fn stairs<'a>(points: impl Iterator<Item = &'a Point>) -> Vec<(f64, f64)> {
    let mut front: Vec<_> = points.filter(|p| p.front).map(|p| (p.microseconds, p.error)).collect();
    front.sort_by(|a, b| a.0.total_cmp(&b.0));
    front
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_front_is_what_nothing_else_of_the_race_beats() {
        let point = |microseconds: f64, error: f64, own: bool| Point {
            series: String::new(),
            setting: None,
            substeps: None,
            microseconds,
            error,
            by_coordinate: Vec::new(),
            diverged: 0,
            front: false,
            own,
        };
        let mut points =
            [(4.0, 0.1, false), (1.0, 0.5, false), (2.0, 0.6, false), (0.5, 0.01, true), (1.0, 0.7, false)].map(|p| point(p.0, p.1, p.2));
        mark(&mut points);
        assert_eq!(stairs(points.iter()), [(1.0, 0.5), (4.0, 0.1)], "neither the beaten nor what has a reference of its own");
    }
}
