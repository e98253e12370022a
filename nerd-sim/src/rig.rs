//! A solver with an actuator and sensor model ([`Motors`]). Torques may be delayed, weakened, reduced at speed or
//! rippling; states are sensor readings.
//!
//! ```
//! use nerd_sim::prelude::*;
//! use nerd_sim::{rig::Rig, vary};
//! let mut system = (*System::named("pendulum")?).clone();
//! system.spec.vary = Some(vary::VarySpec { delay: Some(Range { low: 0.0, high: 2.0 }), ..Default::default() });
//! let system = Arc::new(system);
//! let batch = vary::batch(&system, "free", 8, 0)?;
//! let solver = Rig::new(Articulated::new(ArticulatedConfig::accurate(&system)));
//! let mut simulation = Simulation::new(batch, solver);
//! // Torques act on some robots in the first frame, on all in the third.
//! (0..3).try_for_each(|_| simulation.step(&[100.0; 16]))?;
//! assert!(simulation.batch.state(0) != simulation.batch.state(1));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use nerd_core::state::wrap_state;

pub use crate::robots::motors::{LATEST, Motors};
use crate::{internal::*, solver::around, vary::VarySpec};

/// Number of frames whose commanded torques are stored, including the present frame.
const FRAMES: usize = LATEST as usize + 1;

/// Steps robots with their actuators and sensors, around a solver without a model of them. With a delay, the next frame
/// depends on commanded torques of earlier frames. Commanded torques count as zero before a start and for missing
/// frames.
pub struct Rig<S = Box<dyn Solver>> {
    solver: S,
    /// Pairs of a robot and its copy without motors: for the batch's robot, then for the robot of each environment.
    bare: Vec<[Arc<System>; 2]>,
    /// Commanded torques `[env][FRAMES][joint]`, newest first; `newest`: frame number of the newest torques, `[env]`.
    asked: Vec<f64>,
    newest: Vec<u64>,
    torques: Vec<f64>,
}

/// The solver, in a [`Rig`] if the robot's `[vary]` has ranges for actuators or sensors.
pub fn rigged(bare: Box<dyn Solver>, system: &System) -> Box<dyn Solver> {
    if system.spec.vary.as_ref().is_some_and(VarySpec::rigged) { Box::new(Rig::new(bare)) } else { bare }
}

impl<S: Solver> Rig<S> {
    /// Wraps a solver.
    pub fn new(solver: S) -> Self {
        Self { solver, bare: Vec::new(), asked: Vec::new(), newest: Vec::new(), torques: Vec::new() }
    }

    /// The robot without its motors; `k`: index of the robot in `bare`.
    fn stripped(&mut self, k: usize, system: &Arc<System>) -> Arc<System> {
        if let Some([_, bare]) = self.bare.get(k).filter(|[own, _]| Arc::ptr_eq(own, system)) {
            return bare.clone();
        }
        let bare = if system.motors.ideal() {
            system.clone()
        } else {
            Arc::new(System { motors: Motors::default(), ..(**system).clone() })
        };
        self.bare.resize_with(self.bare.len().max(k + 1), || [system.clone(), bare.clone()]);
        self.bare[k] = [system.clone(), bare.clone()];
        bare
    }

    /// Computes the torques that act in this frame, and stores the commanded torques.
    fn drive(&mut self, batch: &Batch, torques: &[f64]) {
        let n = batch.len();
        let joints = batch.system.robot.joint_count();
        if self.newest.len() != n || self.asked.len() != n * FRAMES * joints {
            (self.asked, self.newest) = (vec![0.0; n * FRAMES * joints], vec![u64::MAX - 1; n]);
        }
        self.torques.resize(n * joints, 0.0);
        for env in 0..n {
            let asked = &mut self.asked[env * FRAMES * joints..][..FRAMES * joints];
            if batch.frames[env] == 0 || self.newest[env] + 1 != batch.frames[env] {
                asked.fill(0.0);
            }
            self.newest[env] = batch.frames[env];
            asked.copy_within(..(FRAMES - 1) * joints, joints);
            asked[..joints].copy_from_slice(&torques[env * joints..][..joints]);
            let rows: [&[f64]; FRAMES] = std::array::from_fn(|k| &asked[k * joints..(k + 1) * joints]);
            let robot = &batch.system.robot;
            let state = batch.state(env);
            let positions = &state[robot.root_coords()..];
            let velocities = &state[robot.nq() + robot.root_dofs()..];
            batch.of(env).motors.act(&rows, positions, velocities, &mut self.torques[env * joints..][..joints]);
        }
    }
}

/// Converts sensor readings to joint positions (`side` 1) or joint positions to readings (-1).
fn shift(batch: &mut Batch, side: f64) {
    for env in 0..batch.len() {
        let own = batch.of(env).clone();
        if !own.motors.zeros.is_empty() {
            let state = batch.state_mut(env);
            let first = own.robot.root_coords();
            state[first..].iter_mut().zip(&own.motors.zeros).for_each(|(q, zero)| *q += side * zero);
            wrap_state(&own.robot, state);
        }
    }
}

impl<S: Solver> Solver for Rig<S> {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        batch.check().map_err(StepError::Solver)?;
        let joints = batch.system.robot.joint_count();
        let d = batch.system.robot.state_dim();
        if torques.len() != batch.len() * joints {
            return Err(StepError::torques(torques.len(), batch.len(), joints));
        }
        let shown = batch.states.clone();
        shift(batch, 1.0);
        self.drive(batch, torques);
        let systems = std::mem::take(&mut batch.systems);
        let bare = self.stripped(0, &batch.system);
        let system = std::mem::replace(&mut batch.system, bare);
        batch.systems = systems.iter().enumerate().map(|(env, own)| self.stripped(env + 1, own)).collect();
        let done = self.solver.step(batch, &self.torques);
        (batch.system, batch.systems) = (system, systems);
        shift(batch, -1.0);
        // Environments that were not stepped keep their readings, to the bit.
        match &done {
            Ok(()) => {}
            Err(StepError::Environments(faults)) => {
                faults
                    .iter()
                    .map(|f| f.env * d..(f.env + 1) * d)
                    .for_each(|row| batch.states[row.clone()].copy_from_slice(&shown[row]));
            }
            Err(_) => batch.states.copy_from_slice(&shown),
        }
        done
    }

    around!();

    fn reset(&mut self, env: usize) {
        if let Some(newest) = self.newest.get_mut(env) {
            *newest = u64::MAX - 1;
        }
        self.solver.reset(env);
    }
}
