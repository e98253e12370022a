//! The live simulation: environments of one robot under a solver that can be swapped. A ghost shows the truth's motion
//! of the first environment; a spring may pull a link.

use nerd_train::evaluate::{Gaps, quantities};
use nerd_train::replay::{Replay, poses};
use nerd_train::spec::{ArticulatedSpec, Method, RapierSpec};

use super::act::Act;
use super::ask::Ask;
use super::crowd::{Stick, ends};
use super::hand::Hand;
use super::menu::{Made, Menu, chosen};
use crate::prelude::*;

/// The simulation behind the live page.
pub struct World {
    pub title: String,
    menu: Menu,
    /// Number of worlds before this one. Choosing a robot, scene, policy or number of environments makes a new world.
    pub number: usize,
    act: Act,
    /// The system as loaded, without the visitor's friction changes; solvers are built for it.
    pub system: Arc<System>,
    start: Vec<f64>,
    settings: Vec<SolverSpec>,
    solver: usize,
    truth: SolverSpec,
    ghost: Option<Simulation>,
    gaps: Gaps,
    controller: Controller,
    sticks: Vec<Stick>,
    hold: bool,
    pub paused: bool,
    hand: Option<Hand>,
    frame: u64,
    /// Wall time of the last frame (us): `[solver, ghost]`.
    cost: [f64; 2],
    trouble: String,
}

#[derive(Serialize)]
pub struct Shown {
    /// Number of the world; the page reloads when it changes.
    pub number: usize,
    pub frame: u64,
    /// Link poses of the first environment's robot, then of the ghost if there is one.
    pub tracks: Vec<Vec<[f32; 7]>>,
    /// Distance between the first robot and the ghost: mean |dq| over position (m), orientation (rad) and joints.
    pub apart: Option<f64>,
    /// Wall time of a frame (us): `[solver, ghost]`.
    pub cost: [f64; 2],
    /// Index of the present solver in the page's list.
    pub solver: usize,
    pub name: String,
    /// Substeps a frame, if the solver lets them be chosen.
    pub substeps: Option<usize>,
    pub paused: bool,
    /// Whether the joints of a robot without a policy hold the default pose.
    pub hold: bool,
    /// The last error, in one line; empty if there is none.
    pub trouble: String,
}

impl World {
    pub fn of(mut menu: Menu) -> Result<Self> {
        let Made { title, act, settings } = menu.make()?;
        Ok(Self { menu, ..Self::new(&title, act, settings)? })
    }

    /// Makes a world without menu entries. Its first solver is the first of `settings`.
    pub fn new(title: &str, mut act: Act, settings: Vec<SolverSpec>) -> Result<Self> {
        let simulation = act.simulation_mut();
        let system = simulation.batch.system.clone();
        let Some(first) = settings.first() else { bail!("no solver is named") };
        simulation.solver = first.solver(&system, simulation.batch.len())?;
        Ok(Self {
            title: title.into(),
            menu: Menu { envs: simulation.batch.len(), ..Menu::default() },
            number: 0,
            start: simulation.batch.states.clone(),
            settings,
            solver: 0,
            truth: system.spec.truth.into(),
            ghost: None,
            gaps: Gaps::new(&system),
            controller: Controller::new(&system),
            sticks: Vec::new(),
            system,
            hold: true,
            paused: false,
            hand: None,
            frame: 0,
            cost: [0.0; 2],
            trouble: String::new(),
            act,
        })
    }

    /// Simulated time of a step (s): of one frame, or of one policy step.
    pub fn pace(&self) -> f64 {
        self.act.seconds()
    }

    /// Returns the page's initial data: robot and scene to draw, choices, friction coefficient and gravity (m/s^2).
    pub fn page(&mut self) -> serde_json::Value {
        let batch = &self.act.simulation().batch;
        let robot = Replay::new(&self.title, batch, self.pace());
        let many = batch.len() > 1;
        self.sticks = if many { Stick::all(&robot.shapes) } else { Vec::new() };
        let name = |own: &SolverSpec| own.asked().map_or(own.to_string(), |_| own.series().to_string());
        serde_json::json!({
            "robot": robot, "sticks": self.sticks, "solvers": self.settings.iter().map(name).collect_vec(), "menu": self.menu, "number": self.number,
            "friction": batch.system.spec.material.friction, "gravity": batch.scenes[0].gravity.norm(),
        })
    }

