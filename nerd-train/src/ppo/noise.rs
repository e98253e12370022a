//! Action noise: normal numbers from ChaCha8 streams. The numbers depend only on the seed, the stream's number and the
//! position in the stream.

use super::*;

/// A ChaCha8 stream, by seed and number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StreamKey {
    /// Seed.
    pub seed: u64,
    /// Stream number.
    pub number: u64,
}

impl StreamKey {
    /// Generator at the beginning of the stream.
    pub(super) fn rng(self) -> ChaCha8Rng {
        stream(self.seed, self.number)
    }
}

/// ChaCha8 key of a generator, as four 64-bit words for the kernels.
#[cfg(feature = "cuda")]
pub(super) fn key(rng: &ChaCha8Rng) -> [u64; 4] {
    let seed = rng.get_seed();
    std::array::from_fn(|word| u64::from_le_bytes(seed.as_chunks().0[word]))
}

/// Samples actions `N(mean, exp(spread)^2)` with the noise of one stream. Each thread starts at the stream position of
/// its first action. So the result does not depend on the number of threads.
pub(super) fn drawn(answer: &PolicyOutput, key: StreamKey) -> Vec<f32> {
    const PART: usize = 4096;
    let mut out = vec![0.0; answer.mean.len()];
    let said = answer.mean.par_chunks(PART).zip(answer.spread.par_chunks(PART));
    out.par_chunks_mut(PART).zip(said).enumerate().for_each(|(part, (out, (mean, spread)))| {
        let mut rng = key.rng();
        let mut spare = None;
        // Each pair of normal numbers takes four 32-bit words of the stream.
        rng.set_word_pos(2 * (part * PART) as u128);
        for (a, mu, s) in izip!(out, mean, spread) {
            *a = mu + s.exp() * normal(&mut rng, &mut spare);
        }
    });
    out
}

/// Standard normal number (Box-Muller); the second of a pair is kept in `spare`.
pub(super) fn normal(rng: &mut ChaCha8Rng, spare: &mut Option<f32>) -> f32 {
    if let Some(x) = spare.take() {
        return x;
    }
    let (u, v) = (1.0 - rng.random::<f64>(), rng.random::<f64>());
    let radius = (-2.0 * u.ln()).sqrt();
    let (sin, cos) = (std::f64::consts::TAU * v).sin_cos();
    *spare = Some((radius * sin) as f32);
    (radius * cos) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_drawn_in_parts_is_that_of_one_stream() {
        let n = 10_001;
        let key = StreamKey { seed: 3, number: 9 };
        let all = PolicyOutput {
            mean: vec![0.5; n],
            spread: (0..n).map(|k| (k as f32 * 0.01).sin()).collect(),
            value: Vec::new(),
        };
        let mut rng = key.rng();
        let mut spare = None;
        let one: Vec<f32> =
            all.mean.iter().zip(&all.spread).map(|(mu, s)| mu + s.exp() * normal(&mut rng, &mut spare)).collect();
        let apart = one.iter().zip(&drawn(&all, key)).position(|(a, b)| a != b);
        assert_eq!(apart, None, "the first number that differs");
    }
}
