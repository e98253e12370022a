//! Slopes of the sweeps along the tree, from the leaves to the root.
//!
//! A motion of links is `X_i = X_p + S_i x_i`: a twist, an acceleration without velocities, a virtual motion. A gradient by it is a wrench, which
//! the link above takes over. Where links are displaced by motions `D_i` about the common origin, an axis moves with its link,
//! `dS_i = D_i x S_i`, and an inertia, `dI = D x* I - I D x`; a gradient by `D_i` is a load. A floating root's own numbers are in fixed axes, which do
//! not turn with it, about its own origin, which they follow: so of its load the moment is its slope by a turn (world axes), and no more is.

use crate::prelude::*;

/// Motions `J_i x` of all links at rates `x` of the DoFs (length `nv`). Needs `kinematics`.
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

/// Adds what wrenches on links, about the common origin, do along each DoF: `J^T` of them. Each link's wrench becomes that of its subtree.
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

/// [`motions`] back: adds gradients by its rates to `out`, and by the displacements of links to `loads`.
pub fn motions_back(robot: &Robot, data: &Data, rates: &[f64], by: &mut [Wrench], loads: &mut [Wrench], out: &mut [f64]) {
    onto(robot, data, by, out);
    for (i, _) in robot.links.iter().enumerate().filter(|(_, link)| link.joint.is_some()) {
        loads[i] += data.axis[i].cross_wrench(&(by[i] * rates[data.dof[i]]));
    }
}

/// Working memory for slopes of inverse dynamics, `tau . virtual rates`, and of whatever else is made of the motions in it.
#[derive(Clone, Debug)]
pub struct Adjoint {
    /// Motions of links at the virtual rates.
    pub virtuals: Vec<Motion>,
    /// What `qdd` does to accelerations of links.
    pub quickened: Vec<Motion>,
    /// Gradients by `virtuals`.
    pub by_virtual: Vec<Wrench>,
    /// By `quickened`.
    pub by_quickened: Vec<Wrench>,
    /// By twists, `data.velocity`.
    pub by_velocity: Vec<Wrench>,
    /// By accelerations at zero `qdd`, `data.acceleration` of `bias`.
    pub by_acceleration: Vec<Wrench>,
    unused: Vec<f64>,
}

impl Adjoint {
    /// Room for those of a robot.
    pub fn new(robot: &Robot) -> Self {
        let n = robot.links.len();
        let (motions, wrenches) = (vec![Motion::default(); n], vec![Wrench::default(); n]);
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

    /// Begins with `-virtual . RNEA(q, qd, qdd)` and adds its gradients by displacements to `loads`. Needs `inertias` and [`super::bias`] at the
    /// twists' rates. Wrenches from outside and armatures are the caller's.
    ///
    /// With `F = I a + v x* I v` of a link, L its virtual motion and `Y = v x L`, `-L . F = Y . I v - L . I a`.
    pub fn begin(&mut self, robot: &Robot, data: &Data, virtual_rates: &[f64], qdd: &[f64], loads: &mut [Wrench]) {
        motions(robot, virtual_rates, data, &mut self.virtuals);
        motions(robot, qdd, data, &mut self.quickened);
        for (i, load) in loads.iter_mut().enumerate() {
            let (inertia, v, l) = (&data.inertia[i], &data.velocity[i], &self.virtuals[i]);
            let (a, y) = (data.acceleration[i] + self.quickened[i], v.cross(l));
            let (of_a, of_v, of_l, of_y) = (inertia.apply(&a), inertia.apply(v), inertia.apply(l), inertia.apply(&y));
            self.by_virtual[i] = (of_a + v.cross_wrench(&of_v)) * -1.0;
            self.by_quickened[i] = of_l * -1.0;
            self.by_acceleration[i] = of_l * -1.0;
            self.by_velocity[i] = l.cross_wrench(&of_v) + of_y;
            *load += l.cross_wrench(&of_a) + a.cross_wrench(&of_l) - y.cross_wrench(&of_v) - v.cross_wrench(&of_y);
        }
    }

    /// Ends: adds the gradients by the twists' rates `qd` to `out`, and by displacements to `loads`. Returns that by the acceleration of the base,
    /// which is `-gravity`.
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
        let mut base = Vector3::zeros();
        // A_i = A_p + V_i x S_i qd_i
        for (i, link) in robot.links.iter().enumerate().rev() {
            let by = self.by_acceleration[i];
            if link.joint.is_some() {
                let (axis, rate) = (&data.axis[i], qd[data.dof[i]]);
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

    /// Adds to `loads` what displacements do to `scale` times the kinetic energy twice, `x^T M x`, at the rates of `self.virtuals`; the caller adds that of
    /// what else the motions do by `by_virtual`, which this begins, and ends with [`Self::end_energy`].
    pub fn begin_energy(&mut self, robot: &Robot, data: &Data, rates: &[f64], scale: f64, loads: &mut [Wrench]) {
        motions(robot, rates, data, &mut self.virtuals);
        for (i, load) in loads.iter_mut().enumerate() {
            let (own, momentum) = (&self.virtuals[i], data.inertia[i].apply(&self.virtuals[i]) * (2.0 * scale));
            self.by_virtual[i] = momentum;
            *load += own.cross_wrench(&momentum) * -1.0;
        }
    }

    /// See [`Self::begin_energy`].
    pub fn end_energy(&mut self, robot: &Robot, data: &Data, rates: &[f64], loads: &mut [Wrench]) {
        motions_back(robot, data, rates, &mut self.by_virtual, loads, &mut self.unused);
    }
}
