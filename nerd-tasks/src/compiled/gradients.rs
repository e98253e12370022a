//! Gradients of a task's formulas on the CPU: reverse mode over the values of one evaluation.

use nerd_core::tangent::{numbers_back, push, wrenches_back};
use nerd_sim::prelude::*;

use super::evaluate::{Inputs, value};
use crate::formula::{Ends, Given, Leaf, Program, sweep};
use crate::{Task, View, Work};

/// Values of one evaluation, and accumulators for its gradients.
struct Found<'a> {
    values: &'a [f64],
    lists: &'a [Vec<Given>],
    controller: &'a mut Controller,
    state: &'a [f64],
    by_state: Vec<f64>,
    /// Gradients with respect to actions or torques.
    by_given: &'a mut [f64],
    /// Gradients with respect to positions of points on links, and to distances of contact points.
    places: Vec<(usize, [f64; 3], Vector3<f64>)>,
    gaps: Vec<(usize, f64)>,
}

impl Ends<f64> for Found<'_> {
    fn value(&self, node: usize) -> f64 {
        self.values[node]
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
        let action: Vec<f64> = self.lists[call].iter().map(|x| value(self.values, *x)).collect();
        let mut by_action = vec![0.0; by.len()];
        self.controller.back(self.state, &action, by, &mut self.by_state, &mut by_action);
        by_action
    }
}

impl Program {
    /// Vector-Jacobian product for the upstream gradients `by` with respect to the results. Adds to `gradient[2 nv]`
    /// (with respect to the state) and to `by_given` (to the action or the torques).
    pub(super) fn back(
        &self,
        task: &dyn Task,
        (view, inputs): (View, Inputs),
        work: &mut Work,
        by: &[f64],
        (gradient, by_given): (&mut [f64], &mut [f64]),
    ) {
        let system = work.system.clone();
        let robot = &system.robot;
        let values = self.values(task, view, inputs, work);
        let Work { controller, data, events, .. } = work;
        let places = Vec::new();
        let gaps = Vec::new();
        let by_state = vec![0.0; robot.state_dim()];
        let lists = &self.lists;
        let state = view.state;
        let mut found = Found { values: &values, lists, controller, state, by_state, by_given, places, gaps };
        let seeds: Vec<_> = self.out.iter().copied().zip(by.iter().copied()).collect();
        sweep(&self.nodes, &self.lists, &seeds, &mut found);
        numbers_back(robot, view.state, &found.by_state, gradient);
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
        wrenches_back(robot, data, &mut loads, gradient);
    }
}
