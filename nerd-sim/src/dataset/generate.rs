//! Random trajectories: a start from the system's box, a random scene, fresh random torques every frame.

use std::path::Path;
use std::sync::Arc;

use nerd_core::dynamics::Data;

use super::begin::Begun;
use super::drive::Drive;
use super::recording::sha256_of;
use super::{DatasetError, FORMAT, GenerateConfig, Manifest, Recording, manifest, read_shard, write_shard};
use crate::batch::contacts;
use crate::solver::Solver;
use crate::system::System;

/// Records trajectories `first .. first + count` of the seed with `solver`, which is the truth of this data.
pub fn record(
    system: &Arc<System>,
    solver: &mut dyn Solver,
    config: &GenerateConfig,
    first: u64,
    count: usize,
) -> Result<Recording, DatasetError> {
    config.check(system)?;
    let (d, joints, points) = (system.robot.state_dim(), system.robot.joint_count(), system.robot.contact_points.len());
    let Begun { mut batch, mut streams, mut drives, drawn, scales, holds, mut pilots } = Begun::new(system, config, first, count);
    (0..count).for_each(|env| solver.reset(env));
    let f = config.frames;
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
    };
    let (mut data, mut events, mut tau) = (Data::new(&system.robot), Vec::new(), vec![0.0; count * joints]);
    let mut begun = streams.clone();
    for frame in 0..=f {
        for env in 0..count {
            let at = (env * (f + 1) + frame) * d;
            out.states[at..at + d].copy_from_slice(batch.state(env));
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
                None => of(&mut drives, env).draw(batch.state(env), scales[env].into(), &mut streams[env], now),
            }
            out.torques[row * joints..][..joints].copy_from_slice(&tau[env * joints..][..joints]);
            if points > 0 {
                contacts(system, &batch.scenes[env], batch.state(env), &mut data, &mut events);
                for (k, event) in events.iter().enumerate() {
                    let at = (row * points + k) * 3;
                    out.normals[at..at + 3].copy_from_slice(event.normal.as_slice());
                    out.points[at..at + 3].copy_from_slice(event.p1.as_slice());
                    out.depths[row * points + k] = event.distance;
                }
            }
        }
        if frame < f {
            solver.step(&mut batch, &tau).map_err(|source| DatasetError::Step { first, source })?;
        }
    }
    Ok(out)
}

/// What drives an environment.
fn of(drives: &mut [Drive], env: usize) -> &mut Drive {
    let last = drives.len() - 1;
    &mut drives[env.min(last)]
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
    config.check(system)?;
    let total = config.trajectories();
    let identity = manifest::header(system, truth);
    if let Some(other) = Manifest::read(folder).ok().filter(|other| other.robot != system.name) {
        let reason = format!("holds data of robot `{}`; take another folder for `{}`, or delete it", other.robot, system.name);
        return Err(DatasetError::Format { path: folder.into(), reason });
    }
    let mut hashes = Vec::new();
    let mut shards = Vec::new();
    let mut first = 0;
    while first < total {
        let count = config.shard_trajectories.min(total - first);
        let name = format!("shard-{:05}.safetensors", shards.len());
        let path = folder.join(&name);
        let mut header = identity.clone();
        let settings = [
            ("seed", config.seed.to_string()),
            ("first", first.to_string()),
            ("frames", config.frames.to_string()),
            ("trajectories", count.to_string()),
            ("torque_scale", config.torque_scale.to_string()),
            ("hold", config.hold.to_string()),
            ("resets", config.resets.to_string()),
            ("pilot", format!("{:?}", config.pilot)),
        ];
        header.extend(settings.map(|(k, v)| (k.to_string(), v)));
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
    let manifest = Manifest {
        format: Some(FORMAT),
        robot: system.name.clone(),
        robot_sha256: system.robot_sha256(),
        system_sha256: system.sha256(),
        truth: truth.into(),
        trajectories: total,
        frames: config.frames,
        seed: config.seed,
        shards,
        sha256,
    };
    let path = folder.join("manifest.json");
    let text = serde_json::to_string_pretty(&manifest).map_err(|e| DatasetError::Format { path: path.clone(), reason: e.to_string() })?;
    crate::files::write(&path, text.as_bytes()).map_err(|source| DatasetError::File { path, source })?;
    Ok(manifest)
}
