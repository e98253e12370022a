//! Are the truth's substeps enough? Rollouts by robot and games by task at half, once and twice the substeps that the robot's
//! specification asks for.
//!
//! Rollouts have a floor beside them: how far the truth goes from itself where its starts are shaken a little. Games begin alike
//! at any number of substeps, so their rewards are compared pair by pair.

mod rewards;
mod rollouts;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use nerd_model::pick::Setting;
use nerd_sim::prelude::*;
use serde::{Deserialize, Serialize};

use super::Experiment;
use super::games::judged;
use super::policies::Policies;
use crate::error::Result;
use crate::report::plot::{Figure, Series};
use crate::report::{Input, Inputs, Table};
use nerd_train::bounds::{self, FRAMES, SEEDS, STARTS};
use nerd_train::evaluate::{Action, PassiveConfig};
use nerd_train::progress::bar;
use nerd_train::settings::settings;

pub use rewards::Played;
pub use rollouts::{Apart, Rolled};

settings! {
    /// Rollouts and rewards of the truth at half, once and twice its substeps.
    pub struct Substeps {
        /// Robots, comma-separated [default: all but NAME-paper]
        robot: Vec<String> = Vec::new(), Texts;
        /// Folders of policies, comma-separated [default: all in models/policies]
        policy: Vec<PathBuf> = Vec::new(), Texts;
        /// Rollouts of each robot in each of its scenes, passive and under random torques
        starts: usize = 64, Whole(STARTS);
        /// Frames of a rollout
        frames: usize = 100, Whole(FRAMES);
        /// Standard deviation of what a shaken start is beside: of coordinates (rad or m), and of velocities (rad/s or m/s)
        shake: f64 = 1e-3, Positive;
        /// Games of each policy at each number of substeps
        games: usize = 32, Whole(STARTS);
        /// Leave the games out
        no_games: bool = false, Flag;
        /// Seed of the starts
        seed: u64 = 500, Whole(SEEDS);
    }
}

/// What was measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Enough {
    /// By robot, scene and drive.
    pub rollouts: Vec<Rolled>,
    /// By policy.
    pub games: Vec<Played>,
    /// Of shaken starts.
    pub shake: f64,
}

/// The truth at `times` as many substeps, in contact and without; of fewer than one there is one.
fn at(system: &System, times: f64) -> ArticulatedConfig {
    let own = ArticulatedConfig::accurate(system);
    let scaled = |n: usize| ((n as f64 * times).round() as usize).max(1);
    ArticulatedConfig { substeps: scaled(own.substeps), contact_substeps: scaled(own.contact_substeps), ..own }
}

/// How many of its substeps are taken in a scene.
fn taken(system: &System, scene: &Scene, config: &ArticulatedConfig) -> usize {
    let touches = !scene.colliders.is_empty() && !system.robot.contact_points.is_empty();
    if touches || system.robot.dry() { config.contact_substeps } else { config.substeps }
}

/// A robot in a scene under a drive.
type Case = (Arc<System>, Arc<Scene>, Action);

impl Substeps {
    fn policies(&self) -> Result<Vec<PathBuf>> {
        if self.no_games {
            return Ok(Vec::new());
        }
        Policies { policy: self.policy.clone(), ..Policies::default() }.folders()
    }

    /// Robots, each in a scene under a drive.
    fn cases(&self) -> Result<Vec<Case>> {
        let own = || System::built_in().into_iter().filter(|name| !name.ends_with("-paper")).map(String::from).collect();
        let robots: Vec<String> = if self.robot.is_empty() { own() } else { self.robot.clone() };
        let mut cases = Vec::new();
        for robot in robots {
            let system = System::named(&robot)?;
            // What has no joints is driven by nothing.
            let drives = [Action::Zero, Action::Random(1.0)].into_iter().take(1 + system.robot.joint_count().min(1));
            for scene in system.usual_scenes() {
                let scene = system.scene(scene)?;
                cases.extend(drives.clone().map(|drive| (system.clone(), scene.clone(), drive)));
            }
        }
        Ok(cases)
    }
}

impl Experiment for Substeps {
    type Data = Enough;

    fn name(&self) -> String {
        "substeps".into()
    }

    fn seed(&self) -> u64 {
        self.seed
    }

    fn effort(&self) -> f64 {
        let (cases, policies) = (self.cases().map_or(0, |all| all.len()), self.policies().map_or(0, |all| all.len()));
        (self.starts * cases) as f64 * self.frames as f64 + (self.games * policies) as f64
    }

    fn inputs(&self) -> Result<Inputs> {
        let mut inputs = Inputs::default();
        for (system, scene, _) in self.cases()? {
            let frames = [("--starts", self.starts), ("--frames", self.frames)];
            // The states of two rollouts are kept.
            bounds::memory(&frames, 2 * 8 * system.robot.state_dim())?;
            bounds::time(&[frames[0], frames[1], ("substeps", rollouts::MOST)])?;
            inputs.add(Input::robot(&system));
            inputs.add(Input::motion(&system.name, &scene.name, &Setting::Accurate)?);
        }
        judged(&self.policies()?, &mut inputs)?;
        Ok(inputs)
    }

    fn measure(&self) -> Result<Enough> {
        let (cases, policies) = (self.cases()?, self.policies()?);
        let bar = bar("robots in scenes", cases.len() as u64);
        let mut rollouts = Vec::new();
        for (system, scene, action) in &cases {
            bar.say(&format!("{} in {}", system.name, scene.name));
            let protocol = PassiveConfig { starts: self.starts, steps: self.frames, seed: self.seed, action: *action };
            rollouts.push(rollouts::measure(system, scene, protocol, self.shake)?);
            bar.set(rollouts.len() as u64);
        }
        bar.finish();
        let games = policies.iter().map(|path| rewards::measure(path, self.games, self.seed)).collect::<Result<_>>()?;
        Ok(Enough { rollouts, games, shake: self.shake })
    }

    fn tables(&self, data: &Enough) -> Result<Vec<Table>> {
        let rewards = (!data.games.is_empty()).then(|| rewards::table(&data.games));
        Ok([rollouts::table(&data.rollouts, data.shake), rollouts::ladder(&data.rollouts)].into_iter().chain(rewards).collect())
    }

    /// By robot the scene and drive in which twice the substeps change most, beside the floor.
    fn pictures(&self, data: &Enough, stem: &Path) -> Result<()> {
        let mut series: Vec<Series> = Vec::new();
        for rows in data.rollouts.chunk_by(|a, b| a.robot == b.robot) {
            let Some(worst) = rows.iter().max_by(|a, b| a.share(&a.twice).total_cmp(&b.share(&b.twice))) else { continue };
            let word = |n: usize| if n == worst.substeps { "the truth" } else { "" };
            let points = worst.ladder.iter().map(|(n, error)| (*n as f64, error / worst.shaken.mean(), word(*n).to_string()));
            // Neither a floor of 0 nor an error of 0 has a place on a logarithmic axis.
            let points = points.filter(|p: &(f64, f64, String)| p.1 > 0.0 && p.1.is_finite());
            series.push(Series { name: format!("{}, {}, {}", worst.robot, worst.scene, worst.drive()), points: points.collect() });
        }
        let figure = Figure {
            title: "How far rollouts are from converged ones".into(),
            x: "substeps a frame".into(),
            y: format!("mean error, of that of a start shaken by {:e}", data.shake),
            series,
            front: Vec::new(),
            levels: vec![(1.0, "a shaken start".into())],
        };
        figure.save(stem)
    }
}
