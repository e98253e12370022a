//! Checks measurements: velocities that contradict the poses, free fall that is not gravity.

use super::data::{Log, LogError, bad};
use super::read::{Moment, Raw};
use super::spec::{Axes, LogSpec, Order};
use super::tidy::rate;
use crate::internal::*;
use crate::table::Place;

/// Relative error above which measured velocities are refused as contradicting the poses, or a free fall as
/// contradicting gravity.
const MAX_RELATIVE_ERROR: f64 = 0.5;
/// Largest relative change of a velocity from one row to the next that counts as steady.
const MAX_STEADY_CHANGE: f64 = 0.3;
/// Relative error of measured velocities, against differences of the poses, above which the error is noted.
const NOTED_VELOCITY_ERROR: f64 = 0.15;
/// Relative error of free fall above which it is noted, and of angular velocity above which other axes are proposed.
const MIN_NOTED_ERROR: f64 = 0.01;
/// Number of rows up to which all velocities are checked.
const MAX_CHECKED_ROWS: usize = 100_000;
/// Least duration (s) and number of frames of a flight for measuring free fall.
const MIN_FLIGHT: (f64, usize) = (0.08, 8);
/// Frame time (s) above which a contact may go unnoticed between frames.
const MAX_FRAME_TIME: f64 = 0.02;
/// Least distance (m) from every surface in free flight.
const MIN_CLEARANCE: f64 = 0.005;
/// Relative difference of an acceleration from gravity above which a body does not fall freely.
const MAX_FALL_DIFFERENCE: f64 = 0.5;
/// Ratios of measured to expected values (or their inverses) that indicate a wrong unit.
const UNITS: [(f64, &str); 6] = [
    (std::f64::consts::PI / 180.0, "degrees taken for radians"),
    (180.0 / std::f64::consts::PI, "radians taken for degrees"),
    (1000.0, "a factor of 1000"),
    (1e-3, "a factor of 1000"),
    (100.0, "a factor of 100"),
    (0.01, "a factor of 100"),
];

/// The wrong unit indicated by a factor, if any.
fn unit(factor: f64) -> Option<&'static str> {
    UNITS.iter().find(|(f, _)| (factor / f).ln().abs() < 0.2).map(|u| u.1)
}

/// Pairs of consecutive rows; of very many rows, an even subset.
fn pairs(raw: &[Raw]) -> impl Iterator<Item = (&Moment, &Moment)> {
    let rows: usize = raw.iter().map(|r| r.moments.len()).sum();
    let all = raw.iter().flat_map(|r| r.moments.windows(2).map(|pair| (&pair[0], &pair[1])));
    all.step_by((rows / MAX_CHECKED_ROWS).max(1))
}

/// Compares measured velocities, averaged over two consecutive rows, with the velocity between the poses of these rows.
/// Returns the median error, relative to the median magnitude of the velocity between poses, and the best-fitting
/// factor on measured velocities. Only the fastest quarter counts, since velocities at rest are noise. Velocities that
/// change much between the two rows are skipped, since the time of the change is unknown.
fn misfit(rates: impl Iterator<Item = (Vector3<f64>, [Vector3<f64>; 2])>) -> Option<[f64; 2]> {
    let (mut off, mut size, mut product, mut square) = (Vec::new(), Vec::new(), 0.0, 0.0);
    let steady = rates
        .filter(|(_, [a, b])| (a - b).norm() <= MAX_STEADY_CHANGE * (a + b).norm() / 2.0)
        .map(|(found, [a, b])| (found, (a + b) / 2.0));
    let mut all: Vec<_> = steady.filter(|(found, measured)| (found + measured).iter().all(|x| x.is_finite())).collect();
    all.sort_by(|a, b| (b.0.norm() * b.1.norm()).total_cmp(&(a.0.norm() * a.1.norm())));
    all.truncate(all.len().div_ceil(4));
    for (found, measured) in all {
        off.push((found - measured).norm());
        size.push(found.norm());
        (product, square) = (product + found.dot(&measured), square + measured.norm_squared());
    }
    let size = median(&mut size).filter(|s| *s > 1e-6)?;
    Some([median(&mut off)? / size, product / square])
}

