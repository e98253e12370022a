//! Links of a robot on each other (`self_collision`).
//!
//! The law is that of contact ([`super::force`]), of the robot's own material, between the capsules of two links; its force acts on both at one
//! place, so momentum stays what it was to rounding. A touch of two links couples branches of the tree, which the implicit solve does not
//! know: so it is an external force in the middle of the substep. With `1 / w` the least inertia that two points feel against each other, in any
//! pose and direction, stiffness k, damping d and drag c are bounded by what a substep h can follow:
//!
//! ```text
//! k <= z_k / (h^2 w n),    d, c <= z_d / (h w n)        leapfrog is stable for  h^2 k w + 2 h d w < 4
//! ```
//!
//! with n touches of a pair of links at a time. The bounds are numbers of the robot alone, so that what a touch has stored is what it gives back. A
//! link that rests on another by g sinks in by some `n g h^2 / z_k`; one that a drive presses on it by many times its weight, deeper.

use nalgebra::{DVector, Matrix3, Vector3};
use nerd_core::dynamics::{Data, Factor, crba, kinematics};
use nerd_core::robot::Robot;
use nerd_core::spatial::Wrench;

use super::config::Friction;
use super::find::{inside, part_of};
use super::force::force;
use crate::random::stream;
use crate::range::Range;
use crate::scene::Material;
use crate::system::System;

/// z_k and z_d.
pub(super) const FOLLOWED: [f64; 2] = [1.0, 0.25];
/// Touches of a pair of links at a time, at most: four carry a face that lies on another.
const AT_ONCE: usize = 4;
/// Poses in which the least inertia is looked for, and how much less it may be between them.
const POSES: u64 = 16;
const BETWEEN: f64 = 2.0;

/// Adds to `data.external` what links do to each other in a substep h in whose middle they are now; `whole` is the frame's substep, `ease` of each
/// pair w n.
pub(super) fn fold(system: &System, ease: &[f64], whole: f64, h: f64, friction: Friction, data: &mut Data) {
    data.external.fill(Wrench::default());
    let folds = &system.folds;
    for ([a, b], ease) in folds.pairs.iter().zip(ease) {
        let ball = |link: usize| data.position[link] + data.rotation[link] * folds.balls[link].0;
        let (one, other, reach) = (ball(*a), ball(*b), folds.balls[*a].1 + folds.balls[*b].1);
        let twist = data.velocity[*a] - data.velocity[*b];
        let way = 0.5 * h * (twist.at(&one).norm() + twist.ang.norm() * reach);
        if (one - other).norm() > reach + way {
            continue;
        }
        let material = followed(&system.spec.material, *ease, whole);
        let mut sum = Wrench::default();
        for one in folds.placed(*a, data) {
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

/// Of each pair of links w n: a bound on what a unit force between them gives them of acceleration against each other, in any direction.
pub(super) fn eases(system: &System) -> Vec<f64> {
    let (robot, folds) = (&system.robot, &system.folds);
    if folds.is_empty() {
        return Vec::new();
    }
    let (mut data, mut factor) = (system.data(), Factor::new(robot));
    let mut most = vec![0.0f64; folds.pairs.len()];
    for pose in 0..POSES {
        kinematics(robot, &posed(system, pose), &mut data);
        crba(robot, &mut data);
        if !factor.refill(&data.mass) {
            continue;
        }
        let roots: Vec<f64> = (0..robot.links.len()).map(|link| ease(system, link, &data, &factor).sqrt()).collect();
        // Each may be pushed through what the other hangs on.
        most.iter_mut().zip(&folds.pairs).for_each(|(most, [a, b])| *most = most.max((roots[*a] + roots[*b]).powi(2)));
    }
    let count = |[a, b]: &[usize; 2]| (folds.own[*a].len() + folds.own[*b].len() - 1).min(AT_ONCE) as f64;
    most.iter().zip(&folds.pairs).map(|(w, pair)| if *w > 0.0 { BETWEEN * w * count(pair) } else { f64::INFINITY }).collect()
}

/// The default pose, or a random one.
fn posed(system: &System, pose: u64) -> Vec<f64> {
    let (robot, mut rng) = (&system.robot, stream(0, pose));
    let mut q = system.default_state()[..robot.nq()].to_vec();
    if pose > 0 {
        for (x, joint) in q[robot.root_coords()..].iter_mut().zip(robot.joints()) {
            let turns = Range { low: -std::f64::consts::PI, high: std::f64::consts::PI };
            let range = joint.limit.map_or(turns, |l| Range { low: l.lower.max(*x - 10.0), high: l.upper.min(*x + 10.0) });
            *x = range.draw(&mut rng);
        }
    }
    q
}

/// The largest w at an end of one of a link's capsules; nothing moves a link's places farther than its ends.
fn ease(system: &System, link: usize, data: &Data, factor: &Factor) -> f64 {
    let ends = system.folds.placed(link, data).flat_map(|c| [c.middle - c.half, c.middle + c.half]);
    ends.map(|x| eased(&system.robot, link, &x, data, factor)).fold(0.0, f64::max)
}

/// Largest eigenvalue of `J M^-1 J^T` at a place of a link.
fn eased(robot: &Robot, link: usize, x: &Vector3<f64>, data: &Data, factor: &Factor) -> f64 {
    let columns = [0, 1, 2].map(|k| {
        let force = Vector3::ith(k, 1.0);
        let mut column = DVector::zeros(robot.nv());
        for i in std::iter::successors(Some(link), |i| robot.links[*i].parent) {
            if robot.links[i].joint.is_some() {
                // Joints that follow one share its column.
                column[data.dof[i]] += data.axis[i].at(x).dot(&force);
            } else {
                column.rows_mut(0, 3).copy_from(&x.cross(&force));
                column.rows_mut(3, 3).copy_from(&force);
            }
        }
        column
    });
    let moved = columns.clone().map(|mut column| {
        factor.solve(column.as_mut_slice());
        column
    });
    Matrix3::from_fn(|r, c| columns[r].dot(&moved[c])).symmetric_eigenvalues().max()
}
