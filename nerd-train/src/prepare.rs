//! Turns recorded trajectories into normalised windows.

use nerd_sim::dataset::{Manifest, record, sha256_of};

use crate::prelude::*;

/// Function that makes the solver of one thread.
pub type MakeSolver<'a> = dyn Fn() -> Box<dyn Solver> + Sync + 'a;

/// Tokens and targets of every frame of a recording, not normalised. Tokens come from sensor readings, targets from the
/// true motion.
pub fn tokens(system: &Arc<System>, recording: &Trajectories, history: usize, form: impl Into<Form>) -> Windows {
    let form = form.into();
    let inputs = Features::inputs(system, form);
    let d = system.robot.state_dim();
    let f = recording.frames;
    let mut x = vec![0.0; recording.count * f * inputs];
    let mut y = vec![0.0; recording.count * f * d];
    let rows = x.par_chunks_mut(f * inputs).zip(y.par_chunks_mut(f * d)).enumerate();
    rows.for_each_init(
        || Features::new(system, form),
        |features, (trajectory, (x, y))| {
            let width = recording.drawn.len() / recording.count;
            features.tell(&recording.drawn[trajectory * width..][..width]);
            let gravity = vector(&recording.gravity[3 * trajectory..]);
            for frame in 0..f {
                let (x, y) = (&mut x[frame * inputs..][..inputs], &mut y[frame * d..][..d]);
                let events = events(system, recording, trajectory * f + frame);
                let torques = recording.torques(trajectory, frame);
                features.token(recording.seen(trajectory, frame), &events, torques, &gravity, x);
                features.target(recording.state(trajectory, frame), recording.state(trajectory, frame + 1), y);
            }
        },
    );
    Windows { inputs, outputs: d, frames: f, history, x, y }
}

/// Contact events at the start of a frame.
fn events(system: &System, recording: &Trajectories, row: usize) -> Vec<ContactEvent> {
    let points = system.robot.contact_points.len();
    let event = |i: usize| {
        let (p1, normal) = (vector(&recording.points[3 * i..]), vector(&recording.normals[3 * i..]));
        let distance = recording.depths[i];
        // The point on the robot, `p0`, follows from the other numbers and is not a network input.
        ContactEvent {
            p0: p1 + if distance.is_finite() { normal * distance } else { normal },
            p1,
            normal,
            distance,
            collider: 0,
        }
    };
    (row * points..(row + 1) * points).map(event).collect()
}

/// A data set before normalisation, with the hash of its recordings.
pub struct Prepared {
    /// Tokens and targets, not normalised.
    pub windows: Windows,
    /// SHA-256 of the recordings ([`sha256_of`]).
    pub sha256: String,
}

/// Records the trajectories of `config` in memory and turns them into tokens. `solver` makes the truth; `progress` gets
/// the number of transitions of each finished shard. The same config gives the same bytes as
/// [`nerd_sim::dataset::generate`].
///
/// # Errors
/// If the truth cannot step.
pub fn generate(
    system: &Arc<System>,
    solver: &MakeSolver,
    config: &GenerateConfig,
    form: (usize, Form),
    progress: &(dyn Fn(usize) + Sync),
) -> Result<Prepared> {
    let shards = recorded(system, config, progress, |first, count| shard(system, solver, config, first, count, form))?;
    let (windows, hashes): (Vec<_>, Vec<_>) = shards.into_iter().unzip();
    Ok(Prepared { windows: joined(windows), sha256: sha256_of(hashes) })
}

/// Calls `make` with the first trajectory and the number of trajectories of every shard, in parallel. Results are in
/// shard order.
pub(crate) fn recorded<T: Send>(
    system: &System,
    config: &GenerateConfig,
    progress: &(dyn Fn(usize) + Sync),
    make: impl Fn(u64, usize) -> Result<T, DatasetError> + Sync,
) -> Result<Vec<T>, DatasetError> {
    config.check(system)?;
    let starts = (0..config.trajectories()).step_by(config.shard_trajectories);
    let starts = starts.collect_vec();
    let shard = |&first: &usize| {
        let count = config.shard_trajectories.min(config.trajectories() - first);
        let done = make(first as u64, count)?;
        progress(count * config.frames);
        Ok(done)
    };
    starts.par_iter().map(shard).collect()
}

/// Tokens and targets of trajectories `first .. first + count`, and the hash of their recording.
pub(crate) fn shard(
    system: &Arc<System>,
    solver: &MakeSolver,
    config: &GenerateConfig,
    first: u64,
    count: usize,
    (history, form): (usize, Form),
) -> Result<(Windows, [u8; 32]), DatasetError> {
    let recording = record(system, &mut *solver(), config, first, count)?;
    Ok((tokens(system, &recording, history, form), recording.sha256()))
}

/// Reads a data folder that [`nerd_sim::dataset::generate`] wrote. The data must be of the truth named `truth`.
pub fn read(
    system: &Arc<System>,
    truth: &str,
    folder: &Path,
    history: usize,
    form: impl Into<Form>,
) -> Result<Prepared, DatasetError> {
    let form = form.into();
    let (shards, sha256) = opened(system, truth, folder, |manifest, name| {
        let shard = manifest.shard(folder, name, system)?;
        Ok((shard.sha256(), [shard.count, shard.frames], tokens(system, &shard, history, form)))
    })?;
    Ok(Prepared { windows: joined(shards), sha256 })
}

/// A shard's hash, its numbers of trajectories and frames, and what was made of it.
type Opened<T> = ([u8; 32], [usize; 2], T);

/// The results of `read` for each shard of a data folder, in order, and the hash of the folder's manifest. Shards are
/// read in parallel.
pub(crate) fn opened<T: Send>(
    system: &System,
    truth: &str,
    folder: &Path,
    read: impl Fn(&Manifest, &str) -> Result<Opened<T>, DatasetError> + Sync,
) -> Result<(Vec<T>, String), DatasetError> {
    let manifest = Manifest::read(folder)?;
    manifest.check(folder, system, truth)?;
    let shards: Vec<_> = manifest.shards.par_iter().map(|name| read(&manifest, name)).collect::<Result<_, _>>()?;
    let count = shards.iter().map(|(_, [count, _], _)| count).sum();
    let frames = shards.iter().map(|(_, [_, frames], _)| *frames).find(|frames| *frames != manifest.frames);
    let frames = frames.unwrap_or(manifest.frames);
    manifest.holds(folder, shards.iter().map(|(hash, ..)| *hash), count, frames)?;
    Ok((shards.into_iter().map(|(.., made)| made).collect(), manifest.sha256))
}

fn joined(shards: Vec<Windows>) -> Windows {
    let mut shards = shards.into_iter();
    let mut windows = shards.next().unwrap_or_default();
    for shard in shards {
        windows.x.extend_from_slice(&shard.x);
        windows.y.extend_from_slice(&shard.y);
    }
    windows
}

/// Moments of training windows; apply them with [`normalize`].
pub fn moments(windows: &Windows) -> Normalizer {
    let of = |rows: &[f32], width| Moments::of(rows, width, windows.frames, windows.history);
    Normalizer { inputs: of(&windows.x, windows.inputs), outputs: of(&windows.y, windows.outputs) }
}

/// Normalises windows in place.
pub fn normalize(windows: &mut Windows, normalizer: &Normalizer) {
    let rows = |x: &mut Vec<f32>, width: usize, moments: &Moments| {
        x.par_chunks_mut(width * 4096).for_each(|rows| moments.normalize(rows))
    };
    rows(&mut windows.x, windows.inputs, &normalizer.inputs);
    rows(&mut windows.y, windows.outputs, &normalizer.outputs);
}
