//! Touches of the implicit step, by kind: contact, limit, friction, drive.

use super::force::drag;
use crate::prelude::*;

/// Velocity (rad/s or m/s) below which dry friction holds, as a drag: what it holds creeps.
pub(super) const CREEP: f64 = 1e-3;

/// The share of a spring that keeps its energy: the mean of the gaps at the substep's ends, `g + h (v' - v) / 4`.
pub(super) const EVEN: f64 = 0.25;

/// Something that acts within a substep, or will.
#[derive(Clone)]
#[allow(clippy::large_enum_variant)] // Most are contacts.
pub(super) enum Touch {
    /// A point on a collider. It pushes, is damped, and rubs.
    Contact(Contact),
    /// Dry friction of a joint.
    Friction(DryFriction),
    /// A joint beyond an end of its range. It may pull, and is damped both ways.
    Limit(Spring),
    /// A drive, within its least and largest force; the bound that holds it, once one does.
    Drive { spring: Spring, bounds: [f64; 2], held: Option<f64> },
}

/// A point on a collider: what it is, then what the substep makes of it.
#[derive(Clone)]
pub(super) struct Contact {
    /// Its number among points and colliders, and its point's.
    pub(super) index: usize,
    pub(super) point: usize,
    pub(super) link: usize,
    /// Where it touches (m, from the root).
    pub(super) x: Vector3<f64>,
    /// Its columns among all, `J = [.. column ..]` by DoF, where the matrix is at hand.
    pub(super) columns: std::ops::Range<usize>,
    /// The material of the part of the substep in which it is inside, and the whole.
    pub(super) material: Material,
    pub(super) whole: Material,
    pub(super) normal: Vector3<f64>,
    /// Its gap in the middle of the substep, and the mean of what is inside.
    pub(super) middle: f64,
    pub(super) gap: f64,
    pub(super) velocity: Vector3<f64>,
    /// Its velocity at the start, when J was another: half a substep of `J_dot qd` off `velocity`, which J of the middle takes it for.
    pub(super) start: Vector3<f64>,
    /// What its velocity changes by over the substep without accelerations (m/s): because the root turns while it travels, `h w x v`, and
    /// because its place moves and J with it, `h J_dot qd`.
    pub(super) turn: Vector3<f64>,
    /// Shares a of the spring, the damper and the drag.
    pub(super) ahead: [f64; 3],
    /// Drag c (N s/m).
    pub(super) across: f64,
    /// Its link's angular velocity, and drags (N m s/rad) about the normal and across it; zero without torsional and rolling friction.
    pub(super) spin: Vector3<f64>,
    pub(super) turning: [f64; 2],
    /// Whether it would pull, and acts no more.
    pub(super) parted: bool,
    /// Its force (N) on the robot in the substep.
    pub(super) force: Vector3<f64>,
}

/// A spring and a damper of one joint.
#[derive(Clone)]
pub(super) struct Spring {
    /// Its number among all weights.
    pub(super) index: usize,
    pub(super) joint: usize,
    /// The sign of the joint's velocity in `rate`.
    pub(super) side: f64,
    pub(super) stiffness: f64,
    pub(super) damping: f64,
    /// How far it is from rest in the middle of the substep, the mean of what is beyond, and how fast it leaves it.
    pub(super) middle: f64,
    pub(super) gap: f64,
    pub(super) rate: f64,
    /// Shares a of the spring and the damper.
    pub(super) ahead: [f64; 2],
}

/// A joint that rubs under a constant force, and always looks all the way ahead.
#[derive(Clone)]
pub(super) struct DryFriction {
    pub(super) joint: usize,
    /// Largest force (N m or N).
    pub(super) most: f64,
    pub(super) rate: f64,
    /// Drag (N m s/rad or N s/m).
    pub(super) across: f64,
}

impl Touch {
    /// Its number among all weights, if it is weighed.
    pub(super) fn index(&self) -> Option<usize> {
        match self {
            Self::Contact(contact) => Some(contact.index),
            Self::Limit(spring) | Self::Drive { spring, .. } => Some(spring.index),
            Self::Friction(_) => None,
        }
    }
}

