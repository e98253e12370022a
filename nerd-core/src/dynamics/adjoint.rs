//! Adjoints of RNEA and of kinetic energy: gradients by sweeps from the leaves to the root.
//!
//! Link motions obey `X_i = X_p + S_i x_i`: twists, accelerations without velocity terms, and virtual motions. The
//! gradient with respect to `X_i` is a wrench; the parent's gradient includes it. `D_i` is the displacement of link i
//! about the common origin. Axis and inertia move with their link: `dS_i = D_i x S_i`, `dI = D x* I - I D x`. The
//! gradient with respect to `D_i` is called a load. The coordinates of a floating root are about the root's moving
//! position, in axes that do not rotate with the root. So only the moment of the root's load is a gradient: with
//! respect to the root's rotation (world axes).

use crate::prelude::*;

/// Damping wrench on a floating root at position `x` (m, from the common origin) with twist `v`.
#[inline]
pub(super) fn drag(robot: &Robot, v: &Motion, x: &Vector3<f64>) -> Wrench {
    let d = robot.free.damping;
    Wrench::force_at(v.at(x) * d, x) + Wrench::new(v.ang * d, Vector3::zeros())
}

/// Writes the motion `J_i x` of each link i to `out[link]`, for the DoF rates x = `rates[nv]`. Needs `kinematics`.
#[inline]
pub fn motions(robot: &Robot, rates: &[f64], data: &Data, out: &mut [Motion]) {
    for (i, link) in robot.links.iter().enumerate() {
        out[i] = match (link.joint.is_some(), link.parent) {
            (false, _) => Motion::from_slice(rates),
            (true, None) => data.axis[i] * rates[data.dof[i]],
            (true, Some(p)) => out[p] + data.axis[i] * rates[data.dof[i]],
        };
    }
}

/// Adds `sum_i J_i^T w_i` to `out[nv]`, with the wrenches w = `wrenches[link]` about the common origin. On return each
/// wrench is the sum over its link's subtree.
pub fn onto(robot: &Robot, data: &Data, wrenches: &mut [Wrench], out: &mut [f64]) {
    for (i, link) in robot.links.iter().enumerate().rev() {
        let wrench = wrenches[i];
        match link.joint {
            Some(_) => out[data.dof[i]] += data.axis[i].dot(&wrench),
            None => out[..6].iter_mut().zip(wrench.vector().iter()).for_each(|(o, w)| *o += w),
        }
        if let Some(p) = link.parent {
            wrenches[p] += wrench;
        }
    }
}

/// Adjoint of [`motions`]. Adds the gradient with respect to the rates to `out[nv]`, and the gradient with respect to
/// link displacements to `loads[link]`. `by[link]` holds the gradients with respect to the motions; on return it holds
/// their subtree sums.
pub fn motions_back(
    robot: &Robot,
    data: &Data,
    rates: &[f64],
    by: &mut [Wrench],
    loads: &mut [Wrench],
    out: &mut [f64],
) {
    onto(robot, data, by, out);
    for (i, _) in robot.links.iter().enumerate().filter(|(_, link)| link.joint.is_some()) {
        loads[i] += data.axis[i].cross_wrench(&(by[i] * rates[data.dof[i]]));
    }
}

/// Position (m, from the common origin) and mass (kg) of a link's gravity-compensated mass, if nonzero.
fn lifted(robot: &Robot, data: &Data, link: usize) -> Option<(Vector3<f64>, f64)> {
    let own = &robot.links[link].lifted;
    (own.mass != 0.0).then(|| (data.position[link] + data.rotation[link] * own.at, own.mass))
}

/// Working memory for gradients of `tau . virtual rates`, with tau from inverse dynamics, and of other functions of the
/// link motions.
#[derive(Clone, Debug)]
pub struct Adjoint {
    /// Link motions at the virtual rates.
    pub virtuals: Vec<Motion>,
    /// Link accelerations caused by `qdd` alone, without velocity terms and gravity.
    pub quickened: Vec<Motion>,
    /// Gradients with respect to `virtuals`.
    pub by_virtual: Vec<Wrench>,
    /// Gradients with respect to `quickened`.
    pub by_quickened: Vec<Wrench>,
    /// Gradients with respect to the twists `data.velocity`.
    pub by_velocity: Vec<Wrench>,
    /// Gradients with respect to the accelerations at zero `qdd`, which are `data.acceleration` after `bias`.
    pub by_acceleration: Vec<Wrench>,
    unused: Vec<f64>,
}

impl Adjoint {
    /// Working memory for a robot.
    pub fn new(robot: &Robot) -> Self {
        let n = robot.links.len();
        let motions = vec![Motion::default(); n];
        let wrenches = vec![Wrench::default(); n];
        Self {
            virtuals: motions.clone(),
            quickened: motions,
            by_virtual: wrenches.clone(),
            by_quickened: wrenches.clone(),
            by_velocity: wrenches.clone(),
            by_acceleration: wrenches,
            unused: vec![0.0; robot.nv()],
        }
    }

