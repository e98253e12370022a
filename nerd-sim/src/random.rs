//! Random numbers. Each trajectory draws from its own ChaCha8 stream, keyed by (seed, trajectory), so its draws depend
//! on neither threads nor other trajectories.

use nalgebra::Vector3;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// The random stream of a trajectory.
pub fn stream(seed: u64, trajectory: u64) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(trajectory);
    rng
}

/// One N(0, 1) number by Box and Muller, from two draws.
pub fn normal(rng: &mut impl Rng) -> f64 {
    let (u, v): (f64, f64) = (rng.random(), rng.random());
    (-2.0 * (1.0 - u).ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}

/// A unit vector: a point drawn uniformly in a cube, then normalised. Directions are denser toward the cube's corners.
pub(crate) fn direction(rng: &mut impl Rng) -> Vector3<f64> {
    let mut side = || 2.0 * rng.random::<f64>() - 1.0;
    loop {
        let n = Vector3::new(side(), side(), side());
        if n.norm() > 1e-6 {
            return n.normalize();
        }
    }
}
