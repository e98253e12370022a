//! Links of a robot on each other (`self_collision`).
//!
//! The law is that of contact ([`super::force`]), of the robot's own material, between the capsules of two links; its force acts on both at one
//! place, so momentum stays what it was to rounding. A touch of two links couples branches of the tree, which the implicit solve does not
//! know: so it is an external force in the middle of the substep. With `1 / w` the inertia that two points feel against each other at least, as
//! if their links were free, stiffness k, damping d and drag c are bounded by what a substep h can follow:
//!
//! ```text
//! k <= z_k / (h^2 w n),    d, c <= z_d / (h w n)        leapfrog is stable for  h^2 k w + 2 h d w < 4
//! ```
//!
//! with n touches of a pair of links at a time. The bounds are numbers of the robot alone, so that what a touch has stored is what it gives back. A
//! link that rests on another by g sinks in by some `n g h^2 / z_k`; one that a drive presses on it by many times its weight, deeper.

use super::force::force;
use super::touch::{inside, part_of};
use crate::prelude::*;
use crate::system::capsules::Capsule;

/// z_k and z_d.
pub(super) const FOLLOWED: [f64; 2] = [0.5, 0.25];

/// Adds to `data.external` what links do to each other in a substep h in whose middle they are now; `whole` is the frame's substep, `ease` of each
/// pair w n.
pub(super) fn fold(system: &System, ease: &[f64], whole: f64, h: f64, friction: Friction, data: &mut Data) {
    data.external.fill(Wrench::default());
    let folds = &system.folds;
    for ([a, b], ease) in folds.pairs.iter().zip(ease) {
        let ball = |link: usize| data.position[link] + data.rotation[link] * folds.balls[link].0;
        let (centre, other, reach) = (ball(*a), ball(*b), folds.balls[*a].1 + folds.balls[*b].1);
        let twist = data.velocity[*a] - data.velocity[*b];
        let way = 0.5 * h * (twist.at(&centre).norm() + twist.ang.norm() * reach);
        if (centre - other).norm() > reach + way {
            continue;
        }
        let material = followed(&system.spec.material, *ease, whole);
        let mut sum = Wrench::default();
        let near = |c: &Capsule| (c.middle - other).norm() <= c.half.norm() + c.radius + folds.balls[*b].1 + way;
        for one in folds.placed(*a, data).filter(near) {
            for other in folds.placed(*b, data) {
                let met = one.meets(&other);
                let v = twist.at(&met.place);
                let Some((part, gap)) = inside(met.gap, 0.5 * h * met.normal.dot(&v)) else { continue };
                let f = force(gap, &met.normal, &v, &part_of(&material, part), friction);
                sum += Wrench::force_at(f, &met.place);
            }
        }
        data.external[*a] += sum;
        data.external[*b] += sum * -1.0;
    }
}

/// A material as soft as a substep needs it, at w n.
fn followed(material: &Material, ease: f64, h: f64) -> Material {
    let [stiffest, most] = FOLLOWED.map(|z| z / (h * ease));
    Material {
        stiffness: material.stiffness.min(stiffest / h),
        damping: material.damping.min(most),
        friction_damping: material.friction_damping.min(most),
        friction: material.friction,
    }
}
