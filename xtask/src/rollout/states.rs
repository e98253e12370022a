//! The CSV that `rollout` reads: starts, and torques if it has them. Columns are found by their whole names.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result, anyhow, bail};
use csv::StringRecord;
use nerd_sim::prelude::*;

use crate::numbers::{FRAMES, finite};

/// How far a quaternion's length may be from 1: digits are cut in files.
const UNIT: f64 = 1e-3;

/// What a file holds.
pub struct States {
    /// Trajectories by id.
    pub trajectories: BTreeMap<u64, Trajectory>,
    /// Whether it has torques.
    pub driven: bool,
}

/// One trajectory: its start, and its torques by step.
#[derive(Default)]
pub struct Trajectory {
    /// State of step 0.
    pub start: Vec<f64>,
    /// By step the line it stands on, and joint torques; the last row of a trajectory needs none.
    steps: BTreeMap<usize, (u64, Option<Vec<f64>>)>,
}

impl Trajectory {
    /// Torques held from a step to the next.
    pub fn torques(&self, step: usize) -> Option<&[f64]> {
        self.steps.get(&step)?.1.as_deref()
    }
}

impl States {
    /// Frames that the file has.
    pub fn frames(&self) -> usize {
        self.trajectories.values().filter_map(|t| t.steps.last_key_value()).map(|(step, _)| *step).max().unwrap_or(0)
    }

    /// Its rows.
    pub fn rows(&self) -> usize {
        self.trajectories.values().map(|t| t.steps.len()).sum()
    }

    /// Says which torques are missing of `steps` frames, if any are.
    pub fn check(&self, steps: usize) -> Result<()> {
        for (id, t) in self.trajectories.iter().filter(|_| self.driven) {
            if let Some(step) = (0..steps).find(|step| t.torques(*step).is_none()) {
                bail!("trajectory {id} has no torques at step {step}, {steps} steps were asked for");
            }
        }
        Ok(())
    }
}

/// Reads a file.
pub fn read(path: &Path, system: &System) -> Result<States> {
    let name = path.display().to_string();
    table(path, system).map_err(|e| anyhow!("{name}: {e:#}"))
}

fn table(path: &Path, system: &System) -> Result<States> {
    let mut reader = csv::Reader::from_path(path).context("cannot read it")?;
    let header = reader.headers()?.clone();
    let columns = Columns::find(&header, system)?;
    let mut trajectories: BTreeMap<u64, Trajectory> = BTreeMap::new();
    for record in reader.records() {
        let record = record?;
        let row = Row { line: record.position().map_or(0, |p| p.line()), header: &header, record: &record };
        let (id, step) = (row.whole(columns.traj, u64::MAX)?, row.whole(columns.step, *FRAMES.end())? as usize);
        let trajectory = trajectories.entry(id).or_default();
        if let Some((first, _)) = trajectory.steps.get(&step) {
            bail!("line {}: trajectory {id} has step {step} already on line {first}", row.line);
        }
        if step == 0 {
            trajectory.start = row.numbers(&columns.states)?;
            if system.robot.floating() {
                row.unit(&columns.states[3..7], &trajectory.start[3..7])?;
            }
        }
        let given = columns.torques.iter().any(|&c| !row.cell(c).is_empty());
        let torques = given.then(|| row.numbers(&columns.torques)).transpose()?;
        trajectory.steps.insert(step, (row.line, torques));
    }
    if trajectories.is_empty() {
        bail!("no rows under the header");
    }
    if let Some((id, _)) = trajectories.iter().find(|(_, t)| !t.steps.contains_key(&0)) {
        bail!("trajectory {id} has no row of step 0, its start");
    }
    Ok(States { trajectories, driven: !columns.torques.is_empty() })
}

/// Where the columns stand.
struct Columns {
    traj: usize,
    step: usize,
    states: Vec<usize>,
    torques: Vec<usize>,
}

impl Columns {
    fn find(header: &StringRecord, system: &System) -> Result<Self> {
        let (states, torques) = (&system.spec.state_columns, &system.spec.torque_columns);
        let wanted: Vec<&str> = ["traj", "step"].into_iter().chain(states.iter().chain(torques).map(String::as_str)).collect();
        if let Some(name) = twice(wanted.iter().copied()) {
            bail!("robot `{}` has two columns `{name}`: give its joints other names in tables, `column = ..` in its TOML", system.name);
        }
        let there: Vec<&str> = header.iter().map(str::trim).collect();
        if let Some(name) = twice(there.iter().copied().filter(|name| !name.is_empty())) {
            bail!("line 1: column `{name}` stands there twice");
        }
        let at = |name: &str| there.iter().position(|h| *h == name);
        let missing = |name: &str| {
            let (needed, driving) = (wanted[..2 + states.len()].join(", "), torques.join(", "));
            anyhow!("line 1: no column `{name}`; there are {}; needed are {needed} and, for torques, {driving}", there.join(", "))
        };
        let needed = |name: &str| at(name).ok_or_else(|| missing(name));
        let given = |name: &&&str| torques.iter().any(|t| t == **name) || name.starts_with("tau") && !states.iter().any(|s| s == **name);
        // Torques are all there, or none is: one that is called otherwise would be passed over.
        let driven = there.iter().any(|name| given(&name));
        Ok(Self {
            traj: needed("traj")?,
            step: needed("step")?,
            states: states.iter().map(|name| needed(name)).collect::<Result<_>>()?,
            torques: if driven { torques.iter().map(|name| needed(name)).collect::<Result<_>>()? } else { Vec::new() },
        })
    }
}

/// A name that comes a second time.
fn twice<'a>(names: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let mut seen = std::collections::BTreeSet::new();
    names.into_iter().find(|name| !seen.insert(*name))
}

/// A row that can say where it stands.
struct Row<'a> {
    line: u64,
    header: &'a StringRecord,
    record: &'a StringRecord,
}

impl Row<'_> {
    fn cell(&self, column: usize) -> &str {
        self.record.get(column).unwrap_or_default().trim()
    }

    fn wrong(&self, column: usize, what: &str) -> anyhow::Error {
        anyhow!("line {}, column `{}`: `{}` is no {what}", self.line, self.header[column].trim(), self.cell(column))
    }

    fn whole(&self, column: usize, most: u64) -> Result<u64> {
        let number = self.cell(column).parse().ok().filter(|n| *n <= most);
        number.ok_or_else(|| self.wrong(column, &format!("whole number from 0 to {most}")))
    }

    fn numbers(&self, columns: &[usize]) -> Result<Vec<f64>> {
        columns.iter().map(|&c| finite(self.cell(c)).map_err(|_| self.wrong(c, "finite number"))).collect()
    }

    fn unit(&self, columns: &[usize], quaternion: &[f64]) -> Result<()> {
        let length = quaternion.iter().map(|x| x * x).sum::<f64>().sqrt();
        if (length - 1.0).abs() <= UNIT {
            return Ok(());
        }
        let names: Vec<&str> = columns.iter().map(|&c| self.header[c].trim()).collect();
        bail!("line {}, columns {}: a quaternion of length {length:.6}, 1 is needed", self.line, names.join(", "));
    }
}
