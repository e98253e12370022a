//! The loss of predicted rods.
//!
//! With `p(e) = sqrt(1 + e^2) - 1` of every number and means over them, in the k-th frame of a rollout with `q = 2 f sqrt k`:
//! `p(dtd / A q) + p(dt / A T q) + 2 p(dx / V T q) + p(dv / V q) + p(dg / 2 G) / 5`, A the mean change of rates, V the mean change of
//! nodes' velocities and G the error of the gripper's glide, all over a frame of time T. Errors grow along a rollout, and their scale grows
//! with them.

use super::*;

/// Share f of a frame's change that is an error of one: of single frames, and of rollouts.
const SHARE: [f64; 2] = [0.1, 0.2];

/// What errors are counted in.
#[derive(Clone, Copy, Debug)]
pub struct Loss {
    /// Mean change of rates (1/s).
    pub rate: f64,
    /// Mean change of nodes' velocities (m/s).
    pub velocity: f64,
    /// What the gripper's glide misses (m, m/s, rad, rad/s).
    pub gripper: [f64; 12],
    /// Share f of a frame's change that counts as an error of one.
    pub share: f64,
}

impl Loss {
    /// From what a network's numbers mean, the mean change of nodes' velocities, and the frames of a rollout.
    pub fn new(scale: &[f64; OUTPUTS], velocity: f64, frames: usize) -> Self {
        let gripper = std::array::from_fn(|k| scale[6 + k]);
        Self { rate: 0.5 * scale[0], velocity, gripper, share: SHARE[usize::from(frames > 1)] }
    }

    /// The loss of the k-th frame, k from 1, times `weight`; its gradients go to `slope`.
    pub fn of(&self, chain: &Chain, (predicted, truth): (&Rods, &Rods), k: usize, weight: f64, slope: &mut Rods) -> f64 {
        let (q, dt) = (2.0 * self.share * (k as f64).sqrt(), chain.frame_time);
        let ([x, v], [true_x, true_v]) = (chain.nodes(predicted), chain.nodes(truth));
        let mut by_nodes = [vec![Vector3::zeros(); chain.rods], vec![Vector3::zeros(); chain.rods]];
        let mut total = 0.0;
        total += vectors(&predicted.rates, &truth.rates, self.rate * q, weight, &mut slope.rates);
        total += vectors(&predicted.along, &truth.along, self.rate * dt * q, weight, &mut slope.along);
        total += vectors(&x, &true_x, self.velocity * dt * q, 2.0 * weight, &mut by_nodes[0]);
        total += vectors(&v, &true_v, self.velocity * q, weight, &mut by_nodes[1]);
        chain.nodes_back(&by_nodes, slope);
        let led = predicted.gripper.numbers().zip(truth.gripper.numbers()).zip(self.gripper).zip(slope.gripper.numbers_mut());
        total + led.map(|(((a, b), unit), slope)| bent(a - b, 2.0 * unit, 0.2 * weight / 12.0, slope)).sum::<f64>()
    }
}

/// Mean over the numbers of vectors.
fn vectors(a: &[Vector3<f64>], b: &[Vector3<f64>], unit: f64, weight: f64, slope: &mut [Vector3<f64>]) -> f64 {
    let weight = weight / (3 * a.len()) as f64;
    let one = |((a, b), slope): ((&Vector3<f64>, &Vector3<f64>), &mut Vector3<f64>)| {
        (0..3).map(|i| bent(a[i] - b[i], unit, weight, &mut slope[i])).sum::<f64>()
    };
    a.iter().zip(b).zip(slope).map(one).sum()
}
