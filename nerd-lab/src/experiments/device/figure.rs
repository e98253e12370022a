//! The picture of a robot's settings.

use super::Pace;
use crate::report::plot::{Figure, Series};

/// Error against time, by solver, and the front.
pub(super) fn figure(paces: &[&Pace], environments: usize) -> Figure {
    let mut series: Vec<Series> = Vec::new();
    let mut front = Vec::new();
    for pace in paces {
        // What has no error to draw, or one of a rollout that left, stands in the table.
        let Some((time, error)) = pace.microseconds().zip(pace.errors[1]).filter(|(_, e)| *e > 0.0 && *e < 10.0) else { continue };
        let mark = (time, error, pace.label.clone());
        if pace.front {
            front.push((time, error));
        }
        match series.last_mut().filter(|s| s.name == pace.series) {
            Some(known) => known.points.push(mark),
            None => series.push(Series { name: pace.series.clone(), points: vec![mark] }),
        }
    }
    front.sort_by(|a, b| a.0.total_cmp(&b.0));
    let of = paces.first().map_or("", |p| &p.of);
    Figure {
        title: format!("{of} on a GPU: speed against accuracy (x4: four substeps a frame)"),
        x: format!("microseconds a frame and environment, of {environments}"),
        y: format!("mean |dq| over {} frames (rad or m)", super::pace::FRAMES),
        series,
        front,
        levels: Vec::new(),
    }
}
