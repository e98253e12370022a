//! Mass, momentum and energy of a whole robot: the quantities that conservation laws are about.

use super::{inertias, velocities};
use crate::{prelude::*, velocity::to_local};

/// Sums over all links of a robot at one state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Totals {
    /// Mass (kg).
    pub mass: f64,
    /// Centre of mass in the world (m).
    pub com: Vector3<f64>,
    /// Angular momentum about the centre of mass (kg m^2/s) and linear momentum (kg m/s), world axes.
    pub momentum: Wrench,
    /// First moment of the gravity-compensated mass: the sum of mass times world position (kg m).
    pub lifted: Vector3<f64>,
    /// Kinetic energy of links and armatures (J).
    pub kinetic: f64,
}

impl Totals {
    /// Kinetic plus potential energy (J) under `gravity` (m/s^2). Potential energy is zero at the world's origin.
    pub fn energy(&self, gravity: &Vector3<f64>) -> f64 {
        self.kinetic - gravity.dot(&(self.com * self.mass - self.lifted))
    }
}

/// Totals at a state `[q, qd]`, in which a floating root's twist is about the world's origin.
pub fn totals(robot: &Robot, state: &[f64], data: &mut Data) -> Totals {
    let (q, qd) = state.split_at(robot.nq());
    let mut local = qd.to_vec();
    to_local(robot, q, &mut local);
    kinematics(robot, q, data);
    inertias(robot, data);
    velocities(robot, &local, data);
    let mut mass = 0.0;
    let mut moment = Vector3::zeros();
    let mut momentum = Wrench::default();
    let mut kinetic = 0.0;
    let mut lifted = Vector3::zeros();
    for (i, link) in robot.links.iter().enumerate() {
        let h = data.inertia[i].apply(&data.velocity[i]);
        mass += link.inertia.mass;
        moment += (data.position[i] + data.rotation[i] * link.inertia.com) * link.inertia.mass;
        lifted += (data.origin + data.position[i] + data.rotation[i] * link.lifted.at) * link.lifted.mass;
        momentum += h;
        kinetic += 0.5 * data.velocity[i].dot(&h);
    }
    let com = moment / mass;
    momentum.ang -= com.cross(&momentum.lin);
    let drives =
        robot.links.iter().zip(&data.dof).filter_map(|(link, k)| link.joint.as_ref().map(|j| (j, j.ratio() * qd[*k])));
    kinetic += drives.map(|(joint, v)| 0.5 * joint.armature * v * v).sum::<f64>();
    Totals { mass, com: data.origin + com, momentum, lifted, kinetic }
}
