//! Robot-centric frames, equations (1) to (8) of the paper's appendix A.1, both directions.
//!
//! The frame B of a state is the pose `(x, R)` of its root. The root is the floating base, or the first moving link of
//! a fixed-base robot. Only the coordinates of a *floating* root change with the frame; joint coordinates are the same
//! in every frame. A root with position p, rotation Q and twist `(w, v)` about the world origin has these coordinates
//! in B:
//!
//! ```text
//! x_B = R^-1 (p - x)     R_B = R^-1 Q     w_B = R^-1 w     v_B = R^-1 (v - x cross w)
//! ```
//!
//! With `(x, R)` taken from the state itself these formulas are equations (1) to (4), and `x_B = 0`, `R_B = 1`. With
//! the frame of the previous token the formulas are equations (5) to (8). Differences are taken in f64 before the cast
//! to f32. So moving the world's origin changes the results by rounding only.

use crate::prelude::*;

/// Velocity of a floating root in its body axes: angular velocity (rad/s), and velocity of the root's origin (m/s).
pub fn own_velocity(state: &[f64], nq: usize) -> [Vector3<f64>; 2] {
    let x = vector(&state[..3]);
    let r = quaternion(&state[3..7]);
    let (w, v) = (vector(&state[nq..]), vector(&state[nq + 3..]));
    [r.inverse_transform_vector(&w), r.inverse_transform_vector(&(v - x.cross(&w)))]
}

/// The frame B: the pose of a robot's root in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RootFrame {
    /// Origin x in the world (m).
    pub origin: Vector3<f64>,
    /// Rotation R from B to the world.
    pub rotation: UnitQuaternion<f64>,
}

impl RootFrame {
    /// The frame at `pose` of the root.
    pub fn at(pose: &Isometry3<f64>) -> Self {
        Self { origin: pose.translation.vector, rotation: pose.rotation }
    }

    /// The frame of a floating robot's root at `state`.
    pub fn of(state: &[f64]) -> Self {
        Self { origin: vector(&state[..3]), rotation: quaternion(&state[3..7]) }
    }

    /// The world point `p` (m) expressed in B (equation 5).
    pub fn point(&self, p: &Vector3<f64>) -> Vector3<f64> {
        self.rotation.inverse_transform_vector(&(p - self.origin))
    }

    /// The world direction `d` expressed in B.
    pub fn direction(&self, d: &Vector3<f64>) -> Vector3<f64> {
        self.rotation.inverse_transform_vector(d)
    }

    /// Equations (1) to (8): writes the world state `state` (`[q, qd]`) expressed in B to `out`, of equal length.
    pub fn state_in(&self, robot: &Robot, state: &[f64], out: &mut [f64]) {
        out.copy_from_slice(state);
        if !robot.floating() {
            return;
        }
        let p = vector(&state[..3]);
        let r = quaternion(&state[3..7]);
        let v = robot.nq();
        let (w, nu) = (vector(&state[v..]), vector(&state[v + 3..]));
        out[..3].copy_from_slice(self.point(&p).as_slice());
        write_quaternion(&mut out[3..7], &(self.rotation.inverse() * r));
        out[v..v + 3].copy_from_slice(self.direction(&w).as_slice());
        out[v + 3..v + 6].copy_from_slice(self.direction(&(nu - self.origin.cross(&w))).as_slice());
    }

    /// The inverse of [`Self::state_in`].
    pub fn state_out(&self, robot: &Robot, state: &[f64], out: &mut [f64]) {
        out.copy_from_slice(state);
        if !robot.floating() {
            return;
        }
        let p = vector(&state[..3]);
        let r = quaternion(&state[3..7]);
        let v = robot.nq();
        let w = self.rotation * vector(&state[v..]);
        let nu = self.origin.cross(&w) + self.rotation * vector(&state[v + 3..]);
        out[..3].copy_from_slice((self.origin + self.rotation * p).as_slice());
        write_quaternion(&mut out[3..7], &(self.rotation * r));
        out[v..v + 3].copy_from_slice(w.as_slice());
        out[v + 3..v + 6].copy_from_slice(nu.as_slice());
    }
}