/// Refuses velocities that contradict the poses, and names a possible cause; smaller errors are noted.
pub(super) fn rates(
    csv: &Path,
    spec: &LogSpec,
    system: &System,
    raw: &[Raw],
    notes: &mut Vec<String>,
) -> Result<(), LogError> {
    let seconds = |a: &Moment, b: &Moment| b.time - a.time;
    // Velocities between poses and measured velocities, for `many` columns starting at `from`.
    let columns = |from: usize, many: usize| {
        let some = |all: &[f64]| Vector3::from_fn(|i, _| if i < many { all[from + i] } else { 0.0 });
        misfit(
            pairs(raw)
                .map(|(a, b)| (some(&rate(&system.robot, &a.q, &b.q, seconds(a, b))), [a, b].map(|m| some(&m.qd)))),
        )
    };
    if let Some(root) = &spec.root {
        if let (Some(names), Some([off, factor])) = (&root.velocity, columns(3, 3)) {
            refuse(csv, &names.join(", "), off, factor, None, notes)?;
        }
        let ang_vel = |order: Order, axes: Axes| {
            misfit(pairs(raw).map(|(a, b)| {
                let [x, y] = [a, b].map(|m| as_if(&m.q[3..7], root.order, order));
                // The numbers of the columns, then the angular velocity (world axes) if `axes` and `order` were right.
                let measured = [(a, x), (b, y)].map(|(m, turn)| {
                    let own = Vector3::new(m.qd[0], m.qd[1], m.qd[2]);
                    let own = if root.axes == Axes::Body { quaternion(&m.q[3..7]).inverse() * own } else { own };
                    if axes == Axes::Body { turn * own } else { own }
                });
                ((y * x.inverse()).scaled_axis() / seconds(a, b), measured)
            }))
        };
        if let (Some(names), Some([off, factor])) = (&root.ang_vel, ang_vel(root.order, root.axes)) {
            let all = [Order::Wxyz, Order::Xyzw].into_iter().flat_map(|o| [Axes::Body, Axes::World].map(|a| (o, a)));
            let best = all.filter_map(|(o, a)| Some((ang_vel(o, a)?[0], o, a))).min_by(|a, b| a.0.total_cmp(&b.0));
            let better = best.filter(|(other, ..)| *other < 0.5 * off && off > MIN_NOTED_ERROR);
            let words = better.map(|(other, order, axes)| {
                let word = |x: &dyn std::fmt::Debug| format!("{x:?}").to_lowercase();
                format!(
                    "with order = \"{}\" and axes = \"{}\" they are {:.0} % off",
                    word(&order),
                    word(&axes),
                    100.0 * other
                )
            });
            let columns = format!("{} and {}", root.quaternion.join(", "), names.join(", "));
            refuse(csv, &columns, off, factor, words, notes)?;
        }
    }
    let first = system.robot.joint_count();
    for (k, joint) in system.robot.joints().enumerate() {
        let column = spec.joints.iter().find(|j| j.name == joint.name).and_then(|j| j.velocity.as_ref());
        if let (Some(column), Some([off, factor])) = (column, columns(system.robot.nv() - first + k, 1)) {
            refuse(csv, column, off, factor, None, notes)?;
        }
    }
    Ok(())
}

/// An orientation (x y z w) read in the order `stated`, reread in `order`.
fn as_if(q: &[f64], stated: Order, order: Order) -> UnitQuaternion<f64> {
    order.turn(match stated {
        Order::Wxyz => [q[3], q[0], q[1], q[2]],
        Order::Xyzw => [q[0], q[1], q[2], q[3]],
    })
}

fn refuse(
    csv: &Path,
    columns: &str,
    off: f64,
    factor: f64,
    better: Option<String>,
    notes: &mut Vec<String>,
) -> Result<(), LogError> {
    let words = format!("columns {columns}: rates are {:.0} % off those that the poses have", 100.0 * off);
    let advice = match (better, unit(factor)) {
        (Some(better), _) => better,
        (None, Some(unit)) => format!("{unit} would explain it"),
        (None, None) if off < MAX_RELATIVE_ERROR => {
            notes.extend((off > NOTED_VELOCITY_ERROR).then(|| format!("{words}; times {factor:.3} they fit best")));
            return Ok(());
        }
        (None, None) => format!("rates times {factor:.3} fit best"),
    };
    Err(bad(csv, format!("{words}; {advice}")))
}

