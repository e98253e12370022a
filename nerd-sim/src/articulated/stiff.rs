//! Detects dampers and limits too stiff for an explicit substep h, before they diverge.
//!
//! A damper d and a spring k at joint i change the joint's velocity v within a substep by `h (d + h k) w v`. Here
//! `1 / w = 1 / (M^-1)_ii` is the joint's own inertia, and r the spectral radius of `S^1/2 M^-1 S^1/2`,
//! `S_i = h (2 d + h k)`. Symplectic Euler is stable for r < 4, Runge-Kutta for r < 5.5. For r < 2 a lone damper does
//! not overshoot under symplectic Euler. Under Runge-Kutta its velocity after a substep is within 2 % of the exact one.
//! The trace bounds the radius, and the radius of all joints bounds any subset's. So the radius is seldom computed. A
//! frame with too stiff a force is stepped implicitly instead.
//!
//! Friction's drag c is bounded by Coulomb's law, so it never diverges. But where `h c w` is large, with `1 / w` the
//! point's inertia, the point's velocity oscillates about zero and a standing robot creeps. A frame with such friction,
//! too, is stepped implicitly.

use nerd_core::{dynamics::Factor, spatial::parallel_axis};

use crate::prelude::*;

/// Largest spectral radius r of dampers, and of limits under symplectic Euler.
pub(super) const MAX_RADIUS: f64 = 2.0;
/// Largest spectral radius r of limits under Runge-Kutta. The Ant's r reaches 5.0 with all its joints beyond their
/// limits.
pub(super) const MAX_RADIUS_RK4: f64 = 5.2;
/// Largest `h c w` of friction, with the upper bound on w. ANYmal's shins have an `h c w` of up to 8.4 with the
/// reference's substeps.
pub(super) const MAX_DRAG: f64 = 12.0;
/// Most simultaneous contacts of a pair of links: four carry a face that lies on another.
const MAX_PAIR_CONTACTS: usize = 4;
/// Steps of the power iteration.
pub(super) const POWER_STEPS: usize = 12;

/// Bounds on inertia for a robot in any pose.
pub(super) struct Bounds {
    /// Lower bound on each joint's inertia (kg m^2 or kg).
    pub(super) least: Vec<f64>,
    /// Upper bound on w of each contact point in any direction (1/kg).
    pub(super) inv_mass: Vec<f64>,
    /// Sum over the joints of twice the damping over the least inertia, `2 d / least` (1/s).
    pub(super) damped: f64,
    /// w n (1/kg) of each pair of links that may touch, see [`inv_masses`].
    pub(super) folds: Vec<f64>,
}

impl Bounds {
    pub(super) fn new(system: &System) -> Self {
        let robot = &system.robot;
        let least: Vec<f64> = (0..robot.links.len()).filter_map(|i| least_inertia(system, i)).collect();
        let share =
            |(joint, least): (&Joint, &f64)| if joint.damping > 0.0 { 2.0 * joint.damping / least } else { 0.0 };
        let damped = robot.joints().zip(&least).map(share).sum();
        let of = |p: &ContactPoint| {
            p.places().iter().map(|place| inv_mass(&robot.links[p.link].inertia, place)).fold(0.0, f64::max)
        };
        let inv_mass = robot.contact_points.iter().map(of).collect();
        Self { least, inv_mass, damped, folds: inv_masses(system) }
    }
}

pub(super) struct Stiff {
    pub(super) bounds: Arc<Bounds>,
    /// Whether the dampers were checked in this frame.
    looked: bool,
    /// Whether all limits together are soft enough for explicit substeps of this frame, if known.
    soft: Option<bool>,
    /// w of each joint, computed at most once a frame.
    weights: Vec<Option<f64>>,
    /// Joints beyond a limit now, each with its `S_i = h (2 d + h k)`.
    acting: Vec<(usize, f64)>,
    others: Vec<(usize, f64)>,
    vector: Vec<f64>,
    column: Vec<f64>,
}

impl Stiff {
    pub(super) fn new(robot: &Robot, bounds: Arc<Bounds>) -> Self {
        let n = bounds.least.len();
        Self {
            bounds,
            looked: false,
            soft: None,
            weights: vec![None; n],
            acting: Vec::with_capacity(n),
            others: Vec::with_capacity(n),
            vector: vec![0.0; n],
            column: vec![0.0; robot.nv()],
        }
    }

    pub(super) fn begin(&mut self) {
        (self.looked, self.soft) = (false, None);
        self.weights.fill(None);
    }

    /// Whether a drag (N s/m) at contact point `point` is too stiff for a substep `h`.
    #[inline]
    pub(super) fn drags(&self, point: usize, drag: f64, h: f64) -> bool {
        h * drag * self.bounds.inv_mass[point] > MAX_DRAG
    }

    #[inline]
    pub(super) fn clear(&mut self) {
        self.acting.clear();
    }

    #[inline]
    pub(super) fn beyond(&mut self, i: usize, limit: &Limit, h: f64) {
        self.acting.push((i, stiffness(limit, h)));
    }

