//! Random trajectories: a start from the system's box, a random scene, fresh random torques every frame.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use nerd_core::dynamics::Data;
use rand::RngExt;
use serde::{Deserialize, Serialize};

use super::drive::Drive;
use super::pilot::Pilot;
use super::recording::sha256_of;
use super::{DatasetError, Recording, read_shard, write_shard};
use crate::batch::{Batch, contacts};
use crate::law::Law;
use crate::sampling::{Start, scene, start, stream};
use crate::solver::Solver;
use crate::system::System;

/// What to generate.
#[derive(Clone, Debug)]
pub struct GenerateConfig {
    /// Transitions in all, rounded up to whole trajectories.
    pub transitions: usize,
    /// Frames of a trajectory (paper: 100).
    pub frames: usize,
    /// Seed (training 0, validation 10 in the paper).
    pub seed: u64,
    /// Trajectories of a shard.
    pub shard_trajectories: usize,
    /// Law of a factor on the torque amplitudes, drawn once a trajectory (paper: always 1); a share of the trajectories is
    /// passive where draws are negative ([`super::Drive::draw`]).
    pub torque_scale: Law,
    /// Most frames for which an action is held; their number is drawn once a trajectory, its logarithm evenly (paper: 1).
    pub hold: usize,
    /// Share of the trajectories that start as evaluations and tasks do, not from the box of the data (paper: 0).
    pub resets: f64,
    /// Who acts in place of random torques, from starts of its own, and in what share of the trajectories (paper: none).
    pub pilot: Option<(Arc<dyn Pilot>, f64)>,
}

impl Default for GenerateConfig {
    fn default() -> Self {
        let torque_scale = Law { low: 1.0, high: 1.0 };
        Self { transitions: 1_000_000, frames: 100, seed: 0, shard_trajectories: 2048, torque_scale, hold: 1, resets: 0.0, pilot: None }
    }
}

impl GenerateConfig {
    /// Trajectories in all.
    pub fn trajectories(&self) -> usize {
        self.transitions.div_ceil(self.frames)
    }
}

/// What a folder of shards holds; `manifest.json` in it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// Robot.
    pub robot: String,
    /// Trajectories.
    pub trajectories: usize,
    /// Frames of each.
    pub frames: usize,
    /// Seed.
    pub seed: u64,
    /// Shard files, in order.
    pub shards: Vec<String>,
    /// Hash of all shards ([`sha256_of`]).
    pub sha256: String,
}

