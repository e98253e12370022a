//! Robots, scenes, policies and models to choose from.

use nerd_sim::scene::WORLDS;
use nerd_tasks::named;
use nerd_train::ppo::{Actor, Running, folder};

use super::act::Act;
use crate::{prelude::*, roll::begun};

pub const MOST: usize = 4096;

/// Lists of choices, and the present choice by index.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Menu {
    pub robots: Vec<String>,
    pub scenes: Vec<String>,
    pub policies: Vec<PathBuf>,
    /// Folders of models, besides `models/ROBOT`.
    #[serde(skip)]
    pub models: Vec<PathBuf>,
    pub robot: usize,
    pub scene: Option<usize>,
    /// The policy in its task, counted from 1; 0 for none.
    pub policy: usize,
    pub envs: usize,
}

/// The robot's own scenes, then the shared ones if it has contact points; the page cannot draw the mesh of `hills`.
fn scenes(system: &System) -> Vec<String> {
    let touches = !system.robot.contact_points.is_empty();
    let worlds = WORLDS.into_iter().filter(|world| touches && *world != "hills");
    system.scene_names().into_iter().chain(worlds).map(String::from).collect()
}

pub(super) struct Made {
    pub title: String,
    pub act: Act,
    pub settings: Vec<SolverSpec>,
}

impl Menu {
    /// All that ships with the project, and the given robot, policy and models. Without `scene`: `ground`, else the
    /// first after `free` if the base is free or the robot has scenes, else `free`.
    pub fn new(robot: Option<&str>, scene: Option<&str>, policy: Option<&Path>, models: &[PathBuf]) -> Result<Self> {
        let mut robots: Vec<String> =
            [System::built_in(), System::cables()].concat().into_iter().map(String::from).collect();
        let mut policies = shipped::policies("")?;
        let place = |at: Option<usize>, end: usize| at.unwrap_or(end);
        let at = robot.map_or(0, |own| place(robots.iter().position(|robot| robot == own), robots.len()));
        robots.extend(robot.filter(|_| at == robots.len()).map(String::from));
        let plays = policy.map_or(0, |own| 1 + place(policies.iter().position(|policy| policy == own), policies.len()));
        policies.extend(policy.filter(|_| plays > policies.len()).map(PathBuf::from));
        let menu =
            Self { robots, policies, models: models.to_vec(), robot: at, policy: plays, envs: 1, ..Self::default() };
        let Some(scene) = scene else { return Ok(menu) };
        let scenes = scenes(&*System::named(&menu.robots[at])?);
        let Some(scene) = scenes.iter().position(|own| own == scene) else {
            bail!("there is no scene `{scene}`; there are {}", scenes.join(", "))
        };
        Ok(Self { scene: Some(scene), ..menu })
    }

    /// Builds the present choice, and lists its scenes.
    pub(super) fn make(&mut self) -> Result<Made> {
        let policy = match self.policy.checked_sub(1) {
            None => None,
            Some(k) => Some(
                self.policies
                    .get(k)
                    .with_context(|| format!("there is no policy {}; there are {}", k + 1, self.policies.len()))?,
            ),
        };
        let (act, system, title) = match policy {
            Some(policy) => {
                let (config, policy) = folder::load(policy)?;
                let arena = Arena::from(named(&config.task)?.system()?.spec.truth);
                let episodes = arena.episodes(&config.task, self.envs, 0)?;
                let (system, running) =
                    (episodes.simulation.batch.system.clone(), Running::new(&episodes, policy.shape.stack));
                (self.scenes, self.scene) = (Vec::new(), None);
                (Act::Policy(Box::new((episodes, running, Actor::new(policy)))), system, config.task)
            }
            None => {
                let Some(robot) = self.robots.get(self.robot) else {
                    bail!("there is no robot {}; there are {}", self.robot, self.robots.len())
                };
                let system = System::named(robot)?;
                let own = system.scene_names().len();
                self.scenes = scenes(&system);
                let usual = self
                    .scenes
                    .iter()
                    .position(|scene| scene == "ground")
                    .unwrap_or((system.robot.floating() || own > 1).into());
                let at = *self.scene.get_or_insert(usual.min(self.scenes.len() - 1));
                let Some(name) = self.scenes.get(at) else {
                    bail!("there is no scene {at}; there are {}", self.scenes.len())
                };
                let scene = system.scene(name)?;
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
