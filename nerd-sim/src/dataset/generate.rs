//! Records random trajectories, and writes them as shards.

use std::time::Instant;

use super::begin::Begun;
use super::config::GenerateConfig;
use super::manifest::{Manifest, header};
use super::shard::{DatasetError, FORMAT, Recording, is_shard, read_shard, sha256_of, write_shard};
use crate::files::{has_keys, unclaimed};
use crate::{disturb::blur, internal::*};

/// Records trajectories `first .. first + count` of the seed with `solver`, the truth of this data.
pub fn record(
    system: &Arc<System>,
    solver: &mut dyn Solver,
    config: &GenerateConfig,
    first: u64,
    count: usize,
) -> Result<Recording, DatasetError> {
    config.check(system)?;
    let (d, joints, points) = (system.robot.state_dim(), system.robot.joint_count(), system.robot.contact_points.len());
    let Begun { mut batch, mut streams, mut sensors, mut drives, drawn, scales, holds, mut pilots } =
        Begun::new(system, config, first, count);
    (0..count).for_each(|env| solver.reset(env));
    let (f, last) = (config.frames, drives.len() - 1);
    let zeros = |n: usize| vec![0.0; n];
    let mut out = Recording {
        trajectories: count,
        frames: f,
        states: zeros(count * (f + 1) * d),
        torques: zeros(count * f * joints),
        normals: zeros(count * f * points * 3),
        points: zeros(count * f * points * 3),
        depths: zeros(count * f * points),
        gravity: batch.scenes.iter().flat_map(|s| s.gravity.iter().copied()).collect(),
        drawn,
        shown: zeros(sensors.len() * f * d),
    };
    let (mut data, mut events, mut tau) = (Data::new(&system.robot), Vec::new(), vec![0.0; count * joints]);
    let mut begun = streams.clone();
    for frame in 0..=f {
        if config.until.is_some_and(|until| Instant::now() >= until) {
            return Err(DatasetError::Late);
        }
        for env in 0..count {
            let at = (env * (f + 1) + frame) * d;
            out.states[at..at + d].copy_from_slice(batch.state(env));
            if frame == f {
                continue;
            }
            let row = env * f + frame;
            // A held action repeats its random numbers, since a position law responds to the state of each frame.
            if pilots[env].is_some() || frame % holds[env] == 0 {
                begun[env] = streams[env].clone();
            } else {
                streams[env] = begun[env].clone();
            }
            let now = &mut tau[env * joints..(env + 1) * joints];
            match &mut pilots[env] {
                Some(act) => act.torques(batch.state(env), &batch.scenes[env], &mut streams[env], now),
                None => drives[env.min(last)].draw(batch.state(env), scales[env], &mut streams[env], now),
            }
            out.torques[row * joints..][..joints].copy_from_slice(&tau[env * joints..][..joints]);
            let mut seen = batch.state(env);
            if let Some(rng) = sensors.get_mut(env) {
                let shown = &mut out.shown[row * d..][..d];
                shown.copy_from_slice(seen);
                blur(batch.of(env), shown, rng);
                seen = shown;
            }
            if points > 0 {
                contacts(system, &batch.scenes[env], seen, &mut data, &mut events);
                for (k, event) in events.iter().enumerate() {
                    let at = (row * points + k) * 3;
                    out.normals[at..at + 3].copy_from_slice(event.normal.as_slice());
                    out.points[at..at + 3].copy_from_slice(event.p1.as_slice());
                    out.depths[row * points + k] = event.distance;
                }
            }
        }
        if frame < f {
            solver.step(&mut batch, &tau).map_err(|error| DatasetError::Step(first, error))?;
        }
    }
    Ok(out)
}

