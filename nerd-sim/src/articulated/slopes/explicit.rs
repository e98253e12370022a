//! Back over Runge-Kutta's substeps, stage by stage.

use nalgebra::Quaternion;
use nerd_core::dynamics::{bias, crba};

use super::super::workspace::Workspace;
use super::numbers::Layout;
use super::row::{Row, set};
use super::stage::{Memory, Place};
use crate::prelude::*;

impl Workspace {
    /// Back over the frame's substeps, of each of which the state before it and the four rates were kept.
    pub(super) fn back_runge_kutta(&mut self, place: Place, kept: &[f64], rows: &mut [Row]) -> Result<(), String> {
        let robot = &place.system.robot;
        let (nq, d) = (robot.nq(), robot.state_dim());
        let dt = place.system.frame_time * (5 * d) as f64 / kept.len() as f64;
        let mut memory = Memory::new(robot);
        let mut trial = vec![0.0; d];
        // By the numbers of the state before a substep and after it, a quaternion's four among them, and by those of a stage's trial.
        let mut by: Vec<[Vec<f64>; 3]> = vec![[0; 3].map(|_| vec![0.0; d]); rows.len()];
        let mut by_rate = vec![0.0; d];
        for substep in kept.chunks_exact(5 * d).rev() {
            let (state, rates) = substep.split_at(d);
            let rates: Vec<&[f64]> = rates.chunks_exact(d).collect();
            trial.copy_from_slice(state);
            for (weight, rates) in [1.0, 2.0, 2.0, 1.0].into_iter().zip(&rates) {
                trial.iter_mut().zip(*rates).for_each(|(x, r)| *x += weight / 6.0 * dt * r);
            }
            for (row, [by_state, by_end, by_trial]) in rows.iter().zip(&mut by) {
                row.numbers(robot, &trial, by_end);
                by_state.copy_from_slice(by_end);
                by_trial.fill(0.0);
            }
            // Shares of a stage's rate in its own trial's successor, and in the end.
            for (k, (at, next, weight)) in
                [(0.0, 0.5, 1.0), (0.5, 0.5, 2.0), (0.5, 1.0, 2.0), (1.0, 0.0, 1.0)].into_iter().enumerate().rev()
            {
                trial.copy_from_slice(state);
                if k > 0 {
                    trial.iter_mut().zip(rates[k - 1]).for_each(|(x, r)| *x += at * dt * r);
                }
                kinematics(robot, &trial, &mut self.data);
                crba(robot, &mut self.data);
                bias(robot, &trial[nq..], &place.scene.gravity, &mut self.data);
                if !self.factor.refill(&self.data.mass) {
                    return Err(self.factor.fault(robot));
                }
                for (row, [by_state, by_end, by_trial]) in rows.iter_mut().zip(&mut by) {
                    let sums = by_end.iter().zip(&*by_trial).map(|(end, trial)| dt * (weight / 6.0 * end + next * trial));
                    by_rate.iter_mut().zip(sums).for_each(|(b, sum)| *b = sum);
                    self.back_rate(robot, (&trial, rates[k]), &by_rate, row, &mut memory, by_trial);
                    by_state.iter_mut().zip(&*by_trial).for_each(|(s, t)| *s += t);
                }
            }
            rows.iter_mut().zip(&by).for_each(|(row, [by_state, ..])| row.take_numbers(robot, state, by_state));
        }
        Ok(())
    }

