//! Touches, the forces of the implicit step that follow from its solution: contacts, limits, dry friction, drives.

use super::force::drag;
use super::stick::{BREAKAWAY_SOLVES, CREEPS, MIN_INV_MASS, STICK_DRAG, breaking};
use super::turning::Turning;
use crate::prelude::*;

/// Velocity (rad/s or m/s) below which dry friction is a drag: a joint that it holds creeps.
pub(super) const CREEP: f64 = 1e-3;

/// Theta of a spring that keeps its energy: the mean of the gaps at the substep's ends, `g + h (v' - v) / 4`.
pub(super) const MEAN_THETA: f64 = 0.25;

/// A force that acts, or may act, within a substep.
#[derive(Clone)]
#[allow(clippy::large_enum_variant)] // Most are contacts.
pub(super) enum Touch {
    /// A point on a collider: it pushes, is damped, and has friction.
    Contact(Contact),
    /// Dry friction of a joint.
    Friction(DryFriction),
    /// A joint beyond an end of its range: a spring that may pull, and a damper for both directions.
    Limit(Spring),
    /// A drive, its least and largest force, and the bound that it is held at, if saturated.
    Drive { spring: Spring, bounds: [f64; 2], held: Option<f64> },
}

/// A point on a collider: its geometry, then the state of the solve.
#[derive(Clone)]
pub(super) struct Contact {
    /// Index of the pair of point and collider, and index of the point.
    pub(super) index: usize,
    pub(super) point: usize,
    pub(super) link: usize,
    /// Contact place (m, from `data.origin`).
    pub(super) x: Vector3<f64>,
    /// Range of its columns of J, by DoF, in `Touches::columns`; empty along the tree.
    pub(super) columns: std::ops::Range<usize>,
    /// Material scaled by the part of the substep that the point is inside, and the unscaled material.
    pub(super) material: Material,
    pub(super) whole: Material,
    pub(super) normal: Vector3<f64>,
    /// Gap (m) at the substep's middle, and mean gap while the point is inside the surface.
    pub(super) middle: f64,
    pub(super) gap: f64,
    pub(super) velocity: Vector3<f64>,
    /// Point velocity (m/s) at the substep's start, `J qd - h/2 J_dot qd`. `velocity` is `J qd`, with J of the middle.
    pub(super) start: Vector3<f64>,
    /// Change of the point's velocity (m/s) over the substep at zero `qdd`: `h w x p_dot` of the root, and
    /// `h J_dot qd`, since the place moves and J with it.
    pub(super) turn: Vector3<f64>,
    /// Theta of the spring, the damper and the drag.
    pub(super) theta: [f64; 3],
    /// Damping and its theta while approaching and while parting; the material and `theta` have those in use.
    pub(super) dampers: [[f64; 2]; 2],
    /// Drag c (N s/m).
    pub(super) drag: f64,
    /// Slip offset `s_0` (m/s) with zero drag force: the friction held from the last solve, over the sticking drag.
    pub(super) slip_offset: Vector3<f64>,
    /// Slip offset `s_0` (m/s) at the substep's start.
    pub(super) slip_offset_start: Vector3<f64>,
    pub(super) turning: Turning,
    /// Whether the point would pull; then it no longer acts.
    pub(super) parted: bool,
    /// Whether the point sticks and slips by more than `CREEPS`.
    pub(super) creeps: bool,
    /// Force (N) on the robot in the substep.
    pub(super) force: Vector3<f64>,
}

/// A spring and a damper of one joint.
#[derive(Clone)]
pub(super) struct Spring {
    /// Index of the spring's w in `Touches::weights`.
    pub(super) index: usize,
    pub(super) joint: usize,
    /// Sign of the joint's velocity in `rate`.
    pub(super) side: f64,
    pub(super) stiffness: f64,
    pub(super) damping: f64,
    /// Gap (rad or m) at the middle of the substep; mean gap over the part beyond the limit; rate of the gap. A drive
    /// has its errors of position and velocity here.
    pub(super) middle: f64,
    pub(super) gap: f64,
    pub(super) rate: f64,
    /// Theta of the spring and the damper.
    pub(super) theta: [f64; 2],
}

/// Dry friction of a joint: a constant force, or a drag below `CREEP`; its theta is 1.
#[derive(Clone)]
pub(super) struct DryFriction {
    pub(super) joint: usize,
    /// Largest force (N m or N).
    pub(super) most: f64,
    pub(super) rate: f64,
    /// Drag (N m s/rad or N s/m).
    pub(super) drag: f64,
}

impl Touch {
    /// Index of the touch's w in `Touches::weights`, if it has a w.
    pub(super) fn index(&self) -> Option<usize> {
        match self {
            Self::Contact(contact) => Some(contact.index),
            Self::Limit(spring) | Self::Drive { spring, .. } => Some(spring.index),
            Self::Friction(_) => None,
        }
    }
}

