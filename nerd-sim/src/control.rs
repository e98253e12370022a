//! Controllers: map actions in [-1, 1] to joint torques, once a frame, outside any solver.

use crate::internal::*;

/// The controller of a system's specification: direct torques, or a PD law on joint positions. Actions have one entry
/// per joint.
#[derive(Clone, Debug)]
pub struct Controller {
    system: Arc<System>,
    /// Stiffness (N m/rad or N/m) and damping (N m s/rad or N s/m) by joint; zero without a PD law.
    pub gains: Vec<[f64; 2]>,
    /// Whether the law acts inside the frame ([`crate::solver::Simulation::serve`]). [`Controller::torques`] then
    /// returns the torques at the frame's start, without torque limits.
    pub servo: bool,
    stable_pd: Option<StablePd>,
    wraps: Vec<bool>,
    /// Position error (rad or m) and velocity (rad/s or m/s) by joint, at the present state or predicted for the end of
    /// the frame.
    gaps: Vec<[f64; 2]>,
}

impl Controller {
    /// The controller that `system.spec.control` describes.
    pub fn new(system: &Arc<System>) -> Self {
        let stable_pd = system.spec.control.is_some_and(|control| control.stable_pd);
        let gains = system.joint_specs().map(|j| [j.kp, j.kd]).collect();
        let wraps = system.robot.joints().map(|j| j.wraps()).collect();
        Self {
            system: system.clone(),
            gains,
            servo: false,
            stable_pd: stable_pd.then(|| StablePd::new(system)),
            wraps,
            gaps: Vec::new(),
        }
    }

    /// Switches to the gains and parameters of another robot of the same family.
    pub fn turn_to(&mut self, system: &Arc<System>) {
        if !Arc::ptr_eq(&self.system, system) {
            self.system = system.clone();
            self.gains.iter_mut().zip(system.joint_specs()).for_each(|(gains, joint)| *gains = [joint.kp, joint.kd]);
        }
    }

    /// Torques (N m or N), one per joint, for an action at a state `[q, qd]`.
    ///
    /// Without `[control]`, the torque is `gain clamp(a)` for action a. With `[control]`, the torque is
    /// `kp (target - q) - kd qd`. The target is the default pose (with `relative`: the present pose) plus `scale a`.
    /// With `clamp` the torque stays within the gain. Toward a default pose, a joint without limits takes the shorter
    /// direction.
    ///
    /// A torque held constant over a frame h makes a stiff law unstable in any solver (`kp > 4 I / h^2`). With
    /// `stable_pd` the law acts on the predicted state at the end of the frame: linearised, without contact. This law
    /// is stable at any gain (Tan, Liu and Turk 2011, stable proportional-derivative control):
    ///
    /// ```text
    /// (M + h kd + h^2 kp) qdd = kp (target - q - h qd) - kd qd - bias
    /// tau = kp (target - q - h qd - h^2 qdd) - kd (qd + h qdd)
    /// ```
    ///
    /// The frame time limits the effective stiffness of this law, most on light links. A servo that acts inside the
    /// frame has no such limit.
    ///
    /// # Panics
    /// If `state`, `action` or `out` have other sizes than the system.
    pub fn torques(&mut self, state: &[f64], action: &[f64], out: &mut [f64]) {
        let joints = self.system.robot.joint_count();
        let found = action.len();
        assert!(found == joints && out.len() == joints, "one action and one torque a joint");
        if self.system.spec.control.is_none() {
            for ((tau, joint), a) in out.iter_mut().zip(self.system.joint_specs()).zip(action) {
                *tau = joint.gain.unwrap_or(joint.torque) * a.clamp(-1.0, 1.0);
            }
            return;
        }
        self.look(state, action);
        (0..joints).for_each(|i| out[i] = self.law(i).clamp(-self.torque_limit(i), self.torque_limit(i)));
    }

