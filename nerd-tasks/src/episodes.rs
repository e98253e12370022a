//! Batches of episodes of one task on any solver.
//!
//! A step is [`crate::Task::frames`] frames, each one call of the solver for all environments. Every episode draws from
//! its ChaCha8 stream, keyed by (seed, environment, episode), so results depend on neither threads nor other
//! environments.

mod begin;

use nerd_sim::disturb::{blurred, pushed};
use nerd_sim::prelude::*;
use rayon::prelude::*;

use crate::snapshot::{MOVED, Past};
use crate::step::{CHUNK, StepResult, episode, rows, view};
use crate::{Compiled, Snapshot, Task, Trace, View, Work};

/// A coordinate (m, rad) or velocity (m/s, rad/s) beyond this is a failure and ends the episode.
const FAR: f64 = 1e5;

/// Episodes of one task in every environment of a simulation. Ended episodes restart at once.
pub struct Episodes {
    /// The task, recorded for the simulation's robot.
    pub task: Compiled,
    /// The simulation, with any solver.
    pub simulation: Simulation,
    seed: u64,
    /// Index of this object's first environment within a larger set of environments.
    first: usize,
    begun: Vec<u64>,
    goals: Vec<f64>,
    torques: Vec<f64>,
    works: Vec<Work>,
    observations: Vec<f64>,
    past: Past,
    trace: Option<Trace>,
    /// Whether the terrain's level changes between episodes.
    climbs: bool,
    /// Reason of the first solver failure that ended an episode.
    pub fault: Option<String>,
}

impl Episodes {
    /// Starts an episode in every environment.
    ///
    /// # Panics
    /// If the simulation has another robot than the task.
    pub fn new(task: Box<dyn Task>, simulation: Simulation, seed: u64) -> Self {
        Self::part(task, simulation, seed, 0)
    }

    /// Starts episodes in the environments from `first` on of a larger set. An environment's episodes here are the same
    /// as within that set.
    ///
    /// # Panics
    /// As [`Episodes::new`].
    pub fn part(task: Box<dyn Task>, simulation: Simulation, seed: u64, first: usize) -> Self {
        let n = simulation.batch.len();
        let system = simulation.batch.system.clone();
        let task = Compiled::new(task, &system);
        let mut episodes = Self {
            seed,
            first,
            begun: vec![0; n],
            goals: vec![0.0; n * task.goal_dim()],
            torques: vec![0.0; n * system.robot.joint_count()],
            works: (0..n.div_ceil(CHUNK)).map(|_| Work::new(&system)).collect(),
            observations: vec![0.0; n * task.observation_dim()],
            past: Past::for_lag(&system),
            trace: None,
            climbs: false,
            fault: None,
            task,
            simulation,
        };
        if episodes.task.controlled() {
            episodes.simulation.serve();
        }
        (0..n).for_each(|env| episodes.start(env));
        episodes.observe(|_| true);
        episodes
    }

    /// Keeps the last `frames` frames for [`Self::snapshot`]. This should be the number of frames on which the solver's
    /// next step depends: the receptive field of a network; 0 for an analytic solver.
    pub fn remember(&mut self, frames: usize) {
        self.past.most = frames.max(Past::for_lag(&self.simulation.batch.system).most);
    }

    /// Starts recording all frames; returns the frames recorded so far.
    pub fn trace(&mut self) -> Trace {
        self.trace.replace(Trace::default()).unwrap_or_default()
    }

    /// Seed, and index of the first environment. With [`Snapshot::begun`] these determine the next random draws.
    pub fn draws(&self) -> (u64, usize) {
        (self.seed, self.first)
    }

    /// Number of frames kept, see [`Self::remember`].
    pub fn remembered(&self) -> usize {
        self.past.most
    }

    /// Number of environments.
    pub fn len(&self) -> usize {
        self.begun.len()
    }

    /// Whether there are no environments.
    pub fn is_empty(&self) -> bool {
        self.begun.is_empty()
    }

    /// Observations `[env][observation_dim]` of the present states. After a reset the observations show the start
    /// state.
    pub fn observations(&self) -> &[f64] {
        &self.observations
    }

