//! Simulations of the live page, each with its source of torques.

use nerd_tasks::Episodes;
use nerd_train::ppo::{Actor, Running};

use crate::prelude::*;

/// A simulation with its source of torques.
pub enum Act {
    /// A robot without torques, or under its own control law towards the default pose.
    Alone(Simulation),
    /// A policy that plays episodes of its task.
    Policy(Box<(Episodes, Running, Actor)>),
}

impl Act {
    pub(super) fn simulation(&self) -> &Simulation {
        match self {
            Self::Alone(simulation) => simulation,
            Self::Policy(played) => &played.0.simulation,
        }
    }

    pub(super) fn simulation_mut(&mut self) -> &mut Simulation {
        match self {
            Self::Alone(simulation) => simulation,
            Self::Policy(played) => &mut played.0.simulation,
        }
    }

    pub(super) fn seconds(&self) -> f64 {
        let frames = if let Self::Policy(played) = self { played.0.task.frames() } else { 1 };
        self.simulation().batch.system.frame_time * frames as f64
    }

    /// Steps one frame, or one policy step; `law` gives the torques of a robot without a policy. Returns the first
    /// environment's torques `[frame][joint]`, and whether its episode ended.
    pub(super) fn step(&mut self, law: Option<&mut Controller>) -> Result<(Vec<f64>, bool), StepError> {
        let joints = self.simulation().batch.system.robot.joint_count();
        match self {
            Self::Alone(simulation) => {
                let n = simulation.batch.len();
                let rest = vec![0.0; joints];
                let mut torques = vec![0.0; n * joints];
                simulation.batch.servo = false;
                if let (Some(law), true) = (law, joints > 0) {
                    law.servo = simulation.serve();
                    torques
                        .chunks_exact_mut(joints)
                        .enumerate()
                        .for_each(|(env, own)| law.torques(simulation.batch.state(env), &rest, own));
                }
                simulation.step(&torques)?;
                torques.truncate(joints);
                Ok((torques, false))
            }
            Self::Policy(played) => {
                let (episodes, running, actor) = &mut **played;
                let actions = actor.mean(&running.stack.rows);
                let (_, ended) = running.step(episodes, &actions, &mut Vec::new())?;
                let torques = episodes.trace().torques;
                let width = joints * episodes.len();
                let first = torques.chunks_exact(width.max(1)).flat_map(|frame| &frame[..joints]).copied().collect();
                Ok((first, ended.iter().any(|ended| ended.env == 0)))
            }
        }
    }

    /// Resets to `start`, the states `[env][state]`; a policy begins its next episodes instead.
    pub(super) fn reset(&mut self, start: &[f64]) {
        match self {
            Self::Alone(simulation) => {
                let width = simulation.batch.system.robot.state_dim();
                start.chunks_exact(width).enumerate().for_each(|(env, state)| simulation.reset(env, state));
            }
            Self::Policy(played) => {
                let (episodes, running, actor) = &mut **played;
                (0..episodes.len()).for_each(|env| episodes.begin(env));
                *running = Running::new(episodes, actor.policy.shape.stack);
            }
        }
    }
}
