//! One robot under a solver that can be swapped, its truth as a ghost, and a hand that pulls at a link.

use nalgebra::{DMatrix, Matrix3};
use nerd_core::{dynamics::Axes, robot::FixedFrame};
use nerd_tasks::Episodes;
use nerd_train::evaluate::{Gaps, quantities};
use nerd_train::ppo::{Actor, Running};
use nerd_train::replay::{Replay, poses};

use super::Ask;
use crate::prelude::*;

/// Stiffness of the hand over the robot's mass (1/s^2); its damping is critical for that mass. It is as strong at the end of a toe, so it is
/// stepped implicitly.
const PULL: f64 = 60.0;

/// Who gives the torques.
pub enum Act {
    /// Nobody, or the robot's own law towards its rest pose.
    Alone(Simulation),
    /// A policy in its task.
    Policy(Box<(Episodes, Running, Actor)>),
}

impl Act {
    fn simulation(&mut self) -> &mut Simulation {
        match self {
            Self::Alone(simulation) => simulation,
            Self::Policy(played) => &mut played.0.simulation,
        }
    }

    fn seconds(&self) -> f64 {
        match self {
            Self::Alone(simulation) => simulation.batch.system.frame_time,
            Self::Policy(played) => played.0.simulation.batch.system.frame_time * played.0.task.frames() as f64,
        }
    }
}

/// What is shown, and does as it is asked.
pub struct World {
    act: Act,
    /// As it was read: solvers are made for it, whatever friction it has now.
    system: Arc<System>,
    start: Vec<f64>,
    settings: Vec<Setting>,
    solver: usize,
    truth: Setting,
    ghost: Option<Simulation>,
    gaps: Gaps,
    controller: Controller,
    hold: bool,
    paused: bool,
    pull: Option<(usize, Vector3<f64>, Vector3<f64>)>,
    frame: u64,
    /// Microseconds of the last frame: of the solver, of the ghost.
    cost: [f64; 2],
    trouble: String,
}

/// The latest frame, for the page.
#[derive(Clone, Debug, Serialize)]
pub struct Shown {
    /// Frames since the start.
    pub frame: u64,
    /// Poses by link: of the robot, and of its ghost if there is one.
    pub tracks: Vec<Vec<[f32; 7]>>,
    /// Distance of the ghost: mean |dq| over position, orientation and joints (m and rad), as `evaluate` has it.
    pub apart: Option<f64>,
    /// Microseconds a frame: of the solver, of the ghost.
    pub cost: [f64; 2],
    /// Place of the solver in the list.
    pub solver: usize,
    /// Whether it stands still.
    pub paused: bool,
    /// Whether joints without a policy hold the rest pose.
    pub hold: bool,
    /// What went wrong last, in a line.
    pub trouble: String,
}

impl World {
    /// A world that begins with the first of `settings`.
    ///
    /// # Errors
    /// If that solver cannot be made.
    pub fn new(mut act: Act, settings: Vec<Setting>) -> Result<Self> {
        let simulation = act.simulation();
        let system = simulation.batch.system.clone();
        let Some(first) = settings.first() else { bail!("no solver is named") };
        simulation.solver = first.solver(&system)?;
        Ok(Self {
            start: simulation.batch.states.clone(),
            settings,
            solver: 0,
            truth: system.spec.truth.into(),
            ghost: None,
            gaps: Gaps::new(&system),
            controller: Controller::new(&system),
            system,
            hold: true,
            paused: false,
            pull: None,
            frame: 0,
            cost: [0.0; 2],
            trouble: String::new(),
            act,
        })
    }

    /// Seconds from one look to the next: a frame, or a policy's step.
    pub fn pace(&self) -> f64 {
        self.act.seconds()
    }

    /// What the page begins with: robot and scene for the painter, names of the solvers, friction and gravity (m/s^2).
    pub fn page(&mut self, title: &str) -> serde_json::Value {
        let pace = self.pace();
        let solvers: Vec<_> = self.settings.iter().map(ToString::to_string).collect();
        let batch = &self.act.simulation().batch;
        let (friction, gravity) = (batch.system.spec.material.friction, batch.scenes[0].gravity.norm());
        serde_json::json!({ "robot": Replay::new(title, batch, pace), "solvers": solvers, "friction": friction, "gravity": gravity })
    }

    /// Whether it stands still.
    pub fn paused(&self) -> bool {
        self.paused
    }

