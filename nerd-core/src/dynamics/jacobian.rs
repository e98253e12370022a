//! Jacobians of points and frames.

use nalgebra::{DMatrix, Vector3};

use super::Data;
use crate::robot::Robot;
use crate::spatial::Motion;

/// Jacobian of a frame that is fixed on link `link` at `local` (m, in the link's frame) into `out`, 6 by `nv`: the frame's angular
/// velocity (rows 0 to 2, rad/s) and the velocity of its origin (rows 3 to 5, m/s), both in world axes, are `J qd`, with `qd` local (see
/// [`crate::velocity`]). Needs `kinematics`.
///
/// Column of DoF k: the axis of its joint as a motion, at the frame's place `x`: `(w, v + w x x)`; zero for joints that do not carry
/// the link.
pub fn jacobian(robot: &Robot, data: &Data, link: usize, local: &Vector3<f64>, out: &mut DMatrix<f64>) {
    let x = data.position[link] + data.rotation[link] * local;
    out.fill(0.0);
    let mut add = |k: usize, m: &Motion| {
        let v = m.at(&x);
        for r in 0..3 {
            out[(r, k)] += m.ang[r];
            out[(3 + r, k)] += v[r];
        }
    };
    let mut on = Some(link);
    while let Some(i) = on {
        match robot.links[i].joint {
            Some(_) => add(data.dof[i], &data.axis[i]),
            None => (0..6).for_each(|k| add(k, &Motion::unit(k))),
        }
        on = robot.links[i].parent;
    }
}

/// Rate of that Jacobian while the robot moves, into `out`: the acceleration of the frame is `J qdd + J_dot qd`. Needs
/// [`super::velocities`].
///
/// An axis moves with the link that carries it, `S_dot = V x S`, and the place with its own velocity: of a column `(w, v + w x x)` the
/// rate is `(w_dot, v_dot + w_dot x x + w x x_dot)`. Those of a floating root turn about its origin, which moves.
pub fn jacobian_rate(robot: &Robot, data: &Data, link: usize, local: &Vector3<f64>, out: &mut DMatrix<f64>) {
    let x = data.position[link] + data.rotation[link] * local;
    let speed = data.velocity[link].at(&x);
    out.fill(0.0);
    let mut on = Some(link);
    while let Some(i) = on {
        let above = robot.links[i].parent.map_or(Motion::default(), |p| data.velocity[p]);
        match robot.links[i].joint {
            Some(_) => {
                let turned = above.cross(&data.axis[i]);
                let rate = turned.at(&x) + data.axis[i].ang.cross(&speed);
                for r in 0..3 {
                    out[(r, data.dof[i])] += turned.ang[r];
                    out[(3 + r, data.dof[i])] += rate[r];
                }
            }
            None => (0..3).for_each(|k| {
                let rate = Vector3::ith(k, 1.0).cross(&(speed - data.velocity[i].lin));
                (0..3).for_each(|r| out[(3 + r, k)] += rate[r]);
            }),
        }
        on = robot.links[i].parent;
    }
}

/// Jacobian of the centre of mass into `out`, 3 by `nv`: its velocity (m/s, world axes) is `J qd`, with `qd` local. Needs
/// `kinematics`. Returns the centre of mass in the world (m); of a robot without mass both are not a number.
///
/// Column of DoF k: `m_k / m` times the velocity that its axis gives to the centre of mass of what it carries, of mass `m_k`.
pub fn com_jacobian(robot: &Robot, data: &Data, out: &mut DMatrix<f64>) -> Vector3<f64> {
    let n = robot.links.len();
    let (mut masses, mut moments) = (vec![0.0; n], vec![Vector3::zeros(); n]);
    let (mut mass, mut moment) = (0.0, Vector3::zeros());
    for (i, link) in robot.links.iter().enumerate().rev() {
        masses[i] += link.inertia.mass;
        moments[i] += (data.position[i] + data.rotation[i] * link.inertia.com) * link.inertia.mass;
        let (own, at) = (masses[i], moments[i]);
        match link.parent {
            Some(p) => (masses[p], moments[p]) = (masses[p] + own, moments[p] + at),
            None => (mass, moment) = (mass + own, moment + at),
        }
    }
    out.fill(0.0);
    for (i, link) in robot.links.iter().enumerate() {
        let mut add = |k: usize, m: &Motion| {
            let v = (m.lin * masses[i] + m.ang.cross(&moments[i])) / mass;
            (0..3).for_each(|r| out[(r, k)] += v[r]);
        };
        match link.joint {
            Some(_) => add(data.dof[i], &data.axis[i]),
            None => (0..6).for_each(|k| add(k, &Motion::unit(k))),
        }
    }
    data.origin + moment / mass
}