    /// Handles a request of the page; an error becomes [`Shown::trouble`].
    pub fn answer(&mut self, ask: Ask) {
        self.trouble.clear();
        let mut done = Ok(());
        let menu = self.menu.clone();
        match ask {
            Ask::Pause(to) => self.paused = to,
            Ask::Step => self.step(),
            Ask::Reset => done = self.reset(),
            Ask::Solver(to) => done = self.swap(to),
            Ask::Substeps(to) => done = self.divide(to),
            Ask::Ghost(to) => done = self.haunt(to),
            Ask::Hold(to) => self.hold = to,
            Ask::Friction(to) => done = self.rub(to),
            Ask::Gravity(to) => self.weigh(to),
            Ask::Drag(link, local, target) => {
                done = self.grasp(Hand { link, local: local.into(), target: target.into() })
            }
            Ask::Release => self.hand = None,
            Ask::Robot(to) => done = self.choose(Menu { robot: to, scene: None, policy: 0, ..menu }),
            Ask::Scene(to) => done = self.choose(Menu { scene: Some(to), policy: 0, ..menu }),
            Ask::Policy(to) => done = self.choose(Menu { policy: to, ..menu }),
            Ask::Envs(to) => done = self.choose(Menu { envs: to, ..menu }),
        }
        if let Err(error) = done {
            self.trouble = format!("{error:#}");
        }
    }

    /// Steps one frame, or one policy step. A solver error pauses the world.
    pub fn step(&mut self) {
        if let Err(error) = self.advance() {
            self.trouble = error.to_string();
            self.paused = true;
        }
    }

    fn advance(&mut self) -> Result<(), StepError> {
        let dt = self.act.seconds();
        let impulse = self.hand.and_then(|hand| hand.pull(&mut self.act.simulation_mut().batch, dt));
        let began = Instant::now();
        let (torques, ended) = self.act.step(self.hold.then_some(&mut self.controller))?;
        self.cost[0] = 1e6 * began.elapsed().as_secs_f64();
        self.frame = if ended { 0 } else { self.frame + 1 };
        let Some(ghost) = &mut self.ghost else { return Ok(()) };
        if ended {
            ghost.reset(0, self.act.simulation().batch.state(0));
            return Ok(());
        }
        if let (Some(impulse), Some(hand)) = (impulse, self.hand) {
            hand.push(&mut ghost.batch, |_, _, _| impulse);
        }
        let began = Instant::now();
        let joints = ghost.batch.system.robot.joint_count();
        if joints == 0 {
            ghost.step(&[])?;
        }
        torques.chunks_exact(joints.max(1)).try_for_each(|torques| ghost.step(torques))?;
        self.cost[1] = 1e6 * began.elapsed().as_secs_f64();
        Ok(())
    }

    fn reset(&mut self) -> Result<()> {
        self.act.reset(&self.start);
        self.frame = 0;
        self.hand = None;
        self.haunt(self.ghost.is_some())
    }

    fn swap(&mut self, to: usize) -> Result<()> {
        let solver = chosen("solver", &self.settings, to, 0)?.solver(&self.system, self.menu.envs)?;
        let simulation = self.act.simulation_mut();
        simulation.solver = solver;
        self.solver = to;
        simulation.batch.forces.clear();
        Ok(())
    }

    fn divide(&mut self, substeps: usize) -> Result<()> {
        let setting = match &self.settings[self.solver] {
            SolverSpec::Articulated(ArticulatedSpec { method: Method::Implicit, substeps: Some(_), .. }) => {
                SolverSpec::implicit(substeps)
            }
            SolverSpec::Rapier(own) => SolverSpec::Rapier(RapierSpec { steps: substeps, ..*own }),
            other => bail!("{other} has substeps of its own; choose another solver"),
        };
        self.settings[self.solver] = setting;
        self.swap(self.solver)
    }