    /// Back over the rate of a state `[q, qd]` in local velocities, `explicit::rate`: writes the gradient by the state's numbers.
    fn back_rate(
        &self,
        robot: &Robot,
        (state, rate): (&[f64], &[f64]),
        by_rate: &[f64],
        row: &mut Row,
        memory: &mut Memory,
        out: &mut [f64],
    ) {
        let (nq, dofs, coords) = (robot.nq(), robot.root_dofs(), robot.root_coords());
        let (q, qd) = state.split_at(nq);
        let mut virtuals = by_rate[nq..].to_vec();
        let mut qdd = rate[nq..].to_vec();
        let (mut pose, mut speed) = (vec![0.0; robot.nv()], vec![0.0; robot.nv()]);
        out.fill(0.0);
        speed[dofs..].copy_from_slice(&by_rate[coords..nq]);
        if robot.floating() {
            let [w, v, by] = [qd, &qd[3..], &by_rate[nq + 3..]].map(vector);
            let turn = w.cross(&v);
            (0..3).for_each(|k| qdd[3 + k] -= turn[k]);
            let (spun, by_spun) = (numbers(&q[3..]), numbers(&by_rate[3..]));
            let by_w = (by_spun * spun.conjugate()).imag() * 0.5;
            set(&mut speed, [by_w + v.cross(&by), vector(by_rate) + by.cross(&w)]);
            out[3..7].copy_from_slice((Quaternion::from_imag(w) * by_spun * -0.5).coords.as_slice());
        }
        self.factor.solve(&mut virtuals);
        row.loads.fill(Wrench::default());
        memory.adjoint.begin(robot, &self.data, &virtuals, &qdd, &mut row.loads);
        row.inertias(robot, &self.data, &memory.adjoint);
        let by_base = memory.adjoint.end(robot, &self.data, (&virtuals, qd, &qdd), &mut row.loads, &mut speed);
        row.numbers.add(Layout::gravity, (-by_base).into());
        row.unload(robot, &self.data, &mut pose);
        for (i, joint) in robot.joints().enumerate() {
            let own = virtuals[dofs + i];
            row.torque[i] += own;
            speed[dofs + i] -= joint.damping * own;
            row.numbers.add(|at| at.joint(i, 0), [-qd[dofs + i] * own, 0.0, -qdd[dofs + i] * own]);
            if let Some(limit) = joint.limit.filter(|l| l.force(q[coords + i], qd[dofs + i]) != 0.0) {
                pose[dofs + i] -= limit.stiffness * own;
                speed[dofs + i] -= limit.damping * own;
            }
        }
        out[coords..nq].copy_from_slice(&pose[dofs..]);
        out[nq..].copy_from_slice(&speed);
        if robot.floating() {
            let by = turned_back(&q[3..], &vector(&pose));
            (0..4).for_each(|k| out[3 + k] += by.coords[k]);
        }
    }
}

/// The four numbers `x y z w` of a quaternion of any size.
fn numbers(x: &[f64]) -> Quaternion<f64> {
    Quaternion::new(x[3], x[0], x[1], x[2])
}

/// The gradient by a quaternion's numbers, of any size, from that by the turn (fixed axes) that they make: `t = 2 Im(dQ Q*) / |Q|^2`.
fn turned_back(q: &[f64], by_turn: &Vector3<f64>) -> Quaternion<f64> {
    let q = numbers(q);
    Quaternion::from_imag(*by_turn) * q * (2.0 / q.norm_squared())
}

impl Row {
    /// Writes its gradients by the numbers of a state `[q, qd]`, whose quaternion may be of any size.
    fn numbers(&self, robot: &Robot, state: &[f64], out: &mut [f64]) {
        let (dofs, coords, nq) = (robot.root_dofs(), robot.root_coords(), robot.nq());
        out[coords..nq].copy_from_slice(&self.pose[dofs..]);
        out[nq..].copy_from_slice(&self.speed);
        if robot.floating() {
            out[..3].copy_from_slice(&self.pose[3..6]);
            out[3..7].copy_from_slice(turned_back(&state[3..], &vector(&self.pose)).coords.as_slice());
        }
    }

    /// Takes over gradients by the numbers of a state.
    fn take_numbers(&mut self, robot: &Robot, state: &[f64], by: &[f64]) {
        let (dofs, coords, nq) = (robot.root_dofs(), robot.root_coords(), robot.nq());
        self.pose[dofs..].copy_from_slice(&by[coords..nq]);
        self.speed.copy_from_slice(&by[nq..]);
        if robot.floating() {
            let turn = (numbers(&by[3..]) * numbers(&state[3..]).conjugate()).imag() * 0.5;
            set(&mut self.pose, [turn, vector(by)]);
        }
    }
}
