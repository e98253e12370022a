//! `cargo xtask evaluate --robot pendulum --scene ground1 --solver neural --trajectories 2048`: compares passive motion
//! with the truth ([`crate::experiments::passive`]). A model is compared with the truth that it learned.
//! [`Protocol`] declares most options; `nerd_train::evaluate` computes the errors.

use crate::experiments::passive::{Case, Passive, Protocol, Recorded};
use crate::motions;
use crate::out::{self, conduct, tables};
use crate::prelude::*;
use crate::solvers::SolverArgs;

#[derive(clap::Args)]
pub struct EvaluateArgs {
    /// Robots, comma-separated: names from `list robots`, or paths of a .urdf, MJCF (.xml) or cable .toml. Needed
    /// without --data, whose log names the robot
    #[arg(long, required_unless_present = "data", conflicts_with = "data")]
    pub robot: Vec<String>,
    #[command(flatten)]
    pub keys: Keys<Protocol>,
    #[command(flatten)]
    pub solver: SolverArgs,
    /// HTML page to write: the first start without torques, in the model beside its truth. Needs --solver neural
    /// [default: none]
    #[arg(long, value_name = "FILE")]
    pub replay: Option<PathBuf>,
    /// Name of the result [default: passive]
    #[arg(long)]
    pub name: Option<String>,
    /// Folder to write the result into; without --out and --name nothing is written [default: none; with --name
    /// results]
    #[arg(long)]
    pub out: Option<PathBuf>,
}

const REPLAY: &str = "--replay shows a model of one robot beside its truth: --solver neural is needed";

pub fn run(args: EvaluateArgs) -> Result<()> {
    let asked = args.keys.settings()?;
    let robots = args.robot.iter().flat_map(|robots| listed(robots)).collect_vec();
    let folder = args.out.or_else(|| args.name.as_ref().map(|_| results()));
    let name = args.name.unwrap_or_else(|| "passive".into());
    if robots.is_empty() {
        return recorded(&args.solver, args.replay, &asked, &name, folder);
    }
    let case = |robot: &String| -> Result<Case> {
        let solver = args.solver.choose(&*System::named(robot)?)?;
        Ok(Case { robot: robot.clone(), solver, truth: args.solver.truth, asked: asked.clone() })
    };
    let cases = robots.iter().map(case).collect::<Result<Vec<_>>>()?;
    let replay = args.replay.map(|file| -> Result<_> {
        let [Case { robot, solver, .. }] = &cases[..] else { bail!(REPLAY) };
        let Some(folder) = solver.folder() else { bail!(REPLAY) };
        out::page(&file)?;
        let system = System::named(robot)?;
        let scene = asked.scene.first().map_or_else(|| system.usual_scenes()[0], String::as_str);
        Ok((file, motions::passive(robot, scene, folder, asked.frames.unwrap_or(300), asked.seed)?))
    });
    let replay = replay.transpose()?;
    let passive = Passive::new(&name, &cases)?;
    match folder {
        Some(folder) => drop(conduct(&passive, &folder)?),
        None => {
            let rows = passive.rows()?;
            tables(&[rows.table()].into_iter().chain(rows.verdicts()).collect_vec());
        }
    }
    replay.map_or(Ok(()), |(file, page)| out::replay(&file, &page))
}

fn recorded(
    solver: &SolverArgs,
    replay: Option<PathBuf>,
    asked: &Protocol,
    name: &str,
    out: Option<PathBuf>,
) -> Result<()> {
    let card = solver.device.is_some_and(Device::is_cuda);
    let others = SolverArgs { solver: None, model: None, device: solver.device.filter(|_| !card), ..solver.clone() };
    let other = solver.solver.is_some() && !solver.neural() || others != SolverArgs::default() || replay.is_some();
    let (Some(data), Some(model), false) = (&asked.data, &solver.model, other) else {
        bail!(
            "--data compares a model with recorded motion: --model names it, --device cuda times it there, too, and no other option of solvers is taken"
        );
    };
    let recorded = Recorded::new(name, data, model, asked, card)?;
    match out {
        Some(folder) => drop(conduct(&recorded, &folder)?),
        None => tables(&recorded.tables(&recorded.found()?)),
    }
    Ok(())
}
