//! `cargo xtask grow`: what a frame costs as a robot grows, and from which size on a learned solver would be the cheaper one.
//!
//! Arms of n links of 0.1 m, hinged in turn about y and z and held 0.2 m above the ground, on which the rest of them falls; a contact point at every link's end. Analytic solvers are timed and held against a converged reference from random
//! starts; of each size the cheapest setting within a tolerance is drawn. Learned solvers are only timed (nobody has trained
//! them: their weights are zero, and a frame costs the same whatever the weights): the crossing holds if one of that size
//! learns to that tolerance.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use nerd_model::base::Base;
use nerd_model::features::Features;
use nerd_model::folder::{Model, ModelConfig};
use nerd_model::neural::Neural;
use nerd_model::normalizer::{Moments, Normalizer};
use nerd_model::pick::Setting;
use nerd_model::transformer::{Positions, TransformerConfig, Weights};
use nerd_sim::prelude::*;
use nerd_train::evaluate::{Action, PassiveConfig, passive};
use serde::Serialize;

use crate::chart::{Recorder, Replay, Timed, mean};
use crate::numbers::{self, FRAMES, SEEDS, STARTS, count, positive};
use crate::plot::{Figure, Series};
use crate::provenance::Provenance;
use crate::table::{digits, markdown};

/// Links of an arm: its mass matrix is dense.
const LINKS: std::ops::RangeInclusive<u64> = 1..=256;
/// Substeps of the reference.
const FINEST: usize = 256;

/// Time a frame of arms of more and more links.
#[derive(clap::Args, Clone, Debug)]
pub struct GrowArgs {
    /// Numbers of links, comma-separated
    #[arg(long, value_delimiter = ',', default_value = "4,8,16,32,64", value_parser = count::<usize>(LINKS))]
    pub links: Vec<usize>,
    /// Trajectories
    #[arg(long, default_value_t = 16, value_parser = count::<usize>(STARTS))]
    pub starts: usize,
    /// Frames
    #[arg(long, default_value_t = 30, value_parser = count::<usize>(FRAMES))]
    pub horizon: usize,
    /// Errors (mean |dq|, rad) that an analytic solver is asked for, comma-separated
    #[arg(long, value_delimiter = ',', default_value = "0.03,0.01", value_parser = positive)]
    pub tolerance: Vec<f64>,
    /// Seed of the starts
    #[arg(long, default_value_t = 500, value_parser = count::<u64>(SEEDS))]
    pub seed: u64,
    /// Folder for grow.svg, .png, .json and .md
    #[arg(long, default_value = "results")]
    pub out: PathBuf,
}

/// One solver on one arm.
#[derive(Clone, Debug, Serialize)]
struct Point {
    links: usize,
    solver: String,
    /// Of an analytic solver.
    setting: Option<Setting>,
    /// Frame of one environment on one core.
    microseconds: f64,
    /// Mean |dq| from the reference; none of what is not trained.
    error: Option<f64>,
}

/// Runs the verb.
pub fn run(args: GrowArgs) -> Result<()> {
    let longest = args.links.iter().copied().max().unwrap_or(0);
    let frames = [("--starts", args.starts), ("--horizon", args.horizon), ("--links", longest)];
    numbers::memory(&frames, 16)?;
    numbers::time(&[frames[0], frames[1], frames[2], ("substeps", FINEST)])?;
    if (1..args.links.len()).any(|k| args.links[..k].contains(&args.links[k])) {
        bail!("--links: each number once");
    }
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().context("cannot start a thread")?;
    let bar = crate::common::bar("sizes", args.links.len() as u64);
    let mut points = Vec::new();
    for (k, links) in args.links.iter().enumerate() {
        points.extend(one.install(|| measure(&args, *links))?);
        bar.set(k as u64 + 1);
    }
    bar.finish();
    let series = series(&args, &points);
    let names: Vec<&str> = std::iter::once("links").chain(series.iter().map(|s| s.name.as_str())).collect();
    let of = |s: &Series, links: usize| {
        let found = s.points.iter().find(|p| p.0 == links as f64);
        found.map_or_else(|| "-".into(), |p| if p.2.is_empty() { digits(p.1) } else { format!("{} ({})", digits(p.1), p.2) })
    };
    let row = |links: &usize| std::iter::once(links.to_string()).chain(series.iter().map(|s| of(s, *links))).collect::<Vec<_>>();
    let table = markdown(&names, &args.links.iter().map(row).collect::<Vec<_>>());
    println!("microseconds a frame of one environment on one core\n\n{table}");
    let stamp = Provenance::now(args.seed);
    let from = format!("\n`{}`, seed {}, commit {}, {}, {}\n", stamp.command, stamp.seed, stamp.commit, stamp.machine, stamp.date);
    let json = serde_json::json!({ "provenance": stamp, "horizon": args.horizon, "starts": args.starts, "points": points });
    crate::files::write(&args.out.join("grow.json"), (serde_json::to_string_pretty(&json)? + "\n").as_bytes())?;
    crate::files::write(
        &args.out.join("grow.md"),
        format!("Microseconds a frame of one environment on one core.\n\n{table}{from}").as_bytes(),
    )?;
    let figure = Figure {
        title: "An arm on the ground, growing".into(),
        x: "links".into(),
        y: "microseconds a frame, one environment, one core".into(),
        series,
        front: Vec::new(),
        levels: Vec::new(),
    };
    Ok(figure.save(&args.out.join("grow"))?)
}