/// Notes a coordinate that changes in one row more than a thousand times as much as in 99 % of the rows. This suggests
/// a glitch of a sensor or file.
pub(super) fn jumps(spec: &LogSpec, system: &System, raw: &[Raw], notes: &mut Vec<String>) {
    let root = spec.root.iter().flat_map(|root| root.position.iter().enumerate());
    let joint = |name: &String| spec.joints.iter().find(|j| j.name == *name).map(|j| &j.position);
    let first = system.robot.root_coords();
    let joints = system.robot.joints().enumerate().filter_map(|(k, j)| Some((first + k, joint(&j.name)?)));
    for (k, column) in root.chain(joints) {
        let rows = raw.iter().flat_map(|r| r.moments.windows(2));
        let mut moved: Vec<(f64, Place)> =
            rows.map(|pair| ((pair[1].q[k] - pair[0].q[k]).abs(), pair[1].place)).collect();
        moved.sort_by(|a, b| a.0.total_cmp(&b.0));
        let Some((most, place)) = moved.last() else { continue };
        let usual = moved[(moved.len() * 99 / 100).saturating_sub(1)].0;
        if usual > 0.0 && *most > 1e3 * usual {
            notes.push(format!(
                "{place}, column `{column}`: it moves by {most:.3e} there, in 99 of 100 rows by {usual:.1e} at most; is it a glitch?"
            ));
        }
    }
}

/// Checks lengths and times by free fall. A difference from gravity is an error if a wrong unit explains it or if it is
/// large; otherwise it is noted. Removes frames before a release: a held body does not fall.
pub(super) fn falls(csv: &Path, log: &mut Log, scene: &Arc<Scene>) -> Result<(), LogError> {
    let g = scene.gravity.norm();
    if !log.system.robot.floating() || g == 0.0 || log.system.frame_time > MAX_FRAME_TIME {
        return Ok(());
    }
    let (system, mut data, mut events) = (log.system.clone(), Data::new(&log.system.robot), Vec::new());
    let (mut free_falls, mut first_falls, mut held) = (Vec::new(), Vec::new(), 0);
    let least = MIN_FLIGHT.1.max((MIN_FLIGHT.0 / system.frame_time).ceil() as usize);
    for trajectory in &mut log.trajectories {
        let height = |state: &Vec<f64>| {
            contacts(&system, scene, state, &mut data, &mut events);
            let clear =
                events.iter().zip(&system.robot.contact_points).all(|(e, p)| e.distance - p.radius > MIN_CLEARANCE);
            clear.then(|| -totals(&system.robot, state, &mut data).com.dot(&scene.gravity) / g)
        };
        let heights: Vec<f64> = trajectory.states.iter().map_while(height).collect();
        let fall = |from: usize, to: usize| -acceleration(&heights[from..to], system.frame_time);
        let Some(last) = heights.len().checked_sub(least) else { continue };
        let free = (0..=last)
            .rev()
            .find(|&k| (fall(k, k + least) / g - 1.0).abs() > MAX_FALL_DIFFERENCE)
            .map_or(0, |k| k + least / 2);
        first_falls.push(fall(0, least));
        if heights.len() < free + least {
            continue;
        }
        free_falls.push(fall(free, heights.len()));
        if free > 0 {
            held += 1;
            trajectory.states.drain(..free);
            trajectory.torques.drain(..free);
        }
    }
    // If nothing falls at about gravity, the first fall shows the unit.
    let Some(found) = median(&mut free_falls).or_else(|| median(&mut first_falls)) else { return Ok(()) };
    let words = format!("free fall is {found:.3} m/s^2, gravity is {g:.3}");
    match unit(found / g) {
        Some(unit) => return Err(bad(csv, format!("{words}; {unit} would explain it"))),
        None if (found / g - 1.0).abs() > MAX_RELATIVE_ERROR => {
            return Err(bad(csv, format!("{words}: lengths or times cannot be right")));
        }
        None if (found / g - 1.0).abs() > MIN_NOTED_ERROR => {
            log.notes.push(format!("{words}: lengths may be {:+.1} % off", 100.0 * (found / g - 1.0)));
        }
        None => {}
    }
    if held > 0 {
        log.notes.push(format!("{held} trajectories do not fall freely at first, and begin where they do"));
    }
    Ok(())
}

fn median(x: &mut [f64]) -> Option<f64> {
    x.sort_by(f64::total_cmp);
    x.get(x.len() / 2).copied()
}

/// Acceleration of the least-squares parabola through evenly spaced samples.
fn acceleration(x: &[f64], dt: f64) -> f64 {
    let n = x.len() as f64;
    let time = |k: usize| (k as f64 - 0.5 * (n - 1.0)) * dt;
    let square = (0..x.len()).map(|k| time(k).powi(2)).sum::<f64>() / n;
    // The component of t^2 orthogonal to straight lines.
    let bend = |k: usize| time(k).powi(2) - square;
    let norm: f64 = (0..x.len()).map(|k| bend(k).powi(2)).sum();
    2.0 * x.iter().enumerate().map(|(k, x)| bend(k) * x).sum::<f64>() / norm
}
