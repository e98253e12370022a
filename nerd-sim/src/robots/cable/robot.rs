//! Builds the chain of rods of a cable.

use super::spec::{CableSpec, Support};
use crate::{internal::*, robots::derive::rounded};

/// Ratio of damping to stiffness (s) if no damping is given. Leads, hoses and ropes lose a bend quickly, and an
/// undamped chain of springs would oscillate with growing amplitude.
const DAMPING_TIME: f64 = 0.01;
/// Natural frequency (rad/s) of a gripper's axes: 4 Hz.
const GRIPPER_FREQUENCY: f64 = 8.0 * std::f64::consts::PI;

impl CableSpec {
    /// The chain. Links are named `rod1`, `rod2`, .., joints `bend1`, `sway1`, `twist1`, .., and a gripper's joints
    /// `x`, `y`, `z`, `yaw`, `pitch`, `roll`.
    pub fn robot(&self, name: &str) -> Robot {
        let at = Isometry3::translation(self.position()[0], self.position()[1], self.position()[2]);
        let mut robot = Robot::new(name, if self.support == Support::Free { Base::Floating } else { Base::Fixed(at) });
        let mut parent = (self.support == Support::Gripper).then(|| self.carriage(&mut robot));
        let step = self.length / self.links as f64;
        let mass = self.mass / self.links as f64;
        let radius = 0.5 * self.diameter;
        let across = mass * (3.0 * radius * radius + step * step) / 12.0;
        let rod = BodyInertia {
            mass,
            com: Vector3::x() * (0.5 * step),
            inertia: Matrix3::from_diagonal(&Vector3::new(0.5 * mass * radius * radius, across, across)),
        };
        for k in 0..self.links {
            let name = format!("rod{}", k + 1);
            if k == 0 && self.support == Support::Free {
                robot.links.push(Link::new(name, None, None, rod));
                parent = Some(0);
            } else {
                let clamped = k == 0;
                let mut origin = if clamped {
                    Isometry3::from_parts(Vector3::zeros().into(), self.turn())
                } else {
                    Isometry3::translation(step, 0.0, 0.0)
                };
                let mut hinges =
                    vec![("sway", Vector3::z_axis(), self.bending), ("bend", Vector3::y_axis(), self.bending)];
                hinges.extend(self.twisting.map(|stiffness| ("twist", Vector3::x_axis(), stiffness)));
                let last = hinges.len() - 1;
                for (i, (word, axis, stiffness)) in hinges.into_iter().enumerate() {
                    let mut joint = Joint::new(format!("{word}{}", k + 1), JointKind::Continuous, origin, axis);
                    joint.stiffness = if clamped { 2.0 } else { 1.0 } * stiffness / step;
                    joint.damping = match self.damping {
                        None => joint.stiffness * DAMPING_TIME,
                        Some(damping) if self.bending > 0.0 => joint.stiffness * damping / self.bending,
                        Some(damping) => damping / step,
                    };
                    let (name, inertia) = if i == last {
                        (name.clone(), rod)
                    } else {
                        (format!("{word}{}", k + 1), BodyInertia::default())
                    };
                    robot.links.push(Link::new(name, parent, Some(joint), inertia));
                    parent = Some(robot.links.len() - 1);
                    origin = Isometry3::identity();
                }
            }
            let end = |x: f64| ContactPoint::new(robot.links.len() - 1, Vector3::x() * x, radius);
            let ends =
                if k == 0 && self.support == Support::Free { vec![end(0.0), end(step)] } else { vec![end(step)] };
            robot.contact_points.extend(ends);
        }
        robot
    }

    /// Adds the six axes of the gripper and returns the index of the gripper's link. The gripper has the mass of a rod;
    /// the axes have inertia only as armature.
    fn carriage(&self, robot: &mut Robot) -> usize {
        let [x, y, z] = [Vector3::x_axis(), Vector3::y_axis(), Vector3::z_axis()];
        let slide = JointKind::Prismatic;
        let turn = JointKind::Continuous;
        let axes = [
            ("x", slide, x),
            ("y", slide, y),
            ("z", slide, z),
            ("yaw", turn, z),
            ("pitch", turn, y),
            ("roll", turn, x),
        ];
        for (k, (name, kind, axis)) in axes.into_iter().enumerate() {
            let mut joint = Joint::new(name, kind, Isometry3::identity(), axis);
            (joint.armature, joint.stiffness) = self.drive(kind == slide);
            joint.damping = 2.0 * (joint.armature * joint.stiffness).sqrt();
            let mass = self.mass / self.links as f64;
            let radius = 3.0 * self.diameter;
            let ball = BodyInertia {
                mass,
                com: Vector3::zeros(),
                inertia: Matrix3::identity() * (0.4 * mass * radius * radius),
            };
            let (name, inertia) =
                if k < 5 { (format!("axis_{name}"), BodyInertia::default()) } else { ("gripper".into(), ball) };
            robot.links.push(Link::new(name, k.checked_sub(1), Some(joint), inertia));
        }
        5
    }

    /// Armature (kg or kg m^2) and stiffness (N/m or N m/rad) of a gripper axis: large enough that the cable hardly
    /// moves the gripper.
    fn drive(&self, slides: bool) -> (f64, f64) {
        let stiffness = if slides {
            10.0 * self.mass * GRIPPER_FREQUENCY * GRIPPER_FREQUENCY
        } else {
            25.0 * self.mass * GRAVITY * self.length
        };
        (rounded(stiffness / (GRIPPER_FREQUENCY * GRIPPER_FREQUENCY)), rounded(stiffness))
    }
}