impl Contact {
    /// Chooses theta of the contact's forces for stability over h, and computes the initial drag. `w` (1/kg) is along
    /// the normal, `across` (1/kg) the sum over both tangential directions. `held`: force (N) and torque (N m) of the
    /// substep before.
    #[inline]
    pub(super) fn set_thetas(&mut self, w: f64, across: f64, held: &Wrench, h: f64, friction: Friction) {
        let vn = self.normal.dot(&self.velocity);
        self.dampers =
            [self.material.damping, self.material.stiffness * self.material.release].map(|d| [d, damper(h, d, w)]);
        let [damping, damper_theta] = self.dampers[usize::from(vn >= 0.0)];
        self.material.damping = damping;
        if friction == Friction::Coulomb {
            self.material.friction_damping = STICK_DRAG / (h * across.max(MIN_INV_MASS));
            self.hold(held);
            (self.slip_offset_start, self.turning.turn_offset_start) = (self.slip_offset, self.turning.turn_offset);
        }
        let m = &self.material;
        let normal = (-(m.stiffness * self.gap + m.damping * vn)).max(0.0);
        let slip = self.velocity - self.normal * vn - self.slip_offset;
        self.drag = drag(normal, slip.norm(), m, friction);
        self.theta = [spring_theta(h * h * m.stiffness * w), damper_theta, damper(h, self.drag, w)];
        if self.turns() {
            self.turning.set_thetas(&self.normal, &self.material, normal);
        }
    }

    /// Sets slip and turn offsets so that at zero slip the drags give this wrench (N, N m) without its normal force.
    #[inline]
    pub(super) fn hold(&mut self, Wrench { lin: force, ang: torque }: &Wrench) {
        let stiff = self.material.friction_damping;
        self.slip_offset =
            if stiff > 0.0 { (force - self.normal * self.normal.dot(force)) / stiff } else { Vector3::zeros() };
        if self.turns() && stiff > 0.0 {
            self.turning.turn_offset = torque / self.turning.stick(&self.material);
        }
    }

    /// Whether the damper sees the point part, at normal velocity `vn` (m/s) at the substep's start and its change `dn`
    /// (m/s).
    #[inline]
    pub(super) fn parts(&self, vn: f64, dn: f64) -> bool {
        vn + self.dampers[0][1] * dn >= 0.0
    }

    /// Whether the contact has torsional or rolling friction.
    #[inline]
    pub(super) fn turns(&self) -> bool {
        self.material.torsion > 0.0 || self.material.rolling > 0.0
    }

    /// Wrench on its link at the point: force (N) and torque (N m).
    pub(super) fn wrench(&self) -> Wrench {
        Wrench::new(self.turning.torque, self.force)
    }

    /// Computes `start` and `turn` from velocities and accelerations in `data` at zero `qdd`. With the argument
    /// `turn = w x p_dot` (m/s^2) of the root, `J_dot qd = a + w_dot x x + w x x_dot - turn`. `free = g - turn`, since
    /// `data` has accelerations less gravity.
    #[inline]
    pub(super) fn bend(&mut self, point: &ContactPoint, data: &Data, free: &Vector3<f64>, turn: &Vector3<f64>, h: f64) {
        let twist = &data.velocity[self.link];
        let moves = match point.locus {
            Locus::Rim { .. } => {
                let rotation = &data.rotation[self.link];
                let centre = data.position[self.link] + rotation * point.local;
                twist.at(&centre) + point.runs(rotation, &self.normal, &twist.ang, h)
            }
            // Velocity of the centre of the point's ball.
            _ => twist.at(&(self.x + self.normal * point.radius)),
        };
        let bend = data.acceleration[self.link].at(&self.x) + twist.ang.cross(&moves) + free;
        self.start = self.velocity - bend * (0.5 * h);
        self.turn = (turn + bend) * h;
    }

    /// Force (N) on the robot at zero `qdd`, and resistances (N s/m) along and across its normal: the entries of D.
    #[inline]
    pub(super) fn push(&self, h: f64) -> (Vector3<f64>, f64, f64) {
        let n = &self.normal;
        let m = &self.material;
        let [spring, damper, slide] = self.theta;
        let (along, across) = (spring * h * m.stiffness + damper * m.damping, slide * self.drag);
        let velocity = &self.start;
        let turn = &self.turn;
        let vn = n.dot(velocity);
        let force = n * -(m.stiffness * self.gap + m.damping * vn) - (velocity - n * vn - self.slip_offset) * self.drag;
        (force - n * ((along - across) * n.dot(turn)) - turn * across, along, across)
    }

    /// Takes the damping of approach or of parting, whichever the damper sees at `vn` and `dn` (m/s) of
    /// [`Self::parts`]. Returns whether the damping changed.
    #[inline]
    pub(super) fn take_side(&mut self, vn: f64, dn: f64) -> bool {
        let [damping, damper] = self.dampers[usize::from(self.parts(vn, dn))];
        let other = damping != self.material.damping;
        (self.material.damping, self.theta[1]) = (damping, damper);
        other
    }

