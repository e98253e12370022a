//! `cargo xtask urdf FOLDER`: other people's robots, see [`nerd_lab::survey`].

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use nerd_lab::survey::{FRAMES, Found, PinocchioError, Surveyed, differences, find, survey};

use nerd_lab::report::table::digits;
use nerd_lab::report::{Artifact, Input, Inputs, Provenance, Table};
use nerd_train::progress::bar;

/// Read URDFs and roll them out.
#[derive(clap::Args, Clone, Debug)]
pub struct UrdfArgs {
    /// Files, or folders to be searched for .urdf
    #[arg(required = true)]
    pub paths: Vec<PathBuf>,
    /// A Python with Pinocchio (PyPI: pin): the dynamics are compared with its own
    #[arg(long, value_name = "PYTHON", conflicts_with_all = ["stand", "crowd"])]
    pub pinocchio: Option<PathBuf>,
    /// With --pinocchio: random states of each robot
    #[arg(long, default_value_t = 100, value_parser = clap::value_parser!(u64).range(1..=10_000))]
    pub states: u64,
    /// Instead: each stands on a plane for ten seconds, its joints held by drives, and then falls without
    #[arg(long)]
    pub stand: bool,
    /// Instead: so many robots of each file, each with its own masses and friction: error and speed on one core, beside MuJoCo
    #[arg(long, value_name = "ROBOTS", requires = "mujoco", conflicts_with = "stand", value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    pub crowd: Option<u64>,
    /// With --stand or --crowd: a Python with MuJoCo, for comparison
    #[arg(long, value_name = "PYTHON")]
    pub mujoco: Option<PathBuf>,
    /// Folder to write urdfs.json and urdfs.md into
    #[arg(long, value_name = "FOLDER")]
    pub out: Option<PathBuf>,
}

/// Runs the verb.
pub fn run(args: UrdfArgs) -> Result<()> {
    let mut files = Vec::new();
    for path in &args.paths {
        files.extend(find(path).with_context(|| format!("cannot read {}", path.display()))?);
    }
    if files.is_empty() {
        bail!("no .urdf in {}", args.paths.iter().map(|p| p.display().to_string()).collect::<Vec<_>>().join(", "));
    }
    if let (Some(n), Some(python)) = (args.crowd, &args.mujoco) {
        return crate::crowd::run(&files, python, n as usize, args.out.as_deref());
    }
    if args.mujoco.is_some() && !args.stand {
        bail!("--mujoco needs --stand or --crowd");
    }
    if args.stand {
        return crate::stand::run(&files, args.mujoco.as_deref(), args.out.as_deref());
    }
    let bar = bar("robots", files.len() as u64);
    // A panic has a line in the table; elsewhere it would tear the bar.
    let hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(|_| ()));
    let mut robots = Vec::new();
    for (k, file) in files.iter().enumerate() {
        bar.set(k as u64);
        robots.push(survey(file));
    }
    std::panic::set_hook(hook);
    bar.finish();
    let header = ["file", "links", "joints", "mass (kg)", "meshes passed over", "fixed base", "floating base"];
    let sum = format!(
        "{} files: {} move on a fixed base, {} on a floating one. `ok`: {FRAMES} frames from zero coordinates under gravity, \
         `articulated`, preset `converged`, finite; else what is missing. Links and joints are those that move on a fixed base; \
         a joint has one DoF, a floating base six more.",
        files.len(),
        robots.iter().filter(|r| r.fixed.is_ok()).count(),
        robots.iter().filter(|r| r.floating.is_ok()).count()
    );
    let mut tables = vec![Table::new("urdfs", &header).with(robots.iter().map(row)).noted(&sum)];
    if let Some(python) = &args.pinocchio {
        tables.push(held_against(python, args.states as usize, &files, &robots)?);
    }
    crate::out::tables(&tables);
    if let [robot] = &robots[..] {
        robot.notes.iter().for_each(|note| eprintln!("{note}"));
    }
    let Some(out) = args.out else { return Ok(()) };
    let (provenance, effort) = (Provenance::now(0), files.len() as f64);
    let inputs = Inputs(vec![Input::files("URDFs", &files.iter().map(|found| found.path.clone()).collect::<Vec<_>>())?]);
    Ok(Artifact { provenance, inputs, effort, tables, data: Default::default() }.write(&out, "urdfs")?)
}

/// Largest relative differences from Pinocchio's dynamics, of both bases.
fn held_against(python: &Path, states: usize, files: &[Found], robots: &[Surveyed]) -> Result<Table> {
    let bar = bar("robots", 2 * robots.len() as u64);
    let mut rows = Vec::new();
    let (mut version, mut same) = (String::new(), 0);
    for (k, (file, robot)) in files.iter().zip(robots).enumerate() {
        let path = std::fs::canonicalize(&file.path).with_context(|| format!("cannot read {}", file.path.display()))?;
        for (base, robot) in ["fixed", "floating"].into_iter().zip(&robot.robots) {
            bar.set(2 * k as u64);
            let Some(robot) = robot else { continue };
            let mut cells = vec![file.name.clone(), base.to_string()];
            match differences(python, &path, robot, states, 0) {
                Ok((worst, said)) => {
                    same += usize::from(worst.values().all(|x| *x < SAME));
                    version = said;
                    cells.extend(QUANTITIES.map(|q| worst.get(q).map_or("-".into(), |x| format!("{x:.0e}"))));
                }
                Err(PinocchioError::Robot(reason)) => {
                    cells.push(reason.replace('|', "/"));
                    cells.resize(2 + QUANTITIES.len(), String::new());
                }
                Err(absent) => bail!("--pinocchio: {absent}"),
            }
            rows.push(cells);
        }
    }
    bar.finish();
    let header: Vec<&str> = ["file", "base"].into_iter().chain(QUANTITIES).collect();
    let note = format!(
        "Dynamics beside Pinocchio {version} at {states} random states: largest entry of the difference over the largest of Pinocchio's \
         (or over 1e-6, where that is more), the worst state. {same} of {} rows are below {SAME:.0e} in everything.",
        rows.len()
    );
    Ok(Table::new("pinocchio", &header).with(rows).noted(&note))
}

/// What is compared, in words: the mass matrix, torques at rest, inverse and forward dynamics, their derivatives, Jacobians of frames.
const QUANTITIES: [&str; 9] = ["mass", "bias", "inverse", "forward", "inverse_q", "inverse_qd", "forward_q", "forward_qd", "jacobian"];
/// Closer than this, two dynamics are the same.
const SAME: f64 = 1e-9;

fn row(robot: &Surveyed) -> Vec<String> {
    let sizes = robot
        .sizes
        .map_or(["-"; 4].map(String::from), |s| [s.links.to_string(), s.joints.to_string(), digits(s.mass), s.meshes.to_string()]);
    let said = |moves: &Result<usize, String>| match moves {
        Ok(0) => "ok: nothing to move".into(),
        Ok(4) => "ok".into(),
        Ok(substeps) => format!("ok at {substeps} substeps"),
        Err(reason) => reason.clone(),
    };
    let floating = if robot.fixed.is_err() && robot.fixed == robot.floating { "the same".into() } else { said(&robot.floating) };
    [robot.name.clone()].into_iter().chain(sizes).chain([said(&robot.fixed), floating]).collect()
}
