//! Gradients of a task's formulas on the CPU: reverse mode over the record of one evaluation.

use nerd_core::tangent::{numbers_back, push, wrenches_back};
use nerd_sim::prelude::*;

use super::sight::Recorded;
use super::sweep::{Ends, sweep};
use super::tape::{Given, Leaf, Node, Tape, Traced};
use super::{Formulas, formulas::bounded};
use crate::{Slopes, View, Work};

/// Destinations of gradients.
struct Found<'a> {
    nodes: &'a [(Node, f64)],
    lists: &'a [Vec<Given>],
    controller: &'a mut Controller,
    state: &'a [f64],
    by_state: Vec<f64>,
    /// With respect to actions or torques.
    by_given: &'a mut [f64],
    /// With respect to positions of links, and to distances of contact points.
    places: Vec<(usize, [f64; 3], Vector3<f64>)>,
    gaps: Vec<(usize, f64)>,
}

impl Ends<f64> for Found<'_> {
    fn value(&self, node: usize) -> f64 {
        self.nodes[node].1
    }

    fn leaf(&mut self, leaf: Leaf, by: f64) {
        match leaf {
            Leaf::State(k) => self.by_state[k] += by,
            Leaf::Action(k) | Leaf::Torque(k) => self.by_given[k] += by,
            Leaf::Place { link, local, axis } => self.places.push((link, local, Vector3::ith(axis, by))),
            Leaf::Distance(point) => self.gaps.push((point, by)),
            _ => (),
        }
    }

    fn controlled(&mut self, call: usize, by: &[f64]) -> Vec<f64> {
        let value = |of: &Given| match *of {
            Given::Known(x) => x,
            Given::Node(k) => self.nodes[k].1,
        };
        let (action, mut by_action) = (self.lists[call].iter().map(value).collect::<Vec<_>>(), vec![0.0; by.len()]);
        self.controller.back(self.state, &action, by, &mut self.by_state, &mut by_action);
        by_action
    }
}

/// Vector-Jacobian product of the formulas `say` with upstream gradients `by`: adds to `slope` (state) and to `by_given`.
fn back(
    view: View,
    work: &mut Work,
    by: &[f64],
    (slope, by_given): (&mut [f64], &mut [f64]),
    say: impl FnOnce(&mut Recorded) -> Vec<Given>,
) {
    let (system, tape) = (work.system.clone(), Tape::default());
    let robot = &system.robot;
    let said = say(&mut Recorded::of(&tape, &system, view, work));
    let (nodes, lists) = (tape.nodes.take(), tape.lists.take());
    let Work { controller, data, events, .. } = work;
    let (places, gaps, by_state) = (Vec::new(), Vec::new(), vec![0.0; robot.state_dim()]);
    let mut found = Found { nodes: &nodes, lists: &lists, controller, state: view.state, by_state, by_given, places, gaps };
    let seeds: Vec<_> = said.into_iter().zip(by.iter().copied()).collect();
    sweep(&nodes.iter().map(|node| node.0).collect::<Vec<_>>(), &lists, &seeds, &mut found);
    numbers_back(robot, view.state, &found.by_state, slope);
    if found.places.is_empty() && found.gaps.is_empty() {
        return;
    }
    if !found.gaps.is_empty() {
        contacts(&system, view.scene, view.state, data, events);
    }
    kinematics(robot, view.state, data);
    let mut loads = vec![Wrench::default(); robot.links.len()];
    for (link, local, force) in found.places {
        loads[link] += Wrench::force_at(force, &(point_position(data, link, &local.into()) - data.origin));
    }
    for (point, by) in found.gaps {
        push(data, &robot.contact_points[point], &events[point], events[point].normal * by, &mut loads);
    }
    wrenches_back(robot, data, &mut loads, slope);
}

fn given(numbers: &[Traced]) -> Vec<Given> {
    numbers.iter().map(|x| x.given()).collect()
}

impl<F: Formulas> Slopes for F {
    fn observe_back(&self, view: View, work: &mut Work, by: &[f64], slope: &mut [f64]) {
        back(view, work, by, (slope, &mut []), |sight| {
            let mut out = vec![Traced::Number(0.0); by.len()];
            self.observe(sight, &mut out);
            given(&out)
        });
    }

    fn act_back(&self, view: View, action: &[f64], work: &mut Work, by: &[f64], slope: &mut [f64], by_action: &mut [f64]) {
        back(view, work, by, (slope, by_action), |sight| {
            let mut torques = vec![Traced::Number(0.0); by.len()];
            let action = action.iter().enumerate().map(|(k, a)| sight.tape.leaf(Leaf::Action(k), a.clamp(-1.0, 1.0)));
            self.act(sight, &action.collect::<Vec<_>>(), &mut torques);
            given(&torques)
        });
    }

    fn reward_back(&self, view: View, torques: &[f64], work: &mut Work, by: f64, slope: &mut [f64], by_torques: &mut [f64]) {
        let system = work.system.clone();
        back(view, work, &[by], (slope, by_torques), |sight| {
            let torques = torques.iter().enumerate().map(|(k, tau)| sight.tape.leaf(Leaf::Torque(k), *tau));
            given(&[self.reward(sight, &bounded(self, &system, torques))])
        });
    }
}