    /// Starts the adjoint of `-virtual . RNEA(q, qd, qdd)`; adds its gradient with respect to link displacements to
    /// `loads[link]`. Needs `inertias`, and [`super::bias`] under the same `gravity`. The caller adds the parts of
    /// external wrenches and armature.
    ///
    /// With `F = I a + v x* I v` the wrench of a link, L its virtual motion and `Y = v x L`: `-L . F = Y . I v - L . I
    /// a`.
    pub fn begin(
        &mut self,
        robot: &Robot,
        data: &Data,
        (virtual_rates, qdd): (&[f64], &[f64]),
        gravity: &Vector3<f64>,
        loads: &mut [Wrench],
    ) {
        motions(robot, virtual_rates, data, &mut self.virtuals);
        motions(robot, qdd, data, &mut self.quickened);
        for (i, load) in loads.iter_mut().enumerate() {
            let inertia = &data.inertia[i];
            let v = &data.velocity[i];
            let l = &self.virtuals[i];
            let a = data.acceleration[i] + self.quickened[i];
            let y = v.cross(l);
            let (of_a, of_v, of_l, of_y) = (inertia.apply(&a), inertia.apply(v), inertia.apply(l), inertia.apply(&y));
            self.by_virtual[i] = (of_a + v.cross_wrench(&of_v)) * -1.0;
            self.by_quickened[i] = of_l * -1.0;
            self.by_acceleration[i] = of_l * -1.0;
            self.by_velocity[i] = l.cross_wrench(&of_v) + of_y;
            *load += l.cross_wrench(&of_a) + a.cross_wrench(&of_l) - y.cross_wrench(&of_v) - v.cross_wrench(&of_y);
            if let Some((x, mass)) = lifted(robot, data, i) {
                // The compensated point mass moves with the link; the direction of its weight stays.
                let weight = gravity * mass;
                self.by_virtual[i] = self.by_virtual[i] - Wrench::force_at(weight, &x);
                *load += Wrench::force_at(l.ang.cross(&weight), &x);
            }
        }
        if robot.free.damping != 0.0 {
            let v = &data.velocity[0];
            let l = &self.virtuals[0];
            let x = &data.position[0];
            self.by_virtual[0] = self.by_virtual[0] - drag(robot, v, x);
            self.by_velocity[0] = self.by_velocity[0] - drag(robot, l, x);
            // The damping acts at the root's position, which moves relative to the common origin.
            loads[0] =
                loads[0] - Wrench::force_at((v.at(x).cross(&l.ang) + l.at(x).cross(&v.ang)) * robot.free.damping, x);
        }
    }

    /// Ends the adjoint that [`Self::begin`] started. Adds the gradient with respect to `qd` to `out[nv]`, and the one
    /// with respect to link displacements to `loads[link]`. Returns the gradient with respect to the acceleration of
    /// the base, which is `-gravity`.
    pub fn end(
        &mut self,
        robot: &Robot,
        data: &Data,
        (virtual_rates, qd, qdd): (&[f64], &[f64], &[f64]),
        loads: &mut [Wrench],
        out: &mut [f64],
    ) -> Vector3<f64> {
        motions_back(robot, data, virtual_rates, &mut self.by_virtual, loads, &mut self.unused);
        motions_back(robot, data, qdd, &mut self.by_quickened, loads, &mut self.unused);
        let lift = (0..robot.links.len())
            .filter_map(|i| lifted(robot, data, i).map(|(x, mass)| self.virtuals[i].at(&x) * mass));
        let mut base: Vector3<f64> = lift.sum();
        // Adjoint of A_i = A_p + V_i x S_i qd_i.
        for (i, link) in robot.links.iter().enumerate().rev() {
            let by = self.by_acceleration[i];
            if link.joint.is_some() {
                let axis = &data.axis[i];
                let rate = qd[data.dof[i]];
                self.by_velocity[i] += (*axis * rate).cross_wrench(&by);
                let by_own = data.velocity[i].cross_wrench(&by) * -1.0;
                out[data.dof[i]] += axis.dot(&by_own);
                loads[i] += axis.cross_wrench(&(by_own * rate));
            }
            match link.parent {
                Some(p) => self.by_acceleration[p] += by,
                None => base += by.lin,
            }
        }
        motions_back(robot, data, qd, &mut self.by_velocity, loads, out);
        base
    }

    /// Starts the adjoint of `scale` times `x^T M x`, twice the kinetic energy at rates x. Adds its gradient with
    /// respect to link displacements to `loads[link]` and sets `by_virtual`. The caller adds the gradients of other
    /// functions of the link motions to `by_virtual`, then calls [`Self::end_energy`].
    pub fn begin_energy(&mut self, robot: &Robot, data: &Data, rates: &[f64], scale: f64, loads: &mut [Wrench]) {
        motions(robot, rates, data, &mut self.virtuals);
        for (i, load) in loads.iter_mut().enumerate() {
            let own = &self.virtuals[i];
            let momentum = data.inertia[i].apply(&self.virtuals[i]) * (2.0 * scale);
            self.by_virtual[i] = momentum;
            *load += own.cross_wrench(&momentum) * -1.0;
        }
    }

    /// Ends the adjoint that [`Self::begin_energy`] started: adds the gradient with respect to link displacements to
    /// `loads[link]`.
    pub fn end_energy(&mut self, robot: &Robot, data: &Data, rates: &[f64], loads: &mut [Wrench]) {
        motions_back(robot, data, rates, &mut self.by_virtual, loads, &mut self.unused);
    }
}