/// Every solver on an arm of that many links.
fn measure(args: &GrowArgs, links: usize) -> Result<Vec<Point>> {
    let system = arm(links)?;
    let scene = system.scene("ground")?;
    let config = PassiveConfig { starts: args.starts, steps: args.horizon, seed: args.seed, action: Action::Limp };
    let mut truth = Recorder { solver: Setting::Implicit(FINEST).solver(&system)?, frames: Vec::new() };
    passive(&system, &scene, &mut truth, &mut Idle, config, &mut |_| ())?;
    let mut points = Vec::new();
    let settings = [1, 2, 4, 8, 16].map(Setting::Implicit).into_iter().chain([4, 8, 16, 32, 64, 128].map(Setting::Euler));
    for setting in settings.chain([Setting::RapierSteps(4)]) {
        let mut timed = Timed { solver: setting.solver(&system)?, spent: Duration::ZERO };
        let mut replay = Replay { frames: &truth.frames, next: 0 };
        // What leaves has no error to speak of.
        let Ok(report) = passive(&system, &scene, &mut replay, &mut timed, config, &mut |_| ()) else { continue };
        let microseconds = timed.spent.as_secs_f64() * 1e6 / (args.starts * args.horizon) as f64;
        let error = mean(&report.error);
        numbers::figures(&format!("{setting:?} on {links} links: its mean error"), &[error])?;
        points.push(Point { links, solver: format!("{setting:?}"), setting: Some(setting), microseconds, error: Some(error) });
    }
    for (embedding, layers, base) in [(64, 2, Base::State), (64, 2, Base::Flight), (192, 6, Base::State), (192, 6, Base::Flight)] {
        let solver = format!("NeRD {}, E {embedding}, {layers} layers", if base.flies() { "on flight" } else { "paper's form" });
        points.push(Point {
            links,
            solver,
            setting: None,
            microseconds: untrained(&system, &scene, embedding, layers, base)?,
            error: None,
        });
    }
    Ok(points)
}

/// Moves nothing; for a truth that is only recorded.
struct Idle;

impl Solver for Idle {
    fn step(&mut self, _batch: &mut Batch, _torques: &[f64]) -> Result<(), StepError> {
        Ok(())
    }
}

