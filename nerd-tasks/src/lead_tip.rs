//! A gripper draws a lead's free end, the tip, across a floor, after a target that moves along a winding line. World up is +z; m, rad, s.
//!
//! The target starts from rest and moves at v along a line that winds about a heading psi towards the gripper: with s the distance gone,
//!
//! ```text
//! s(t) = v (t - T (1 - exp(-t / T))),   w(s) = m L / (2 pi) (sin(2 pi s / L + p) - sin p),   T = 0.3
//! R = 0.7 exp(-(d / 0.04)^2) + 0.3 exp(-d / 0.2) - 0.02 |v_gripper|^2
//! ```
//!
//! where w is its offset to the left, m the steepest slope of its windings, L their length, and d the distance of tip and target. A lead
//! can be drawn but not pushed, so the target never turns back, and begins ahead of the tip. The policy chooses how much of the lead lies
//! on the floor: the higher the gripper, the more closely the tip follows.
//!
//! Action: velocity of the gripper's three slides, 1 is [`FASTEST`]; its hinges stay at home. In each frame the spring targets are set far
//! enough ahead to give this velocity, within [`BOX`]. Heights, speeds and the gripper's direction match the cable's training data; a
//! learned cable does not see its position on the floor.
//!
//! Observation: 71 numbers in world axes: tip from target, and its velocity from the target's (6); the target's velocity, and its
//! displacement in the next 1/4, 1/2 and 1 s (8); gripper from target, gripper from home, its velocity (9); eight points along the lead,
//! the tip the last, each with its velocity, from the gripper (48). Never terminated; truncated after 100 steps of 3 frames of 1/60 s.

use nalgebra::Vector2;
use nerd_core::{dynamics::velocities, velocity::root_position};
use nerd_sim::prelude::*;
use rand_chacha::ChaCha8Rng;

use crate::drape::{drape, hinges};
use crate::{About, Task, View, Work};

/// The task; it has no settings.
#[derive(Clone, Copy, Debug, Default)]
pub struct LeadTip;

/// Rods of the lead, and slides and hinges in front of them.
const RODS: usize = 40;
const AXES: usize = 6;
/// Observed points along the lead.
const SEEN: usize = 8;
/// Seconds of a frame.
const FRAME: f64 = 1.0 / 60.0;
/// Frames ahead at which a policy sees where the target will be.
const AHEAD: [u64; 3] = [15, 30, 60];
/// Velocity of the gripper at an action of 1 (m/s). In the data it goes through 0.3 m and more in 0.3 to 1.5 s.
const FASTEST: f64 = 0.4;
/// Bounds of the gripper, from home (m). The data exceeds the height in one frame of twenty; the sides fit the longest line.
const BOX: [Range; 3] = [Range { low: -0.5, high: 0.5 }, Range { low: -0.5, high: 0.5 }, Range { low: -0.2, high: 0.2 }];
/// Distance (m) from the target within which an episode succeeds.
const NEAR: f64 = 0.02;

/// Initial position of the tip (m, from the foot of home), and its range about that, along x and y.
const TIP: Vector2<f64> = Vector2::new(0.75, 0.0);
const BESIDE: Range = Range { low: -0.03, high: 0.03 };
/// Initial height of the gripper (m), and the lead's heading (rad, from x) as seen from there.
const HEIGHT: Range = Range { low: 0.6, high: 0.7 };
const HEADING: Range = Range { low: -0.3, high: 0.3 };
/// How far the target begins ahead of [`TIP`] (m).
const LEAD: Range = Range { low: 0.0, high: 0.08 };
/// v (m/s), m and L (m) of its line.
const SPEED: Range = Range { low: 0.06, high: 0.12 };
const SLOPE: Range = Range { low: 0.3, high: 1.0 };
const LENGTH: Range = Range { low: 0.25, high: 0.5 };
/// T: time (s) of acceleration.
const RISE: f64 = 0.3;

/// Numbers of a goal: where the target is now, and the frames that it has gone; where it began, v, psi, m, L and p.
const GOAL: usize = 11;

/// Position of a goal's target after `frames` frames.
fn place(goal: &[f64], frames: f64) -> Vector2<f64> {
    let [x, y, speed, heading, slope, length, phase] = std::array::from_fn(|k| goal[4 + k]);
    let t = frames * FRAME;
    let way = speed * (t - RISE * (1.0 - (-t / RISE).exp()));
    let turn = std::f64::consts::TAU / length;
    let off = slope / turn * ((turn * way + phase).sin() - phase.sin());
    // Towards the gripper, which is at the other end of the heading.
    let ahead = -Vector2::new(heading.cos(), heading.sin());
    Vector2::new(x, y) + ahead * way + Vector2::new(-ahead.y, ahead.x) * off
}

/// The lead as a task sees it.
struct Seen {
    /// Place and velocity of the gripper, from home.
    gripper: [Vector3<f64>; 2],
    /// Home (world).
    home: Vector3<f64>,
    /// Places (world) and velocities of points along the lead; the last is the tip.
    points: [[Vector3<f64>; 2]; SEEN],
}