    /// Does what is asked; what cannot be done is said in [`Shown::trouble`].
    pub fn answer(&mut self, ask: Ask) {
        self.trouble.clear();
        let mut done = Ok(());
        match ask {
            Ask::Pause { to } => self.paused = to,
            Ask::Step {} => self.step(),
            Ask::Reset {} => done = self.reset(),
            Ask::Solver { to } => done = self.swap(to),
            Ask::Ghost { to } => done = self.haunt(to),
            Ask::Hold { to } => self.hold = to,
            Ask::Friction { to } => done = self.rub(to),
            Ask::Gravity { to } => self.weigh(to),
            Ask::Drag { link, local, target } => done = self.grasp(link, local.into(), target.into()),
            Ask::Release {} => self.pull = None,
        }
        if let Err(error) = done {
            self.trouble = format!("{error:#}");
        }
    }

    /// One frame, or a policy's step. A solver that cannot go on stops the world.
    pub fn step(&mut self) {
        if let Err(error) = self.advance() {
            (self.trouble, self.paused) = (error.to_string(), true);
        }
    }

    fn advance(&mut self) -> Result<(), StepError> {
        let pulled = self.pulled();
        let began = Instant::now();
        let torques = match &mut self.act {
            Act::Alone(simulation) => {
                let mut torques = vec![0.0; simulation.batch.system.robot.joint_count()];
                if self.hold {
                    let rest = vec![0.0; torques.len()];
                    self.controller.torques(simulation.batch.state(0), &rest, &mut torques);
                }
                simulation.step(&torques)?;
                torques
            }
            Act::Policy(played) => {
                let (episodes, running, actor) = &mut **played;
                let actions = actor.mean(&running.stack.rows);
                let (_, ended) = running.step(episodes, &actions, &mut Vec::new())?;
                let torques = episodes.trace().torques;
                if !ended.is_empty() {
                    if let Some(ghost) = &mut self.ghost {
                        ghost.reset(0, episodes.simulation.batch.state(0));
                    }
                    self.frame = 0;
                    return Ok(());
                }
                torques
            }
        };
        self.cost[0] = 1e6 * began.elapsed().as_secs_f64();
        self.frame += 1;
        let Some(ghost) = &mut self.ghost else { return Ok(()) };
        if let (Some(impulse), Some((link, local, _))) = (pulled, self.pull) {
            push(&mut ghost.batch, link, local, |_, _, _| impulse);
        }
        let began = Instant::now();
        let joints = ghost.batch.system.robot.joint_count().max(1);
        if torques.is_empty() {
            ghost.step(&[])?;
        }
        torques.chunks_exact(joints).try_for_each(|torques| ghost.step(torques))?;
        self.cost[1] = 1e6 * began.elapsed().as_secs_f64();
        Ok(())
    }

    /// The hand's push at the robot before the frame; its impulse (N s), so that the ghost feels the same.
    fn pulled(&mut self) -> Option<Vector3<f64>> {
        let ((link, local, target), dt) = (self.pull?, self.act.seconds());
        let mass: f64 = self.system.robot.links.iter().map(|l| l.inertia.mass).sum();
        // p = dt m (k (target - x - dt v') - c v') with v' = v + G p, for p.
        let (spring, damper) = (dt * mass * PULL, dt * mass * (PULL * dt + 2.0 * PULL.sqrt()));
        let hand = |place: Vector3<f64>, speed: Vector3<f64>, gives: Matrix3<f64>| {
            let lhs = Matrix3::identity() + gives * damper;
            lhs.lu().solve(&((target - place) * spring - speed * damper)).unwrap_or_default()
        };
        push(&mut self.act.simulation().batch, link, local, hand)
    }

    fn reset(&mut self) -> Result<()> {
        match &mut self.act {
            Act::Alone(simulation) => simulation.reset(0, &self.start),
            Act::Policy(played) => {
                let (episodes, running, actor) = &mut **played;
                episodes.begin(0)?;
                *running = Running::new(episodes, actor.policy.shape.stack);
            }
        }
        (self.frame, self.pull) = (0, None);
        self.haunt(self.ghost.is_some())
    }

    fn swap(&mut self, to: usize) -> Result<()> {
        let Some(setting) = self.settings.get(to) else { bail!("there is no solver {to}; there are {}", self.settings.len()) };
        let solver = setting.solver(&self.system)?;
        let simulation = self.act.simulation();
        (simulation.solver, self.solver) = (solver, to);
        simulation.batch.forces.clear();
        Ok(())
    }

