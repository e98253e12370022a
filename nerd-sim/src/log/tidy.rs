//! Converts rows to frames: removes copies, cuts at gaps, differentiates positions, resamples.

use nerd_core::state::{difference, wrap_state};

use super::data::Trajectory;
use super::read::{Moment, Raw};
use crate::internal::*;

/// Ratio of a time step to the trajectory's usual step above which the time step is a gap.
const GAP_RATIO: f64 = 1.5;
/// Largest deviation of a row's time from the time of its frame, as a share of the frame time. Half of the times' last
/// digit is also accepted, up to `MAX_TIME_ROUNDING` of a frame.
const MAX_JITTER: f64 = 0.01;
const MAX_TIME_ROUNDING: f64 = 0.05;
/// Largest difference of numbers between two copies: files round digits.
const COPY_TOLERANCE: f64 = 1e-4;

/// Usual time step (s) of a trajectory: the median.
pub(super) fn step(moments: &[Moment]) -> f64 {
    let mut steps: Vec<f64> = moments.windows(2).map(|pair| pair[1].time - pair[0].time).collect();
    steps.sort_by(f64::total_cmp);
    steps.get(steps.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Half of the last decimal digit (s) of the times; 0 for digits below 10 us.
fn rounding(moments: &[Moment]) -> f64 {
    let whole = |digit: f64| moments.iter().all(|m| (m.time / digit - (m.time / digit).round()).abs() < 1e-3);
    [1e-1, 1e-2, 1e-3, 1e-4, 1e-5].into_iter().find(|digit| whole(*digit)).unwrap_or(0.0) / 2.0
}

/// Removes trajectories that equal another one up to a rotation about the vertical and a horizontal shift. Such copies
/// would count twice, and could be in both the training and the test data.
pub(super) fn copies(system: &System, raw: &mut Vec<Raw>, notes: &mut Vec<String>) {
    if !system.robot.floating() {
        return;
    }
    let joints = system.robot.root_coords();
    // Numbers that such a rotation and shift leave unchanged: heights, the vertical in body axes, joint positions.
    let print = |raw: &Raw| -> Vec<f64> {
        let of = |m: &Moment| {
            let up = quaternion(&m.q[3..7]).inverse() * Vector3::z();
            [&m.q[joints..], &[m.q[2], up.x, up.y]].concat()
        };
        raw.moments.iter().flat_map(of).collect()
    };
    // Numbers of the trajectories kept so far, by the middle number in multiples of `COPY_TOLERANCE`.
    let mut prints: BTreeMap<i64, Vec<Vec<f64>>> = BTreeMap::new();
    let before = raw.len();
    raw.retain(|r| {
        let own = print(r);
        let same = |other: &Vec<f64>| {
            own.len() == other.len() && own.iter().zip(other).all(|(a, b)| (a - b).abs() < COPY_TOLERANCE)
        };
        let Some(amid) = own.get(own.len() / 2).map(|x| (x / COPY_TOLERANCE) as i64) else { return true };
        let new = !prints.range(amid - 1..=amid + 1).any(|(_, others)| others.iter().any(same));
        if new {
            prints.entry(amid).or_default().push(own);
        }
        new
    });
    if raw.len() < before {
        notes.push(format!(
            "{} of {before} trajectories are another one turned about the vertical, and are left out",
            before - raw.len()
        ));
    }
}

/// Cuts trajectories where rows or torques are missing; a piece needs at least two rows.
pub(super) fn cut(raw: Vec<Raw>, notes: &mut Vec<String>) -> Vec<Raw> {
    let (mut all, mut gaps, mut idle, mut first) = (Vec::new(), 0, 0, None);
    for Raw { id, moments } in raw {
        let limit = GAP_RATIO * step(&moments);
        let mut part: Vec<Moment> = Vec::new();
        for moment in moments {
            // The torque after a trajectory's last row may be unknown.
            let unknown = part.last().is_some_and(|last| last.torques.iter().any(|t| t.is_nan()));
            let late = part.last().is_some_and(|last| moment.time - last.time > limit);
            if late || unknown {
                idle += usize::from(unknown);
                gaps += usize::from(late);
                first = first.or(late.then_some(moment.place));
                all.push(Raw { id, moments: std::mem::take(&mut part) });
            }
            part.push(moment);
        }
        all.push(Raw { id, moments: part });
    }
    if idle > 0 {
        notes.push(format!(
            "{idle} rows that are not the last of a trajectory have no torque: trajectories are cut there"
        ));
    }
    let before = all.len();
    all.retain(|raw| raw.moments.len() > 1);
    if let Some(place) = first {
        notes.push(format!("{gaps} gaps in time, the first before {place}: trajectories are cut there"));
    }
    if all.len() < before {
        notes.push(format!("{} pieces of a single row are left out", before - all.len()));
    }
    all
}

/// Fills in missing velocities by central differences; returns whether any were missing.
fn differentiate(system: &System, moments: &mut [Moment]) -> bool {
    let robot = &system.robot;
    let missing: Vec<usize> = (0..robot.nv()).filter(|&k| moments.iter().any(|m| m.qd[k].is_nan())).collect();
    if missing.is_empty() {
        return false;
    }
    let all: Vec<(f64, Vec<f64>)> = moments.iter().map(|m| (m.time, m.q.clone())).collect();
    for (k, moment) in moments.iter_mut().enumerate() {
        let (a, b) = (&all[k.saturating_sub(1)], &all[(k + 1).min(all.len() - 1)]);
        let rate = rate(robot, &a.1, &b.1, b.0 - a.0);
        missing.iter().for_each(|&i| moment.qd[i] = rate[i]);
    }
    true
}

/// Difference (rad or m) of joint positions `b - a`; endless joints take the shorter direction.
pub(crate) fn turned(robot: &Robot, a: &[f64], b: &[f64]) -> Vec<f64> {
    let first = robot.root_coords();
    let each = robot.joints().zip(a[first..].iter().zip(&b[first..]));
    each.map(|(joint, (a, b))| if joint.wraps() { wrap(b - a) } else { b - a }).collect()
}

/// Mean velocities from pose `a` to pose `b`. First come angular (rad/s) and linear (m/s) velocity of the root in world
/// axes, then joint velocities (rad/s or m/s).
pub(super) fn rate(robot: &Robot, a: &[f64], b: &[f64], seconds: f64) -> Vec<f64> {
    let mut out = vec![0.0; robot.nv()];
    difference(robot, a, b, &mut out);
    out.iter_mut().for_each(|way| *way /= seconds);
    out
}

/// Mean torque over an interval, with each row's torque held constant until the next row; 0 outside all rows.
fn held(moments: &[Moment], [from, to]: [f64; 2]) -> Vec<f64> {
    let (mut sum, mut total) = (vec![0.0; moments[0].torques.len()], 0.0);
    for pair in moments.windows(2).take_while(|pair| pair[0].time < to) {
        let share = pair[1].time.min(to) - pair[0].time.max(from);
        if share > 0.0 {
            total += share;
            sum.iter_mut().zip(&pair[0].torques).for_each(|(sum, t)| *sum += share * t);
        }
    }
    sum.into_iter().map(|sum| if total > 0.0 { sum / total } else { 0.0 }).collect()
}

/// Interpolates between two moments at `time`: positions and velocities linearly, rotations along the shortest arc,
/// torques held constant.
fn between(robot: &Robot, a: &Moment, b: &Moment, time: f64) -> Moment {
    let s = (time - a.time) / (b.time - a.time);
    let mix = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a + s * (b - a)).collect::<Vec<_>>();
    let mut q = mix(&a.q, &b.q);
    let joints = q[robot.root_coords()..].iter_mut().zip(&a.q[robot.root_coords()..]);
    joints.zip(turned(robot, &a.q, &b.q)).for_each(|((q, a), d)| *q = a + s * d);
    if robot.floating() {
        let (from, to) = (quaternion(&a.q[3..7]), quaternion(&b.q[3..7]));
        let arc = (to * from.inverse()).scaled_axis() * s;
        write_quaternion(&mut q[3..], &(UnitQuaternion::from_scaled_axis(arc) * from));
    }
    Moment { place: a.place, time, q, qd: mix(&a.qd, &b.qd), torques: a.torques.clone() }
}

pub(super) fn states(system: &System, raw: Vec<Raw>, notes: &mut Vec<String>) -> Vec<Trajectory> {
    let (robot, frame) = (&system.robot, system.frame_time);
    let (mut differences, mut resampled, total) = (0, Vec::new(), raw.len());
    let all = raw.into_iter().map(|Raw { id, mut moments }| {
        differences += usize::from(differentiate(system, &mut moments));
        let start = moments[0].time;
        let early = Some(rounding(&moments))
            .filter(|half| *half <= MAX_TIME_ROUNDING * frame)
            .map_or(0.0, |half| 2.001 * half)
            .max(MAX_JITTER * frame);
        let on_time = |(k, m): (usize, &Moment)| (m.time - start - k as f64 * frame).abs() <= early;
        if !moments.iter().enumerate().all(on_time) {
            resampled.push(step(&moments));
            let frames = ((moments[moments.len() - 1].time - start) / frame + MAX_JITTER) as usize;
            let mut at = 0;
            let even = (0..=frames).map(|k| {
                let time = start + k as f64 * frame;
                while at + 2 < moments.len() && moments[at + 1].time < time {
                    at += 1;
                }
                let torques = held(&moments[at..], [time, time + frame]);
                Moment { torques, ..between(robot, &moments[at], &moments[at + 1], time) }
            });
            moments = even.collect();
        }
        let states = moments.iter().map(|m| {
            let mut qd = m.qd.clone();
            to_world(robot, &m.q, &mut qd);
            let mut state = [&m.q[..], &qd[..]].concat();
            wrap_state(robot, &mut state);
            state
        });
        // Torques after the last row have no effect.
        let torques = moments.iter().map(|m| m.torques.iter().map(|t| if t.is_nan() { 0.0 } else { *t }).collect());
        Trajectory { id, states: states.collect(), torques: torques.collect() }
    });
    let all: Vec<Trajectory> = all.collect();
    if differences > 0 {
        notes.push(format!(
            "velocities that no column holds are central differences of the poses, in {differences} trajectories"
        ));
    }
    resampled.sort_by(f64::total_cmp);
    if let Some(usual) = resampled.get(resampled.len() / 2) {
        let (count, own, theirs) = (resampled.len(), 1.0 / frame, 1.0 / usual);
        let keep = if (own / theirs - 1.0).abs() > MAX_TIME_ROUNDING {
            format!("; `frame_time = {usual:.6}` of the robot keeps them")
        } else {
            String::new()
        };
        notes.push(format!(
            "{count} of {total} trajectories have {theirs:.1} Hz and the robot {own:.1}: they are resampled{keep}"
        ));
    }
    all
}
