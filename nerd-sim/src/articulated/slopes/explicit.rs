//! Back over Runge-Kutta's substeps, stage by stage.

use nalgebra::{Quaternion, Vector3};
use nerd_core::dynamics::{bias, crba, kinematics};
use nerd_core::robot::Robot;
use nerd_core::spatial::Wrench;
use nerd_core::state::vector;

use super::super::workspace::Workspace;
use super::numbers::Layout;
use super::row::{Row, set};
use super::stage::{Memory, Place};

impl Workspace {
    /// Back over substeps of `dt` that began at these states, in local velocities.
    pub(super) fn back_runge_kutta(
        &mut self,
        place: Place,
        tau: &[f64],
        states: &[Vec<f64>],
        dt: f64,
        rows: &mut [Row],
    ) -> Result<(), String> {
        let robot = &place.system.robot;
        let (nq, nv) = (robot.nq(), robot.nv());
        let mut memory = Memory::new(robot);
        for state in states.iter().rev() {
            self.runge_kutta(robot, place.scene, &mut state.clone(), tau, dt)?;
            let rates = self.rates.clone();
            let mut end = state.clone();
            for (weight, rates) in [1.0, 2.0, 2.0, 1.0].into_iter().zip(&rates) {
                end.iter_mut().zip(rates).for_each(|(x, r)| *x += weight / 6.0 * dt * r);
            }
            // By the numbers of the state, a quaternion's four among them.
            let mut by_state: Vec<Vec<f64>> = rows.iter().map(|row| row.numbers(robot, &end)).collect();
            let by_end = by_state.clone();
            let mut by_trial = vec![vec![0.0; nq + nv]; rows.len()];
            for (k, (at, weight)) in [(0.0, 1.0), (0.5, 2.0), (0.5, 2.0), (1.0, 1.0)].into_iter().enumerate().rev() {
                // How much of this stage's rate is in the trial of the next.
                let next = [0.5, 0.5, 1.0, 0.0][k];
                let mut trial = state.clone();
                if k > 0 {
                    trial.iter_mut().zip(&rates[k - 1]).for_each(|(x, r)| *x += at * dt * r);
                }
                kinematics(robot, &trial, &mut self.data);
                crba(robot, &mut self.data);
                bias(robot, &trial[nq..], &place.scene.gravity, &mut self.data);
                if !self.factor.refill(&self.data.mass) {
                    return Err(self.factor.fault(robot));
                }
                for (row, ((by_state, by_end), by_trial)) in rows.iter_mut().zip(by_state.iter_mut().zip(&by_end).zip(&mut by_trial)) {
                    let by_rate: Vec<f64> =
                        by_end.iter().zip(&*by_trial).map(|(end, trial)| dt * (weight / 6.0 * end + next * trial)).collect();
                    *by_trial = self.back_rate(robot, &trial, &rates[k], &by_rate, row, &mut memory);
                    by_state.iter_mut().zip(&*by_trial).for_each(|(s, t)| *s += t);
                }
            }
            rows.iter_mut().zip(&by_state).for_each(|(row, by)| row.take_numbers(robot, state, by));
        }
        Ok(())
    }

    /// Back over the rate of a state `[q, qd]` in local velocities, `explicit::rate` at this acceleration: the gradient by the state's numbers.
    fn back_rate(&mut self, robot: &Robot, state: &[f64], rate: &[f64], by_rate: &[f64], row: &mut Row, memory: &mut Memory) -> Vec<f64> {
        let (nq, dofs, coords) = (robot.nq(), robot.root_dofs(), robot.root_coords());
        let (q, qd) = state.split_at(nq);
        let mut virtuals = by_rate[nq..].to_vec();
        let mut qdd = rate[nq..].to_vec();
        let (mut pose, mut speed) = (vec![0.0; robot.nv()], vec![0.0; robot.nv()]);
        let mut out = vec![0.0; state.len()];
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
        out
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
    /// Its gradients by the numbers of a state `[q, qd]`, whose quaternion may be of any size.
    fn numbers(&self, robot: &Robot, state: &[f64]) -> Vec<f64> {
        let mut out = [&self.pose[robot.root_dofs()..], &self.speed].concat();
        if robot.floating() {
            let turn = turned_back(&state[3..], &vector(&self.pose));
            out = [&self.pose[3..6], turn.coords.as_slice(), &out].concat();
        }
        out
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
