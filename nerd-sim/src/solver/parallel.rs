//! The batch loop of the analytic solvers. Environments are independent, and each is stepped by one thread, so results
//! do not depend on the number of threads.

use std::sync::{Mutex, PoisonError};

use nerd_core::state::wrap_state;
use rayon::prelude::*;

use super::check::{finish, gone, sound};
use super::refusal::{Fault, Gradients};
use crate::prelude::*;

/// Working memory that advances one environment at a time by one frame; it carries nothing over to the next frame.
pub(crate) trait Frame: Send + Sized {
    type Config: Sync;
    /// Data precomputed from a robot's parameters.
    type Prepared: Send + Sync;
    /// Environments that a thread steps in sequence.
    const CHUNK: usize;
    /// Whether the solver supports drives inside the frame, and reports contact forces.
    const DRIVEN: bool = false;

    /// Precomputes the data of a system; the error says why it cannot be simulated.
    fn prepare(system: &System) -> Result<Arc<Self::Prepared>, String>;

    /// Creates working memory for a system, and for all systems that differ from it only in parameters.
    fn new(system: &System, prepared: Arc<Self::Prepared>) -> Self;

    /// Switches to the precomputed data of the next system.
    fn turn_to(&mut self, prepared: &Arc<Self::Prepared>);

    /// Advances `state` under joint torques `tau`; the error is the reason of a failure.
    fn step(
        &mut self,
        system: &System,
        scene: &Scene,
        config: &Self::Config,
        state: &mut [f64],
        tau: &[f64],
    ) -> Result<(), String>;

    /// Sets the drives of the next environment, and whether its torques are servo commands.
    fn drive(&mut self, _drives: &[Drive], _servo: bool) {}

    /// Mean force (N) on each contact point over the last frame, world axes.
    fn forces(&self) -> &[Vector3<f64>] {
        &[]
    }
}

/// A frame with a vector-Jacobian product.
pub(crate) trait Back: Frame {
    /// Steps as [`Frame::step`], and multiplies gradients `[row][2 nv]` with respect to the next state by the frame's
    /// Jacobian. Results are gradients with respect to state, torques and, if `numbers`, parameters of robot and scene.
    #[allow(clippy::too_many_arguments)]
    fn back(
        &mut self,
        system: &System,
        scene: &Scene,
        config: &Self::Config,
        state: &[f64],
        tau: &[f64],
        grad_next: &[f64],
        numbers: bool,
    ) -> Result<Gradients, String>;
}

/// Steps the environments of a batch in chunks. Allocates in its first step, and when the batch grows or its robot
/// changes.
pub(crate) struct Parallel<F: Frame> {
    /// Precomputed data of the batch's robot; `own`: of each environment's robot, if robots differ.
    prepared: Option<Prepared<F>>,
    own: Vec<Prepared<F>>,
    frames: Vec<F>,
    next: Vec<f64>,
    /// Dummy contact forces, one per chunk, for robots or solvers without contact forces.
    none: Vec<Vector3<f64>>,
    faults: Mutex<Vec<Fault>>,
}

/// A system and its precomputed data.
type Prepared<F> = (Arc<System>, Arc<<F as Frame>::Prepared>);

/// Index, states, forces and working memory of a chunk.
type Chunk<'a, F> = (usize, ((&'a mut [f64], &'a mut [Vector3<f64>]), &'a mut F));

impl<F: Frame> Parallel<F> {
    pub(crate) const CAPABILITIES: Capabilities = Capabilities { drives: F::DRIVEN, forces: F::DRIVEN, systems: true };

    pub(crate) fn new() -> Self {
        Self {
            prepared: None,
            own: Vec::new(),
            frames: Vec::new(),
            next: Vec::new(),
            none: Vec::new(),
            faults: Mutex::default(),
        }
    }

