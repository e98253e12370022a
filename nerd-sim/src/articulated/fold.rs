//! Links of a robot on each other (`self_collision`).
//!
//! The law is that of contact ([`super::force`]), of the robot's own material or what its file says of a pair but for torsional and rolling friction, between the capsules of two links; its force acts on both at one
//! place, so momentum stays what it was to rounding. A touch of two links couples branches of the tree, which the implicit solve does not
//! know: so it is an external force in the middle of the substep. With `1 / w` the inertia that two points feel against each other at least, as
//! if their links were free, stiffness k, damping d and drag c are bounded by what a substep h can follow:
//!
//! ```text
//! k <= z_k / (h^2 w n),    d, c <= z_d / (h w n)        leapfrog is stable for  h^2 k w + 2 h d w < 4
//! ```
//!
//! with n touches of a pair of links at a time. The bounds are numbers of the robot and its frame's substeps alone, which a frame keeps that is stepped
//! again, finer (`energy.rs`), so that what a touch has stored is what it gives back. A
//! link that rests on another by g sinks in by some `n g h^2 / z_k`; one that a drive presses on it by many times its weight, deeper.

use super::force::force;
use super::touch::{inside, part_of};
use crate::prelude::*;
use crate::system::capsules::Capsule;

/// z_k and z_d.
pub(super) const FOLLOWED: [f64; 2] = [0.5, 0.25];

/// What two parts of a robot are to each other.
struct Met {
    links: [usize; 2],
    material: Material,
    /// Gap (m) less the margin, its gradient when the first moves, where, and how the first moves there against the second.
    gap: f64,
    normal: Vector3<f64>,
    place: Vector3<f64>,
    velocity: Vector3<f64>,
}

/// All that may meet within half a time h at the velocities of `data`; see [`fold`].
fn meetings(system: &System, ease: &[f64], whole: f64, h: f64, data: &Data, mut met: impl FnMut(Met)) {
    let folds = &system.folds;
    for (k, (parts, ease)) in folds.pairs.iter().zip(ease).enumerate() {
        let ([a, b], links) = (parts, parts.map(|part| folds.links[part]));
        let ball = |part: usize, link: usize| data.position[link] + data.rotation[link] * folds.balls[part].0;
        let (centre, other, reach) = (ball(*a, links[0]), ball(*b, links[1]), folds.balls[*a].1 + folds.balls[*b].1);
        let twist = data.velocity[links[0]] - data.velocity[links[1]];
        let way = 0.5 * h * (twist.at(&centre).norm() + twist.ang.norm() * reach);
        let material = system.folding(k);
        if (centre - other).norm() > reach + way + material.margin {
            continue;
        }
        let material = followed(&material, *ease, whole);
        let near = |c: &Capsule| (c.middle - other).norm() <= c.half.norm() + c.radius + folds.balls[*b].1 + way + material.margin;
        for one in folds.placed(*a, data).filter(near) {
            for other in folds.placed(*b, data) {
                let found = one.meets(&other);
                let (gap, velocity) = (found.gap - material.margin, twist.at(&found.place));
                met(Met { links, material, gap, normal: found.normal, place: found.place, velocity });
            }
        }
    }
}

/// What links do to each other in a substep h in whose middle they are now, into `data.external`; whether they do anything. `whole` is the substep
/// that the frame began with, `ease` of each pair w n.
pub(super) fn fold(system: &System, ease: &[f64], whole: f64, h: f64, friction: Friction, data: &mut Data) -> bool {
    let mut external = std::mem::take(&mut data.external);
    external.fill(Wrench::default());
    let mut any = false;
    meetings(system, ease, whole, h, data, |met| {
        let Some((part, gap)) = inside(met.gap, 0.5 * h * met.normal.dot(&met.velocity)) else { return };
        let f = Wrench::force_at(force(gap, &met.normal, &met.velocity, &part_of(&met.material, part), friction), &met.place);
        external[met.links[0]] += f;
        external[met.links[1]] += f * -1.0;
        any = true;
    });
    data.external = external;
    any
}

/// Energy (J) in the springs between links.
pub(super) fn folded(system: &System, ease: &[f64], whole: f64, data: &Data) -> f64 {
    let mut sum = 0.0;
    meetings(system, ease, whole, 0.0, data, |met| sum += 0.5 * met.material.stiffness * met.gap.min(0.0).powi(2));
    sum
}

/// A material as soft as a substep needs it, at w n.
fn followed(material: &Material, ease: f64, h: f64) -> Material {
    let [stiffest, most] = FOLLOWED.map(|z| z / (h * ease));
    let stiffness = material.stiffness.min(stiffest / h);
    Material {
        stiffness,
        release: if stiffness > 0.0 { material.release.min(most / stiffness) } else { 0.0 },
        damping: material.damping.min(most),
        friction_damping: material.friction_damping.min(most),
        ..*material
    }
}
