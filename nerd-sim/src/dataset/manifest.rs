//! The manifest of a folder of shards.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::shard::{check_format, read_shard};
use super::{DatasetError, GenerateConfig, Recording, begin, sha256_of};
use crate::scene::Scene;
use crate::system::System;

/// `manifest.json` of a folder of shards.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// [`super::FORMAT`] of the shards.
    #[serde(default)]
    pub format: Option<u32>,
    /// Robot.
    pub robot: String,
    /// [`System::robot_sha256`] of what was recorded.
    #[serde(default)]
    pub robot_sha256: String,
    /// [`System::sha256`] of what was recorded.
    #[serde(default)]
    pub system_sha256: String,
    /// Name of the truth.
    #[serde(default)]
    pub truth: String,
    /// Trajectories.
    pub trajectories: usize,
    /// Frames of each.
    pub frames: usize,
    /// Seed.
    pub seed: u64,
    /// Shard files, in order.
    pub shards: Vec<String>,
    /// Hash of all shards ([`super::sha256_of`]).
    pub sha256: String,
}

impl Manifest {
    /// Reads that of a folder.
    ///
    /// # Errors
    /// If there is none, or it is not of this form.
    pub fn read(folder: &Path) -> Result<Self, DatasetError> {
        let path = folder.join("manifest.json");
        let text = crate::files::read_text(&path).map_err(|source| DatasetError::File { path: path.clone(), source })?;
        let wrong = |reason: String| DatasetError::Format { path: path.clone(), reason };
        let manifest: Self = serde_json::from_str(&text).map_err(|e| wrong(e.to_string()))?;
        check_format(manifest.format).map_err(wrong)?;
        if let Some(name) = manifest.shards.iter().find(|name| Path::new(name).file_name().is_none_or(|file| file != name.as_str())) {
            return Err(wrong(format!("shard `{name}` does not name a file in this folder")));
        }
        Ok(manifest)
    }

    /// Refuses data of another system or truth, and says in what they differ.
    ///
    /// # Errors
    /// If the data are of another system or truth.
    pub fn check(&self, system: &System, truth: &str) -> Result<(), String> {
        same_system(system, &self.robot, &self.robot_sha256, &self.system_sha256)?;
        same_truth(truth, &self.truth)
    }
}

impl Manifest {
    /// Reads one of its shards, if that is of `system` and of its truth.
    ///
    /// # Errors
    /// If it cannot be read, or in what it differs.
    pub fn shard(&self, folder: &Path, name: &str, system: &System) -> Result<Recording, DatasetError> {
        let path = folder.join(name);
        let (recording, header) = read_shard(&path)?;
        let checked = check_header(&header, system, &self.truth).and_then(|()| recording.check(system));
        checked.map(|()| recording).map_err(|reason| DatasetError::Format { path, reason })
    }

    /// The same with the scene of each trajectory: a shard does not hold them, its seed draws them again.
    ///
    /// # Errors
    /// As [`Manifest::shard`], and if what is drawn is not what was recorded.
    pub fn shard_in_scenes(&self, folder: &Path, name: &str, system: &Arc<System>) -> Result<(Recording, Vec<Arc<Scene>>), DatasetError> {
        let recording = self.shard(folder, name, system)?;
        let (path, (_, header)) = (folder.join(name), read_shard(&folder.join(name))?);
        let wrong = |reason: String| DatasetError::Format { path: path.clone(), reason };
        let number = |key: &str| {
            let text = header.get(key).map_or("", String::as_str);
            text.parse::<f64>().map_err(|_| wrong(format!("`{key}` of its header is `{text}`, a number is needed")))
        };
        let (n, frames, seed) = (recording.trajectories, recording.frames, self.seed);
        let config = GenerateConfig { transitions: n * frames, frames, seed, resets: number("resets")?, ..GenerateConfig::default() };
        let begun = begin(system, &config, number("first")? as u64, n)?;
        let rows = recording.states.chunks_exact((frames + 1) * system.robot.state_dim());
        if let Some(k) = rows.enumerate().position(|(k, row)| !row.starts_with(begun.state(k))) {
            let text = "its scenes cannot be drawn again from its seed: policies acted in it, or another program made it";
            return Err(wrong(format!("trajectory {k}: {text}; record the data set again")));
        }
        Ok((recording, begun.scenes))
    }

    /// Refuses shards, by their hashes in order, that are others or of other lengths than it was written for.
    ///
    /// # Errors
    /// What it says and what there is.
    pub fn holds(
        &self,
        folder: &Path,
        shards: impl IntoIterator<Item = [u8; 32]>,
        trajectories: usize,
        frames: usize,
    ) -> Result<(), DatasetError> {
        let wrong = |reason: String| {
            Err(DatasetError::Format { path: folder.join("manifest.json"), reason: reason + "; record the data set again" })
        };
        let (t, f) = (self.trajectories, self.frames);
        if sha256_of(shards) != self.sha256 {
            return wrong("the shards are not those it was written for (SHA-256 differs)".into());
        }
        if (t, f) != (trajectories, frames) {
            return wrong(format!("says {t} trajectories of {f} frames, its shards hold {trajectories} of {frames}"));
        }
        Ok(())
    }
}

/// What a shard's header says of the system and the truth.
pub(super) fn header(system: &System, truth: &str) -> BTreeMap<String, String> {
    let own = [
        ("robot", system.name.clone()),
        ("robot_sha256", system.robot_sha256()),
        ("system_sha256", system.sha256()),
        ("truth", truth.into()),
    ];
    let drawn = crate::vary::columns(system);
    let drawn = (!drawn.is_empty()).then(|| ("drawn", serde_json::json!(drawn).to_string()));
    own.into_iter().chain(drawn).map(|(key, value)| (key.to_string(), value)).collect()
}

/// Refuses a shard whose header names another system or truth.
fn check_header(header: &BTreeMap<String, String>, system: &System, truth: &str) -> Result<(), String> {
    let of = |key: &str| header.get(key).map_or("unknown", String::as_str);
    same_system(system, of("robot"), of("robot_sha256"), of("system_sha256"))?;
    same_truth(truth, of("truth"))
}

fn same_system(system: &System, name: &str, robot: &str, all: &str) -> Result<(), String> {
    let (wanted_robot, wanted) = (system.robot_sha256(), system.sha256());
    if robot != wanted_robot {
        let what =
            if name == system.name { "its masses, joints, contact points, frame, gravity or material differ" } else { "another robot" };
        return Err(format!("holds robot `{name}` ({robot}), not `{}` ({wanted_robot}): {what}; record the data set again", system.name));
    }
    if all != wanted {
        return Err(format!(
            "holds data of `{name}` sampled, driven or controlled otherwise, or in other scenes (system {all}, not {wanted}); record the data set again"
        ));
    }
    Ok(())
}

fn same_truth(wanted: &str, found: &str) -> Result<(), String> {
    if found == wanted { Ok(()) } else { Err(format!("holds transitions of truth `{found}`, not `{wanted}`")) }
}