    /// The task's view of one environment.
    pub fn view(&self, env: usize) -> View<'_> {
        view(&self.simulation.batch, &self.goals, self.task.goal_dim(), env)
    }

    /// One step under `actions` (`[env][action_dim]`).
    ///
    /// # Errors
    /// If the number of actions is wrong, the solver as a whole fails, or the task has a size of 0. Also if an
    /// observation or reward is not finite.
    pub fn step(&mut self, actions: &[f64]) -> Result<StepResult, StepError> {
        let n = self.len();
        let width = self.task.action_dim();
        if actions.len() != n * width {
            return Err(StepError::Solver(format!("{} actions for {n} environments of {width} each", actions.len())));
        }
        self.task.check().map_err(StepError::Solver)?;
        // The actions were computed from the present observations, so check the observations too.
        self.finite("observe", &self.observations)?;
        let mut failed = vec![false; n];
        for _ in 0..self.task.frames() {
            self.push();
            self.act(actions);
            self.frame(&mut failed)?;
        }
        self.done(actions);
        let d = self.simulation.batch.system.robot.state_dim();
        let states = self.simulation.batch.states.par_chunks_exact(d).with_min_len(CHUNK);
        failed.par_iter_mut().zip(states).for_each(|(failed, state)| *failed |= state.iter().any(|x| x.abs() > FAR));
        if self.fault.is_none() && failed.contains(&true) {
            self.fault = Some(format!("a coordinate or its rate passed {FAR:e}"));
        }
        let mut result = StepResult::default();
        (0..n).filter(|env| failed[*env]).for_each(|env| self.start(env));
        self.judge(&failed, &mut result);
        self.finite("reward", &result.rewards)?;
        self.rise(&result);
        self.observe(|_| true);
        self.finite("observe", &self.observations)?;
        if let Some(trace) = &mut self.trace {
            let states = self.simulation.batch.states.chunks_exact(d).zip(&failed);
            trace
                .reached
                .extend(states.flat_map(|(state, failed)| state.iter().map(|x| if *failed { f64::NAN } else { *x })));
        }
        result.reached = self.observations.par_iter().with_min_len(MOVED).copied().collect();
        result.failed = failed;
        let ended = |env: usize| result.terminated[env] || result.truncated[env];
        (0..n).filter(|env| ended(*env)).for_each(|env| self.start(env));
        self.observe(ended);
        Ok(result)
    }

    /// The state of all episodes: everything that later steps depend on.
    pub fn snapshot(&self) -> Snapshot {
        let batch = &self.simulation.batch;
        let (states, frames) = (batch.states.clone(), batch.frames.clone());
        let mut snapshot =
            Snapshot { states, frames, goals: self.goals.clone(), begun: self.begun.clone(), ..Default::default() };
        self.past.write(&mut snapshot);
        snapshot
    }

    /// Continues from a snapshot with the same task and the same number of environments.
    ///
    /// # Errors
    /// If sizes differ, or the solver fails while it replays the snapshot's frames.
    pub fn restore(&mut self, snapshot: &Snapshot) -> Result<(), StepError> {
        let batch = &mut self.simulation.batch;
        let fits = (batch.states.len(), batch.frames.len(), self.goals.len(), self.begun.len());
        let found = (snapshot.states.len(), snapshot.frames.len(), snapshot.goals.len(), snapshot.begun.len());
        if found != fits {
            return Err(StepError::Solver(format!(
                "a snapshot of {found:?} numbers (states, frames, goals, episodes), not of {fits:?}"
            )));
        }
        batch.states.copy_from_slice(&snapshot.states);
        batch.frames.copy_from_slice(&snapshot.frames);
        self.goals.copy_from_slice(&snapshot.goals);
        self.begun.copy_from_slice(&snapshot.begun);
        (0..self.begun.len()).for_each(|env| self.lay(env, true));
        self.past.read(snapshot, self.torques.len() / self.begun.len().max(1));
        (0..self.begun.len()).for_each(|env| self.simulation.solver.reset(env));
        self.past.replay(&mut self.simulation)?;
        self.observe(|_| true);
        Ok(())
    }

    /// Refuses results of the task (`[env][width]`) that are not finite.
    fn finite(&self, method: &str, numbers: &[f64]) -> Result<(), StepError> {
        let Some(at) = numbers.par_iter().with_min_len(MOVED).position_first(|x| !x.is_finite()) else { return Ok(()) };
        let width = numbers.len() / self.len();
        let task = self.task.name();
        let env = self.first + at / width;
        let entry = at % width;
        Err(StepError::Solver(format!(
            "task `{task}`, environment {env}: its `{method}` gives {} as entry {entry}, or leaves it out",
            numbers[at]
        )))
    }

    pub(crate) fn done(&mut self, actions: &[f64]) {
        let task = &self.task;
        let width = self.task.action_dim();
        if task.memory() > 0 {
            let goals = self.goals.chunks_exact_mut(task.goal_dim()).zip(actions.chunks_exact(width));
            goals.for_each(|(goal, action)| task.remember(goal, action));
        }
    }

    /// Applies random pushes to the robots of a family with pushes.
    fn push(&mut self) {
        let Self { simulation: Simulation { batch, .. }, seed, first, begun, .. } = self;
        if batch.systems.is_empty() || !batch.system.pushed() {
            return;
        }
        for (env, begun) in begun.iter().enumerate() {
            let own = batch.of(env).clone();
            let frame = batch.frames[env];
            pushed(&own, batch.state_mut(env), frame, episode(*seed, *first + env, *begun));
        }
    }

    pub(crate) fn act(&mut self, actions: &[f64]) -> &[f64] {
        let servo = self.task.controlled() && self.simulation.serve();
        self.works.iter_mut().for_each(|work| work.controller.servo = servo);
        let task = &self.task;
        let batch = &self.simulation.batch;
        let goals = &*self.goals;
        let width = task.action_dim();
        let joints = batch.system.robot.joint_count();
        rows(&mut self.torques, joints, &mut self.works, |env, torques, work| {
            work.controller.turn_to(batch.of(env));
            task.act(view(batch, goals, task.goal_dim(), env), &actions[env * width..(env + 1) * width], work, torques);
        });
        &self.torques
    }

    /// Steps one frame. An environment that cannot be stepped is marked in `failed` and restarted; the others are
    /// stepped. Failure in the first frame of an episode is an error.
    pub(crate) fn frame(&mut self, failed: &mut [bool]) -> Result<(), StepError> {
        self.past.push(&self.simulation.batch.states, &self.torques);
        if let Some(trace) = &mut self.trace {
            trace.states.extend_from_slice(&self.simulation.batch.states);
            trace.goals.extend_from_slice(&self.goals);
            trace.torques.extend_from_slice(&self.torques);
        }
        let stepped = self.simulation.step(&self.torques);
        let width = self.task.goal_dim();
        self.goals.chunks_exact_mut(width.max(1)).for_each(|goal| self.task.advance(goal));
        if let Err(error) = stepped {
            for fault in error.faults()? {
                // Restarting after start states that cannot be stepped would loop for ever.
                if fault.frame == 0 && !failed[fault.env] {
                    return Err(StepError::Environments(vec![fault]));
                }
                failed[fault.env] = true;
                self.fault.get_or_insert(fault.reason);
                self.start(fault.env);
            }
        }
        Ok(())
    }

    /// Appends the rewards, terms, errors and ends at the states reached to `result`.
    fn judge(&mut self, failed: &[bool], result: &mut StepResult) {
        let task = &self.task;
        let batch = &self.simulation.batch;
        let goals = &*self.goals;
        let torques = &*self.torques;
        let joints = batch.system.robot.joint_count();
        let length = task.episode_length() * task.frames();
        let chunks = self.works.par_iter_mut().enumerate().map(|(chunk, work)| {
            let envs = chunk * CHUNK..(chunk * CHUNK + CHUNK).min(failed.len());
            let judged = envs.map(|env| {
                if failed[env] {
                    return (vec![0.0; 1 + task.terms().len()], true, false, None);
                }
                let view = view(batch, goals, task.goal_dim(), env);
                let terminated = task.terminated(view, work);
                let rewards = task.rewards(view, &torques[env * joints..(env + 1) * joints], work);
                (rewards, terminated, !terminated && batch.frames[env] >= length, task.error(view, work))
            });
            judged.collect::<Vec<_>>()
        });
        for (rewards, terminated, truncated, error) in chunks.collect::<Vec<_>>().into_iter().flatten() {
            result.rewards.push(rewards[0]);
            result.terms.extend(&rewards[1..]);
            result.terminated.push(terminated);
            result.truncated.push(truncated);
            result.errors.push(error);
        }
    }

    /// Writes the observations of the environments in `some`, with the delay and noise of their sensors.
    fn observe(&mut self, some: impl Fn(usize) -> bool + Sync) {
        let Self {
            task,
            simulation: Simulation { batch, .. },
            goals,
            observations,
            works,
            past,
            seed,
            first,
            begun,
            ..
        } = self;
        let sensed = !batch.systems.is_empty() && batch.system.sensed();
        rows(observations, task.observation_dim(), works, |env, row, work| {
            if !some(env) {
                return;
            }
            let now = view(batch, goals, task.goal_dim(), env);
            if !sensed {
                return task.observe(now, work, row);
            }
            let own = batch.of(env);
            let frame = batch.frames[env];
            let late = (own.motors.lag.round() as u64).min(frame);
            let mut state = past.ago(late as usize, env, now.state.len()).unwrap_or(now.state).to_vec();
            blurred(own, &mut state, frame - late, episode(*seed, *first + env, begun[env]));
            task.observe(View { state: &state, ..now }, work, row);
        });
    }
}
