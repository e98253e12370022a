//! Loss of predicted rods.
//!
//! The loss is `p(dtd / A q) + p(dt / A T q) + 2 p(dx / V T q) + p(dv / V q) + p(dg / 2 G) / 5`. Here
//! `p(e) = sqrt(1 + e^2) - 1`, each term is a mean over its numbers, and `q = 2 f sqrt k` in frame k of a rollout.
//! Errors of rod directions and rates are dt and dtd (1/s). Errors of node positions and velocities are dx (m) and dv
//! (m/s); dg is the gripper's error. T is the frame time (s). A (1/s) and V (m/s) are the mean changes of rates and of
//! node velocities over a frame. G is the mean error of the gripper's glide. Errors grow along a rollout, and q grows
//! with them.

use super::*;

/// Unit of errors, as a share f of the mean change over a frame: for single frames, and for rollouts.
const SHARE: [f64; 2] = [0.1, 0.2];

/// Units of the errors in the loss.
#[derive(Clone, Copy, Debug)]
pub struct Loss {
    /// Mean change of rates over a frame (1/s).
    pub rate: f64,
    /// Mean change of node velocities over a frame (m/s).
    pub velocity: f64,
    /// Mean error of the gripper's glide, its motion under its drives alone (m, m/s, rad, rad/s).
    pub gripper: [f64; 12],
    /// Unit of errors, as a share f of the mean change over a frame.
    pub share: f64,
}

impl Loss {
    /// From the scales of the network's outputs, the mean change of node velocities (m/s), and the frames of a rollout.
    pub fn new(scale: &[f64; OUTPUTS], velocity: f64, frames: usize) -> Self {
        let gripper = std::array::from_fn(|k| scale[6 + k]);
        Self { rate: 0.5 * scale[0], velocity, gripper, share: SHARE[usize::from(frames > 1)] }
    }

    /// Loss of frame k (from 1) for `(predicted, truth)`, times `weight`; adds its gradient to `gradient`.
    pub fn of(
        &self,
        chain: &Chain,
        (predicted, truth): (&Rods, &Rods),
        k: usize,
        weight: f64,
        gradient: &mut Rods,
    ) -> f64 {
        let q = 2.0 * self.share * (k as f64).sqrt();
        let dt = chain.frame_time;
        let ([x, v], [true_x, true_v]) = (chain.nodes(predicted), chain.nodes(truth));
        let mut by_nodes = [vec![Vector3::zeros(); chain.rods], vec![Vector3::zeros(); chain.rods]];
        let mut total = 0.0;
        total += vectors(&predicted.rates, &truth.rates, self.rate * q, weight, &mut gradient.rates);
        total += vectors(&predicted.along, &truth.along, self.rate * dt * q, weight, &mut gradient.along);
        total += vectors(&x, &true_x, self.velocity * dt * q, 2.0 * weight, &mut by_nodes[0]);
        total += vectors(&v, &true_v, self.velocity * q, weight, &mut by_nodes[1]);
        chain.nodes_back(&by_nodes, gradient);
        let both = predicted.gripper.numbers().zip(truth.gripper.numbers());
        let led = izip!(both, self.gripper, gradient.gripper.numbers_mut());
        total + led.map(|((a, b), unit, gradient)| bent(a - b, 2.0 * unit, 0.2 * weight / 12.0, gradient)).sum::<f64>()
    }
}

/// Mean loss over the numbers of the vectors `a` against `b`, times `weight`. Adds its gradient with respect to `a` to
/// `gradient`.
fn vectors(a: &[Vector3<f64>], b: &[Vector3<f64>], unit: f64, weight: f64, gradient: &mut [Vector3<f64>]) -> f64 {
    let weight = weight / (3 * a.len()) as f64;
    let one = |((a, b), gradient): ((&Vector3<f64>, &Vector3<f64>), &mut Vector3<f64>)| {
        (0..3).map(|i| bent(a[i] - b[i], unit, weight, &mut gradient[i])).sum::<f64>()
    };
    a.iter().zip(b).zip(gradient).map(one).sum()
}
