//! Training data: recorded motions with their scenes.

use nerd_sim::dataset::{begin, record, sha256_of};

use super::*;
use crate::prepare::{MakeSolver, opened, recorded};

/// Number of motions that are hashed together.
const HASHED: usize = 16;

/// Motions of equal length, in f64.
#[derive(Clone, Default)]
pub struct Motions {
    /// Frames F of each motion.
    pub frames: usize,
    /// Scene of each motion.
    pub scenes: Vec<Arc<Scene>>,
    /// States `[motion][F + 1][q, qd]`.
    states: Vec<f64>,
    /// Torques `[motion][F][joint]` (N, N m).
    torques: Vec<f64>,
    /// SHA-256 of states and torques.
    pub sha256: String,
}

impl Motions {
    /// Reads motions from a folder that [`nerd_sim::dataset::generate`] wrote with the truth `truth`.
    pub fn read(system: &Arc<System>, truth: &str, folder: &Path) -> Result<Self, DatasetError> {
        let (manifest, shards) =
            opened(system, truth, folder, |manifest, name| manifest.shard_in_scenes(folder, name, system))?;
        let hashes: Vec<_> = shards.par_iter().map(|(recording, _)| recording.sha256()).collect();
        let motions = Self::joined(shards);
        manifest.holds(folder, hashes, motions.len(), motions.frames)?;
        Ok(motions)
    }

    /// Records motions, shards in parallel. `solver` makes the truth; `progress` receives the transitions done.
    pub fn record(
        system: &Arc<System>,
        solver: &MakeSolver,
        config: &GenerateConfig,
        progress: &(dyn Fn(usize) + Sync),
    ) -> Result<Self, DatasetError> {
        let shard = |first, count| {
            let recording = record(system, &mut *solver(), config, first, count)?;
            Ok((recording, begin(system, config, first, count)?.scenes))
        };
        Ok(Self::joined(recorded(system, config, progress, shard)?))
    }

    /// Motions of a recording in one scene.
    pub(crate) fn of(recording: Recording, scene: &Arc<Scene>) -> Self {
        let scenes = vec![scene.clone(); recording.trajectories];
        Self::joined(vec![(recording, scenes)])
    }

    fn joined(shards: Vec<(Recording, Vec<Arc<Scene>>)>) -> Self {
        let mut all = Self::default();
        for (recording, scenes) in shards {
            all.frames = recording.frames;
            all.states.extend(recording.states);
            all.torques.extend(recording.torques);
            all.scenes.extend(scenes);
        }
        // Hash a fixed number of motions at a time: the result must not depend on shards.
        let part = |numbers: &[f64]| -> [u8; 32] {
            let mut hash = Sha256::new();
            numbers.iter().for_each(|x| hash.update(x.to_le_bytes()));
            hash.finalize().into()
        };
        let parts = |numbers: &[f64]| {
            numbers.par_chunks((numbers.len() / all.len().max(1)).max(1) * HASHED).map(part).collect::<Vec<_>>()
        };
        all.sha256 = sha256_of(parts(&all.states).into_iter().chain(parts(&all.torques)));
        all
    }

    /// Number of motions.
    pub fn len(&self) -> usize {
        self.scenes.len()
    }

    /// Whether there are no motions.
    pub fn is_empty(&self) -> bool {
        self.scenes.is_empty()
    }

    /// All states `[motion][F + 1][q, qd]`.
    pub fn states(&self) -> &[f64] {
        &self.states
    }

    /// State `[q, qd]` before a frame, or after the last.
    pub fn state(&self, motion: usize, frame: usize) -> &[f64] {
        let d = self.states.len() / (self.len() * (self.frames + 1));
        &self.states[(motion * (self.frames + 1) + frame) * d..][..d]
    }

    /// Torques of all joints during a frame (N, N m).
    pub fn torques(&self, motion: usize, frame: usize) -> &[f64] {
        let joints = self.torques.len() / (self.len() * self.frames);
        &self.torques[(motion * self.frames + frame) * joints..][..joints]
    }
}
