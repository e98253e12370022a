//! Quantities of one environment that formulas read.

use nerd_sim::prelude::*;

use super::Number;
use super::tape::{Leaf, Tape, Traced};

/// One environment, as numbers on a tape. Every number that is read is recorded; its value is known when the tape is
/// evaluated.
pub struct Sight<'a> {
    pub(crate) tape: &'a Tape,
    system: &'a System,
    goals: usize,
    plain: usize,
}

impl<'a> Sight<'a> {
    /// A robot's environment, recorded on `tape`. `goals` and `plain` count the task's goal numbers and its numbers
    /// from plain code.
    pub(crate) fn new(tape: &'a Tape, system: &'a System, goals: usize, plain: usize) -> Self {
        Self { tape, system, goals, plain }
    }

    /// The action, clamped to [-1, 1].
    pub fn action(&self, width: usize) -> Vec<Traced<'a>> {
        (0..width).map(|k| self.tape.leaf(Leaf::Action(k))).collect()
    }

    /// The robot.
    pub fn system(&self) -> &'a System {
        self.system
    }

    /// Number k of the state's `q` (m, rad; a free root's quaternion is x y z w).
    pub fn q(&self, k: usize) -> Traced<'a> {
        self.tape.among("coordinates", k, self.system.robot.nq());
        self.tape.leaf(Leaf::State(k))
    }

    /// Number k of the state's `qd` (m/s, rad/s); a free root's first six are the twist about the world's origin.
    pub fn qd(&self, k: usize) -> Traced<'a> {
        self.tape.among("velocities", k, self.system.robot.nv());
        self.tape.leaf(Leaf::State(self.system.robot.nq() + k))
    }

    /// Number k of the episode's goal: first those drawn from [`crate::Task::goal`], then those of [`crate::Plain`],
    /// then those of [`crate::Task::memory`].
    pub fn goal(&self, k: usize) -> Traced<'a> {
        self.tape.among("numbers of the goal", k, self.goals);
        self.tape.leaf(Leaf::Goal(k))
    }

    /// Number k of [`crate::Plain::numbers`]. Known on the CPU alone, and without gradients.
    pub fn plain(&self, k: usize) -> Traced<'a> {
        self.tape.among("numbers of plain code", k, self.plain);
        self.tape.leaf(Leaf::Plain(k))
    }

    /// World position (m) of a point of a link; `local` in the link frame (m).
    pub fn place(&self, link: usize, local: [f64; 3]) -> [Traced<'a>; 3] {
        self.tape.among("links", link, self.system.robot.links.len());
        [0, 1, 2].map(|axis| self.tape.leaf(Leaf::Place { link, local, axis }))
    }

    /// Distance (m) of contact point `point` from the scene; the point's radius is not subtracted. `point` counts in
    /// the order of the robot's `contact_points`.
    pub fn distance(&self, point: usize) -> Traced<'a> {
        self.tape.among("contact points", point, self.system.robot.contact_points.len());
        self.tape.leaf(Leaf::Distance(point))
    }

    /// Height (m) of uneven ground ([`Scene::ground`]) at `at` (m) ahead of a free root and to its left; 0 for other
    /// ground.
    pub fn ground(&self, at: [f64; 2]) -> Traced<'a> {
        self.tape.leaf(Leaf::Ground(at))
    }

    /// The robot's controller ([`nerd_sim::control::Controller`]): one action per joint in, one torque per joint out (N
    /// m or N).
    pub fn controlled(&self, action: &[Traced<'a>], torques: &mut [Traced<'a>]) {
        let joints = self.system.robot.joint_count();
        if action.len() != joints || torques.len() != joints {
            let text =
                format!("{} actions and {} torques for a controller of {joints} joints", action.len(), torques.len());
            self.tape.wrong.borrow_mut().get_or_insert(text);
            return;
        }
        let call = self.tape.list(action);
        torques.iter_mut().enumerate().for_each(|(i, tau)| *tau = self.tape.leaf(Leaf::Controlled { call, i }));
    }
}

/// Rotation matrix of a quaternion (x y z w), normalised or not: `[i][j]` is the component of body axis j along world
/// axis i.
pub fn rotation<'a>([x, y, z, c]: [Traced<'a>; 4]) -> [[Traced<'a>; 3]; 3] {
    let n = x.squared() + y.squared() + z.squared() + c.squared();
    let one = Traced::from(1.0);
    let two = Traced::from(2.0);
    let along = |a: Traced<'a>, b: Traced<'a>| one - two * (a.squared() + b.squared()) / n;
    [
        [along(y, z), two * (x * y - c * z) / n, two * (x * z + c * y) / n],
        [two * (x * y + c * z) / n, along(x, z), two * (y * z - c * x) / n],
        [two * (x * z - c * y) / n, two * (y * z + c * x) / n, along(x, y)],
    ]
}