    /// Whether the acting limits are too stiff for a substep `h`; `factor`: of the mass matrix.
    #[inline]
    pub(super) fn limits(&mut self, robot: &Robot, factor: &Factor, h: f64, integrator: Integrator) -> bool {
        if self.acting.is_empty() {
            return false;
        }
        let most = if integrator == Integrator::Rk4 { MAX_RADIUS_RK4 } else { MAX_RADIUS };
        if self.soft == Some(true) || self.acting.iter().map(|(i, s)| s / self.bounds.least[*i]).sum::<f64>() <= most {
            return false;
        }
        let dofs = robot.root_dofs();
        let mut trace = 0.0;
        for (i, s) in &self.acting {
            trace += s * *self.weights[*i].get_or_insert_with(|| {
                self.column.fill(0.0);
                self.column[dofs + i] = 1.0;
                factor.solve(&mut self.column);
                self.column[dofs + i]
            });
        }
        if trace <= most {
            return false;
        }
        if self.soft.is_none() {
            self.others.clear();
            self.others.extend(robot.joints().enumerate().filter_map(|(i, j)| Some((i, stiffness(&j.limit?, h)))));
            self.soft = Some(radius(&self.others, dofs, factor, &mut self.vector, &mut self.column) <= most);
        }
        self.soft == Some(false) && radius(&self.acting, dofs, factor, &mut self.vector, &mut self.column) > most
    }

    /// Whether the joints' dampers are too stiff for a substep `h`; checked once a frame.
    #[inline]
    pub(super) fn dampers(&mut self, robot: &Robot, factor: &Factor, h: f64) -> bool {
        if self.looked || h * self.bounds.damped <= MAX_RADIUS {
            return false;
        }
        self.looked = true;
        self.others.clear();
        self.others
            .extend(robot.joints().enumerate().filter(|(_, j)| j.damping > 0.0).map(|(i, j)| (i, 2.0 * h * j.damping)));
        radius(&self.others, robot.root_dofs(), factor, &mut self.vector, &mut self.column) > MAX_RADIUS
    }
}

fn stiffness(limit: &Limit, h: f64) -> f64 {
    h * (2.0 * limit.damping + h * limit.stiffness)
}

/// Spectral radius of `S^1/2 M^-1 S^1/2` of some joints, by power iteration.
fn radius(joints: &[(usize, f64)], dofs: usize, factor: &Factor, vector: &mut [f64], column: &mut [f64]) -> f64 {
    let vector = &mut vector[..joints.len()];
    // A start without symmetry, so that no eigenvector is missed.
    vector.iter_mut().enumerate().for_each(|(k, x)| *x = 0.1 + (0.618_034 * k as f64).fract());
    let mut size = 0.0;
    for _ in 0..POWER_STEPS {
        let length = vector.iter().map(|x| x * x).sum::<f64>().sqrt();
        column.fill(0.0);
        joints.iter().zip(&*vector).for_each(|((i, s), x)| column[dofs + i] = s.sqrt() * x / length);
        factor.solve(column);
        vector.iter_mut().zip(joints).for_each(|(x, (i, s))| *x = s.sqrt() * column[dofs + i]);
        size = vector.iter().map(|x| x * x).sum::<f64>().sqrt();
    }
    size
}

/// Upper bound (1/kg) on a point's acceleration along a force there, per unit of force, as if its link were free. The
/// bound is `1 / m + |[r] I^-1 [r]^T|` with r from the centre of mass.
pub(super) fn inv_mass(link: &BodyInertia, point: &Vector3<f64>) -> f64 {
    let arm = (point - link.com).cross_matrix();
    let turning = link
        .inertia
        .cholesky()
        .map_or(f64::INFINITY, |c| (arm.transpose() * c.solve(&arm)).symmetric_eigenvalues().max());
    1.0 / link.mass + if arm.amax() > 0.0 { turning } else { 0.0 }
}

/// Upper bound on w n (1/kg) of each pair of links in any pose, as if both links were free.
fn inv_masses(system: &System) -> Vec<f64> {
    let links = &system.robot.links;
    let folds = &system.folds;
    // w is largest at the ends of a capsule's axis; a force at its surface goes through the axis.
    let ends = |part: usize| {
        folds.capsules[folds.own[part].clone()].iter().flat_map(|c| [c.middle - c.half, c.middle + c.half])
    };
    let most =
        |part: usize| ends(part).map(|end| inv_mass(&links[folds.links[part]].inertia, &end)).fold(0.0, f64::max);
    let count = |[a, b]: [usize; 2]| (folds.own[a].len() + folds.own[b].len() - 1).min(MAX_PAIR_CONTACTS) as f64;
    folds.pairs.iter().map(|pair| (most(pair[0]) + most(pair[1])) * count(*pair)).collect()
}

/// Lower bound on the inertia at the joint of link `i`, `1 / (M^-1)_ii`, in any pose. The bound is the armature plus
/// the inertia of the two adjacent links, both free to turn about their centres of mass. On a fixed base it is the
/// armature plus the link's inertia about the joint. Links further out only add inertia.
fn least_inertia(system: &System, i: usize) -> Option<f64> {
    let robot = &system.robot;
    let link = &robot.links[i];
    let joint = link.joint.as_ref().filter(|j| j.mimic().is_none())?;
    if !system.stand_ins.is_empty() {
        return Some(joint.armature);
    }
    let axis = joint.axis().into_inner();
    let own = &link.inertia;
    let links = match (joint.kind, link.parent) {
        (JointKind::Prismatic, None) => own.mass,
        (JointKind::Prismatic, Some(_)) => 0.0,
        (_, None) => axis.dot(&((own.inertia + parallel_axis(own.mass, &own.com)) * axis)),
        (_, Some(parent)) => {
            let inv_mass = |inertia: &Matrix3<f64>, a: Vector3<f64>| inertia.cholesky().map(|c| a.dot(&c.solve(&a)));
            let turned = joint.origin().rotation * axis;
            let both = inv_mass(&own.inertia, axis).zip(inv_mass(&robot.links[parent].inertia.inertia, turned));
            both.map_or(0.0, |(a, b)| 1.0 / (a + b))
        }
    };
    Some(joint.armature + links)
}
