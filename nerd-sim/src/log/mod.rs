//! Measured trajectories of any robot: a table (CSV, npz, safetensors), and a TOML that defines meaning, unit and frame
//! of its columns ([`LogSpec`]).
//!
//! A [`Log`] holds states in the form of the solvers, one per frame of the robot. The `notes` of a log list
//! conversions: velocities from differences, cuts at gaps, resampling, dropped copies. Impossible data causes an error,
//! or a note with the size of the deviation. Examples: velocities that contradict the poses, free fall that is not g.

mod check;
mod data;
mod read;
mod spec;
mod tidy;

#[cfg(feature = "calibrate")]
pub(crate) use tidy::turned;

use data::bad;
pub use data::{Log, LogError, Trajectory};
pub use read::{specified, tables};
pub use spec::{LogSpec, Published};

use crate::{internal::*, trajectories::Trajectories};

/// Maximum number of frames between two rows.
const MAX_FRAMES_BETWEEN_ROWS: f64 = 100.0;

impl Log {
    /// Reads the TOML that describes a table. `csv` is the table, by default the file named in the TOML. Errors name
    /// file, row and column.
    pub fn read(path: &Path, csv: Option<&Path>) -> Result<Self, LogError> {
        let (spec, system) = read::specified(path)?;
        let csv = csv.map_or_else(|| path.with_file_name(&spec.file), Path::to_path_buf);
        let scene_name =
            spec.scene.clone().unwrap_or_else(|| if system.scene("ground").is_ok() { "ground" } else { "free" }.into());
        let scene = system.scene(&scene_name)?;
        let (mut raw, mut notes) = (read::rows(&csv, &spec, &system)?, Vec::new());
        check::rates(&csv, &spec, &system, &raw, &mut notes)?;
        check::jumps(&spec, &system, &raw, &mut notes);
        let told = |name: &str| spec.joints.iter().any(|joint| joint.name == name && joint.torque.is_some());
        let driven = system
            .robot
            .joints()
            .zip(system.torque_amplitudes())
            .filter(|(joint, most)| *most > 0.0 && !told(&joint.name));
        let driven: Vec<String> = driven.map(|(joint, _)| format!("`{}`", joint.name)).collect();
        if !driven.is_empty() {
            notes.push(format!("no `torque` is named of {}, which the robot drives: taken as 0", driven.join(", ")));
        }
        tidy::copies(&system, &mut raw, &mut notes);
        let cut = tidy::cut(raw, &mut notes);
        if cut.is_empty() {
            return Err(bad(&csv, format!("no two rows follow each other: {}", notes.join("; "))));
        }
        let frame = system.frame_time;
        if let Some((place, step)) = cut
            .iter()
            .map(|r| (r.moments[0].place, tidy::step(&r.moments)))
            .find(|(_, step)| *step > MAX_FRAMES_BETWEEN_ROWS * frame)
        {
            let text = format!(
                "{place}: rows lie {step:.3e} s apart, a frame of the robot is {frame:.3e} s; is `units.time` right?"
            );
            return Err(bad(&csv, text));
        }
        let trajectories = tidy::states(&system, cut, &mut notes);
        let (folds, published) = (spec.folds.clone(), spec.published.clone());
        let (about, cost) = (spec.about.clone(), spec.cost);
        let mut log = Self { about, cost, scene: scene_name, system, trajectories, notes, folds, published };
        log.parted().map_err(|reason| bad(path, reason))?;
        check::falls(&csv, &mut log, &scene)?;
        Ok(log)
    }

    /// Pieces of `frames` frames, without contacts; each start is a trajectory and the piece's first frame in it.
    pub fn cut<'a>(
        &self,
        starts: impl IntoIterator<Item = (&'a Trajectory, usize)>,
        frames: usize,
    ) -> Result<Trajectories, LogError> {
        let scene = self.system.scene(&self.scene)?;
        let mut out = Trajectories { frames, ..Trajectories::default() };
        for (trajectory, first) in starts {
            out.count += 1;
            out.scenes.push(scene.clone());
            out.gravity.extend(scene.gravity.iter());
            out.states.extend(trajectory.states[first..=first + frames].iter().flatten());
            out.torques.extend(trajectory.torques[first..first + frames].iter().flatten());
        }
        Ok(out)
    }

    /// Cuts trajectories into pieces of `frames` frames. Neighbouring pieces share `shared` frames, so that every run
    /// of `shared + 1` frames is in one piece. The last piece ends with its trajectory and may repeat some runs.
    /// Shorter trajectories are left out.
    pub fn recording(
        &self,
        trajectories: &[Trajectory],
        frames: usize,
        shared: usize,
    ) -> Result<Trajectories, LogError> {
        let every = (frames - shared.min(frames - 1)).max(1);
        let starts = trajectories.iter().flat_map(|trajectory| {
            let last = trajectory.frames().checked_sub(frames);
            last.into_iter().flat_map(move |last| (0..last).step_by(every).chain([last])).map(move |k| (trajectory, k))
        });
        let mut out = self.cut(starts, frames)?;
        out.touch(&self.system);
        Ok(out)
    }
}
