//! Start, scene and drive of random trajectories.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::drive::{Act, Drive, Smooth};
use super::{config::GenerateConfig, shard::DatasetError};
use crate::{internal::*, sampling::scene, vary};

pub(super) struct Begun {
    pub batch: Batch,
    pub streams: Vec<ChaCha8Rng>,
    /// Random streams of sensor noise; empty without noise.
    pub sensors: Vec<ChaCha8Rng>,
    /// One drive for all trajectories, or one each where robots differ.
    pub drives: Vec<Drive>,
    /// Drawn parameters, where robots differ.
    pub drawn: Vec<f64>,
    /// For each trajectory: factor on torques; `holds`: number of frames that an action is held constant; `pilots`:
    /// policy or smooth curves in place of random torques.
    pub scales: Vec<f64>,
    pub holds: Vec<usize>,
    pub pilots: Vec<Option<Box<dyn Act>>>,
}

/// Starts and scenes of trajectories `first .. first + count` of the seed, the same as in [`super::record`].
pub fn begin(system: &Arc<System>, config: &GenerateConfig, first: u64, count: usize) -> Result<Batch, DatasetError> {
    config.check(system)?;
    Ok(Begun::new(system, config, first, count).batch)
}

impl Begun {
    pub fn new(system: &Arc<System>, config: &GenerateConfig, first: u64, count: usize) -> Self {
        let mut streams: Vec<_> = (0..count as u64).map(|k| stream(config.seed, first + k)).collect();
        let mut drives = if system.spec.vary.is_some() { Vec::with_capacity(count) } else { vec![Drive::new(system)] };
        let mut batch = Batch::new(system, &Arc::new(Scene::free(system.gravity())), count);
        let (mut drawn, mut sensors) = (Vec::new(), Vec::new());
        let (mut scales, mut holds, mut pilots) =
            (Vec::with_capacity(count), Vec::with_capacity(count), Vec::with_capacity(count));
        for (env, rng) in streams.iter_mut().enumerate() {
            // Disabled settings draw nothing, so that earlier data is reproduced to the byte.
            let pilot = config.pilot.as_ref().filter(|(_, share)| rng.random::<f64>() < *share);
            let launched = pilot.map(|(pilot, _)| pilot.launch(system, rng));
            let reset = config.resets > 0.0 && rng.random::<f64>() < config.resets;
            let which = if reset { Start::Reset } else { Start::Sample };
            let (state, act) = match launched {
                Some((state, act)) => (state, Some(act)),
                None => (start(system, which, rng), None),
            };
            // Drawn after the start, so that starts do not depend on `[vary]`.
            let (own, numbers) = vary::draw(system, rng);
            drawn.extend(numbers);
            batch.scenes[env] = scene(&own, &state, rng);
            if system.spec.vary.is_some() {
                drives.push(Drive::new(&own));
                batch.systems.push(own);
            }
            batch.reset(env, &state);
            let scale = config.torque_scale.draw(rng);
            scales.push(scale);
            holds.push(if config.hold > 1 { (config.hold as f64 + 1.0).powf(rng.random()) as usize } else { 1 });
            let smooth = |rng| Smooth::new(system, &state, scale, rng).map(|curves| Box::new(curves) as Box<dyn Act>);
            pilots.push(act.or_else(|| smooth(rng)));
            if system.noisy() {
                sensors.push(ChaCha8Rng::seed_from_u64(rng.random()));
            }
        }
        Self { batch, streams, sensors, drives, drawn, scales, holds, pilots }
    }
}
