//! A gripper drags a lead's free end, the tip, across a floor after a target on a winding line. World up is +z; units
//! are m, rad and s.
//!
//! The target accelerates from rest to the speed v along a line that winds about a heading psi, towards the gripper.
//! The distance covered along the heading is s, the offset to the left of the heading w, and the reward R:
//!
//! ```text
//! s(t) = v (t - T (1 - exp(-t / T))),   w(s) = m L / (2 pi) (sin(2 pi s / L + p) - sin p),   T = 0.3
//! R = 0.7 exp(-(d / 0.04)^2) + 0.3 exp(-d / 0.2) - 0.02 |v_gripper|^2
//! ```
//!
//! The steepest slope of the windings is m, the length of one winding L and its phase p. The distance from tip to
//! target is d. A lead can be pulled but not pushed. So the target never turns back, and starts ahead of the tip. The
//! policy chooses how much of the lead lies on the floor: the higher the gripper, the more closely the tip follows.
//!
//! Action: velocities of the gripper's three slides, in units of [`FASTEST`]; the gripper's hinges stay at home. In
//! each frame the spring targets are set far enough ahead for these velocities, within [`BOX`]. Heights, speeds and the
//! gripper's direction match the cable's training data. A learned cable model does not see the cable's position on the
//! floor.
//!
//! Observation: 71 numbers in world axes. Tip relative to target: position and velocity (6). Gripper: position relative
//! to target, position relative to home, velocity (9). Eight points along the lead, the tip last: position and velocity
//! relative to the gripper (48). Target: velocity, and displacement in the next 1/4, 1/2 and 1 s (8). Episodes are
//! never terminated; they are truncated after 100 steps of 3 frames of 1/60 s.

use nalgebra::Vector2;
use nerd_core::{dynamics::velocities, velocity::root_position};
use nerd_sim::prelude::*;
use rand_chacha::ChaCha8Rng;

use crate::drape::{drape, hinges};
use crate::formula::{Number, Sight, Traced};
use crate::{About, Plain, Task, View, Work};

/// The task of dragging a lead's tip after a target. It has no settings.
#[derive(Clone, Copy, Debug, Default)]
pub struct LeadTip;

/// Number of the lead's rods, and of the gripper's axes. In `q` the gripper's axes come before the rods.
const RODS: usize = 40;
const AXES: usize = 6;
/// Number of observed points along the lead.
const SEEN: usize = 8;
/// Index of the gripper's position and velocity in the observation; both are coordinates of the state.
const GRIPPER: usize = 9;
/// Frame time (s).
const FRAME: f64 = 1.0 / 60.0;
/// Frames of target preview in the observation.
const AHEAD: [u64; 3] = [15, 30, 60];
/// Gripper velocity (m/s) at an action of 1. In the training data the gripper covers 0.3 m and more in 0.3 to 1.5 s.
const FASTEST: f64 = 0.4;
/// Bounds of the gripper's position relative to home (m). One frame in twenty of the training data is beyond the height
/// bounds. The bounds along x and y fit the longest line.
const BOX: [Range; 3] =
    [Range { low: -0.5, high: 0.5 }, Range { low: -0.5, high: 0.5 }, Range { low: -0.2, high: 0.2 }];
/// Tolerance: distance (m) between tip and target.
const NEAR: f64 = 0.02;

/// Initial position of the tip (m, relative to the point below home), and the range about this position, along x and y.
const TIP: Vector2<f64> = Vector2::new(0.75, 0.0);
const BESIDE: Range = Range { low: -0.03, high: 0.03 };
/// Initial height of the gripper (m), and heading of the lead as seen from the gripper (rad, from x).
const HEIGHT: Range = Range { low: 0.6, high: 0.7 };
const HEADING: Range = Range { low: -0.3, high: 0.3 };
/// Height (m) of the tip's centre when it lies on the floor.
const LYING: f64 = 0.004;
/// Distance (m) of the target's start ahead of [`TIP`].
const LEAD: Range = Range { low: 0.0, high: 0.08 };
/// Ranges of the line's speed v (m/s), steepest slope m, and winding length L (m).
const SPEED: Range = Range { low: 0.06, high: 0.12 };
const SLOPE: Range = Range { low: 0.3, high: 1.0 };
const LENGTH: Range = Range { low: 0.25, high: 0.5 };
/// T: time constant (s) of the target's acceleration.
const RISE: f64 = 0.3;

/// Numbers of a goal: present target (3), frames elapsed; start of the target (2), v, psi, m, L and p.
const GOAL: usize = 11;

/// Position (m, along x and y) of a goal's target after `frames` frames.
fn place(goal: &[f64], frames: f64) -> Vector2<f64> {
    let [x, y, speed, heading, slope, length, phase] = std::array::from_fn(|k| goal[4 + k]);
    let t = frames * FRAME;
    let way = speed * (t - RISE * (1.0 - (-t / RISE).exp()));
    let turn = std::f64::consts::TAU / length;
    let off = slope / turn * ((turn * way + phase).sin() - phase.sin());
    // The target moves towards the gripper, which is at the other end of the heading.
    let ahead = -Vector2::new(heading.cos(), heading.sin());
    Vector2::new(x, y) + ahead * way + Vector2::new(-ahead.y, ahead.x) * off
}