/// Records trajectories `first .. first + count` of the seed with `solver`, which is the truth of this data.
pub fn record(
    system: &Arc<System>,
    solver: &mut dyn Solver,
    config: &GenerateConfig,
    first: u64,
    count: usize,
) -> Result<Recording, DatasetError> {
    let (d, joints, points) = (system.robot.state_dim(), system.robot.joint_count(), system.robot.contact_points.len());
    let mut drive = Drive::new(system);
    let mut streams: Vec<_> = (0..count as u64).map(|k| stream(config.seed, first + k)).collect();
    let mut batch = Batch::new(system, &Arc::new(crate::scene::Scene::free(system.gravity())), count);
    let (mut scales, mut holds, mut pilots) = (Vec::with_capacity(count), Vec::with_capacity(count), Vec::with_capacity(count));
    for (env, rng) in streams.iter_mut().enumerate() {
        // Laws that are off draw nothing, so that older data is made again to the byte.
        let pilot = config.pilot.as_ref().filter(|(_, share)| rng.random::<f64>() < *share);
        let (state, act) = pilot.map_or_else(Default::default, |(pilot, _)| {
            let (state, act) = pilot.launch(system, rng);
            (state, Some(act))
        });
        let reset = config.resets > 0.0 && rng.random::<f64>() < config.resets;
        let which = if reset { Start::Reset } else { Start::Sample };
        let state = if act.is_some() { state } else { start(system, which, rng) };
        pilots.push(act);
        batch.scenes[env] = scene(system, &state, rng);
        batch.reset(env, &state);
        scales.push(config.torque_scale.draw(rng));
        holds.push(if config.hold > 1 { ((config.hold + 1) as f64).powf(rng.random()) as usize } else { 1 });
        solver.reset(env);
    }
    let f = config.frames;
    let zeros = |n: usize| vec![0.0f32; n];
    let mut out = Recording {
        trajectories: count,
        frames: f,
        states: zeros(count * (f + 1) * d),
        torques: zeros(count * f * joints),
        normals: zeros(count * f * points * 3),
        points: zeros(count * f * points * 3),
        depths: zeros(count * f * points),
        gravity: batch.scenes.iter().flat_map(|s| s.gravity.iter().map(|g| *g as f32)).collect(),
    };
    let (mut data, mut events, mut tau) = (Data::new(&system.robot), Vec::new(), vec![0.0; count * joints]);
    let mut begun = streams.clone();
    for frame in 0..=f {
        for env in 0..count {
            let at = (env * (f + 1) + frame) * d;
            copy(&mut out.states[at..], batch.state(env));
            if frame == f {
                continue;
            }
            let row = env * f + frame;
            // A held action is drawn again from where its numbers began, since a position law answers the state of each frame.
            if pilots[env].is_some() || frame % holds[env] == 0 {
                begun[env] = streams[env].clone();
            } else {
                streams[env] = begun[env].clone();
            }
            let now = &mut tau[env * joints..(env + 1) * joints];
            match &mut pilots[env] {
                Some(act) => act.torques(batch.state(env), &batch.scenes[env], &mut streams[env], now),
                None => drive.draw(batch.state(env), scales[env], &mut streams[env], now),
            }
            copy(&mut out.torques[row * joints..], &tau[env * joints..(env + 1) * joints]);
            if points > 0 {
                contacts(system, &batch.scenes[env], batch.state(env), &mut data, &mut events);
                for (k, event) in events.iter().enumerate() {
                    copy(&mut out.normals[(row * points + k) * 3..], event.normal.as_slice());
                    copy(&mut out.points[(row * points + k) * 3..], event.p1.as_slice());
                    out.depths[row * points + k] = event.distance as f32;
                }
            }
        }
        if frame < f {
            solver.step(&mut batch, &tau).map_err(|source| DatasetError::Step { first, source })?;
        }
    }
    Ok(out)
}

fn copy(out: &mut [f32], x: &[f64]) {
    out.iter_mut().zip(x).for_each(|(o, x)| *o = *x as f32);
}

/// Writes all shards and `manifest.json` into `folder`; shards that are there already, from the same settings, are
/// kept. `progress` is told transitions done and in all.
pub fn generate(
    system: &Arc<System>,
    solver: &mut dyn Solver,
    truth: &str,
    config: &GenerateConfig,
    folder: &Path,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<Manifest, DatasetError> {
    let total = config.trajectories();
    let mut hashes = Vec::new();
    let mut shards = Vec::new();
    let mut first = 0;
    while first < total {
        let count = config.shard_trajectories.min(total - first);
        let name = format!("shard-{:05}.safetensors", shards.len());
        let path = folder.join(&name);
        let header: BTreeMap<String, String> = [
            ("robot", system.name.clone()),
            ("truth", truth.to_string()),
            ("seed", config.seed.to_string()),
            ("first", first.to_string()),
            ("frames", config.frames.to_string()),
            ("trajectories", count.to_string()),
            ("torque_scale", format!("U({}, {})", config.torque_scale.low, config.torque_scale.high)),
            ("hold", config.hold.to_string()),
            ("resets", config.resets.to_string()),
            ("pilot", format!("{:?}", config.pilot)),
        ]
        .map(|(k, v)| (k.to_string(), v))
        .into();
        let kept = read_shard(&path).ok().filter(|(_, found)| *found == header).map(|(recording, _)| recording);
        let recording = match kept {
            Some(recording) => recording,
            None => {
                let recording = record(system, solver, config, first as u64, count)?;
                write_shard(&path, &recording, &header)?;
                recording
            }
        };
        hashes.push(recording.sha256());
        shards.push(name);
        first += count;
        progress(first * config.frames, total * config.frames);
    }
    let sha256 = sha256_of(hashes);
    let manifest = Manifest { robot: system.name.clone(), trajectories: total, frames: config.frames, seed: config.seed, shards, sha256 };
    let path = folder.join("manifest.json");
    let text = serde_json::to_string_pretty(&manifest).map_err(|e| DatasetError::Format { path: path.clone(), reason: e.to_string() })?;
    crate::files::write(&path, text.as_bytes()).map_err(|source| DatasetError::File { path, source })?;
    Ok(manifest)
}
