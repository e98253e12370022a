//! Scales of a chain's quantities, measured in its motions.

use super::*;

const FRAMES: usize = 8000;
/// Smallest scale: avoids division by 0 for numbers that never change.
const LEAST: f64 = 1e-9;

/// Scales of a network's outputs, and the mean change of node velocities over a frame (m/s).
///
/// A rod's outputs have two scales: twice the mean change of its rate (1/s), and twice the trapezoid rule's mean error
/// of its direction. The scales of the gripper's outputs are the mean errors of its glide, its motion under its drives
/// alone.
pub fn scales(chain: &Chain, motions: &Trajectories) -> (Normalizer, f64) {
    let total = motions.count * motions.frames;
    let step = total.div_ceil(FRAMES).max(1);
    let frames = (0..total).step_by(step).collect_vec();
    let sizes: Vec<[f64; 15]> =
        frames.par_iter().map(|row| sizes(chain, motions, row / motions.frames, row % motions.frames)).collect();
    let mean: [f64; 15] =
        std::array::from_fn(|k| (sizes.iter().map(|s| s[k]).sum::<f64>() / sizes.len().max(1) as f64).max(LEAST));
    let scale = |k: usize| match k {
        0..3 => 2.0 * mean[0],
        3..6 => 2.0 * mean[1],
        _ => mean[k - 3],
    };
    let variance = (0..OUTPUTS).map(|k| scale(k) * scale(k)).collect();
    let outputs = Moments { mean: vec![0.0; OUTPUTS], variance, epsilon: 1e-24 };
    (Normalizer { inputs: Moments::identity(INPUTS), outputs }, mean[2])
}

/// Mean absolute values in one frame. In order: change of rod rates (1/s), the trapezoid rule's error of rod
/// directions, change of node velocities (m/s), errors of the gripper's glide.
fn sizes(chain: &Chain, motions: &Trajectories, motion: usize, frame: usize) -> [f64; 15] {
    let (before, after) = (chain.rods(motions.state(motion, frame)), chain.rods(motions.state(motion, frame + 1)));
    let mut sizes = [0.0; 15];
    let mut moved = Rods::zeros(chain.rods);
    for k in 0..chain.rods {
        moved.rates[k] = after.rates[k] - before.rates[k];
        let missed = after.along[k] - before.along[k] - (before.rates[k] + after.rates[k]) * (0.5 * chain.frame_time);
        sizes[0] += moved.rates[k].abs().mean() / chain.rods as f64;
        sizes[1] += missed.abs().mean() / chain.rods as f64;
    }
    let [_, nodes] = chain.nodes(&moved);
    sizes[2] = nodes.iter().map(|v| v.abs().mean()).sum::<f64>() / chain.rods as f64;
    let glided = chain.glide(&before.gripper, motions.torques(motion, frame));
    let missed = after.gripper.numbers().zip(glided.numbers()).map(|(a, b)| (a - b).abs());
    sizes[3..].iter_mut().zip(missed).for_each(|(size, missed)| *size = missed);
    sizes
}
