//! Controllers: actions in [-1, 1] to joint torques, once a frame, outside any solver.

use crate::internal::*;

/// A system's own controller: torque, or joint position by a PD law. An action has one entry a joint.
#[derive(Clone, Debug)]
pub struct Controller {
    system: Arc<System>,
    /// Stiffness (N m/rad or N/m) and damping (N m s/rad or N s/m) by joint; without a PD law both are zero.
    pub gains: Vec<[f64; 2]>,
    /// Whether the law acts inside the frame ([`crate::solver::Simulation::serve`]): torques are those of its beginning, without bounds.
    pub servo: bool,
    ahead: Option<Ahead>,
    wraps: Vec<bool>,
    /// Distance from the target and velocity by joint, now or a frame ahead.
    gaps: Vec<[f64; 2]>,
}

impl Controller {
    /// The controller that `system.spec.control` describes.
    pub fn new(system: &Arc<System>) -> Self {
        let ahead = system.spec.control.is_some_and(|control| control.ahead);
        let gains = system.joint_specs().map(|j| [j.kp, j.kd]).collect();
        let wraps = system.robot.joints().map(|j| j.wraps()).collect();
        Self { system: system.clone(), gains, servo: false, ahead: ahead.then(|| Ahead::new(system)), wraps, gaps: Vec::new() }
    }

    /// From here on that of another robot of the same family.
    pub fn turn_to(&mut self, system: &Arc<System>) {
        if !Arc::ptr_eq(&self.system, system) {
            self.system = system.clone();
            self.gains.iter_mut().zip(system.joint_specs()).for_each(|(gains, joint)| *gains = [joint.kp, joint.kd]);
        }
    }

    /// Torques for an action at a state `[q, qd]`, one a joint (N m or N).
    ///
    /// Without `[control]`: `gain clamp(a)`. With it: `kp (target - q) - kd qd`, where the target is the default pose, or
    /// with `relative` the present one, plus `scale a`; with `clamp` kept within the gain. To a default pose a joint without
    /// limits goes the shorter way round.
    ///
    /// A torque held over a frame h makes a stiff law unstable, whatever solver follows (`kp > 4 I / h^2`). With `ahead`
    /// the law is that of the state which the robot without contact will have reached, linearised, so that it is stable at
    /// any gain and no stiffer than a frame allows (Tan, Liu and Turk 2011, stable proportional-derivative control):
    ///
    /// ```text
    /// (M + h kd + h^2 kp) qdd = kp (target - q - h qd) - kd qd - bias
    /// tau = kp (target - q - h qd - h^2 qdd) - kd (qd + h qdd)
    /// ```
    ///
    /// Of a light link it is as soft as the frame is long, contact or not; a servo that acts inside the frame is not.
    ///
    /// # Panics
    /// If `state`, `action` and `out` are not of the system's sizes.
    pub fn torques(&mut self, state: &[f64], action: &[f64], out: &mut [f64]) {
        let (joints, found) = (self.system.robot.joint_count(), action.len());
        assert!(found == joints && out.len() == joints, "one action and one torque a joint");
        if self.system.spec.control.is_none() {
            for ((tau, joint), a) in out.iter_mut().zip(self.system.joint_specs()).zip(action) {
                *tau = joint.gain.unwrap_or(joint.torque) * a.clamp(-1.0, 1.0);
            }
            return;
        }
        self.look(state, action);
        (0..joints).for_each(|i| out[i] = self.law(i).clamp(-self.most(i), self.most(i)));
    }

    /// Vector-Jacobian product of [`Self::torques`]: adds to gradients by the numbers of the state and by the action. Mass matrix and bias of
    /// a law that looks ahead count as constant.
    ///
    /// # Panics
    /// As [`Self::torques`].
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
        let (h, ahead) = (system.frame_time, self.look(state, action));
        let free = |i: usize| if self.law(i).abs() <= self.most(i) { by[i] } else { 0.0 };
        // By gap and speed as they are then, and through the acceleration by those of now.
        let mut slopes: Vec<[f64; 2]> = (0..by.len()).map(|i| [self.gains[i][0] * free(i), -self.gains[i][1] * free(i)]).collect();
        if let Some(solved) = self.ahead.as_mut().filter(|_| ahead) {
            let accelerations = slopes.iter().map(|[gap, speed]| h * speed - h * h * gap);
            let by_push = solved.answers(robot.root_dofs(), accelerations);
            for (([gap, speed], [kp, kd]), push) in slopes.iter_mut().zip(&self.gains).zip(by_push) {
                *speed -= h * *gap + (kd + h * kp) * push;
                *gap += kp * push;
            }
        }
        for (i, [gap, speed]) in slopes.into_iter().enumerate() {
            by_action[i] += law.scale * gap;
            by_state[robot.root_coords() + i] -= if law.relative { 0.0 } else { gap };
            by_state[robot.nq() + robot.root_dofs() + i] += speed;
        }
    }

    /// Finds how far the position law's joints are from their targets, and how fast, now or, if that is looked at, a frame ahead.
    fn look(&mut self, state: &[f64], action: &[f64]) -> bool {
        let Self { system, gains, servo, ahead, wraps, gaps } = self;
        let (robot, h) = (&system.robot, system.frame_time);
        let (q, qd) = state.split_at(robot.nq());
        let (q, qd) = (&q[robot.root_coords()..], &qd[robot.root_dofs()..]);
        let Some(law) = &system.spec.control else { return false };
        gaps.clear();
        for (i, joint) in system.joint_specs().enumerate() {
            let from = if law.relative { q[i] } else { joint.default };
            let gap = from + law.scale * action[i] - q[i];
            gaps.push([if wraps[i] && !law.relative { wrap(gap) } else { gap }, qd[i]]);
        }
        let Some(qdd) = ahead.as_mut().filter(|_| !*servo).and_then(|a| a.accelerations(system, state, gains, gaps)) else { return false };
        for ([gap, speed], qdd) in gaps.iter_mut().zip(qdd) {
            *gap -= h * (*speed + h * qdd);
            *speed += h * qdd;
        }
        true
    }

    /// What the law makes of a joint's gap, and the most that it may here.
    fn law(&self, i: usize) -> f64 {
        let ([kp, kd], [gap, speed]) = (self.gains[i], self.gaps[i]);
        kp * gap - kd * speed
    }

    fn most(&self, i: usize) -> f64 {
        if self.servo { f64::INFINITY } else { self.system.most(i) }
    }
}

/// Working memory of the law that looks ahead.
#[derive(Clone, Debug)]
struct Ahead {
    data: Data,
    factor: Factor,
    state: Vec<f64>,
}

impl Ahead {
    fn new(system: &System) -> Self {
        let robot = &system.robot;
        Self { data: system.data(), factor: Factor::new(robot), state: robot.zero_state() }
    }

    /// Joint accelerations under the law, without contact; none at a state that has none.
    fn accelerations(&mut self, system: &System, state: &[f64], gains: &[[f64; 2]], gaps: &[[f64; 2]]) -> Option<&[f64]> {
        let (robot, h) = (&system.robot, system.frame_time);
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

    /// The same matrix, asked about other pushes on the joints, after [`Self::accelerations`].
    fn answers(&mut self, dofs: usize, pushes: impl Iterator<Item = f64>) -> &[f64] {
        let all = self.data.qdd.as_mut_slice();
        all[..dofs].fill(0.0);
        all[dofs..].iter_mut().zip(pushes).for_each(|(x, push)| *x = push);
        self.factor.solve(all);
        &all[dofs..]
    }
}
