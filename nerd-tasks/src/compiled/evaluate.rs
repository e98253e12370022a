//! Values of a recorded formula on the CPU.

use nerd_sim::prelude::*;

use crate::formula::{Given, Leaf, Node, Number, Program};
use crate::{Task, View, Work};

/// Values that a formula reads, beside the state of its environment.
#[derive(Clone, Copy, Default)]
pub(super) struct Inputs<'a> {
    pub action: &'a [f64],
    pub torques: &'a [f64],
}

impl Program {
    /// Values of all nodes; actions are clamped to [-1, 1].
    pub(super) fn values(&self, task: &dyn Task, view: View, inputs: Inputs, work: &mut Work) -> Vec<f64> {
        let mut all: Vec<f64> = std::mem::take(&mut work.numbers);
        all.clear();
        let mut found = Found { task, view, work, placed: false, near: false, place: None, plain: Vec::new() };
        let mut called = Vec::new();
        for node in &self.nodes {
            let next = match *node {
                Node::Made(f, [a, b]) => value(&all, a).made(f, value(&all, b)),
                Node::Leaf(leaf) => match leaf {
                    Leaf::State(k) => view.state[k],
                    Leaf::Goal(k) => view.goal[k],
                    Leaf::Action(k) => inputs.action[k].clamp(-1.0, 1.0),
                    // Torques are recorded even if the reward does not use them; the caller may then leave the torques
                    // out.
                    Leaf::Torque(k) => inputs.torques.get(k).copied().unwrap_or(f64::NAN),
                    Leaf::Place { link, local, axis } => found.place(link, local)[axis],
                    Leaf::Distance(point) => found.distance(point),
                    Leaf::Ground(at) => view.scene.ground(view.state, at).unwrap_or(0.0),
                    Leaf::Plain(k) => found.plain(k),
                    Leaf::Controlled { call, i } => {
                        if i == 0 {
                            let action: Vec<f64> = self.lists[call].iter().map(|x| value(&all, *x)).collect();
                            called.resize(action.len(), 0.0);
                            found.work.controller.torques(view.state, &action, &mut called);
                        }
                        called[i]
                    }
                    // Leaves of upstream gradients occur in adjoints only.
                    Leaf::By(_) | Leaf::Pushed { .. } => f64::NAN,
                },
            };
            all.push(next);
        }
        all
    }

    /// Evaluates the formula and passes its results to `write`, in order.
    pub(super) fn run(
        &self,
        task: &dyn Task,
        view: View,
        inputs: Inputs,
        work: &mut Work,
        mut write: impl FnMut(usize, f64),
    ) {
        let all = self.values(task, view, inputs, work);
        self.out.iter().enumerate().for_each(|(k, x)| write(k, value(&all, *x)));
        work.numbers = all;
    }
}

/// Value of a constant or a node.
pub(super) fn value(all: &[f64], x: Given) -> f64 {
    match x {
        Given::Known(x) => x,
        Given::Node(k) => all[k],
    }
}

/// Quantities of an environment, computed at their first use.
struct Found<'a> {
    task: &'a dyn Task,
    view: View<'a>,
    work: &'a mut Work,
    /// Whether the kinematics in `work` are of this state, and whether the distances are.
    placed: bool,
    near: bool,
    /// The last point that was read: link, position in the link frame, world position (m).
    place: Option<(usize, [f64; 3], [f64; 3])>,
    plain: Vec<f64>,
}

impl Found<'_> {
    fn place(&mut self, link: usize, local: [f64; 3]) -> [f64; 3] {
        if let Some((_, _, at)) = self.place.filter(|(l, p, _)| (*l, *p) == (link, local)) {
            return at;
        }
        let Work { system, data, .. } = &mut *self.work;
        if !std::mem::replace(&mut self.placed, true) {
            kinematics(&system.robot, self.view.state, data);
        }
        let at = point_position(data, link, &local.into()).into();
        self.place = Some((link, local, at));
        at
    }

    fn distance(&mut self, point: usize) -> f64 {
        let Work { system, data, events, .. } = &mut *self.work;
        if !std::mem::replace(&mut self.near, true) {
            contacts(system, self.view.scene, self.view.state, data, events);
            self.placed = false;
        }
        events[point].distance
    }

    fn plain(&mut self, k: usize) -> f64 {
        if let Some(plain) = self.task.plain().filter(|_| self.plain.is_empty()) {
            self.plain.resize(plain.numbers_dim(), f64::NAN);
            plain.numbers(self.view, self.work, &mut self.plain);
            (self.placed, self.near) = (false, false);
        }
        self.plain[k]
    }
}