    /// Updates force and drag after a change `h J qdd` (m/s) of the point's velocity; returns whether another solve is
    /// needed.
    #[inline]
    pub(super) fn settle(
        &mut self,
        change: &Vector3<f64>,
        h: f64,
        friction: Friction,
        (settled, pass): (f64, usize),
    ) -> bool {
        let n = self.normal;
        let m = &self.material;
        let [spring, damper, slide] = self.theta;
        let velocity = &self.start;
        let change = change + self.turn;
        let (vn, dn) = (n.dot(velocity), n.dot(&change));
        let normal = -(m.stiffness * (self.gap + spring * h * dn) + m.damping * (vn + damper * dn));
        self.parted = normal < 0.0;
        let seen = velocity + change * slide;
        let slip = seen - n * n.dot(&seen) - self.slip_offset;
        self.force = if self.parted { Vector3::zeros() } else { n * normal - slip * self.drag };
        let mut next = drag(normal.max(0.0), slip.norm(), m, friction);
        let mut tolerance = settled;
        let damping = m.damping;
        if friction == Friction::Coulomb {
            let inertia = 2.0 * m.friction_damping / STICK_DRAG;
            if pass < BREAKAWAY_SOLVES {
                next = breaking(normal.max(0.0), slip.norm(), self.drag, m, inertia);
            }
            // If a force within the friction cone can stop the slip, the point sticks at once. Only in the first solve:
            // later the points of one body would stick in turns.
            if pass == 0 && slip.norm() * (self.drag + inertia) <= m.friction * normal {
                next = m.friction_damping;
            }
            // A drag far above the point's inertia over the substep hardly changes the motion, so its rise needs no
            // small tolerance.
            if next > self.drag {
                tolerance *= 1.0 + self.drag / inertia;
            }
        }
        let slips = (slip + self.slip_offset).norm() > CREEPS;
        self.creeps = slips && friction == Friction::Coulomb && next >= m.friction_damping;
        let changed = self.parted || (next / self.drag - 1.0).abs() > tolerance;
        self.drag = next;
        self.take_side(vn, dn);
        let apart = (self.material.damping - damping).abs() * (vn + self.theta[1] * dn).abs();
        changed || apart > settled * normal.abs()
    }
}

impl Spring {
    #[inline]
    pub(super) fn set_thetas(&mut self, w: f64, h: f64) {
        self.theta = [spring_theta(h * h * self.stiffness * w), damper(h, self.damping, w)];
    }

    /// Force (N m or N) on the joint at zero `qdd`, and implicit resistance (N m s/rad or N s/m).
    #[inline]
    pub(super) fn push(&self, h: f64) -> (f64, f64) {
        let [spring, damper] = self.theta;
        let force = -(self.stiffness * self.gap + self.damping * self.rate);
        (self.side * force, spring * h * self.stiffness + damper * self.damping)
    }

    /// Force (N m or N) in the gap's direction, after a `change` of the gap's rate over h.
    #[inline]
    pub(super) fn force(&self, change: f64, h: f64) -> f64 {
        let [spring, damper] = self.theta;
        -(self.stiffness * (self.gap + spring * h * change) + self.damping * (self.rate + damper * change))
    }
}

impl DryFriction {
    /// Material whose contact friction at normal force `most` equals this dry friction.
    #[inline]
    pub(super) fn material(&self) -> Material {
        Material {
            stiffness: 0.0,
            damping: 0.0,
            friction_damping: self.most / CREEP,
            friction: 1.0,
            ..Material::default()
        }
    }

    /// Drag (N m s/rad or N s/m) at a joint velocity `rate` (rad/s or m/s).
    #[inline]
    pub(super) fn drag(&self, rate: f64, friction: Friction) -> f64 {
        drag(self.most, rate.abs(), &self.material(), friction)
    }

    /// Updates the drag after a change of the joint's velocity (rad/s or m/s); returns whether another solve is needed.
    #[inline]
    pub(super) fn settle(&mut self, change: f64, friction: Friction, settled: f64) -> bool {
        let next = self.drag(self.rate + change, friction);
        let changed = (next / self.drag - 1.0).abs() > settled;
        self.drag = next;
        changed
    }
}

/// Theta of a spring with `z = h^2 k w`: it keeps the spring's energy, or loses some where the substep is too long to
/// resolve it.
#[inline]
pub(super) fn spring_theta(z: f64) -> f64 {
    (0.5 - 0.5 / z).max(MEAN_THETA)
}

/// Theta at which a damper d is stable over a substep h, at inverse effective mass w.
#[inline]
fn damper(h: f64, d: f64, w: f64) -> f64 {
    (1.0 - 1.0 / (h * d * w)).max(0.5)
}

/// Fraction of a substep during which a gap is negative, and the mean gap over that part; `None` if it never is. The
/// gap is `middle` at the middle and changes by `half` until the end.
pub(super) fn inside(middle: f64, half: f64) -> Option<(f64, f64)> {
    let (least, most) = (middle - half.abs(), middle + half.abs());
    match (least < 0.0, most <= 0.0) {
        (false, _) => None,
        (true, true) => Some((1.0, middle)),
        (true, false) => Some((least / (least - most), 0.5 * least)),
    }
}

/// A material scaled to act for a part of the substep.
pub(super) fn part_of(material: &Material, part: f64) -> Material {
    Material {
        stiffness: part * material.stiffness,
        damping: part * material.damping,
        friction_damping: part * material.friction_damping,
        ..*material
    }
}
