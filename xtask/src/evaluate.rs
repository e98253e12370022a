//! `cargo xtask evaluate --robot pendulum --scene ground1 --solver neural --starts 2048`: passive motion against the truth, a
//! model's against the one it learned.
//!
//! Mean over every step and every trajectory of the absolute difference by coordinate, from the robot's reset law,
//! without torques; beside it the floors `hold` and `glide`, the paper's figure and the count of diverged rollouts.
//! A paper-size network takes some half a millisecond an environment-frame on two cores if it recomputes windows, a tenth of
//! that if it streams. The truth against itself is 0 everywhere and is asked for by name, as `--control`.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use nerd_sim::instruments::Shaken;
use nerd_sim::prelude::*;
use nerd_train::evaluate::{Action, PassiveConfig, PassiveReport, passive, summary};
use serde::{Deserialize, Serialize};

use crate::numbers::{self, FRAMES, SEEDS, STARTS, count, within};
use crate::paper;
use crate::provenance::Provenance;
use crate::solvers::{Choice, SolverArgs};
use crate::table::{markdown, pair};
use crate::truth::Truth;

/// Measure a solver against the truth.
#[derive(clap::Args, Clone, Debug)]
pub struct EvaluateArgs {
    /// Robot: cartpole, pendulum, cube, franka, ant, anymal, anymal-paper, or the path of a .urdf
    #[arg(long)]
    pub robot: String,
    /// Scenes, comma-separated [default: all of the robot's]
    #[arg(long, value_delimiter = ',')]
    pub scene: Vec<String>,
    #[command(flatten)]
    pub solver: SolverArgs,
    /// Trajectories (the paper: 2048)
    #[arg(long, default_value_t = 256, value_parser = count::<usize>(STARTS))]
    pub starts: usize,
    /// Frames [default: the paper's, 1000 for Cartpole, 100 for the pendulum]
    #[arg(long, value_parser = count::<usize>(FRAMES))]
    pub steps: Option<usize>,
    /// Seed of the starts
    #[arg(long, default_value_t = 500, value_parser = count::<u64>(SEEDS))]
    pub seed: u64,
    /// Random torques of the training data times this, in place of passive motion
    #[arg(long, default_value_t = 0.0, value_parser = within(0.0..=1e3))]
    pub drive: f64,
    /// No torque whatever, in place of what a position law holds its pose with
    #[arg(long, conflicts_with = "drive")]
    pub limp: bool,
    /// Noise (rad/s or m/s) on all velocities after every frame of the solver: with the truth itself, how far the motion's own
    /// sensitivity drives apart what differs a little
    #[arg(long, default_value_t = 0.0, value_parser = within(0.0..=1e3))]
    pub shake: f64,
    /// Hold the truth against itself: every error must be 0
    #[arg(long)]
    pub control: bool,
    /// JSON file to write
    #[arg(long)]
    pub out: Option<PathBuf>,
}

/// One scene's errors.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Row {
    /// Robot.
    pub robot: String,
    /// Solver, of a learned one form and size.
    pub method: String,
    /// Scene.
    pub scene: String,
    /// What it is held against.
    pub truth: String,
    /// Trajectories and frames.
    pub protocol: PassiveConfig,
    /// Errors and floors.
    pub report: PassiveReport,
    /// What the paper says, whose truth is `articulated`.
    pub paper: Option<Vec<f64>>,
}

/// Runs the verb.
pub fn run(args: EvaluateArgs) -> Result<()> {
    let rows = rows(&args)?;
    if args.control {
        println!("control: the truth against itself; anything but 0 is a fault of the program\n");
    }
    println!("{}", table(&rows));
    args.out.as_ref().map_or(Ok(()), |path| write(path, &rows, args.seed))
}

/// Writes rows with their provenance.
pub fn write(path: &Path, rows: &[Row], seed: u64) -> Result<()> {
    let json = serde_json::json!({ "provenance": Provenance::now(seed), "rows": rows });
    crate::files::write(path, (serde_json::to_string_pretty(&json)? + "\n").as_bytes())
}

