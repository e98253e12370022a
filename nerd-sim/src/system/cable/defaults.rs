//! Defaults of a cable whose TOML has only `[cable]`.

use super::spec::{CableSpec, Held};
use crate::internal::*;
use crate::system::derive::{between, listed, plain, rounded};
use crate::system::spec::{RootSpec, RootStart, StartSpec};

/// Share of the diameter by which a cable at rest presses its contacts in.
const GIVE: f64 = 0.01;
/// Speed (m/s) at which a contact creeps that a fifth of its weight pushes aside.
const CREEP: f64 = 1e-3;
/// Spread (rad) of the far end's direction at starts. No more: joints are bent independently of each other, as no cable ever is, and what
/// springs hold there is let go at once.
const SPREAD: f64 = 0.06;
/// Seconds in which a gripper goes from one random place to the next.
const PACE: Range = Range { low: 0.3, high: 1.5 };

impl CableSpec {
    /// What a TOML says of such a robot where it says no more.
    pub(crate) fn spec(&self, robot: &Robot) -> Spec {
        let mut spec = plain(robot);
        let bend = SPREAD * (3.0 / self.links as f64).sqrt();
        for (own, joint) in spec.joints.iter_mut().zip(robot.joints()) {
            let reach = match joint.name.as_str() {
                "x" | "y" | "z" => Some(0.3 * self.length),
                "yaw" | "pitch" | "roll" => Some(0.5),
                // What is twisted at random rings: no hand holds it so.
                name if name.starts_with("twist") => Some(0.0),
                _ => None,
            };
            (own.armature, own.stiffness) = (joint.armature, joint.stiffness);
            // A unit of action leads it as far as its reach.
            let most = reach.map_or(0.0, |reach| rounded(reach * joint.stiffness));
            (own.torque, own.gain) = (most, Some(most));
            let q = reach.map_or(between(-bend, bend), |reach| between(-reach, reach));
            own.sample = StartSpec { q, ..StartSpec::default() };
            let near = if reach.is_some() { 0.1 } else { 1.0 };
            own.reset = StartSpec { q: Range { low: near * q.low, high: near * q.high }, ..StartSpec::default() };
        }
        let weight = self.mass / self.links as f64 * GRAVITY;
        let stiffness = rounded(weight / (GIVE * self.diameter));
        spec.material = Material {
            stiffness,
            damping: rounded((stiffness * weight / GRAVITY).sqrt()),
            friction_damping: rounded(0.2 * weight / CREEP),
            friction: 0.5,
        };
        let touches = !robot.contact_points.is_empty();
        let start = RootStart {
            position: self.at().map(|x| Range { low: x, high: x }),
            clearance: touches.then_some(0.5 * self.diameter),
            ..RootStart::default()
        };
        spec.root = (self.held == Held::Free).then(|| RootSpec {
            position: self.at(),
            quaternion: self.turn().coords.into(),
            sample: start,
            reset: None,
        });
        let smooth = (self.held == Held::Gripper).then_some(PACE);
        Spec { substeps: 8, data_scene: touches.then(|| "plane".into()), smooth, contacts: listed(robot), ..spec }
    }
}
