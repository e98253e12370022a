//! What a chart shows: the front, its table, its picture.

use nerd_model::pick::Setting;
use nerd_sim::prelude::System;
use nerd_train::evaluate::{PassiveConfig, summary};
use serde::{Deserialize, Serialize};

use super::Point;
use super::guest::Against;
use crate::report::Table;
use crate::report::figure::{Axis, Figure, Panel, front, push};
use crate::report::table::{digits, pair};

/// What was measured.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct ChartData {
    pub robot: String,
    pub scene: String,
    pub protocol: PassiveConfig,
    pub reference: String,
    /// Its distance from half its substeps.
    pub reference_error: f64,
    /// Error of the predictor that repeats the start.
    pub hold: f64,
    /// Error of the one that keeps the start's velocity.
    pub glide: f64,
    pub points: Vec<Point>,
    /// What MuJoCo was compared with, if it took part.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mujoco: Option<Against>,
}

/// Marks the points that no other beats in both. Those with a reference of their own are out of the race.
pub(super) fn mark(points: &mut [Point]) {
    for i in 0..points.len() {
        let Point { microseconds: t, error: e, own, .. } = points[i];
        let beaten = |p: &Point| !p.own && p.microseconds <= t && p.error <= e && (p.microseconds < t || p.error < e);
        points[i].front = !own && !points.iter().any(beaten);
    }
}

impl ChartData {
    /// All points.
    pub fn table(&self, system: &System, name: &str) -> Table {
        let rows = self.points.iter().map(|p| {
            vec![
                p.series.clone(),
                p.substeps.map_or_else(|| "-".into(), |n| n.to_string()),
                digits(p.microseconds),
                pair(&summary(system, &p.by_coordinate)),
                p.diverged.to_string(),
                if p.front { "*" } else { "" }.into(),
            ]
        });
        let header = ["solver", "substeps", "us a frame", "error (rad or m)", "diverged", "front"];
        let Self { robot, scene, protocol, reference, .. } = self;
        let mut note = format!("{robot} {scene}, mean |dq| over {} frames, reference: {reference}", protocol.steps);
        if let Some(Against { version, reference, reference_error }) = &self.mujoco {
            let error = reference_error.map_or_else(String::new, |e| format!(", whose own error is {}", digits(e)));
            note += &format!(". MuJoCo {version} is compared with {reference}{error}");
        }
        Table::new(name, &header).with(rows).noted(&(note + "."))
    }

    /// Points by solver, the front, the floor and the reference's own error.
    pub fn figure(&self) -> Figure {
        // What knows less than one who repeats the start is in the table; in the picture it would flatten all the others.
        let shown = || self.points.iter().filter(|p| p.error < 2.0 * self.hold);
        let mut series = vec![front(shown().filter(|p| p.front).map(|p| (p.microseconds, p.error)).collect())];
        shown().for_each(|p| push(&mut series, &p.series, (p.microseconds, p.error, label(p))));
        // A reference far below every solver would only stretch the picture.
        let least = self.points.iter().map(|p| p.error).fold(f64::MAX, f64::min);
        let mut levels = vec![(self.hold, "hold last".to_string())];
        levels.extend((self.reference_error > 0.1 * least).then(|| (self.reference_error, "error of the reference".into())));
        let x = Axis::log("microseconds a frame, one environment, one core");
        let y = Axis::log(format!("mean |dq| over {} frames (rad or m)", self.protocol.steps));
        let title = format!("{}, {}: speed against accuracy (x4: four substeps a frame)", self.robot, self.scene);
        Figure::single(title, Panel { x, y, series, levels, ..Panel::default() })
    }
}

/// A word beside a mark.
fn label(point: &Point) -> String {
    match (&point.setting, point.substeps) {
        (_, Some(n)) => format!("x{n}"),
        (Some(Setting::Neural(folder)), None) => format!("NeRD {}", folder.file_name().unwrap_or_default().to_string_lossy()),
        (setting, None) => setting.as_ref().map_or_else(String::new, ToString::to_string),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_front_is_what_nothing_else_of_the_race_beats() {
        let point = |(microseconds, error, own)| Point {
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
        let mut points = [(4.0, 0.1, false), (1.0, 0.5, false), (2.0, 0.6, false), (0.5, 0.01, true), (1.0, 0.7, false)].map(point);
        mark(&mut points);
        let front = points.map(|p| p.front);
        assert_eq!(front, [true, true, false, false, false], "neither the beaten nor what has a reference of its own");
    }
}