/// Microseconds of a frame of a learned solver on 64 environments whose past is full.
fn untrained(system: &Arc<System>, scene: &Arc<Scene>, embedding: usize, layers: usize, base: Base) -> Result<f64> {
    let (inputs, outputs) = (Features::inputs(system, base), Features::outputs(system));
    let positions = Positions::Rotary;
    let network = TransformerConfig { layers, heads: embedding / 16, positions, ..TransformerConfig::paper(inputs, outputs, embedding) };
    let unit = |n: usize| Moments { mean: vec![0.0; n], variance: vec![1.0; n], epsilon: 1e-5 };
    let config = ModelConfig {
        robot: system.name.clone(),
        robot_sha256: system.robot_sha256(),
        model_sha256: String::new(),
        truth: "none".into(),
        base,
        view: Default::default(),
        network,
        data_sha256: String::new(),
        transitions: 0,
        updates: 0,
        batch: 0,
        provenance: Default::default(),
    };
    let weights = Weights { config: network, flat: vec![0.0; network.parameters()] };
    let model = Model { config, normalizer: Normalizer { inputs: unit(inputs), outputs: unit(outputs) }, weights };
    let (envs, frames) = (64, 20);
    let batch = Batch::new(system, scene, envs);
    let torques = vec![0.0; envs * system.robot.joint_count()];
    let mut simulation = Simulation::new(batch, Neural::on_cpu(model, system));
    let state = system.default_state();
    (0..envs).for_each(|env| simulation.reset(env, &state));
    (0..10).try_for_each(|_| simulation.step(&torques))?;
    let started = Instant::now();
    (0..frames).try_for_each(|_| simulation.step(&torques))?;
    Ok(started.elapsed().as_secs_f64() * 1e6 / (envs * frames) as f64)
}

/// Cheapest analytic settings within each tolerance, and the learned solvers.
fn series(args: &GrowArgs, points: &[Point]) -> Vec<Series> {
    let cheapest = |tolerance: &f64| {
        let of = |links: &usize| {
            let enough = points.iter().filter(|p| p.links == *links && p.error.is_some_and(|e| e <= *tolerance));
            let best = enough.min_by(|a, b| a.microseconds.total_cmp(&b.microseconds))?;
            Some((*links as f64, best.microseconds, best.solver.clone()))
        };
        Series { name: format!("cheapest analytic within {tolerance}"), points: args.links.iter().filter_map(of).collect() }
    };
    let mut learned: Vec<Series> = Vec::new();
    for p in points.iter().filter(|p| p.setting.is_none()) {
        let mark = (p.links as f64, p.microseconds, String::new());
        match learned.iter_mut().find(|s| s.name == p.solver) {
            Some(s) => s.points.push(mark),
            None => learned.push(Series { name: p.solver.clone(), points: vec![mark] }),
        }
    }
    args.tolerance.iter().map(cheapest).chain(learned).collect()
}

/// An arm of `links` links of 0.1 m and 0.2 kg.
fn arm(links: usize) -> Result<Arc<System>> {
    let mut urdf = String::from(r#"<robot name="arm"><link name="l0"/>"#);
    let mut toml = String::from(
        "urdf = \"\"\nfloating = false\nframe_time = \"1/60\"\ngravity = [0.0, 0.0, -9.81]\nsubsteps = 16\n\
         material = { stiffness = 1e4, damping = 1e2, friction_damping = 1e2, friction = 0.5 }\n",
    );
    let (mut joints, mut contacts) = (String::new(), String::new());
    // So nearly straight that no tip starts in the ground.
    let (a, b) = (0.5 / links as f64, 4.0 / links as f64);
    for n in 1..=links {
        let (z, x) = if n == 1 { (0.2, 0.0) } else { (0.0, 0.1) };
        let axis = if n % 2 == 1 { "0 1 0" } else { "0 0 1" };
        urdf += &format!(
            r#"<link name="l{n}"><inertial><origin xyz="0.05 0 0"/><mass value="0.2"/><inertia ixx="1e-4" ixy="0" ixz="0" iyy="2e-4" iyz="0" izz="2e-4"/></inertial></link><joint name="j{n}" type="continuous"><parent link="l{}"/><child link="l{n}"/><origin xyz="{x} 0 {z}"/><axis xyz="{axis}"/><dynamics damping="0.05"/></joint>"#,
            n - 1,
        );
        joints += &format!(
            "[[joint]]\nname = \"j{n}\"\narmature = 0.01\nsample = {{ q = \"U(-{a}, {a})\", qd = \"U(-{b}, {b})\" }}\nreset = {{ q = \"U(-{a}, {a})\", qd = \"U(-{b}, {b})\" }}\n"
        );
        contacts += &format!("[[contact]]\nlink = \"l{n}\"\npoint = [0.1, 0.0, 0.0]\nradius = 0.02\nthickness = 0.02\n");
    }
    toml += &(joints + &contacts + "[[scene]]\nname = \"ground\"\nplane = { height = 0.0, angles = [0.0, 0.0, 0.0] }\n");
    Ok(Arc::new(System::from_text("arm", &(urdf + "</robot>"), Some(&toml))?))
}