    /// Steps every environment without a fault by one frame; see [`crate::solver::Solver::step`].
    pub(crate) fn step(&mut self, config: &F::Config, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        Self::CAPABILITIES.admit(batch)?;
        sound(batch, torques, self.faults.get_mut().unwrap_or_else(PoisonError::into_inner))?;
        self.prepare(batch).map_err(StepError::Solver)?;
        let system = &*batch.system;
        let d = system.robot.state_dim();
        let joints = system.robot.joint_count();
        let chunks = batch.len().div_ceil(F::CHUNK);
        let own = &self.own;
        // Take the forces out of the batch, since all threads read the batch.
        let mut forces = std::mem::take(&mut batch.forces);
        let points = if F::DRIVEN { system.robot.contact_points.len() } else { 0 };
        forces.resize(batch.len() * points, Vector3::zeros());
        let width = (F::CHUNK * points).max(1);
        self.none.resize(chunks, Vector3::zeros());
        let reported = if points > 0 { &mut forces[..] } else { &mut self.none[..] };
        self.next.clone_from(&batch.states);
        // Environments with invalid inputs are not stepped.
        let faults = self.faults.get_mut().unwrap_or_else(PoisonError::into_inner);
        let bad: Vec<usize> = faults.iter().map(|f| f.env).collect();
        let faults = &self.faults;
        let now = &*batch;
        let run = |(chunk, ((states, reported), frame)): Chunk<'_, F>| {
            for (i, state) in states.chunks_exact_mut(d).enumerate() {
                let env = chunk * F::CHUNK + i;
                let reported = &mut reported[i * points..(i + 1) * points];
                if bad.contains(&env) {
                    reported.fill(Vector3::zeros());
                    continue;
                }
                let tau = &torques[env * joints..(env + 1) * joints];
                frame.drive(now.driven(env), now.servo);
                if let Some((_, prepared)) = own.get(env) {
                    frame.turn_to(prepared);
                }
                match frame.step(now.of(env), &now.scenes[env], config, state, tau) {
                    Ok(()) => reported.copy_from_slice(frame.forces()),
                    Err(reason) => {
                        reported.fill(Vector3::zeros());
                        let mut faults = faults.lock().unwrap_or_else(PoisonError::into_inner);
                        faults.push(Fault { env, frame: now.frames[env], reason: now.of(env).source.lost(reason) });
                    }
                }
            }
        };
        if chunks <= 1 {
            self.next
                .chunks_mut(F::CHUNK * d)
                .zip(reported.chunks_mut(width))
                .zip(&mut self.frames)
                .enumerate()
                .for_each(run);
        } else {
            let both = self.next.par_chunks_mut(F::CHUNK * d).zip(reported.par_chunks_mut(width));
            both.zip(self.frames.par_iter_mut()).enumerate().for_each(run);
        }
        batch.forces = forces;
        finish(batch, &mut self.next, self.faults.get_mut().unwrap_or_else(PoisonError::into_inner))
    }

    pub(crate) fn back(
        &mut self,
        config: &F::Config,
        batch: &Batch,
        torques: &[f64],
        rows: usize,
        grad_next: &[f64],
        numbers: bool,
    ) -> Result<Gradients, StepError>
    where
        F: Back,
    {
        Self::CAPABILITIES.admit(batch)?;
        let n = batch.len();
        let robot = &batch.system.robot;
        let d = robot.state_dim();
        let joints = robot.joint_count();
        let width = rows * 2 * robot.nv();
        if grad_next.len() != n * width {
            return Err(StepError::Solver(format!(
                "{} gradients for {rows} rows of {n} environments, of {} numbers each",
                grad_next.len(),
                2 * robot.nv()
            )));
        }
        let mut faults = Vec::new();
        sound(batch, torques, &mut faults)?;
        self.prepare(batch).map_err(StepError::Solver)?;
        let own = &self.own;
        let go = |(env, state, frame): (usize, &[f64], &mut F)| {
            frame.drive(batch.driven(env), batch.servo);
            if let Some((_, prepared)) = own.get(env) {
                frame.turn_to(prepared);
            }
            let tau = &torques[env * joints..(env + 1) * joints];
            let grad_next = &grad_next[env * width..(env + 1) * width];
            let mut found = frame.back(batch.of(env), &batch.scenes[env], config, state, tau, grad_next, numbers)?;
            finite(batch.of(env), &found)?;
            wrap_state(robot, &mut found.next);
            Ok(found)
        };
        let chunk = |(chunk, (states, frame)): (usize, (&[f64], &mut F))| {
            let all = states.chunks_exact(d).enumerate();
            all.map(|(i, state)| go((chunk * F::CHUNK + i, state, &mut *frame))).collect::<Vec<_>>()
        };
        if !faults.is_empty() {
            return Err(StepError::Environments(faults));
        }
        let chunks = batch.states.par_chunks(F::CHUNK * d).zip(&mut self.frames).enumerate();
        let found: Vec<Result<Gradients, String>> = chunks.map(chunk).flatten_iter().collect();
        gathered(batch, found)
    }

    /// Precomputes data of robots that have changed since the last frame, and allocates memory for all chunks.
    fn prepare(&mut self, batch: &Batch) -> Result<(), String> {
        let prepared = match &self.prepared {
            Some((system, prepared)) if Arc::ptr_eq(system, &batch.system) => prepared.clone(),
            _ => {
                self.frames.clear();
                self.own.clear();
                self.prepared.insert((batch.system.clone(), F::prepare(&batch.system)?)).1.clone()
            }
        };
        if batch.systems.is_empty() && !self.own.is_empty() {
            self.own.clear();
            self.frames.iter_mut().for_each(|frame| frame.turn_to(&prepared));
        }
        self.own.truncate(batch.systems.len());
        for (env, system) in batch.systems.iter().enumerate() {
            if self.own.get(env).is_some_and(|(own, _)| Arc::ptr_eq(own, system)) {
                continue;
            }
            batch.system.alike(system).map_err(|what| {
                format!("the robot of environment {env} is built otherwise than the batch's: {what}")
            })?;
            let prepared = (system.clone(), F::prepare(system)?);
            match self.own.get_mut(env) {
                Some(own) => *own = prepared,
                None => self.own.push(prepared),
            }
        }
        while self.frames.len() < batch.len().div_ceil(F::CHUNK) {
            self.frames.push(F::new(&batch.system, prepared.clone()));
        }
        Ok(())
    }
}

/// Refuses a frame with a next state or gradients that are not finite.
fn finite(system: &System, found: &Gradients) -> Result<(), String> {
    if let Some(reason) = gone(system, &found.next) {
        return Err(reason);
    }
    if ![&found.states, &found.torques, &found.numbers].into_iter().flatten().all(|x| x.is_finite()) {
        return Err("the frame's gradients are not finite".into());
    }
    Ok(())
}

/// The gradients of all environments, or the faults of those that failed.
fn gathered(batch: &Batch, found: Vec<Result<Gradients, String>>) -> Result<Gradients, StepError> {
    let mut out = Gradients::default();
    let mut faults = Vec::new();
    for (env, found) in found.into_iter().enumerate() {
        match found {
            Ok(found) => out.append(found),
            Err(reason) => {
                faults.push(Fault { env, frame: batch.frames[env], reason: batch.of(env).source.lost(reason) })
            }
        }
    }
    if faults.is_empty() { Ok(out) } else { Err(StepError::Environments(faults)) }
}
