//! Records random trajectories, and writes them as shards.

use std::time::Instant;

use rand_chacha::ChaCha8Rng;

use super::begin::Begun;
use super::config::GenerateConfig;
use super::manifest::{Manifest, header};
use super::shard::{DatasetError, FORMAT, is_shard, read_shard, sha256_of, write_shard};
use crate::files::{has_keys, unclaimed};
use crate::{disturb::blur, internal::*, trajectories::Trajectories};

/// Records trajectories `first .. first + count` of the seed with `solver`, the truth of this data.
pub fn record(
    system: &Arc<System>,
    solver: &mut dyn Solver,
    config: &GenerateConfig,
    first: u64,
    count: usize,
) -> Result<Trajectories, DatasetError> {
    config.check(system)?;
    let (f, joints) = (config.frames, system.robot.joint_count());
    let mut begun = Begun::new(system, config, first, count);
    (0..count).for_each(|env| solver.reset(env));
    let mut out = empty(system, &mut begun, f, count);
    let (mut held, mut tau) = (begun.streams.clone(), vec![0.0; count * joints]);
    for frame in 0..=f {
        if config.until.is_some_and(|until| Instant::now() >= until) {
            return Err(DatasetError::Late);
        }
        for env in 0..count {
            let d = system.robot.state_dim();
            let at = (env * (f + 1) + frame) * d;
            out.states[at..at + d].copy_from_slice(begun.batch.state(env));
            if frame == f {
                continue;
            }
            let row = env * f + frame;
            let now = &mut tau[env * joints..(env + 1) * joints];
            act(&mut begun, &mut held[env], env, frame, now);
            out.torques[row * joints..][..joints].copy_from_slice(now);
            if let Some(rng) = begun.sensors.get_mut(env) {
                let shown = &mut out.shown[row * d..][..d];
                shown.copy_from_slice(begun.batch.state(env));
                blur(begun.batch.of(env), shown, rng);
            }
        }
        if frame < f {
            solver.step(&mut begun.batch, &tau).map_err(|error| DatasetError::Step(first, error))?;
        }
    }
    out.touch(system);
    Ok(out)
}

/// States and torques of zeros, with scenes, robots and drawn parameters.
fn empty(system: &System, begun: &mut Begun, f: usize, count: usize) -> Trajectories {
    let (d, zeros) = (system.robot.state_dim(), |n: usize| vec![0.0; n]);
    Trajectories {
        count,
        frames: f,
        scenes: begun.batch.scenes.clone(),
        systems: begun.batch.systems.clone(),
        states: zeros(count * (f + 1) * d),
        torques: zeros(count * f * system.robot.joint_count()),
        gravity: begun.batch.scenes.iter().flat_map(|s| s.gravity.iter().copied()).collect(),
        drawn: std::mem::take(&mut begun.drawn),
        shown: zeros(begun.sensors.len() * f * d),
        ..Trajectories::default()
    }
}

/// Draws an environment's torques of a frame. `held`: copy of the environment's random stream from where the held
/// action began.
fn act(begun: &mut Begun, held: &mut ChaCha8Rng, env: usize, frame: usize, torques: &mut [f64]) {
    let Begun { batch, streams, drives, scales, holds, pilots, .. } = begun;
    let last = drives.len() - 1;
    // A held action repeats its random numbers, since a position law responds to the state of each frame.
    if pilots[env].is_some() || frame.is_multiple_of(holds[env]) {
        *held = streams[env].clone();
    } else {
        streams[env] = held.clone();
    }
    match &mut pilots[env] {
        Some(act) => act.torques(batch.state(env), &batch.scenes[env], &mut streams[env], torques),
        None => drives[env.min(last)].draw(batch.state(env), scales[env], &mut streams[env], torques),
    }
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
    let (identity, shards) = (header(system, truth), Shard::all(config));
    claim(system, &shards, folder)?;
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

/// Refuses a folder that holds data of another robot, or files of others.
fn claim(system: &System, shards: &[Shard], folder: &Path) -> Result<(), FileError> {
    if let Some(other) = Manifest::read(folder).ok().filter(|other| other.robot != system.name) {
        let reason =
            format!("holds data of robot `{}`; take another folder for `{}`, or delete it", other.robot, system.name);
        return Err(FileError::new(folder, reason));
    }
    let names: Vec<&str> = shards.iter().map(|shard| shard.name.as_str()).chain(["manifest.json"]).collect();
    let recorded = |shard: &Shard| is_shard(&folder.join(&shard.name));
    let known = || {
        has_keys(&Manifest::path(folder), &["robot", "shards", "sha256"])
            || !Manifest::path(folder).exists() && shards.iter().any(recorded)
    };
    unclaimed(folder, &names, known).map_err(|e| FileError::new(folder, e))
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
