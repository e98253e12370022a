//! Training data: trajectories with their scenes, without contacts.

use nerd_sim::dataset::{record, sha256_of};

use super::*;
use crate::prepare::{MakeSolver, opened, recorded};

/// Number of motions that are hashed together.
const HASHED: usize = 16;

/// Reads motions from a folder that [`nerd_sim::dataset::generate`] wrote with the truth `truth`.
pub fn read(system: &Arc<System>, truth: &str, folder: &Path) -> Result<Trajectories, DatasetError> {
    let (shards, _) = opened(system, truth, folder, |manifest, name| {
        let shard = manifest.shard_in_scenes(folder, name, system)?;
        Ok((shard.sha256(), [shard.count, shard.frames], shard.bare()))
    })?;
    Ok(Trajectories::joined(shards))
}

/// Records motions, shards in parallel. `solver` makes the truth; `progress` receives the transitions done.
pub fn motions(
    system: &Arc<System>,
    solver: &MakeSolver,
    config: &GenerateConfig,
    progress: &(dyn Fn(usize) + Sync),
) -> Result<Trajectories, DatasetError> {
    let shard = |first, count| Ok(record(system, &mut *solver(), config, first, count)?.bare());
    Ok(Trajectories::joined(recorded(system, config, progress, shard)?))
}

/// SHA-256 of states and torques, equal for any shards.
pub fn sha256(motions: &Trajectories) -> String {
    let part = |numbers: &[f64]| -> [u8; 32] {
        let mut hash = Sha256::new();
        numbers.iter().for_each(|x| hash.update(x.to_le_bytes()));
        hash.finalize().into()
    };
    let parts = |numbers: &[f64]| {
        numbers.par_chunks((numbers.len() / motions.count.max(1)).max(1) * HASHED).map(part).collect::<Vec<_>>()
    };
    sha256_of(parts(&motions.states).into_iter().chain(parts(&motions.torques)))
}
