//! From recorded trajectories to normalised windows.

use std::path::Path;
use std::sync::Arc;

use nalgebra::Vector3;
use nerd_core::contact::ContactEvent;
use nerd_core::state::vector;
use nerd_model::features::Features;
use nerd_model::form::Form;
use nerd_model::normalizer::{Moments, Normalizer};
use nerd_sim::dataset::{DatasetError, GenerateConfig, Manifest, Recording, record, sha256_of};
use nerd_sim::scene::Scene;
use nerd_sim::solver::Solver;
use nerd_sim::system::System;
use rayon::prelude::*;

use crate::error::Result;
use crate::ranks::{RankError, Ranks};
use crate::windows::Windows;

/// Tokens and targets of every frame of a recording, not normalised yet; in the form asked for.
pub fn tokens(system: &Arc<System>, recording: &Recording, history: usize, form: impl Into<Form>) -> Result<Windows, DatasetError> {
    let form = form.into();
    let (inputs, outputs) = (Features::inputs(system, form), Features::outputs(system));
    let f = recording.frames;
    let mut x = vec![0.0; recording.trajectories * f * inputs];
    let mut y = vec![0.0; recording.trajectories * f * outputs];
    let rows = x.par_chunks_mut(f * inputs).zip(y.par_chunks_mut(f * outputs)).enumerate();
    rows.try_for_each_init(
        || (Features::new(system, form), form.base.flight(system), form.base.draft(system)),
        |(features, flight, draft), (trajectory, (x, y))| {
            let row = Row::of(system, recording, trajectory);
            let lost = |reason: String| DatasetError::Config(format!("trajectory {trajectory}: {reason}"));
            let mut drafted = row.states.to_vec();
            let bases = match flight {
                None => row.states,
                Some(flight) => {
                    let free = Arc::new(Scene::free(row.gravity));
                    let scenes = vec![free; f];
                    flight
                        .step(&row.states[..f * outputs], &scenes, row.torques)
                        .map_err(|source| DatasetError::Step { first: trajectory as u64, source })?
                }
            };
            for frame in 0..f {
                let (x, y) = (&mut x[frame * inputs..][..inputs], &mut y[frame * outputs..][..outputs]);
                let events = row.events(recording, frame, system.robot.contact_points.len());
                let mut base = &bases[frame * outputs..][..outputs];
                if let Some(draft) = draft {
                    let draft = draft.as_mut().map_err(|e| lost(e.to_string()))?;
                    let to = &mut drafted[frame * outputs..][..outputs];
                    draft.step(system, &row.gravity, &events, row.torques(frame, system.robot.joint_count()), to).map_err(lost)?;
                    base = to;
                }
                row.frame(system, frame, base, &events, features, x, y);
            }
            Ok(())
        },
    )?;
    Ok(Windows { inputs, outputs, frames: f, history, x, y })
}

/// A trajectory.
struct Row<'a> {
    trajectory: usize,
    states: &'a [f64],
    torques: &'a [f64],
    gravity: Vector3<f64>,
}

impl<'a> Row<'a> {
    fn of(system: &System, recording: &'a Recording, trajectory: usize) -> Self {
        let (f, d, joints) = (recording.frames, system.robot.state_dim(), system.robot.joint_count());
        Self {
            trajectory,
            states: &recording.states[trajectory * (f + 1) * d..][..(f + 1) * d],
            torques: &recording.torques[trajectory * f * joints..][..f * joints],
            gravity: vector(&recording.gravity[3 * trajectory..]),
        }
    }

    /// Contacts at the start of a frame.
    fn events(&self, recording: &Recording, frame: usize, points: usize) -> Vec<ContactEvent> {
        let row = self.trajectory * recording.frames + frame;
        let event = |k: usize| {
            let i = row * points + k;
            let (p1, normal) = (vector(&recording.points[3 * i..]), vector(&recording.normals[3 * i..]));
            let distance = recording.depths[i];
            // The point on the robot follows from the rest and is not an input of the network.
            ContactEvent { p0: p1 + if distance.is_finite() { normal * distance } else { normal }, p1, normal, distance, collider: 0 }
        };
        (0..points).map(event).collect()
    }

    fn torques(&self, frame: usize, joints: usize) -> &'a [f64] {
        &self.torques[frame * joints..][..joints]
    }

    #[allow(clippy::too_many_arguments)]
    fn frame(
        &self,
        system: &System,
        frame: usize,
        base: &[f64],
        events: &[ContactEvent],
        features: &mut Features,
        x: &mut [f32],
        y: &mut [f32],
    ) {
        let d = system.robot.state_dim();
        let (state, next) = (&self.states[frame * d..][..d], &self.states[(frame + 1) * d..][..d]);
        features.token(state, base, events, self.torques(frame, system.robot.joint_count()), &self.gravity, x);
        features.target(state, base, next, y);
    }
}

/// A data set ready to be normalised, and the hash of the recordings it was made from.
pub struct Prepared {
    /// Tokens and targets.
    pub windows: Windows,
    /// [`sha256_of`] the recordings.
    pub sha256: String,
}

