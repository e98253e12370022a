//! `cargo xtask evaluate --robot pendulum --scene ground1 --solver neural --starts 2048`: passive motion against the truth, a
//! model's against the one it learned ([`nerd_lab::experiments::passive`]).

use std::path::PathBuf;

use anyhow::{Result, bail};
use nerd_lab::choice::Choice;
use nerd_lab::experiments::passive::{Case, Passive};
use nerd_lab::page::motions;
use nerd_sim::prelude::*;
use nerd_train::evaluate::Action;
use nerd_train::shipped::results;

use crate::options::{FRAMES, Number, SEEDS, STARTS, Whole, value};
use crate::out::{self, conduct, tables};
use crate::solvers::SolverArgs;

/// Measure a solver against the truth.
#[derive(clap::Args, Clone, Debug)]
pub struct EvaluateArgs {
    /// Robot: cartpole, pendulum, cube, franka, ant, anymal, each as NAME-paper too, or the path of a .urdf
    #[arg(long)]
    pub robot: String,
    /// Scenes, comma-separated [default: all of the robot's]
    #[arg(long, value_delimiter = ',')]
    pub scene: Vec<String>,
    #[command(flatten)]
    pub solver: SolverArgs,
    /// Trajectories (the paper: 2048)
    #[arg(long, default_value_t = 256, value_parser = value::<usize>(Whole(STARTS)))]
    pub starts: usize,
    /// Frames [default: the paper's, 1000 for Cartpole, 100 for the pendulum]
    #[arg(long, value_parser = value::<usize>(Whole(FRAMES)))]
    pub frames: Option<usize>,
    /// Seed of the starts
    #[arg(long, default_value_t = 500, value_parser = value::<u64>(Whole(SEEDS)))]
    pub seed: u64,
    /// Factor on the random torques of the training data, instead of passive motion
    #[arg(long, default_value_t = 0.0, value_parser = value::<f64>(Number(0.0..=1e3)))]
    pub drive: f64,
    /// No torques at all, not even those that hold a default pose
    #[arg(long, conflicts_with = "drive")]
    pub limp: bool,
    /// Noise (rad/s or m/s) on all velocities after every frame of the solver: with the truth itself, how far the motion's own
    /// sensitivity drives apart what differs a little
    #[arg(long, default_value_t = 0.0, value_parser = value::<f64>(Number(0.0..=1e3)))]
    pub shake: f64,
    /// Compare the truth with itself: every error must be 0
    #[arg(long)]
    pub control: bool,
    /// File that replays the first start, let go, in the model and in its truth, as a page (needs --solver neural)
    #[arg(long, value_name = "FILE")]
    pub replay: Option<PathBuf>,
    /// Name of the result to write [default: passive]
    #[arg(long)]
    pub name: Option<String>,
    /// Folder for the result; without it and --name nothing is written [default with --name: results]
    #[arg(long, value_name = "FOLDER")]
    pub out: Option<PathBuf>,
}

/// Runs the verb.
pub fn run(args: EvaluateArgs) -> Result<()> {
    let system = System::named(&args.robot)?;
    let solver = args.solver.choose(&system)?;
    let folder = args.out.or_else(|| args.name.as_ref().map(|_| results()));
    let name = args.name.unwrap_or_else(|| "passive".into());
    let action = match args.drive {
        _ if args.limp => Action::Limp,
        0.0 => Action::Zero,
        factor => Action::Random(factor),
    };
    let replay = args.replay.map(|file| -> Result<_> {
        let Choice::Neural { folder, .. } = &solver else { bail!("--replay shows a model beside its truth: --solver neural is needed") };
        let scene = args.scene.first().map_or_else(|| system.usual_scenes()[0], String::as_str);
        Ok((file, motions::passive(&args.robot, scene, folder, args.frames.unwrap_or(300), args.seed)?))
    });
    let replay = replay.transpose()?;
    let case = Case {
        solver,
        robot: args.robot,
        scenes: args.scene,
        truth: args.solver.truth,
        starts: args.starts,
        steps: args.frames,
        action,
        shake: args.shake,
        control: args.control,
    };
    let passive = Passive::new(&name, args.seed, &[case])?;
    if args.control {
        say!("control: the truth against itself; anything but 0 is a fault of the program\n");
    }
    match folder {
        Some(folder) => drop(conduct(&passive, &folder)?),
        None => tables(&[passive.rows()?.table()]),
    }
    replay.map_or(Ok(()), |(file, page)| out::replay(&file, &page))
}
