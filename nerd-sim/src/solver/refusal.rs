//! Capabilities of a solver, and reasons why it could not step.

use crate::batch::Batch;

/// Capabilities of a solver beside stepping states; check [`super::Solver::capabilities`] before the first step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Capabilities {
    /// Applies a batch's drives inside its frame ([`Batch::drives`]).
    pub drives: bool,
    /// Reports contact forces ([`Batch::contact_force`]).
    pub forces: bool,
    /// Steps an individual robot in each environment ([`Batch::systems`]).
    pub systems: bool,
}

impl Capabilities {
    /// Refuses a batch that needs an unsupported capability ([`StepError::Refused`]).
    pub fn admit(&self, batch: &Batch) -> Result<(), StepError> {
        let missing = if !self.drives && !batch.drives.is_empty() {
            "this solver has no drives inside its frame: leave `drives` empty and give torques (nerd_sim::control), or step with articulated"
        } else if !self.drives && batch.servo {
            "this solver has no drives inside its frame: set the batch's `servo` to false, or step with articulated"
        } else if !self.systems && !batch.systems.is_empty() {
            "this solver knows one robot for all environments: leave `systems` empty, or step with articulated or rapier"
        } else {
            return Ok(());
        };
        Err(StepError::Refused(missing.into()))
    }
}

/// Why a frame could not be stepped.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StepError {
    /// Some environments could not be stepped and keep their states. All others were stepped as usual.
    #[error("{}", line(.0))]
    Environments(Vec<Fault>),
    /// The batch needs a feature that this solver lacks; nothing was stepped.
    #[error("{0}")]
    Refused(String),
    /// The solver as a whole failed; nothing was stepped.
    #[error("{0}")]
    Solver(String),
}

impl StepError {
    /// The number of torques is not one a joint of each environment.
    pub(crate) fn torques(found: usize, environments: usize, joints: usize) -> Self {
        Self::Solver(format!("{found} torques for {environments} environments of {joints} joints"))
    }

    /// The failed environments, for a caller that continues with the others; the error itself, if nothing was stepped.
    pub fn faults(self) -> Result<Vec<Fault>, Self> {
        match self {
            Self::Environments(faults) => Ok(faults),
            other => Err(other),
        }
    }
}

/// An environment that could not be stepped, with its address.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    /// Environment.
    pub env: usize,
    /// Frame counted from the environment's reset.
    pub frame: u64,
    /// One line.
    pub reason: String,
}

fn line(faults: &[Fault]) -> String {
    let Some(Fault { env, frame, reason }) = faults.first() else { return "no environment failed".into() };
    let others = if faults.len() > 1 { format!(" (and {} environments more)", faults.len() - 1) } else { String::new() };
    format!("environment {env}, frame {frame}: {reason}{others}")
}

/// Result of [`super::Solver::back`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Slopes {
    /// States after the frame, `[env][q, qd]`.
    pub next: Vec<f64>,
    /// Gradients with respect to the states before it, `[env][row][2 nv]`.
    pub states: Vec<f64>,
    /// Gradients with respect to the torques, `[env][row][joint]`.
    pub torques: Vec<f64>,
    /// Gradients with respect to numbers of robot and scene if requested, `[env][row][number]`.
    pub numbers: Vec<f64>,
}

impl Slopes {
    /// Jacobian-vector products of a frame from [`super::Solver::linearise`]: the change of the next states, `[env][2 nv]`, when the states
    /// change by `states`, `[env][2 nv]`, and the torques by `torques`, `[env][joint]`.
    pub fn forward(&self, states: &[f64], torques: &[f64]) -> Vec<f64> {
        let size = self.states.len().checked_div(states.len()).unwrap_or_default();
        let joints = (torques.len() * size).checked_div(states.len()).unwrap_or_default();
        let row = |k: usize| {
            let by = |matrix: &[f64], along: &[f64], n: usize| -> f64 {
                matrix[k * n..][..n].iter().zip(&along[k / size * n..][..n]).map(|(a, b)| a * b).sum()
            };
            by(&self.states, states, size) + by(&self.torques, torques, joints)
        };
        (0..states.len()).map(row).collect()
    }

    /// Appends the results of further environments.
    pub fn append(&mut self, more: Self) {
        self.next.extend(more.next);
        self.states.extend(more.states);
        self.torques.extend(more.torques);
        self.numbers.extend(more.numbers);
    }
}