impl Contact {
    /// How far ahead its forces must look to be stable over h, from its own inertia 1 / w.
    #[inline]
    pub(super) fn weigh(&mut self, w: f64, h: f64, friction: Friction) {
        let vn = self.normal.dot(&self.velocity);
        self.material.damping = self.material.damper(vn);
        let m = &self.material;
        let normal = (-(m.stiffness * self.gap + m.damping * vn)).max(0.0);
        self.across = drag(normal, (self.velocity - self.normal * vn).norm(), m, friction);
        self.ahead = [ahead(h * h * m.stiffness * w), damper(h, m.damping, w), damper(h, self.across, w)];
        if self.turns() {
            self.turning = self.turn_drags(normal, &self.spin);
        }
    }

    /// Whether it has torsional or rolling friction.
    #[inline]
    pub(super) fn turns(&self) -> bool {
        self.material.torsion > 0.0 || self.material.rolling > 0.0
    }

    /// Drags of torsional and rolling friction under a normal force: Coulomb's torque over the angular velocity, which creeps below [`CREEP`].
    fn turn_drags(&self, normal: f64, spin: &Vector3<f64>) -> [f64; 2] {
        let about = self.normal.dot(spin);
        let across = (spin - self.normal * about).norm();
        [(self.material.torsion, about.abs()), (self.material.rolling, across)].map(|(arm, rate)| arm * normal / rate.max(CREEP))
    }

    /// Torque (N m) of torsional and rolling friction on its link at an angular velocity.
    #[inline]
    pub(super) fn turn_torque(&self, spin: &Vector3<f64>) -> Vector3<f64> {
        let [about, across] = self.turning;
        self.normal * (-(about - across) * self.normal.dot(spin)) - spin * across
    }

    /// Drags of torsional and rolling friction after a change of the angular velocity; whether another solve is asked for.
    pub(super) fn settle_turns(&mut self, change: &Vector3<f64>, settled: f64) -> bool {
        let drags = self.turn_drags(self.normal.dot(&self.force).max(0.0), &(self.spin + change));
        let changed = drags.iter().zip(self.turning).any(|(new, old)| (new - old).abs() > settled * old.max(1e-12));
        self.turning = drags;
        changed
    }

    /// Its `start` and `turn`, from velocities and accelerations of `data` at zero `qdd`: `J_dot qd = a + w_dot x x + w x x_dot - turn`
    /// with `turn` (m/s^2) the root's, which its coordinates' rates have; `free = g - turn`, since `a` has gravity taken off.
    #[inline]
    pub(super) fn bend(&mut self, point: &ContactPoint, data: &Data, free: &Vector3<f64>, turn: &Vector3<f64>, h: f64) {
        let twist = &data.velocity[self.link];
        let moves = match point.locus {
            Locus::Rim { .. } => {
                let rotation = &data.rotation[self.link];
                let centre = data.position[self.link] + rotation * point.local;
                twist.at(&centre) + point.runs(rotation, &self.normal, &twist.ang, h)
            }
            // The middle of its ball.
            _ => twist.at(&(self.x + self.normal * point.radius)),
        };
        let bend = data.acceleration[self.link].at(&self.x) + twist.ang.cross(&moves) + free;
        self.start = self.velocity - bend * (0.5 * h);
        self.turn = (turn + bend) * h;
    }

    /// Its force on the robot before the substep, and what resists along and across its normal.
    #[inline]
    pub(super) fn push(&self, h: f64) -> (Vector3<f64>, f64, f64) {
        let (n, m, [spring, damper, slide]) = (&self.normal, &self.material, self.ahead);
        let (along, across) = (spring * h * m.stiffness + damper * m.damping, slide * self.across);
        let (velocity, turn) = (&self.start, &self.turn);
        let vn = n.dot(velocity);
        let force = n * -(m.stiffness * self.gap + m.damping * vn) - (velocity - n * vn) * self.across;
        (force - n * ((along - across) * n.dot(turn)) - turn * across, along, across)
    }