/// Records `config`'s trajectories in memory and turns them into tokens: each rank its share of the shards, shard k on rank k mod R, and
/// all are given to all. `solver` makes the truth; `progress` gets the transitions done. The same config gives the same bytes as
/// [`nerd_sim::dataset::generate`].
///
/// # Errors
/// If the truth cannot step, or a rank is lost.
pub fn generate(
    ranks: &Ranks,
    system: &Arc<System>,
    solver: &(dyn Fn() -> Box<dyn Solver> + Sync),
    config: &GenerateConfig,
    (history, form): (usize, Form),
    progress: &(dyn Fn(usize) + Sync),
) -> Result<Prepared> {
    let mut mine = shards(ranks, system, solver, config, (history, form), progress)?;
    if ranks.world() == 1 {
        return Ok(joined(mine));
    }
    mine.reverse();
    let mut all = Vec::new();
    for k in 0..config.trajectories().div_ceil(config.shard_trajectories) {
        let own = if k % ranks.world() == ranks.rank() { mine.pop() } else { None };
        let sent =
            ranks.share(k % ranks.world(), || own.as_ref().map_or_else(Vec::new, |(w, hash)| [&hash[..], &w.to_bytes()].concat()))?;
        let (hash, windows) = sent.split_first_chunk().unwrap_or((&[0; 32], &[]));
        all.push(own.map_or_else(|| Ok((Windows::from_bytes(windows)?, *hash)), Ok::<_, RankError>)?);
    }
    Ok(joined(all))
}

/// This rank's shards, in order.
fn shards(
    ranks: &Ranks,
    system: &Arc<System>,
    solver: &(dyn Fn() -> Box<dyn Solver> + Sync),
    config: &GenerateConfig,
    form: (usize, Form),
    progress: &(dyn Fn(usize) + Sync),
) -> Result<Vec<(Windows, [u8; 32])>, DatasetError> {
    config.check(system)?;
    let starts = (0..config.trajectories()).step_by(config.shard_trajectories);
    let mine: Vec<usize> = starts.skip(ranks.rank()).step_by(ranks.world()).collect();
    let shard = |&first: &usize| {
        let count = config.shard_trajectories.min(config.trajectories() - first);
        let done = shard(system, solver, config, first as u64, count, form)?;
        progress(count * config.frames);
        Ok(done)
    };
    mine.par_iter().map(shard).collect()
}

/// Tokens and targets of trajectories `first .. first + count`, and the hash of their recording.
pub(crate) fn shard(
    system: &Arc<System>,
    solver: &(dyn Fn() -> Box<dyn Solver> + Sync),
    config: &GenerateConfig,
    first: u64,
    count: usize,
    (history, form): (usize, Form),
) -> Result<(Windows, [u8; 32]), DatasetError> {
    let recording = record(system, &mut *solver(), config, first, count)?;
    Ok((tokens(system, &recording, history, form)?, recording.sha256()))
}

/// Reads the shards of a folder that [`nerd_sim::dataset::generate`] wrote with the truth of that name.
pub fn read(system: &Arc<System>, truth: &str, folder: &Path, history: usize, form: impl Into<Form>) -> Result<Prepared, DatasetError> {
    let form = form.into();
    let manifest = Manifest::read(folder)?;
    manifest.check(system, truth).map_err(|reason| DatasetError::Format { path: folder.join("manifest.json"), reason })?;
    let shard = |name: &String| -> Result<_, DatasetError> {
        let recording = manifest.shard(folder, name, system)?;
        Ok((tokens(system, &recording, history, form)?, recording.sha256()))
    };
    let shards = manifest.shards.par_iter().map(shard).collect::<Result<Vec<_>, DatasetError>>()?;
    let hashes: Vec<_> = shards.iter().map(|s| s.1).collect();
    let prepared = joined(shards);
    manifest.holds(folder, hashes, prepared.windows.trajectories(), prepared.windows.frames)?;
    Ok(prepared)
}

fn joined(shards: Vec<(Windows, [u8; 32])>) -> Prepared {
    let sha256 = sha256_of(shards.iter().map(|s| s.1));
    let mut shards = shards.into_iter().map(|s| s.0);
    let mut windows = shards.next().unwrap_or_default();
    for shard in shards {
        windows.x.extend_from_slice(&shard.x);
        windows.y.extend_from_slice(&shard.y);
    }
    Prepared { windows, sha256 }
}

/// Moments of training windows; apply them with [`normalize`].
pub fn moments(windows: &Windows) -> Normalizer {
    let of = |rows: &[f32], width| Moments::of(rows, width, windows.frames, windows.history);
    Normalizer { inputs: of(&windows.x, windows.inputs), outputs: of(&windows.y, windows.outputs) }
}

/// Normalises windows in place.
pub fn normalize(windows: &mut Windows, normalizer: &Normalizer) {
    let rows = |x: &mut Vec<f32>, width: usize, moments: &Moments| x.par_chunks_mut(width * 4096).for_each(|rows| moments.normalize(rows));
    rows(&mut windows.x, windows.inputs, &normalizer.inputs);
    rows(&mut windows.y, windows.outputs, &normalizer.outputs);
}