    fn haunt(&mut self, to: bool) -> Result<()> {
        self.ghost = None;
        if to {
            let solver = self.truth.solver(&self.system)?;
            let batch = Batch { forces: Vec::new(), ..self.act.simulation().batch.clone() };
            self.ghost = Some(Simulation { batch, solver });
        }
        Ok(())
    }

    fn rub(&mut self, friction: f64) -> Result<()> {
        // What solvers have prepared is of the old friction.
        let solvers = [self.settings[self.solver].solver(&self.system)?, self.truth.solver(&self.system)?];
        let simulations = [Some(self.act.simulation()), self.ghost.as_mut()];
        for (simulation, solver) in simulations.into_iter().zip(solvers).filter_map(|(simulation, solver)| Some((simulation?, solver))) {
            let batch = &mut simulation.batch;
            let (mut system, mut scene) = ((*batch.system).clone(), (*batch.scenes[0]).clone());
            system.spec.material.friction = friction;
            scene.colliders.iter_mut().for_each(|body| body.material.friction = friction);
            (batch.system, batch.scenes[0], simulation.solver) = (system.into(), scene.into(), solver);
        }
        Ok(())
    }

    fn weigh(&mut self, gravity: f64) {
        let ghost = self.ghost.as_mut().map(|ghost| &mut ghost.batch);
        for batch in [Some(&mut self.act.simulation().batch), ghost].into_iter().flatten() {
            let mut scene = (*batch.scenes[0]).clone();
            let down = scene.gravity.try_normalize(0.0).unwrap_or(-Vector3::z());
            scene.gravity = down * gravity.max(1e-9);
            batch.scenes[0] = scene.into();
        }
    }

    fn grasp(&mut self, link: usize, local: Vector3<f64>, target: Vector3<f64>) -> Result<()> {
        let links = self.act.simulation().batch.system.robot.links.len();
        if link >= links {
            bail!("there is no link {link}; the robot has {links}");
        }
        self.pull = Some((link, local, target));
        Ok(())
    }

    /// As it is now.
    pub fn shown(&mut self) -> Shown {
        let now = self.act.simulation().batch.states.clone();
        let apart = self.ghost.as_ref().map(|ghost| {
            let mut gaps = vec![0.0; quantities(&ghost.batch.system).len()];
            self.gaps.between(&now, ghost.batch.state(0), &mut gaps);
            mean(&gaps)
        });
        let batch = &self.act.simulation().batch;
        let tracks = std::iter::once(batch).chain(self.ghost.as_ref().map(|ghost| &ghost.batch)).map(poses).collect();
        let Self { frame, cost, solver, paused, hold, ref trouble, .. } = *self;
        Shown { frame, tracks, apart, cost, solver, paused, hold, trouble: trouble.clone() }
    }
}

/// A place on a link.
fn fixed(link: usize, local: Vector3<f64>) -> FixedFrame {
    FixedFrame { name: String::new(), link: Some(link), pose: Isometry3::from_parts(local.into(), Default::default()) }
}

/// Pushes at a point of a link (m, its axes) with the impulse (N s, world axes) that `hand` says of its place, its velocity and how much velocity
/// an impulse there gives: velocities change by `M^-1 J^T impulse`, so any solver feels it. None where the mass matrix cannot be solved.
fn push(
    batch: &mut Batch,
    link: usize,
    local: Vector3<f64>,
    hand: impl FnOnce(Vector3<f64>, Vector3<f64>, Matrix3<f64>) -> Vector3<f64>,
) -> Option<Vector3<f64>> {
    let system = batch.system.clone();
    let (robot, mut data, frame) = (&system.robot, system.data(), fixed(link, local));
    let place = robot.pose(batch.state(0), &frame).translation.vector;
    let (q, qd) = robot.split_mut(batch.state_mut(0));
    let jacobian: DMatrix<f64> = data.jacobian(robot, q, &frame, Axes::World).rows(3, 3).into_owned();
    let moves = data.mass_matrix(robot, q).clone().cholesky()?.solve(&jacobian.transpose());
    let gives: Matrix3<f64> = (&jacobian * &moves).fixed_view::<3, 3>(0, 0).into();
    let mut velocity = qd.into_local(robot, q);
    let speed = Vector3::from_iterator(jacobian.row_iter().map(|row| row.iter().zip(velocity.0.iter()).map(|(a, b)| a * b).sum::<f64>()));
    let impulse = hand(place, speed, gives);
    velocity.accelerate((moves * impulse).iter(), 1.0);
    velocity.into_twist(robot, q);
    Some(impulse)
}
