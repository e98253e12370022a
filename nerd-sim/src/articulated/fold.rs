//! Self-collision: contact forces between links of a robot (`self_collision`).
//!
//! Capsules of two links meet under the contact law of [`super::force`], without torsional and rolling friction. The
//! material is the robot's own, or the pair's from the robot's file. Equal and opposite forces act at one place, so
//! momentum is conserved to rounding. Self-collision couples branches of the tree, so the implicit solve excludes it.
//! Its force is external, evaluated at the middle of the substep. Stiffness k, damping d and drag c are bounded so that
//! a substep h can resolve them. Here `1 / w` is the least effective mass (kg) of two points against each other, as if
//! their links were free:
//!
//! ```text
//! k <= z_k / (h^2 w n),    d, c <= z_d / (h w n)        leapfrog is stable for  h^2 k w + 2 h d w < 4
//! ```
//!
//! with n simultaneous contacts of a pair of links. The bounds depend only on the robot and on the substep h of the
//! frame's first attempt. A frame repeated with more substeps keeps its bounds (`energy.rs`), so a contact returns no
//! more energy than it stored. A link resting on another under gravity g sinks in by about `n g h^2 / z_k` (m). A drive
//! that presses with many times the link's weight makes it sink in more.

use super::force::force;
use super::touch::{inside, part_of};
use crate::prelude::*;
use crate::system::capsules::Capsule;

/// Stability bounds z_k of `h^2 w n k`, and z_d of `h w n d` and `h w n c`.
pub(super) const MAX_FOLD_STIFFNESS: f64 = 0.5;
pub(super) const MAX_FOLD_DAMPING: f64 = 0.25;

/// A contact of two parts of a robot.
struct Met {
    links: [usize; 2],
    material: Material,
    /// Gap (m) less the margin.
    gap: f64,
    /// Gradient of the gap with respect to the first part's position.
    normal: Vector3<f64>,
    /// Contact place (m, from `data.origin`).
    place: Vector3<f64>,
    /// Velocity (m/s) at `place` of the first part relative to the second.
    velocity: Vector3<f64>,
}

/// Calls `met` for all contacts that may occur within `h / 2` at the velocities of `data`; see [`fold`].
fn meetings(system: &System, inv_mass: &[f64], first_h: f64, h: f64, data: &Data, mut met: impl FnMut(Met)) {
    let folds = &system.folds;
    for (k, (parts, inv_mass)) in folds.pairs.iter().zip(inv_mass).enumerate() {
        let [a, b] = parts;
        let links = parts.map(|part| folds.links[part]);
        let ball = |part: usize, link: usize| data.position[link] + data.rotation[link] * folds.balls[part].0;
        let centre = ball(*a, links[0]);
        let other = ball(*b, links[1]);
        let reach = folds.balls[*a].1 + folds.balls[*b].1;
        let twist = data.velocity[links[0]] - data.velocity[links[1]];
        let way = 0.5 * h * (twist.at(&centre).norm() + twist.ang.norm() * reach);
        let material = system.folding(k);
        if (centre - other).norm() > reach + way + material.margin {
            continue;
        }
        let material = followed(&material, *inv_mass, first_h);
        let near = |c: &Capsule| {
            (c.middle - other).norm() <= c.half.norm() + c.radius + folds.balls[*b].1 + way + material.margin
        };
        for one in folds.placed(*a, data).filter(near) {
            for other in folds.placed(*b, data) {
                let found = one.meets(&other);
                let gap = found.gap - material.margin;
                let velocity = twist.at(&found.place);
                met(Met { links, material, gap, normal: found.normal, place: found.place, velocity });
            }
        }
    }
}

/// Writes the forces between links, at the middle of a substep h, to `data.external`; returns whether any act.
/// `first_h`: substep (s) of the frame's first attempt. `inv_mass`: w n of each pair (1/kg).
pub(super) fn fold(
    system: &System,
    inv_mass: &[f64],
    first_h: f64,
    h: f64,
    friction: Friction,
    data: &mut Data,
) -> bool {
    let mut external = std::mem::take(&mut data.external);
    external.fill(Wrench::default());
    let mut any = false;
    meetings(system, inv_mass, first_h, h, data, |met| {
        let Some((part, gap)) = inside(met.gap, 0.5 * h * met.normal.dot(&met.velocity)) else { return };
        let f = Wrench::force_at(
            force(gap, &met.normal, &met.velocity, &part_of(&met.material, part), friction),
            &met.place,
        );
        external[met.links[0]] += f;
        external[met.links[1]] += f * -1.0;
        any = true;
    });
    data.external = external;
    any
}

/// Energy (J) in the springs of self-collision.
pub(super) fn folded(system: &System, inv_mass: &[f64], first_h: f64, data: &Data) -> f64 {
    let mut sum = 0.0;
    meetings(system, inv_mass, first_h, 0.0, data, |met| {
        sum += 0.5 * met.material.stiffness * met.gap.min(0.0).powi(2)
    });
    sum
}

/// Softens a material to the stability bounds of a substep h (s). `inv_mass`: w n (1/kg).
fn followed(material: &Material, inv_mass: f64, h: f64) -> Material {
    let [stiffest, most] = [MAX_FOLD_STIFFNESS, MAX_FOLD_DAMPING].map(|z| z / (h * inv_mass));
    let stiffness = material.stiffness.min(stiffest / h);
    Material {
        stiffness,
        release: if stiffness > 0.0 { material.release.min(most / stiffness) } else { 0.0 },
        damping: material.damping.min(most),
        friction_damping: material.friction_damping.min(most),
        ..*material
    }
}