/// Gripper and lead in one state.
struct Seen {
    /// Position relative to home (m) and velocity (m/s) of the gripper.
    gripper: [Vector3<f64>; 2],
    /// World position of home (m).
    home: Vector3<f64>,
    /// World positions (m) and velocities (m/s) of points along the lead; the last point is the tip.
    points: [[Vector3<f64>; 2]; SEEN],
}

impl Seen {
    fn of(state: &[f64], work: &mut Work) -> Self {
        let robot = &work.system.robot;
        let data = &mut work.data;
        kinematics(robot, state, data);
        velocities(robot, &state[robot.nq()..], data);
        let contacts = &robot.contact_points;
        let points = std::array::from_fn(|k| {
            let point = &contacts[(k + 1) * contacts.len() / SEEN - 1];
            let place = point_position(data, point.link, &point.local);
            [place, data.velocity[point.link].at(&(place - data.origin))]
        });
        Self {
            gripper: [vector(state), vector(&state[robot.nq()..])],
            home: root_position(&work.system.robot, state),
            points,
        }
    }

    /// World position (m) and velocity (m/s) of the tip.
    fn tip(&self) -> [Vector3<f64>; 2] {
        self.points[SEEN - 1]
    }
}

impl Task for LeadTip {
    fn about(&self) -> About {
        About {
            name: "lead-tip",
            robot: "lead-pegs",
            scene: "plane",
            observation: 23 + 6 * SEEN,
            action: 3,
            steps: 100,
            frames: 3,
        }
    }

    fn plain(&self) -> Option<&dyn Plain> {
        Some(self)
    }

    fn observe<'a>(&self, sight: &Sight<'a>, out: &mut [Traced<'a>]) {
        out.iter_mut().enumerate().for_each(|(k, out)| *out = sight.plain(k));
        for k in 0..3 {
            (out[GRIPPER + k], out[GRIPPER + 3 + k]) = (sight.q(k), sight.qd(k));
        }
        // The target's height is constant.
        let robot = &sight.system().robot;
        out[GRIPPER - 1] = root_position(robot, &robot.zero_state()).z + sight.q(2) - LYING;
    }

    fn act<'a>(&self, sight: &Sight<'a>, action: &[Traced<'a>], torques: &mut [Traced<'a>]) {
        for (k, joint) in sight.system().robot.joints().enumerate().take(3) {
            // A critically damped spring of frequency w (rad/s) moves at the commanded velocity if every frame sets its
            // target this far ahead.
            let w = (joint.stiffness / joint.armature).sqrt();
            let ahead = FASTEST * action[k] * (FRAME + (w * FRAME).exp_m1() / w) / (w * FRAME);
            torques[k] = joint.stiffness * (sight.q(k) + ahead).max(BOX[k].low.into()).min(BOX[k].high.into());
        }
    }

    fn reward<'a>(&self, sight: &Sight<'a>, _: &[Traced<'a>]) -> Traced<'a> {
        let d = distance(sight);
        let speed = squares([0, 1, 2].map(|k| sight.qd(k)));
        0.7 * (-(d / 0.04).squared()).exp() + 0.3 * (-d / 0.2).exp() - 0.02 * speed
    }

    fn error<'a>(&self, sight: &Sight<'a>) -> Option<Traced<'a>> {
        Some(distance(sight) / NEAR)
    }
}

/// Distance (m) from tip to target.
fn distance<'a>(sight: &Sight<'a>) -> Traced<'a> {
    squares([0, 1, 2].map(|k| sight.plain(k))).sqrt()
}

fn squares([x, y, z]: [Traced; 3]) -> Traced {
    x.squared() + y.squared() + z.squared()
}

impl Plain for LeadTip {
    fn goal_dim(&self) -> usize {
        GOAL
    }

    fn draw_goal(&self, rng: &mut ChaCha8Rng, out: &mut [f64]) {
        let phase = Range { low: -std::f64::consts::PI, high: std::f64::consts::PI };
        let [ahead, beside, speed, heading, slope, length, phase] =
            [LEAD, BESIDE, SPEED, HEADING, SLOPE, LENGTH, phase].map(|range| range.draw(rng));
        out[4..].copy_from_slice(&[TIP.x - ahead, TIP.y + beside, speed, heading, slope, length, phase]);
        let at = place(out, 0.0);
        out[..4].copy_from_slice(&[at.x, at.y, LYING, 0.0]);
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

    fn numbers_dim(&self) -> usize {
        self.observation_dim()
    }

    /// The observation.
    fn numbers(&self, view: View, work: &mut Work, out: &mut [f64]) {
        let seen = Seen::of(view.state, work);
        let goal = view.goal;
        let now = place(goal, goal[3]);
        let ahead = |frames: u64| place(goal, goal[3] + frames as f64) - now;
        let target = vector(goal);
        let heading = ahead(1) / FRAME;
        let [tip, speed] = seen.tip();
        let [gripper, moving] = seen.gripper;
        let at = seen.home + gripper;
        let own = [tip - target, speed - Vector3::new(heading.x, heading.y, 0.0), at - target, gripper, moving];
        let points = seen.points.iter().flat_map(|[place, velocity]| [place - at, velocity - moving]);
        let spatial = own.into_iter().chain(points).flat_map(|v| [v.x, v.y, v.z]);
        let level = std::iter::once(heading).chain(AHEAD.map(ahead)).flat_map(|v| [v.x, v.y]);
        out.iter_mut().zip(spatial.chain(level)).for_each(|(out, x)| *out = x);
    }
}
