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