impl Seen {
    fn of(state: &[f64], work: &mut Work) -> Self {
        let (robot, data) = (&work.system.robot, &mut work.data);
        kinematics(robot, state, data);
        velocities(robot, &state[robot.nq()..], data);
        let contacts = &robot.contact_points;
        let points = std::array::from_fn(|k| {
            let point = &contacts[(k + 1) * contacts.len() / SEEN - 1];
            let place = point_position(data, point.link, &point.local);
            [place, data.velocity[point.link].at(&(place - data.origin))]
        });
        Self { gripper: [vector(state), vector(&state[robot.nq()..])], home: root_position(&work.system.robot, state), points }
    }

    /// Place and velocity of the tip.
    fn tip(&self) -> [Vector3<f64>; 2] {
        self.points[SEEN - 1]
    }
}

impl Task for LeadTip {
    fn about(&self) -> About {
        About { name: "lead-tip", robot: "lead-pegs", scene: "plane", observation: 23 + 6 * SEEN, action: 3, steps: 100, frames: 3 }
    }

    fn goal_dim(&self) -> usize {
        GOAL
    }

    fn draw_goal(&self, rng: &mut ChaCha8Rng, out: &mut [f64]) {
        let phase = Range { low: -std::f64::consts::PI, high: std::f64::consts::PI };
        let [ahead, beside, speed, heading, slope, length, phase] =
            [LEAD, BESIDE, SPEED, HEADING, SLOPE, LENGTH, phase].map(|range| range.draw(rng));
        out[4..].copy_from_slice(&[TIP.x - ahead, TIP.y + beside, speed, heading, slope, length, phase]);
        let at = place(out, 0.0);
        // The tip's middle, as it lies.
        out[..4].copy_from_slice(&[at.x, at.y, 0.004, 0.0]);
    }

    fn advance(&self, goal: &mut [f64]) {
        goal[3] += 1.0;
        let at = place(goal, goal[3]);
        goal[..2].copy_from_slice(at.as_slice());
    }

    fn reset(&self, system: &System, rng: &mut ChaCha8Rng) -> Vec<f64> {
        let [x, y, height, heading] = [BESIDE, BESIDE, HEIGHT, HEADING].map(|range| range.draw(rng));
        let end = &system.robot.contact_points[0];
        let along = drape(RODS, end.local.x, height - end.radius, heading);
        let tip = Vector3::new(TIP.x + x, TIP.y + y, end.radius);
        let gripper = tip - along.iter().sum::<Vector3<f64>>() * end.local.x;
        let mut state = system.robot.zero_state();
        let from_home = gripper - root_position(&system.robot, &state);
        state[..3].copy_from_slice(from_home.as_slice());
        state[AXES..AXES + 2 * RODS].copy_from_slice(&hinges(&along));
        state
    }

    fn observe(&self, view: View, work: &mut Work, out: &mut [f64]) {
        let (seen, goal) = (Seen::of(view.state, work), view.goal);
        let now = place(goal, goal[3]);
        let ahead = |frames: u64| place(goal, goal[3] + frames as f64) - now;
        let (target, heading) = (vector(goal), ahead(1) / FRAME);
        let ([tip, speed], [gripper, moving]) = (seen.tip(), seen.gripper);
        let at = seen.home + gripper;
        let own = [tip - target, speed - Vector3::new(heading.x, heading.y, 0.0), at - target, gripper, moving];
        let points = seen.points.iter().flat_map(|[place, velocity]| [place - at, velocity - moving]);
        let spatial = own.into_iter().chain(points).flat_map(|v| [v.x, v.y, v.z]);
        let level = std::iter::once(heading).chain(AHEAD.map(ahead)).flat_map(|v| [v.x, v.y]);
        out.iter_mut().zip(spatial.chain(level)).for_each(|(out, x)| *out = x);
    }

    fn act(&self, view: View, action: &[f64], work: &mut Work, torques: &mut [f64]) {
        torques.fill(0.0);
        for (k, joint) in work.system.robot.joints().enumerate().take(3) {
            // A critically damped spring of frequency w moves at that speed if its target is set this far ahead in every frame.
            let w = (joint.stiffness / joint.armature).sqrt();
            let ahead = FASTEST * action[k].clamp(-1.0, 1.0) * (FRAME + (w * FRAME).exp_m1() / w) / (w * FRAME);
            torques[k] = joint.stiffness * (view.state[k] + ahead).clamp(BOX[k].low, BOX[k].high);
        }
    }

    fn reward(&self, view: View, _torques: &[f64], work: &mut Work) -> f64 {
        let seen = Seen::of(view.state, work);
        let d = (seen.tip()[0] - vector(view.goal)).norm();
        0.7 * (-(d / 0.04).powi(2)).exp() + 0.3 * (-d / 0.2).exp() - 0.02 * seen.gripper[1].norm_squared()
    }

    fn miss(&self, view: View, work: &mut Work) -> Option<f64> {
        Some((Seen::of(view.state, work).tip()[0] - vector(view.goal)).norm() / NEAR)
    }
}
