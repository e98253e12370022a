//! The live page's choices: robots, scenes, policies and models.

use nerd_sim::scene::WORLDS;
use nerd_tasks::named;
use nerd_train::ppo::{Actor, Running, folder};

use super::act::Act;
use crate::{prelude::*, roll::begun};

pub const MOST: usize = 4096;

/// Lists of choices, and the present choice as indices into them.
#[derive(Clone, Default, Serialize)]
pub struct Menu {
    pub robots: Vec<String>,
    pub scenes: Vec<String>,
    pub policies: Vec<PathBuf>,
    /// Folders of models to choose from, besides `models/ROBOT`.
    #[serde(skip)]
    pub models: Vec<PathBuf>,
    pub robot: usize,
    pub scene: Option<usize>,
    /// Number of the chosen policy in `policies`, counted from 1; 0 for none.
    pub policy: usize,
    pub envs: usize,
}

/// Lists the robot's own scenes, then the shared ones if the robot has contact points. Leaves out `hills`, whose mesh
/// the page cannot draw.
fn scenes(system: &System) -> Vec<String> {
    let touches = !system.robot.contact_points.is_empty();
    let worlds = WORLDS.into_iter().filter(|world| touches && *world != "hills");
    system.scene_names().into_iter().chain(worlds).map(String::from).collect()
}

/// Returns the index of `own` in a list; appends it if it is new.
fn place<T: PartialEq>(all: &mut Vec<T>, own: T) -> usize {
    let at = all.iter().position(|one| *one == own).unwrap_or(all.len());
    if at == all.len() {
        all.push(own);
    }
    at
}

pub(super) struct Made {
    pub title: String,
    pub act: Act,
    pub settings: Vec<SolverSpec>,
}

/// Returns entry `k` of a list, counted from 0; the error counts from `first`.
pub(super) fn chosen<'a, T>(what: &str, all: &'a [T], k: usize, first: usize) -> Result<&'a T> {
    all.get(k).with_context(|| format!("there is no {what} {}; there are {}", k + first, all.len()))
}

impl Menu {
    /// Lists all that ships with the project, and the given robot, policy and models. Without `scene`, the scene is
    /// `ground` if the robot has it. Else it is `free`, or the next scene if the base is floating or the robot has
    /// scenes of its own.
    pub fn new(robot: Option<&str>, scene: Option<&str>, policy: Option<&Path>, models: &[PathBuf]) -> Result<Self> {
        let mut robots = [System::built_in(), System::cables()].concat().into_iter().map(String::from).collect_vec();
        let mut policies = shipped::policies("")?;
        let at = robot.map_or(0, |own| place(&mut robots, own.into()));
        let plays = policy.map_or(0, |own| 1 + place(&mut policies, own.into()));
        let menu =
            Self { robots, policies, models: models.to_vec(), robot: at, policy: plays, envs: 1, ..Self::default() };
        let Some(scene) = scene else { return Ok(menu) };
        let scenes = scenes(&*System::named(&menu.robots[at])?);
        let Some(scene) = scenes.iter().position(|own| own == scene) else {
            bail!("there is no scene `{scene}`; there are {}", scenes.join(", "))
        };
        Ok(Self { scene: Some(scene), ..menu })
    }

    /// Builds the simulation of the present choice, and lists its robot's scenes.
    pub(super) fn make(&mut self) -> Result<Made> {
        let (act, system, title) = match self.policy.checked_sub(1) {
            Some(k) => {
                let (config, policy) = folder::load(chosen("policy", &self.policies, k, 1)?)?;
                let arena = Arena::from(named(&config.task)?.system()?.spec.truth);
                let episodes = arena.episodes(&config.task, self.envs, 0)?;
                let system = episodes.simulation.batch.system.clone();
                let running = Running::new(&episodes, policy.shape.stack);
                self.scenes = Vec::new();
                self.scene = None;
                (Act::Policy(Box::new((episodes, running, Actor::new(policy)))), system, config.task)
            }
            None => {
                let system = System::named(chosen("robot", &self.robots, self.robot, 0)?)?;
                let own = system.scene_names().len();
                self.scenes = scenes(&system);
                let usual = self
                    .scenes
                    .iter()
                    .position(|scene| scene == "ground")
                    .unwrap_or((system.robot.floating() || own > 1).into());
                let at = *self.scene.get_or_insert(usual.min(self.scenes.len() - 1));
                let scene = system.scene(chosen("scene", &self.scenes, at, 0)?)?;
                let mut batch = begun(&system, &scene, self.envs, Start::Reset, 0);
                batch.reset(0, &system.default_state());
                let title = format!("{} in {}", system.name, scene.name);
                (
                    Act::Alone(Simulation::new(batch, Articulated::new(ArticulatedConfig::accurate(&system)))),
                    system,
                    title,
                )
            }
        };
        let shipped = Some(shipped::model(system.spec.truth, &system.name)).filter(|folder| folder.exists());
        let models = shipped.into_iter().chain(self.models.iter().cloned()).map(SolverSpec::neural);
        let settings = [system.spec.truth.into(), SolverSpec::implicit(1), SolverSpec::rapier(4)]
            .into_iter()
            .chain(models)
            .collect();
        Ok(Made { title, act, settings })
    }
}
