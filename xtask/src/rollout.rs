//! `cargo xtask rollout --robot pendulum --scene ground3 --solver articulated --preset paper --friction coulomb
//! --states FILE.csv --steps 100 --out OUT.csv`: how anyone checks us.
//!
//! FILE has columns `traj`, `step`, the state's columns and, if any, torque columns `tau_*`; others are ignored. The
//! rows of step 0 are the starts, the torques of a row are held from its step to the next. OUT has `traj`, `step` and
//! the state's columns, in f64 with as many digits as it takes.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use nerd_sim::prelude::*;

use crate::solvers::{SolverArgs, build};

/// Roll a solver out from the states of a file.
#[derive(clap::Args, Clone, Debug)]
pub struct RolloutArgs {
    /// Robot: cartpole, pendulum, cube, franka, ant, anymal, anymal-paper, or the path of a .urdf
    #[arg(long)]
    pub robot: String,
    /// Scene: free, a scene of the robot (ground, or ground1 .. ground6 for the pendulum), plane, slope, box, steps, hills
    #[arg(long, default_value = "free")]
    pub scene: String,
    #[command(flatten)]
    pub solver: SolverArgs,
    /// CSV with starts and torques
    #[arg(long)]
    pub states: PathBuf,
    /// Frames to roll out [default: as many as the file has]
    #[arg(long)]
    pub steps: Option<usize>,
    /// CSV to write
    #[arg(long)]
    pub out: PathBuf,
}

/// One trajectory of the file: its start, and its torques by step.
#[derive(Default)]
struct Trajectory {
    start: Option<Vec<f64>>,
    torques: BTreeMap<usize, Vec<f64>>,
    last: usize,
}

/// Runs the verb.
pub fn run(args: RolloutArgs) -> Result<()> {
    let system = System::named(&args.robot)?;
    let scene = system.scene(&args.scene)?;
    let (trajectories, driven) = read(&args.states, &system)?;
    let ids: Vec<&u64> = trajectories.keys().collect();
    let steps = args.steps.unwrap_or_else(|| trajectories.values().map(|t| t.last).max().unwrap_or(0));
    let mut batch = Batch::new(&system, &scene, ids.len());
    for (env, (id, t)) in trajectories.iter().enumerate() {
        let start = t.start.as_ref().with_context(|| format!("{}: trajectory {id} has no row of step 0", args.states.display()))?;
        batch.reset(env, start);
    }
    let mut solver = build(&args.solver, &system, &scene.name, ids.len())?;
    let mut out = csv::Writer::from_writer(Vec::new());
    out.write_record(["traj", "step"].into_iter().chain(system.spec.state_columns.iter().map(String::as_str)))?;
    write_rows(&mut out, &ids, 0, &batch)?;
    let joints = system.robot.joint_count();
    let mut torques = vec![0.0; ids.len() * joints];
    let bar = crate::common::bar("frames", steps as u64);
    for step in 0..steps {
        if driven {
            for (env, (id, t)) in trajectories.iter().enumerate() {
                let given = t.torques.get(&step);
                let given = given.with_context(|| {
                    format!("{}: trajectory {id} has no torques at step {step}, {steps} steps were asked for", args.states.display())
                })?;
                torques[env * joints..(env + 1) * joints].copy_from_slice(given);
            }
        }
        solver.step(&mut batch, &torques)?;
        write_rows(&mut out, &ids, step + 1, &batch)?;
        bar.set(step as u64 + 1);
    }
    bar.finish();
    let bytes = out.into_inner().context("cannot finish the table")?;
    crate::files::write(&args.out, &bytes)
}

fn write_rows(out: &mut csv::Writer<Vec<u8>>, ids: &[&u64], step: usize, batch: &Batch) -> Result<()> {
    for (env, id) in ids.iter().enumerate() {
        let state = batch.state(env).iter().map(|x| x.to_string());
        out.write_record([id.to_string(), step.to_string()].into_iter().chain(state))?;
    }
    Ok(())
}

/// Trajectories by id, and whether the file has torques.
fn read(path: &Path, system: &System) -> Result<(BTreeMap<u64, Trajectory>, bool)> {
    let name = path.display();
    let mut reader = csv::Reader::from_path(path).with_context(|| format!("cannot read {name}"))?;
    let header = reader.headers().with_context(|| format!("{name}: no header"))?.clone();
    let column = |wanted: &str| header.iter().position(|h| h.trim() == wanted);
    let needed = |wanted: &str| column(wanted).with_context(|| format!("{name}: no column `{wanted}`"));
    let (traj, step) = (needed("traj")?, needed("step")?);
    let states = system.spec.state_columns.iter().map(|c| needed(c)).collect::<Result<Vec<_>>>()?;
    let taus: Vec<usize> = (0..header.len()).filter(|&i| header[i].trim().starts_with("tau")).collect();
    let named: Option<Vec<usize>> = system.spec.torque_columns.iter().map(|c| column(c)).collect();
    let torques = match named {
        Some(columns) => columns,
        None if taus.is_empty() || taus.len() == system.robot.joint_count() => taus,
        None => bail!("{name}: {} torque columns, robot `{}` has {} joints", taus.len(), system.name, system.robot.joint_count()),
    };
    let mut found: BTreeMap<u64, Trajectory> = BTreeMap::new();
    for (i, record) in reader.records().enumerate() {
        let line = i + 2;
        let record = record.with_context(|| format!("{name}: line {line}"))?;
        let number = |column: usize| {
            let text = record.get(column).unwrap_or_default().trim();
            text.parse::<f64>()
                .ok()
                .filter(|x| x.is_finite())
                .with_context(|| format!("{name}: line {line}, column `{}`: `{text}` is no finite number", &header[column]))
        };
        let whole = |column: usize| {
            let text = record.get(column).unwrap_or_default().trim();
            text.parse::<u64>()
                .ok()
                .with_context(|| format!("{name}: line {line}, column `{}`: `{text}` is no whole number", &header[column]))
        };
        let step = whole(step)? as usize;
        let t = found.entry(whole(traj)?).or_default();
        t.last = t.last.max(step);
        if step == 0 {
            t.start = Some(states.iter().map(|&c| number(c)).collect::<Result<_>>()?);
        }
        // The last row of a trajectory has no torques: its cells are empty.
        if torques.iter().any(|&c| !record.get(c).unwrap_or_default().trim().is_empty()) {
            t.torques.insert(step, torques.iter().map(|&c| number(c)).collect::<Result<_>>()?);
        }
    }
    if found.is_empty() {
        bail!("{name}: no rows");
    }
    Ok((found, !torques.is_empty()))
}
