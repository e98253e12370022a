//! Rolls out starts and torques from a CSV table under any solver, and writes the states to another table.
//!
//! A table has a header and one row per trajectory and step. Columns are found by name; other columns are ignored:
//!
//! * `traj` and `step`: numbers of the trajectory and of the step.
//! * The state, named by `state_columns` (rad, m, rad/s, m/s). It is read at step 0 only.
//! * All torques, named by `torque_columns` (N m or N), or none. A row's torques are constant until the next step.
//!
//! ```no_run
//! use nerd_sim::{prelude::*, rollout::States};
//! let system = System::named("pendulum")?;
//! let states = States::read("starts.csv".as_ref(), &system)?;
//! let mut solver = Articulated::new(ArticulatedConfig::accurate(&system));
//! let table = states.roll(&system, &system.scene("ground3")?, &mut solver, 100, &mut |_| ())?;
//! std::fs::write("out.csv", table)?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use crate::internal::*;
use crate::table::{Place, Table, twice};

/// Largest step number: 4.6 hours at 1/60 s.
pub const FRAMES: usize = 1_000_000;

/// Errors of reading, computing or writing a rollout.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RolloutError {
    /// The table cannot be read, or lacks torques for a frame.
    #[error(transparent)]
    Table(#[from] FileError),
    /// An error of the solver.
    #[error(transparent)]
    Step(#[from] StepError),
    /// The rows cannot be written.
    #[error("cannot write the table: {0}")]
    Write(#[from] csv::Error),
}

/// Starts and torques that were read from a table.
#[derive(Clone, Debug)]
pub struct States {
    /// Path of the table.
    pub path: PathBuf,
    /// Trajectories by their number in the column `traj`.
    pub trajectories: BTreeMap<u64, Trajectory>,
    /// Whether the table has columns of torques.
    pub driven: bool,
}

/// One trajectory: start, and torques by step.
#[derive(Clone, Debug, Default)]
pub struct Trajectory {
    /// State `[q, qd]` of step 0.
    pub start: Vec<f64>,
    /// By step: place of its row in the file, and the row's joint torques (N m or N), if it has any. The last row of a
    /// trajectory needs none.
    steps: BTreeMap<usize, (Place, Option<Vec<f64>>)>,
}

impl Trajectory {
    /// Joint torques (N m or N), constant from `step` to the next; `None` if the table has none there.
    pub fn torques(&self, step: usize) -> Option<&[f64]> {
        self.steps.get(&step)?.1.as_deref()
    }
}

impl States {
    /// Reads a table for `system`.
    pub fn read(path: &Path, system: &System) -> Result<Self, FileError> {
        let mut table = Table::open(path)?;
        let columns = Columns::find(&table, system)?;
        let mut trajectories: BTreeMap<u64, Trajectory> = BTreeMap::new();
        table.rows(|row| {
            let id = row.whole(columns.traj, u64::MAX)?;
            let step = row.whole(columns.step, FRAMES as u64)? as usize;
            let trajectory = trajectories.entry(id).or_default();
            if let Some((first, _)) = trajectory.steps.get(&step) {
                return Err(row.wrong(&format!(": trajectory {id} has step {step} already on {first}")));
            }
            if step == 0 {
                trajectory.start = row.numbers(&columns.states)?;
                if system.robot.floating() {
                    row.unit(&columns.states[3..7], &trajectory.start[3..7])?;
                }
            }
            let has_torques = columns.torques.iter().any(|&c| !row.empty(c));
            let torques = has_torques.then(|| row.numbers(&columns.torques)).transpose()?;
            trajectory.steps.insert(step, (row.place, torques));
            Ok(())
        })?;
        if trajectories.is_empty() {
            return Err(table.wrong("no rows under the header".into()));
        }
        if let Some((id, _)) = trajectories.iter().find(|(_, t)| !t.steps.contains_key(&0)) {
            return Err(table.wrong(format!("trajectory {id} has no row of step 0, its start")));
        }
        Ok(Self { path: path.into(), trajectories, driven: !columns.torques.is_empty() })
    }

    /// Largest step in the table.
    pub fn frames(&self) -> usize {
        self.trajectories.values().filter_map(|t| t.steps.last_key_value()).map(|(step, _)| *step).max().unwrap_or(0)
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.trajectories.values().map(|t| t.steps.len()).sum()
    }

    /// Refuses a table with columns of torques if a trajectory lacks torques at a step before `frames`.
    pub fn check(&self, frames: usize) -> Result<(), FileError> {
        for (trajectory, t) in self.trajectories.iter().filter(|_| self.driven) {
            if let Some(step) = (0..frames).find(|step| t.torques(*step).is_none()) {
                let text = format!(
                    "trajectory {trajectory} has no torques at step {step}; a rollout of {frames} frames needs them"
                );
                return Err(FileError::new(&self.path, text));
            }
        }
        Ok(())
    }

    /// Rolls out all trajectories in `scene`, one environment per trajectory, in order of their numbers. Returns the
    /// table of states: `traj`, `step` and the state, for the steps 0 to `frames`, with all digits of an f64. Calls
    /// `progress` with the number of frames done.
    pub fn roll(
        &self,
        system: &Arc<System>,
        scene: &Arc<Scene>,
        solver: &mut dyn Solver,
        frames: usize,
        progress: &mut dyn FnMut(usize),
    ) -> Result<Vec<u8>, RolloutError> {
        self.check(frames)?;
        let (n, joints) = (self.trajectories.len(), system.robot.joint_count());
        let mut batch = Batch::new(system, scene, n);
        self.trajectories.values().enumerate().for_each(|(env, t)| batch.reset(env, &t.start));
        let mut table = csv::Writer::from_writer(Vec::new());
        table.write_record(header(system))?;
        let mut write = |step: usize, batch: &Batch| {
            self.trajectories.keys().enumerate().try_for_each(|(env, id)| {
                let state = batch.state(env).iter().map(f64::to_string);
                table.write_record([id.to_string(), step.to_string()].into_iter().chain(state))
            })
        };
        write(0, &batch)?;
        let mut torques = vec![0.0; n * joints];
        for step in 0..frames {
            for (t, torques) in self.trajectories.values().zip(torques.chunks_exact_mut(joints.max(1))) {
                if let Some(given) = t.torques(step) {
                    torques.copy_from_slice(given);
                }
            }
            solver.step(&mut batch, &torques)?;
            write(step + 1, &batch)?;
            progress(step + 1);
        }
        table.into_inner().map_err(|e| RolloutError::Write(e.into_error().into()))
    }
}

/// Columns of a table of states.
fn header(system: &System) -> Vec<&str> {
    ["traj", "step"].into_iter().chain(system.spec.state_columns.iter().map(String::as_str)).collect()
}

/// Whether `table` has the form that [`States::roll`] writes for `system`: same header, all cells present, numbers in
/// the same format, consecutive steps.
pub fn written(table: &[u8], system: &System) -> bool {
    let mut reader = csv::Reader::from_reader(table);
    let same_header = reader.headers().is_ok_and(|found| *found == header(system));
    let mut last = 0;
    let same_form = |row: Result<csv::StringRecord, csv::Error>| {
        let Ok(row) = row else { return false };
        let step =
            row.get(1).and_then(|step| step.parse::<usize>().ok()).filter(|step| *step == last || *step == last + 1);
        last = step.unwrap_or(last);
        step.is_some() && row.iter().skip(2).all(|cell| cell.parse::<f64>().is_ok_and(|x| x.to_string() == cell))
    };
    same_header && reader.records().all(same_form) && last > 0
}

/// Indices of columns in a table of starts and torques; `torques` is empty without columns of torques.
struct Columns {
    traj: usize,
    step: usize,
    states: Vec<usize>,
    torques: Vec<usize>,
}

impl Columns {
    fn find(table: &Table, system: &System) -> Result<Self, FileError> {
        let (states, torques) = (&system.spec.state_columns, &system.spec.torque_columns);
        let names: Vec<&str> = table.names.iter().map(String::as_str).collect();
        if let Some(name) = twice(names.iter().copied().filter(|name| !name.is_empty())) {
            return Err(table.wrong(format!("line 1: column `{name}` appears twice")));
        }
        let index = |name: &str| {
            names.iter().position(|found| *found == name).ok_or_else(|| {
                let [names, states, torques] = [names.join(", "), states.join(", "), torques.join(", ")];
                table.wrong(format!(
                    "line 1: no column `{name}`; there are {names}; \
                     needed are traj, step, {states} and, for torques, {torques}"
                ))
            })
        };
        // A column of torques, by its full name or misspelled.
        let means_torque = |name: &&str| {
            torques.iter().any(|t| t == *name) || name.starts_with("tau") && !states.iter().any(|s| s == *name)
        };
        // One column of torques requires all, or a misspelled one would be ignored silently.
        let driven = names.iter().any(means_torque);
        Ok(Self {
            traj: index("traj")?,
            step: index("step")?,
            states: states.iter().map(|name| index(name)).collect::<Result<_, _>>()?,
            torques: if driven {
                torques.iter().map(|name| index(name)).collect::<Result<_, _>>()?
            } else {
                Vec::new()
            },
        })
    }
}
