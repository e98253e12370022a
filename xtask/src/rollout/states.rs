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
pub struct Trajectory {
    /// State of step 0.
    pub start: Vec<f64>,
    /// Joint torques of a step, held to the next; the last row of a trajectory needs none.
    pub torques: BTreeMap<usize, Vec<f64>>,
    /// Its last step.
    pub last: usize,
}

impl States {
    /// Frames that the file has.
    pub fn frames(&self) -> usize {
        self.trajectories.values().map(|t| t.last).max().unwrap_or(0)
    }

    /// Says which torques are missing of `steps` frames, if any are.
    pub fn check(&self, steps: usize) -> Result<()> {
        for (id, t) in self.trajectories.iter().filter(|_| self.driven) {
            if let Some(step) = (0..steps).find(|step| !t.torques.contains_key(step)) {
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
    // Rows by trajectory and step, with their lines.
    let mut lines: BTreeMap<(u64, usize), u64> = BTreeMap::new();
    let (mut starts, mut torques): (BTreeMap<u64, Vec<f64>>, BTreeMap<u64, BTreeMap<usize, Vec<f64>>>) = Default::default();
    for record in reader.records() {
        let record = record?;
        let row = Row { line: record.position().map_or(0, |p| p.line()), header: &header, record: &record };
        let (id, step) = (row.whole(columns.traj, u64::MAX)?, row.whole(columns.step, *FRAMES.end())? as usize);
        if let Some(first) = lines.insert((id, step), row.line) {
            bail!("line {}: trajectory {id} has step {step} already on line {first}", row.line);
        }
        if step == 0 {
            let start = row.numbers(&columns.states)?;
            if system.robot.floating() {
                row.unit(&columns.states[3..7], &start[3..7])?;
            }
            starts.insert(id, start);
        }
        if columns.torques.iter().any(|&c| !row.cell(c).is_empty()) {
            torques.entry(id).or_default().insert(step, row.numbers(&columns.torques)?);
        }
    }
    let mut last: BTreeMap<u64, usize> = BTreeMap::new();
    lines.keys().for_each(|(id, step)| {
        // Ascending, so the last one seen is the largest.
        last.insert(*id, *step);
    });
    if last.is_empty() {
        bail!("no rows under the header");
    }
    let trajectory = |(id, last): (u64, usize)| {
        let start = starts.remove(&id).with_context(|| format!("trajectory {id} has no row of step 0, its start"))?;
        Ok((id, Trajectory { start, torques: torques.remove(&id).unwrap_or_default(), last }))
    };
    Ok(States { trajectories: last.into_iter().map(trajectory).collect::<Result<_>>()?, driven: !columns.torques.is_empty() })
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
