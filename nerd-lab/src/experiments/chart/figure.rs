//! The picture of a chart.

use nerd_model::pick::Setting;

use super::{ChartData, Point, front};
use crate::report::plot::{Figure, Series};

/// Points by solver, the front, the floor and the reference's own error.
pub(super) fn figure(data: &ChartData) -> Figure {
    // What knows less than one who repeats the start stands in the table; in the picture it would flatten all the others.
    let shown = || data.points.iter().filter(|p| p.error < 2.0 * data.hold);
    let mut series: Vec<Series> = Vec::new();
    for p in shown() {
        let mark = (p.microseconds, p.error, label(p));
        match series.last_mut().filter(|s| s.name == p.series) {
            Some(s) => s.points.push(mark),
            None => series.push(Series { name: p.series.clone(), points: vec![mark] }),
        }
    }
    // A reference far below every solver would only stretch the picture.
    let least = data.points.iter().map(|p| p.error).fold(f64::MAX, f64::min);
    let mut levels = vec![(data.hold, "hold last".to_string())];
    if data.reference_error > 0.1 * least {
        levels.push((data.reference_error, "error of the reference".into()));
    }
    Figure {
        title: format!("{}, {}: speed against accuracy (x4: four substeps a frame)", data.robot, data.scene),
        x: "microseconds a frame, one environment, one core".into(),
        y: format!("mean |dq| over {} frames (rad or m)", data.protocol.steps),
        series,
        front: front::stairs(shown()),
        levels,
    }
}

/// What stands beside a mark.
fn label(point: &Point) -> String {
    match (&point.setting, point.substeps) {
        (_, Some(n)) => format!("x{n}"),
        (Some(Setting::Neural(folder)), None) => format!("NeRD {}", folder.file_name().unwrap_or_default().to_string_lossy()),
        (setting, None) => setting.as_ref().map_or_else(String::new, ToString::to_string),
    }
}
