//! What the measurement itself is not sure of.

use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

use super::cube::lowest;
use super::data::{DT, Sample, Toss};
use super::protocol::Trial;
use crate::sampling::{normal, stream};

/// Noise of measured velocities, by axis: standard deviations.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Noise {
    /// m/s.
    pub velocity: f64,
    /// rad/s.
    pub spin: f64,
    /// Flights it was taken from.
    pub flights: usize,
}

impl Noise {
    /// So many times as much.
    pub fn times(self, factor: f64) -> Self {
        Self { velocity: factor * self.velocity, spin: factor * self.spin, ..self }
    }
}

/// In flight the velocity is linear in time and the spin of a cube constant; what is left is noise.
pub fn noise(tosses: &[Toss]) -> Noise {
    let (mut v2, mut w2, mut v_free, mut w_free, mut flights) = (0.0, 0.0, 0.0, 0.0, 0);
    for toss in tosses {
        // The filter on the velocities looks one sample ahead.
        let flight = &toss.samples[..toss.first_contact.saturating_sub(2).min(toss.samples.len())];
        if flight.len() < 6 {
            continue;
        }
        let n = flight.len() as f64;
        let middle = 0.5 * (n - 1.0);
        let (mut v, mut slope, mut w, mut square) = (Vector3::zeros(), Vector3::zeros(), Vector3::zeros(), 0.0);
        for (k, s) in flight.iter().enumerate() {
            let t = k as f64 - middle;
            (v, slope, w, square) = (v + s.velocity / n, slope + s.velocity * t, w + s.spin / n, square + t * t);
        }
        slope /= square;
        for (k, s) in flight.iter().enumerate() {
            v2 += (s.velocity - v - slope * (k as f64 - middle)).norm_squared();
            w2 += (s.spin - w).norm_squared();
        }
        (v_free, w_free, flights) = (v_free + 3.0 * (n - 2.0), w_free + 3.0 * (n - 1.0), flights + 1);
    }
    Noise { velocity: f64::sqrt(v2 / f64::max(v_free, 1.0)), spin: f64::sqrt(w2 / f64::max(w_free, 1.0)), flights }
}

/// Puts noise on the velocities of every start; trial k draws from stream k of the seed.
pub fn disturbed(trials: &[Trial], noise: Noise, seed: u64) -> Vec<Trial> {
    let mut all = trials.to_vec();
    for (k, trial) in all.iter_mut().enumerate() {
        let mut rng = stream(seed, k as u64);
        // By the column.
        let normal = Matrix3::from_fn(|_, _| normal(&mut rng));
        trial.start.velocity += normal.column(0) * noise.velocity;
        trial.start.spin += normal.column(1) * noise.spin;
    }
    all
}

/// A measured velocity is the mean of the frame before it; in flight, half a frame of gravity makes it that of its moment.
pub fn aged(trials: &[Trial]) -> Vec<Trial> {
    let mut all = trials.to_vec();
    for Trial { start: Sample { pose, velocity, .. }, .. } in &mut all {
        if lowest(pose) > 0.002 {
            velocity.z -= 0.5 * 9.81 * DT;
        }
    }
    all
}