    fn haunt(&mut self, to: bool) -> Result<()> {
        self.ghost = None;
        if to {
            let solver = self.truth.solver(&self.system, 1)?;
            let all = &self.act.simulation().batch;
            let mut batch = Batch::new(&all.system, &all.scenes[0], 1);
            batch.reset(0, all.state(0));
            batch.drives = all.driven(0).to_vec();
            self.ghost = Some(Simulation { batch, solver });
        }
        Ok(())
    }

    fn rub(&mut self, friction: f64) -> Result<()> {
        // Rebuilds the solvers, since they have prepared data with the old friction.
        let solvers =
            [self.settings[self.solver].solver(&self.system, self.menu.envs)?, self.truth.solver(&self.system, 1)?];
        let simulations = [Some(self.act.simulation_mut()), self.ghost.as_mut()];
        for (simulation, solver) in
            simulations.into_iter().zip(solvers).filter_map(|(simulation, solver)| Some((simulation?, solver)))
        {
            let mut system = (*simulation.batch.system).clone();
            system.spec.material.friction = friction;
            system.one_friction = Some(friction);
            simulation.batch.system = system.into();
            simulation.solver = solver;
            alter(&mut simulation.batch, |scene| {
                scene.colliders.iter_mut().for_each(|body| body.material.friction = friction)
            });
        }
        Ok(())
    }

    fn weigh(&mut self, gravity: f64) {
        let ghost = self.ghost.as_mut().map(|ghost| &mut ghost.batch);
        for batch in [Some(&mut self.act.simulation_mut().batch), ghost].into_iter().flatten() {
            alter(batch, |scene| {
                scene.gravity = scene.gravity.try_normalize(0.0).unwrap_or(-Vector3::z()) * gravity.max(1e-9)
            });
        }
    }

    fn grasp(&mut self, hand: Hand) -> Result<()> {
        let links = self.system.robot.links.len();
        if hand.link >= links {
            bail!("there is no link {}; the robot has {links}", hand.link);
        }
        self.hand = Some(hand);
        Ok(())
    }

    fn choose(&mut self, menu: Menu) -> Result<()> {
        *self = Self { number: self.number + 1, ..Self::of(menu)? };
        Ok(())
    }

    /// Returns the line ends that draw all environments but the first, as bytes.
    pub fn crowd(&self) -> Vec<u8> {
        ends(&self.act.simulation().batch, &self.sticks)
    }

    pub fn shown(&self) -> Shown {
        let batch = &self.act.simulation().batch;
        let apart = self.ghost.as_ref().map(|ghost| {
            let mut gaps = vec![0.0; quantities(&self.system).len()];
            self.gaps.between(batch.state(0), ghost.batch.state(0), &mut gaps);
            mean(&gaps)
        });
        let tracks = std::iter::once(batch).chain(self.ghost.as_ref().map(|ghost| &ghost.batch)).map(poses).collect();
        let Self { number, frame, cost, solver, paused, hold, ref trouble, .. } = *self;
        let name = self.settings[solver].to_string();
        let substeps = self.settings[solver].asked();
        Shown { number, frame, tracks, apart, cost, solver, name, substeps, paused, hold, trouble: trouble.clone() }
    }
}

/// Changes each scene of a batch once, even if consecutive environments share it.
fn alter(batch: &mut Batch, change: impl Fn(&mut Scene)) {
    let mut before: Option<[Arc<Scene>; 2]> = None;
    for scene in &mut batch.scenes {
        let altered = match &before {
            Some([old, new]) if Arc::ptr_eq(old, scene) => new.clone(),
            _ => {
                let mut new = (**scene).clone();
                change(&mut new);
                new.into()
            }
        };
        before = Some([scene.clone(), altered.clone()]);
        *scene = altered;
    }
}
