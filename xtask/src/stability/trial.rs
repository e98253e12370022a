//! One motion under one method, and the faults that show a row can go red.

use std::cell::RefCell;
use std::sync::Arc;

use nerd_core::dynamics::{Data, Totals, totals};
use nerd_core::state::{quaternion, vector};
use nerd_sim::prelude::*;

use super::method::Method;

/// What is broken on purpose.
#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// Gravity at half its strength.
    HalfGravity,
    /// The scene's colliders are gone.
    NoFloor,
    /// Velocities are zero after every frame.
    DroppedVelocity,
    /// The root's angular velocity is given in body axes instead of world axes.
    BodyAngularVelocity,
    /// The state never changes.
    FrozenWorld,
    /// Velocities grow by 2 % a frame.
    PumpedVelocity,
    /// Velocities gain 1e-9 for every frame since the solver was made.
    HiddenClock,
    /// States are kept in f32.
    SinglePrecision,
    /// An error of the solver is passed over.
    SwallowedErrors,
}

/// A method under test, perhaps with a fault.
pub struct Trial<'a> {
    pub method: &'a Method,
    pub fault: Option<Fault>,
    /// What the solver said when it gave up, if it did; from there on the motion stands still.
    pub lost: RefCell<Option<String>>,
}

/// A motion: states after 0, 1, 2, ... frames.
pub struct Motion {
    system: Arc<System>,
    gravity: nalgebra::Vector3<f64>,
    pub states: Vec<Vec<f64>>,
}

impl Motion {
    /// Totals of every state.
    pub fn totals(&self) -> Vec<Totals> {
        let mut data = Data::new(&self.system.robot);
        self.states.iter().map(|s| totals(&self.system.robot, s, &mut data)).collect()
    }

    /// Energy (J) of every state.
    pub fn energies(&self) -> Vec<f64> {
        self.totals().iter().map(|t| t.energy(&self.gravity)).collect()
    }

    /// The last state.
    pub fn last(&self) -> &[f64] {
        &self.states[self.states.len() - 1]
    }
}

/// Sets the torques of a frame: `(frame, state, torques)`.
pub type Drive<'a> = dyn FnMut(usize, &[f64], &mut [f64]) + 'a;

impl<'a> Trial<'a> {
    pub fn new(method: &'a Method, fault: Option<Fault>) -> Self {
        Self { method, fault, lost: RefCell::new(None) }
    }

    /// Whether the method's contacts give way as the material says; rapier's do not.
    pub fn compliant(&self) -> bool {
        !self.method.name.starts_with("rapier")
    }

    /// Rolls out `frames` frames without torques.
    pub fn passive(&self, system: &Arc<System>, scene: &str, start: &[f64], frames: usize) -> Result<Motion, String> {
        self.driven(system, scene, start, frames, &mut |_, _, _| ())
    }

    /// The same under the method with four times the substeps.
    pub fn finer(&self, system: &Arc<System>, scene: &str, start: &[f64], frames: usize) -> Result<Motion, String> {
        self.under((self.method.finer)(system), system, scene, start, frames, &mut |_, _, _| ())
    }

    /// The same by a solver that has stepped another motion, and was then told to forget it.
    pub fn after_reset(&self, system: &Arc<System>, scene: &str, other: &[f64], start: &[f64], frames: usize) -> Result<Motion, String> {
        let mut solver = (self.method.make)(system);
        let mut batch = Batch::new(system, &system.scene(scene).map_err(|e| e.to_string())?, 1);
        batch.reset(0, other);
        let torques = vec![0.0; system.robot.joint_count()];
        for _ in 0..10 {
            solver.step(&mut batch, &torques).map_err(|e| e.to_string())?;
        }
        solver.reset(0);
        self.under(solver, system, scene, start, frames, &mut |_, _, _| ())
    }

    /// Rolls out under torques set by `drive(frame, state, torques)`. An error of the solver is kept in `lost`.
    pub fn driven(&self, system: &Arc<System>, scene: &str, start: &[f64], frames: usize, drive: &mut Drive) -> Result<Motion, String> {
        self.under((self.method.make)(system), system, scene, start, frames, drive)
    }

    fn under(
        &self,
        mut solver: Box<dyn Solver>,
        system: &Arc<System>,
        scene: &str,
        start: &[f64],
        frames: usize,
        drive: &mut Drive,
    ) -> Result<Motion, String> {
        let mut scene = (*system.scene(scene).map_err(|e| e.to_string())?).clone();
        let gravity = scene.gravity;
        match self.fault {
            Some(Fault::HalfGravity) => scene.gravity *= 0.5,
            Some(Fault::NoFloor) => scene.colliders.clear(),
            _ => {}
        }
        let mut batch = Batch::new(system, &Arc::new(scene), 1);
        batch.reset(0, start);
        let (nq, floating) = (system.robot.nq(), system.robot.floating());
        let mut torques = vec![0.0; system.robot.joint_count()];
        let mut states = vec![start.to_vec()];
        for frame in 0..frames {
            drive(frame, batch.state(0), &mut torques);
            match solver.step(&mut batch, &torques) {
                Err(error) if self.fault != Some(Fault::SwallowedErrors) => {
                    self.lost.borrow_mut().get_or_insert(error.to_string());
                    states.resize(frames + 1, batch.state(0).to_vec());
                    break;
                }
                _ => {}
            }
            let state = batch.state_mut(0);
            match self.fault {
                Some(Fault::DroppedVelocity) => state[nq..].fill(0.0),
                Some(Fault::PumpedVelocity) => state[nq..].iter_mut().for_each(|v| *v *= 1.02),
                Some(Fault::HiddenClock) => state[nq..].iter_mut().for_each(|v| *v += 1e-9 * (frame + 1) as f64),
                Some(Fault::SinglePrecision) => state.iter_mut().for_each(|x| *x = f64::from(*x as f32)),
                Some(Fault::FrozenWorld) => state.copy_from_slice(start),
                Some(Fault::BodyAngularVelocity) if floating => {
                    let (p, w, v) = (vector(&state[..3]), vector(&state[nq..]), vector(&state[nq + 3..]));
                    let body = quaternion(&state[3..7]).inverse() * w;
                    state[nq..nq + 3].copy_from_slice(body.as_slice());
                    state[nq + 3..nq + 6].copy_from_slice((v + w.cross(&p) - body.cross(&p)).as_slice());
                }
                _ => {}
            }
            states.push(state.to_vec());
        }
        Ok(Motion { system: system.clone(), gravity, states })
    }
}
