//! Tokens of rods: [`INPUTS`] numbers per rod.
//!
//! | numbers | content |
//! |---|---|
//! | 3, 3, 3 | direction; its rate / 10 (1/s); velocity of the rod's end / 2 (m/s) |
//! | 3 | normal of the nearest surface at the end, if nearer than [`REACH`], else 0 |
//! | 4 | gap `d` (m) at the end: `20 d`, `e^-abs(d)/r sign d`, `tanh 4 d/r`; the end's velocity along the normal / 2 |
//! | 1, 1 | `tanh` of `d` one frame later over `3 r / 4`; whether a surface is near |
//! | 12 | the gripper under its drives: `10 dv`, `v'`, half the change of its direction's rate, new direction |
//!
//! All vectors are in world axes. r is the rods' radius (m), and d is measured from their surface. A token does not
//! contain the chain's position.

use super::{Chain, Gripper, Rods};
use crate::prelude::*;

/// Width of a token.
pub const INPUTS: usize = 30;
/// Gap (m) up to which a token contains the nearest surface, the same as for other robots (paper A.1).
pub(super) const REACH: f64 = 0.1;
/// Scale (s/m) of the gripper's velocity change in a token.
pub(super) const QUICK: f64 = 10.0;

/// Contact with the nearest surface at the end of a rod.
struct Touch {
    /// Outward unit normal (world axes); zeros beyond [`REACH`].
    normal: Vector3<f64>,
    /// Gap (m) between the rod's surface and the nearest surface, at most [`REACH`].
    gap: f64,
}

/// Contacts and gripper motion of a chain in one frame.
pub struct Look {
    /// Contact of each rod.
    touches: Vec<Touch>,
    velocities: Vec<Vector3<f64>>,
    /// The gripper after the frame under its drives alone.
    pub glided: Gripper,
}

impl Look {
    /// Finds contacts and gripper motion. `contact` returns the nearest surface at a position; `torques` (N, N m) act
    /// on the gripper's six axes.
    pub fn at(
        chain: &Chain,
        rods: &Rods,
        torques: &[f64],
        mut contact: impl FnMut(&Vector3<f64>) -> ContactEvent,
    ) -> Self {
        let [nodes, velocities] = chain.nodes(rods);
        let touch = |node: &Vector3<f64>| {
            let event = contact(node);
            let gap = event.distance - chain.radius;
            // A gap of NaN is kept, so that the failure is reported.
            if gap >= REACH {
                Touch { normal: Vector3::zeros(), gap: REACH }
            } else {
                Touch { normal: event.normal, gap }
            }
        };
        Self { touches: nodes.iter().map(touch).collect(), velocities, glided: chain.glide(&rods.gripper, torques) }
    }

    /// Appends the rods' tokens, `[rod][INPUTS]`, to `tokens`.
    pub fn tokens(&self, chain: &Chain, rods: &Rods, tokens: &mut Vec<f32>) {
        let before = rods.gripper.points();
        let after = self.glided.points();
        let velocity = self.glided.velocity;
        let ahead = [(velocity - rods.gripper.velocity) * QUICK, velocity, (after[1] - before[1]) * 0.5, after[0]];
        for (k, Touch { normal, gap }) in self.touches.iter().enumerate() {
            let own = [rods.along[k], rods.rates[k] * 0.1, self.velocities[k] * 0.5, *normal];
            let speed = self.velocities[k].dot(normal);
            let near = [
                20.0 * gap,
                (-gap.abs() / chain.radius).exp().copysign(*gap),
                (4.0 * gap / chain.radius).tanh(),
                0.5 * speed,
                ((gap + speed * chain.frame_time) / (0.75 * chain.radius)).tanh(),
                f64::from(u8::from(*gap < REACH)),
            ];
            tokens.extend(own.iter().flat_map(|v| v.iter()).map(|x| *x as f32));
            tokens.extend(near.map(|x| x as f32));
            tokens.extend(ahead.iter().flat_map(|v| v.iter()).map(|x| *x as f32));
        }
    }

    /// Adjoint of [`Look::tokens`]: adds to `gradient` the gradient with respect to the rods, from gradients with
    /// respect to tokens, `[rod][INPUTS]`. Returns the gradient with respect to `glided`. Normals are held constant.
    pub fn tokens_back(&self, chain: &Chain, rods: &Rods, upstream: &[f32], gradient: &mut Rods) -> Gripper {
        let mut nodes = Vec::with_capacity(chain.rods);
        let mut speeds = Vec::with_capacity(chain.rods);
        let mut ahead = [Vector3::zeros(); 4];
        for (k, (Touch { normal, gap }, row)) in self.touches.iter().zip(upstream.as_chunks::<INPUTS>().0).enumerate() {
            let at = |first: usize| Vector3::new(row[first], row[first + 1], row[first + 2]).map(f64::from);
            gradient.along[k] += at(0);
            gradient.rates[k] += at(3) * 0.1;
            let speed = self.velocities[k].dot(normal);
            let sharp = (4.0 * gap / chain.radius).tanh();
            let soon = ((gap + speed * chain.frame_time) / (0.75 * chain.radius)).tanh();
            let by_soon = f64::from(row[16]) * (1.0 - soon * soon) / (0.75 * chain.radius);
            let by_gap = 20.0 * f64::from(row[12])
                - f64::from(row[13]) * (-gap.abs() / chain.radius).exp() / chain.radius
                + f64::from(row[14]) * (1.0 - sharp * sharp) * 4.0 / chain.radius
                + by_soon;
            // Beyond `REACH` the normal is zero, so the gradient through the gap vanishes.
            nodes.push(normal * by_gap);
            speeds.push(at(6) * 0.5 + normal * (0.5 * f64::from(row[15]) + by_soon * chain.frame_time));
            ahead.iter_mut().enumerate().for_each(|(i, sum)| *sum += at(18 + 3 * i));
        }
        chain.nodes_back(&[nodes, speeds], gradient);
        let [change, velocity, rate, direction] = ahead;
        gradient.gripper.velocity -= change * QUICK;
        rods.gripper.points_back([Vector3::zeros(), rate * -0.5], &mut gradient.gripper);
        let mut glided = Gripper { velocity: change * QUICK + velocity, ..Gripper::default() };
        self.glided.points_back([direction, rate * 0.5], &mut glided);
        glided
    }
}
