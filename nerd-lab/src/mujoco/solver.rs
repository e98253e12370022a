//! MuJoCo as a solver, frame by frame: a judge of policies that knows none of our contact models. Slow, since every frame is
//! asked for in text.

use nerd_sim::solver::{Fault, check, commit};
use serde_json::json;

use super::referee::{Referee, from_mujoco, to_mujoco};
use crate::prelude::*;

/// Steps of a frame: 1/480 s at sixty frames a second.
pub(super) const SUBSTEPS: usize = 8;

/// MuJoCo on one robot in one scene, with its default contacts and integrator. Every frame begins without what the one before
/// had found, so that it is a function of the state as every solver's.
pub struct Mujoco {
    referee: Referee,
    next: Vec<f64>,
    faults: Vec<Fault>,
}

impl Mujoco {
    pub fn new(python: &Path, system: &Arc<System>, scene: &Arc<Scene>) -> Result<Self> {
        Ok(Self { referee: Referee::new(python, &Batch::new(system, scene, 0), 0)?, next: Vec::new(), faults: Vec::new() })
    }
}

impl Solver for Mujoco {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> std::result::Result<(), StepError> {
        check(batch, torques, &mut self.faults)?;
        let (robot, joints) = (&batch.system.robot, batch.system.robot.joint_count());
        let sound: Vec<usize> = (0..batch.len()).filter(|env| self.faults.iter().all(|f| f.env != *env)).collect();
        let from: Vec<_> = sound.iter().map(|env| to_mujoco(robot, batch.state(*env))).collect();
        let forces: Vec<&[f64]> = sound.iter().map(|env| &torques[env * joints..(env + 1) * joints]).collect();
        let asked = json!({ "from": from, "forces": forces, "substeps": SUBSTEPS });
        let states: Vec<Option<Vec<f64>>> = self.referee.python.ask(&asked).map_err(|e| StepError::Solver(format!("{e:#}")))?;
        if states.len() != sound.len() {
            return Err(StepError::Solver(format!("MuJoCo moved {} environments of {}", states.len(), sound.len())));
        }
        self.next.clone_from(&batch.states);
        let d = robot.state_dim();
        for (env, state) in sound.into_iter().zip(states) {
            match state {
                Some(state) => self.next[env * d..(env + 1) * d].copy_from_slice(&from_mujoco(robot, &state)),
                None => self.faults.push(Fault { env, frame: batch.frames[env], reason: "MuJoCo gave it up".into() }),
            }
        }
        commit(batch, &mut self.next, &mut self.faults)
    }
}
