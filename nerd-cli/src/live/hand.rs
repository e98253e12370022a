//! A spring-damper that pulls a link towards the mouse.

use nalgebra::{DMatrix, Matrix3};
use nerd_core::{dynamics::Axes, robot::FixedFrame};

use crate::prelude::*;

/// Stiffness of the spring divided by the robot's mass (1/s^2); damping is critical for that mass. The spring is
/// stepped implicitly, since the pulled link may be far lighter than the robot.
const PULL: f64 = 60.0;

/// A spring-damper from a point of a link to a target point.
#[derive(Clone, Copy)]
pub(super) struct Hand {
    pub link: usize,
    /// Point of the link that is pulled (m, link axes).
    pub local: Vector3<f64>,
    /// Point towards which the spring pulls (m, world axes).
    pub target: Vector3<f64>,
}

impl Hand {
    /// Applies the spring to the first robot of a batch over `dt` seconds; returns the impulse (N s). `None` if the
    /// mass matrix cannot be factorised.
    pub fn pull(&self, batch: &mut Batch, dt: f64) -> Option<Vector3<f64>> {
        let mass: f64 = batch.system.robot.links.iter().map(|l| l.inertia.mass).sum();
        // Solves the spring's implicit step for the impulse p (N s): p = dt m (k (target - x - dt v') - c v') with v' =
        // v + G p.
        let spring = dt * mass * PULL;
        let damper = dt * mass * (PULL * dt + 2.0 * PULL.sqrt());
        self.push(batch, |place, speed, gives| {
            let lhs = Matrix3::identity() + gives * damper;
            lhs.lu().solve(&((self.target - place) * spring - speed * damper)).unwrap_or_default()
        })
    }

    /// Applies an impulse (N s, world axes) at the pulled point of the link. `law` computes it from the point's
    /// position, velocity and inverse effective mass G. Velocities change by `M^-1 J^T impulse`, so any solver
    /// responds.
    pub fn push(
        &self,
        batch: &mut Batch,
        law: impl FnOnce(Vector3<f64>, Vector3<f64>, Matrix3<f64>) -> Vector3<f64>,
    ) -> Option<Vector3<f64>> {
        let system = batch.system.clone();
        let robot = &system.robot;
        let mut data = system.data();
        let pose = Isometry3::from_parts(self.local.into(), Default::default());
        let frame = FixedFrame { name: String::new(), link: Some(self.link), pose };
        let place = robot.pose(batch.state(0), &frame).translation.vector;
        let (q, qd) = robot.split_mut(batch.state_mut(0));
        let jacobian: DMatrix<f64> = data.jacobian(robot, q, &frame, Axes::World).rows(3, 3).into_owned();
        let moves = data.mass_matrix(robot, q).clone().cholesky()?.solve(&jacobian.transpose());
        let gives: Matrix3<f64> = (&jacobian * &moves).fixed_view::<3, 3>(0, 0).into();
        let mut velocity = qd.into_local(robot, q);
        let speed = Vector3::from_iterator(
            jacobian.row_iter().map(|row| row.iter().zip(velocity.0.iter()).map(|(a, b)| a * b).sum::<f64>()),
        );
        let impulse = law(place, speed, gives);
        velocity.accelerate((moves * impulse).iter(), 1.0);
        velocity.into_twist(robot, q);
        Some(impulse)
    }
}