    /// Vector-Jacobian product of [`Self::torques`]: adds to the gradients with respect to `state` and `action`. With
    /// `stable_pd`, mass matrix and bias forces count as constants.
    ///
    /// # Panics
    /// Under the same conditions as [`Self::torques`].
    pub fn back(&mut self, state: &[f64], action: &[f64], by: &[f64], by_state: &mut [f64], by_action: &mut [f64]) {
        let system = self.system.clone();
        let robot = &system.robot;
        let Some(law) = &system.spec.control else {
            let inside = |a: f64| f64::from(u8::from((-1.0..=1.0).contains(&a)));
            for (((g, joint), a), by) in by_action.iter_mut().zip(system.joint_specs()).zip(action).zip(by) {
                *g += by * joint.gain.unwrap_or(joint.torque) * inside(*a);
            }
            return;
        };
        let h = system.frame_time;
        let predicted = self.look(state, action);
        let free = |i: usize| if self.law(i).abs() <= self.torque_limit(i) { by[i] } else { 0.0 };
        // Gradients with respect to predicted position error and velocity. The solve with `stable_pd` maps both to the
        // present state.
        let mut gradients: Vec<[f64; 2]> =
            (0..by.len()).map(|i| [self.gains[i][0] * free(i), -self.gains[i][1] * free(i)]).collect();
        if let Some(solved) = self.stable_pd.as_mut().filter(|_| predicted) {
            let accelerations = gradients.iter().map(|[gap, speed]| h * speed - h * h * gap);
            let by_push = solved.answers(robot.root_dofs(), accelerations);
            for (([gap, speed], [kp, kd]), push) in gradients.iter_mut().zip(&self.gains).zip(by_push) {
                *speed -= h * *gap + (kd + h * kp) * push;
                *gap += kp * push;
            }
        }
        for (i, [gap, speed]) in gradients.into_iter().enumerate() {
            by_action[i] += law.scale * gap;
            by_state[robot.root_coords() + i] -= if law.relative { 0.0 } else { gap };
            by_state[robot.nq() + robot.root_dofs() + i] += speed;
        }
    }

    /// Computes position errors and velocities of the joints. Returns whether errors and velocities are predicted for
    /// the end of the frame.
    fn look(&mut self, state: &[f64], action: &[f64]) -> bool {
        let Self { system, gains, servo, stable_pd, wraps, gaps } = self;
        let robot = &system.robot;
        let h = system.frame_time;
        let (q, qd) = state.split_at(robot.nq());
        let (q, qd) = (&q[robot.root_coords()..], &qd[robot.root_dofs()..]);
        let Some(law) = &system.spec.control else { return false };
        gaps.clear();
        for (i, joint) in system.joint_specs().enumerate() {
            let from = if law.relative { q[i] } else { joint.default_q };
            let gap = from + law.scale * action[i] - q[i];
            gaps.push([if wraps[i] && !law.relative { wrap(gap) } else { gap }, qd[i]]);
        }
        let Some(qdd) =
            stable_pd.as_mut().filter(|_| !*servo).and_then(|a| a.accelerations(system, state, gains, gaps))
        else {
            return false;
        };
        for ([gap, speed], qdd) in gaps.iter_mut().zip(qdd) {
            *gap -= h * (*speed + h * qdd);
            *speed += h * qdd;
        }
        true
    }

    /// Torque of the PD law on joint `i`, before the torque limit.
    fn law(&self, i: usize) -> f64 {
        let [kp, kd] = self.gains[i];
        let [gap, speed] = self.gaps[i];
        kp * gap - kd * speed
    }

    fn torque_limit(&self, i: usize) -> f64 {
        if self.servo { f64::INFINITY } else { self.system.torque_limit(i) }
    }
}

/// Working memory of the stable PD law.
#[derive(Clone, Debug)]
struct StablePd {
    data: Data,
    factor: Factor,
    state: Vec<f64>,
}

impl StablePd {
    fn new(system: &System) -> Self {
        let robot = &system.robot;
        Self { data: system.data(), factor: Factor::new(robot), state: robot.zero_state() }
    }

    /// Joint accelerations under the stable PD law, without contact; `None` where its matrix is not positive definite.
    fn accelerations(
        &mut self,
        system: &System,
        state: &[f64],
        gains: &[[f64; 2]],
        gaps: &[[f64; 2]],
    ) -> Option<&[f64]> {
        let robot = &system.robot;
        let h = system.frame_time;
        let dofs = robot.root_dofs();
        self.state.copy_from_slice(state);
        let (q, qd) = self.state.split_at_mut(robot.nq());
        to_local(robot, q, qd);
        kinematics(robot, q, &mut self.data);
        crba(robot, &mut self.data);
        bias(robot, qd, &system.gravity(), &mut self.data);
        let qdd = self.data.qdd.as_mut_slice();
        qdd.iter_mut().zip(self.data.tau.iter()).for_each(|(a, b)| *a = -b);
        for (i, ([kp, kd], [gap, speed])) in gains.iter().zip(gaps).enumerate() {
            let k = dofs + i;
            self.data.mass[(k, k)] += h * (kd + h * kp);
            qdd[k] += kp * (gap - h * speed) - kd * speed;
        }
        if !self.factor.refill(&self.data.mass) {
            return None;
        }
        self.factor.solve(qdd);
        Some(&self.data.qdd.as_slice()[dofs..])
    }

    /// Solves with the matrix factored by [`Self::accelerations`], for other generalised forces on the joints.
    fn answers(&mut self, dofs: usize, pushes: impl Iterator<Item = f64>) -> &[f64] {
        let all = self.data.qdd.as_mut_slice();
        all[..dofs].fill(0.0);
        all[dofs..].iter_mut().zip(pushes).for_each(|(x, push)| *x = push);
        self.factor.solve(all);
        &all[dofs..]
    }
}