/// Measures every scene asked for.
pub fn rows(args: &EvaluateArgs) -> Result<Vec<Row>> {
    let system = System::named(&args.robot)?;
    let scenes = if args.scene.is_empty() { system.usual_scenes().into_iter().map(String::from).collect() } else { args.scene.clone() };
    let steps = args.steps.unwrap_or_else(|| paper::horizon(&system.name));
    let action = match args.drive {
        _ if args.limp => Action::Limp,
        0.0 => Action::Zero,
        factor => Action::Random(factor),
    };
    let found = scenes.iter().map(|s| system.scene(s)).collect::<Result<Vec<_>, _>>()?;
    let choice = args.solver.choose(&system)?;
    let truth = match args.solver.truth {
        Some(truth) => truth,
        None => choice.learned()?.unwrap_or_default(),
    };
    let mut choices = Vec::new();
    for scene in &found {
        let choice = choice.in_scene(&system, &scene.name)?;
        check(args, &choice, truth, &system, steps)?;
        choices.push(choice);
    }
    let mut method = choice.title()?;
    if args.control {
        method += ", control";
    }
    if args.shake > 0.0 {
        method = format!("{method}, shaken by {}", args.shake);
    }
    let bar = crate::common::bar(&format!("{} frames of {} rollouts", system.name, args.starts), (steps * scenes.len()) as u64);
    let mut rows = Vec::new();
    for (k, (scene, choice)) in found.iter().zip(choices).enumerate() {
        let protocol = PassiveConfig { starts: args.starts, steps, seed: args.seed, action };
        let mut solver = choice.build(&system, &scene.name, args.starts)?;
        if args.shake > 0.0 {
            solver = Box::new(Shaken::new(solver, args.shake, args.seed));
        }
        let mut tell = |step| bar.set((k * steps + step) as u64);
        let report = passive(&system, scene, &mut *truth.solver(&system), &mut *solver, protocol, &mut tell)?;
        let whose = |what: &str| format!("{method} on {} in {}: its {what}", system.name, scene.name);
        numbers::figures(&whose("error"), report.error.iter().chain(&report.standard_error).chain(&report.curve))?;
        numbers::figures(&whose("hold-last or constant-velocity error"), report.hold.iter().chain(&report.glide))?;
        rows.push(Row {
            robot: system.name.clone(),
            method: method.clone(),
            scene: scene.name.clone(),
            truth: truth.name(),
            protocol,
            report,
            // What is no solver's error has nothing to stand beside.
            paper: paper::passive_error(&system.name, &scene.name).filter(|_| truth == Truth::Articulated && !args.control),
        });
    }
    bar.finish();
    Ok(rows)
}

/// Refuses what says nothing, and what is more than can be borne.
fn check(args: &EvaluateArgs, choice: &Choice, truth: Truth, system: &System, steps: usize) -> Result<()> {
    let itself = choice.is(truth, system);
    if itself && args.shake == 0.0 && !args.control {
        bail!(
            "`{}` against itself is 0 everywhere; name what to measure: --solver neural or rapier, --preset, --friction or --substeps, \
             --tolerance, --shake; or --control for the zeros",
            truth.name()
        );
    }
    if args.control && (!itself || args.shake > 0.0) {
        bail!("--control holds the truth `{}` against itself: leave out what names or shakes another solver", truth.name());
    }
    // Two batches with what their solvers keep, sums over steps, working memory of the truth.
    let bytes = choice.bytes()?.saturating_add(1024 * system.robot.state_dim());
    numbers::memory(&[("--starts", args.starts)], bytes)?;
    numbers::time(&[("--starts", args.starts), ("--steps", steps), ("substeps", choice.substeps().max(system.spec.substeps))])
}

/// The rows as a Markdown table.
pub fn table(rows: &[Row]) -> String {
    let cells = rows.iter().map(|r| {
        let p = &r.report;
        let pair = |x: &[f64]| System::named(&r.robot).map_or_else(|_| pair(x), |system| pair(&summary(&system, x)));
        vec![
            if r.truth == Truth::Articulated.name() { r.robot.clone() } else { format!("{} ({})", r.robot, r.truth) },
            r.method.clone(),
            r.scene.clone(),
            format!("{} x {}{}", r.protocol.starts, r.protocol.steps, if r.protocol.action == Action::Limp { ", limp" } else { "" }),
            pair(&p.error),
            pair(&p.standard_error),
            r.paper.as_deref().map_or_else(|| "-".into(), crate::table::pair),
            pair(&p.hold),
            pair(&p.glide),
            p.diverged.to_string(),
        ]
    });
    markdown(
        &[
            "robot",
            "method",
            "scene",
            "starts x steps",
            "error (rad or m)",
            "standard error",
            "paper",
            "hold last",
            "constant velocity",
            "diverged",
        ],
        &cells.collect::<Vec<_>>(),
    )
}