    /// Its force and drag after a change `h J qdd` of its velocity; whether another solve is asked for.
    #[inline]
    pub(super) fn settle(&mut self, change: &Vector3<f64>, h: f64, friction: Friction, settled: f64) -> bool {
        let (n, m, [spring, damper, slide]) = (&self.normal, &self.material, self.ahead);
        let (velocity, change) = (&self.start, change + self.turn);
        let (vn, dn) = (n.dot(velocity), n.dot(&change));
        let normal = -(m.stiffness * (self.gap + spring * h * dn) + m.damping * (vn + damper * dn));
        self.parted = normal < 0.0;
        let seen = velocity + change * slide;
        let slip = seen - n * n.dot(&seen);
        self.force = if self.parted { Vector3::zeros() } else { n * normal - slip * self.across };
        let across = drag(normal.max(0.0), slip.norm(), m, friction);
        let changed = self.parted || (across / self.across - 1.0).abs() > settled;
        self.across = across;
        changed
    }
}

impl Spring {
    #[inline]
    pub(super) fn weigh(&mut self, w: f64, h: f64) {
        self.ahead = [ahead(h * h * self.stiffness * w), damper(h, self.damping, w)];
    }

    /// Its force on the joint before the substep, and what resists.
    #[inline]
    pub(super) fn push(&self, h: f64) -> (f64, f64) {
        let [spring, damper] = self.ahead;
        let force = -(self.stiffness * self.gap + self.damping * self.rate);
        (self.side * force, spring * h * self.stiffness + damper * self.damping)
    }

    /// Its force after a change of its rate over h.
    #[inline]
    pub(super) fn force(&self, change: f64, h: f64) -> f64 {
        let [spring, damper] = self.ahead;
        -(self.stiffness * (self.gap + spring * h * change) + self.damping * (self.rate + damper * change))
    }
}

impl DryFriction {
    /// A contact's that would rub alike.
    #[inline]
    pub(super) fn material(&self) -> Material {
        Material { stiffness: 0.0, damping: 0.0, friction_damping: self.most / CREEP, friction: 1.0, ..Material::default() }
    }

    /// Its drag at a rate of the joint.
    #[inline]
    pub(super) fn drag(&self, rate: f64, friction: Friction) -> f64 {
        drag(self.most, rate.abs(), &self.material(), friction)
    }

    /// Its drag after a change of its rate; whether another solve is asked for.
    #[inline]
    pub(super) fn settle(&mut self, change: f64, friction: Friction, settled: f64) -> bool {
        let across = self.drag(self.rate + change, friction);
        let changed = (across / self.across - 1.0).abs() > settled;
        self.across = across;
        changed
    }
}

/// The share of a spring with `z = h^2 k w`: it keeps energy, or loses it where the substep is too long to follow it.
#[inline]
pub(super) fn ahead(z: f64) -> f64 {
    (0.5 - 0.5 / z).max(EVEN)
}

/// The share of a damper d that keeps it stable.
#[inline]
fn damper(h: f64, d: f64, w: f64) -> f64 {
    (1.0 - 1.0 / (h * d * w)).max(0.5)
}

/// Of a gap that is `middle` in the middle of a substep and `half` more at its end: the part of the substep in which it is
/// negative, and its mean there. None if it never is.
pub(super) fn inside(middle: f64, half: f64) -> Option<(f64, f64)> {
    let (least, most) = (middle - half.abs(), middle + half.abs());
    match (least < 0.0, most <= 0.0) {
        (false, _) => None,
        (true, true) => Some((1.0, middle)),
        (true, false) => Some((least / (least - most), 0.5 * least)),
    }
}

/// A material that acts for a part of the time.
pub(super) fn part_of(material: &Material, part: f64) -> Material {
    Material {
        stiffness: part * material.stiffness,
        damping: part * material.damping,
        friction_damping: part * material.friction_damping,
        ..*material
    }
}