/// Writes all shards and `manifest.json` into `folder`; keeps existing shards with the same settings. `progress`
/// receives the number of transitions done and in total.
pub fn generate(
    system: &Arc<System>,
    solver: &mut dyn Solver,
    truth: &str,
    config: &GenerateConfig,
    folder: &Path,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<Manifest, DatasetError> {
    config.check(system)?;
    if let Some(other) = Manifest::read(folder).ok().filter(|other| other.robot != system.name) {
        let reason =
            format!("holds data of robot `{}`; take another folder for `{}`, or delete it", other.robot, system.name);
        return Err(FileError::new(folder, reason).into());
    }
    let (identity, shards) = (header(system, truth), Shard::all(config));
    let names: Vec<&str> = shards.iter().map(|shard| shard.name.as_str()).chain(["manifest.json"]).collect();
    let recorded = |shard: &Shard| is_shard(&folder.join(&shard.name));
    let known = || {
        has_keys(&Manifest::path(folder), &["robot", "shards", "sha256"])
            || !Manifest::path(folder).exists() && shards.iter().any(recorded)
    };
    unclaimed(folder, &names, known).map_err(|e| FileError::new(folder, e))?;
    let there = |shard: &Shard| -> Option<[u8; 32]> {
        let (recording, found) = read_shard(&folder.join(&shard.name)).ok()?;
        (found == shard.header(&identity, config)).then(|| recording.sha256())
    };
    let (mut hashes, mut done, total) = (Vec::new(), 0, config.trajectories() * config.frames);
    for shard in &shards {
        let hash = match there(shard) {
            Some(hash) => hash,
            None => {
                // The manifest's hash is no longer valid once a shard is overwritten.
                if folder.join(&shard.name).exists() {
                    removed(&Manifest::path(folder))?;
                }
                let recording = record(system, solver, config, shard.first as u64, shard.count)?;
                write_shard(&folder.join(&shard.name), &recording, &shard.header(&identity, config))?;
                recording.sha256()
            }
        };
        hashes.push(hash);
        done += shard.count * config.frames;
        progress(done, total);
    }
    let manifest = Manifest {
        format: Some(FORMAT),
        robot: system.name.clone(),
        robot_sha256: system.robot_sha256(),
        system_sha256: system.sha256(),
        truth: truth.into(),
        trajectories: config.trajectories(),
        frames: config.frames,
        seed: config.seed,
        shards: shards.into_iter().map(|shard| shard.name).collect(),
        sha256: sha256_of(hashes),
    };
    let path = Manifest::path(folder);
    let text = serde_json::to_string_pretty(&manifest).map_err(|e| FileError::new(&path, e))?;
    crate::files::write(&path, text.as_bytes()).map_err(|e| FileError::new(&path, e))?;
    Ok(manifest)
}

/// Removes a file if it exists.
fn removed(path: &Path) -> Result<(), FileError> {
    match std::fs::remove_file(path) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(FileError::new(path, error)),
        _ => Ok(()),
    }
}

struct Shard {
    name: String,
    first: usize,
    count: usize,
}

impl Shard {
    fn all(config: &GenerateConfig) -> Vec<Self> {
        let (most, total) = (config.shard_trajectories, config.trajectories());
        let shard =
            |(k, first)| Self { name: format!("shard-{k:05}.safetensors"), first, count: most.min(total - first) };
        (0..total).step_by(most).enumerate().map(shard).collect()
    }

    fn header(&self, identity: &BTreeMap<String, String>, config: &GenerateConfig) -> BTreeMap<String, String> {
        let settings = [
            ("seed", config.seed.to_string()),
            ("first", self.first.to_string()),
            ("frames", config.frames.to_string()),
            ("trajectories", self.count.to_string()),
            ("torque_scale", config.torque_scale.to_string()),
            ("hold", config.hold.to_string()),
            ("resets", config.resets.to_string()),
            ("pilot", format!("{:?}", config.pilot)),
        ];
        let mut header = identity.clone();
        header.extend(settings.map(|(k, v)| (k.to_string(), v)));
        header
    }
}
