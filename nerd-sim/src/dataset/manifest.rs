//! The manifest of a folder of shards.

use super::shard::{DatasetError, check_format, read_shard, sha256_of};
use super::{begin::begin, config::GenerateConfig};
use crate::{files::read_text, internal::*, trajectories::Trajectories};

/// `manifest.json` of a folder of shards.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// Version of the shards' format: [`super::FORMAT`].
    #[serde(default)]
    pub format: Option<u32>,
    /// Name of the robot.
    pub robot: String,
    /// [`System::robot_sha256`] of the recorded system.
    #[serde(default)]
    pub robot_sha256: String,
    /// [`System::sha256`] of the recorded system.
    #[serde(default)]
    pub system_sha256: String,
    /// Name of the truth.
    #[serde(default)]
    pub truth: String,
    /// Number of trajectories.
    pub trajectories: usize,
    /// Frames per trajectory.
    pub frames: usize,
    /// Seed.
    pub seed: u64,
    /// Shard files, in order.
    pub shards: Vec<String>,
    /// Hash of all shards ([`super::sha256_of`]).
    pub sha256: String,
}

impl Manifest {
    pub(super) fn path(folder: &Path) -> PathBuf {
        folder.join("manifest.json")
    }

    /// Reads a folder's manifest.
    pub fn read(folder: &Path) -> Result<Self, FileError> {
        let path = Self::path(folder);
        let text = read_text(&path).map_err(|e| FileError::new(&path, e))?;
        let manifest: Self = serde_json::from_str(&text).map_err(|e| FileError::new(&path, e))?;
        check_format(manifest.format).map_err(|e| FileError::new(&path, e))?;
        if let Some(name) =
            manifest.shards.iter().find(|name| Path::new(name).file_name().is_none_or(|file| file != name.as_str()))
        {
            return Err(FileError::new(&path, format!("shard `{name}` does not name a file in this folder")));
        }
        Ok(manifest)
    }

    /// Refuses data of another system or truth; the error names the difference.
    pub fn check(&self, folder: &Path, system: &System, truth: &str) -> Result<(), FileError> {
        let found = same(system, truth, [&self.robot, &self.robot_sha256, &self.system_sha256, &self.truth]);
        found.map_err(|reason| FileError::new(&Self::path(folder), reason))
    }

    /// Reads the shard `name`, after checking that the shard is of `system` and of the manifest's truth.
    pub fn shard(&self, folder: &Path, name: &str, system: &System) -> Result<Trajectories, FileError> {
        self.checked(&folder.join(name), system).map(|(recording, _)| recording)
    }

    fn checked(&self, path: &Path, system: &System) -> Result<(Trajectories, BTreeMap<String, String>), FileError> {
        let (recording, header) = read_shard(path)?;
        let found = ["robot", "robot_sha256", "system_sha256", "truth"]
            .map(|key| header.get(key).map_or("unknown", String::as_str));
        let checked = same(system, &self.truth, found).and_then(|()| recording.check(system));
        checked.map(|()| (recording, header)).map_err(|reason| FileError::new(path, reason))
    }

    /// Reads a shard as [`Manifest::shard`] does, with the scene of each trajectory. Shards do not store scenes, so the
    /// scenes are drawn again from the seed.
    ///
    /// # Errors
    /// Under the conditions of [`Manifest::shard`], and if the redrawn starts differ from the recorded starts.
    pub fn shard_in_scenes(
        &self,
        folder: &Path,
        name: &str,
        system: &Arc<System>,
    ) -> Result<Trajectories, DatasetError> {
        let path = folder.join(name);
        let (mut recording, header) = self.checked(&path, system)?;
        let number = |key: &str| {
            let text = header.get(key).map_or("", String::as_str);
            text.parse::<f64>()
                .map_err(|_| FileError::new(&path, format!("`{key}` of its header is `{text}`, a number is needed")))
        };
        let (n, frames, seed) = (recording.count, recording.frames, self.seed);
        let config = GenerateConfig {
            transitions: n * frames,
            frames,
            seed,
            resets: number("resets")?,
            ..GenerateConfig::default()
        };
        let begun = begin(system, &config, number("first")? as u64, n)?;
        if let Some(k) = (0..n).find(|k| recording.state(*k, 0) != begun.state(*k)) {
            let text =
                "its scenes cannot be drawn again from its seed: policies acted in it, or another program made it";
            return Err(FileError::new(&path, format!("trajectory {k}: {text}; record the data set again")).into());
        }
        (recording.scenes, recording.systems) = (begun.scenes, begun.systems);
        Ok(recording)
    }

    /// Refuses shards with hashes (in order) or lengths that differ from the manifest's.
    pub fn holds(
        &self,
        folder: &Path,
        shards: impl IntoIterator<Item = [u8; 32]>,
        trajectories: usize,
        frames: usize,
    ) -> Result<(), FileError> {
        let (t, f) = (self.trajectories, self.frames);
        let wrong = if sha256_of(shards) != self.sha256 {
            "the shards are not those it was written for (SHA-256 differs)".into()
        } else if (t, f) != (trajectories, frames) {
            format!("says {t} trajectories of {f} frames, its shards hold {trajectories} of {frames}")
        } else {
            return Ok(());
        };
        Err(FileError::new(&Self::path(folder), format!("{wrong}; record the data set again")))
    }
}

/// Entries of a shard's header that identify system and truth.
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

/// Refuses data of another system or truth: compares hash of the robot, hash of the system, and truth.
fn same(system: &System, wanted_truth: &str, [name, robot, all, truth]: [&str; 4]) -> Result<(), String> {
    let (wanted_robot, wanted) = (system.robot_sha256(), system.sha256());
    if robot != wanted_robot {
        let what = if name == system.name {
            "its masses, joints, contact points, frame, gravity or material differ"
        } else {
            "another robot"
        };
        return Err(format!(
            "holds robot `{name}` ({robot}), not `{}` ({wanted_robot}): {what}; record the data set again",
            system.name
        ));
    }
    if all != wanted {
        return Err(format!(
            "holds data of `{name}` sampled, driven or controlled otherwise, or in other scenes (system {all}, not {wanted}); record the data set again"
        ));
    }
    if truth == wanted_truth {
        Ok(())
    } else {
        Err(format!("holds transitions of truth `{truth}`, not `{wanted_truth}`"))
    }
}
