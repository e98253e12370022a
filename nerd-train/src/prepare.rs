//! Turns recorded trajectories into normalised windows.

use nerd_sim::dataset::{Manifest, record, sha256_of};

use crate::prelude::*;

/// Function that makes the solver of one thread.
pub type MakeSolver<'a> = dyn Fn() -> Box<dyn Solver> + Sync + 'a;

/// Tokens and targets of every frame of a recording, not normalised. Tokens come from sensor readings, targets from the
/// true motion.
pub fn tokens(system: &Arc<System>, recording: &Recording, history: usize, form: impl Into<Form>) -> Windows {
    let form = form.into();
    let inputs = Features::inputs(system, form);
    let d = system.robot.state_dim();
    let joints = system.robot.joint_count();
    let f = recording.frames;
    let mut x = vec![0.0; recording.trajectories * f * inputs];
    let mut y = vec![0.0; recording.trajectories * f * d];
    let rows = x.par_chunks_mut(f * inputs).zip(y.par_chunks_mut(f * d)).enumerate();
    rows.for_each_init(
        || Features::new(system, form),
        |features, (trajectory, (x, y))| {
            let states = &recording.states[trajectory * (f + 1) * d..][..(f + 1) * d];
            let torques = &recording.torques[trajectory * f * joints..][..f * joints];
            let shown = recording.shown.get(trajectory * f * d..).filter(|shown| !shown.is_empty()).unwrap_or(states);
            let width = recording.drawn.len() / recording.trajectories;
            features.tell(&recording.drawn[trajectory * width..][..width]);
            let gravity = vector(&recording.gravity[3 * trajectory..]);
            for frame in 0..f {
                let (x, y) = (&mut x[frame * inputs..][..inputs], &mut y[frame * d..][..d]);
                let state = &states[frame * d..][..d];
                let next = &states[(frame + 1) * d..][..d];
                let events = events(system, recording, trajectory * f + frame);
                let torques = &torques[frame * joints..][..joints];
                features.token(&shown[frame * d..][..d], &events, torques, &gravity, x);
                features.target(state, next, y);
            }
        },
    );
    Windows { inputs, outputs: d, frames: f, history, x, y }
}

/// Contact events at the start of a frame.
fn events(system: &System, recording: &Recording, row: usize) -> Vec<ContactEvent> {
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
    Ok(joined(recorded(system, config, progress, |first, count| shard(system, solver, config, first, count, form))?))
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
    let (manifest, shards) = opened(system, truth, folder, |manifest, name| {
        let recording = manifest.shard(folder, name, system)?;
        Ok((tokens(system, &recording, history, form), recording.sha256()))
    })?;
    let hashes = shards.iter().map(|s| s.1).collect_vec();
    let prepared = joined(shards);
    manifest.holds(folder, hashes, prepared.windows.trajectories(), prepared.windows.frames)?;
    Ok(prepared)
}

/// The manifest of a data folder, and the result of `read` for each shard's name; shards are read in parallel.
pub(crate) fn opened<T: Send>(
    system: &System,
    truth: &str,
    folder: &Path,
    read: impl Fn(&Manifest, &str) -> Result<T, DatasetError> + Sync,
) -> Result<(Manifest, Vec<T>), DatasetError> {
    let manifest = Manifest::read(folder)?;
    manifest.check(folder, system, truth)?;
    let shards = manifest.shards.par_iter().map(|name| read(&manifest, name)).collect::<Result<_, _>>()?;
    Ok((manifest, shards))
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
    let rows = |x: &mut Vec<f32>, width: usize, moments: &Moments| {
        x.par_chunks_mut(width * 4096).for_each(|rows| moments.normalize(rows))
    };
    rows(&mut windows.x, windows.inputs, &normalizer.inputs);
    rows(&mut windows.y, windows.outputs, &normalizer.outputs);
}
