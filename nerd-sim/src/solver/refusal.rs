//! Capabilities of a solver, step errors, and results of gradients.

use crate::batch::Batch;

/// Capabilities of a solver in addition to stepping states; check [`super::Solver::capabilities`] before the first
/// step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Capabilities {
    /// Applies a batch's drives ([`Batch::drives`]) while it steps a frame.
    pub drives: bool,
    /// Reports contact forces ([`Batch::contact_force`]).
    pub forces: bool,
    /// Steps a different robot in each environment ([`Batch::systems`]).
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

/// Errors of a frame.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StepError {
    /// Some environments could not be stepped and keep their states. All others were stepped.
    #[error("{}", line(.0))]
    Environments(Vec<Fault>),
    /// The batch needs a capability that this solver lacks; nothing was stepped.
    #[error("{0}")]
    Refused(String),
    /// The solver as a whole failed; nothing was stepped.
    #[error("{0}")]
    Solver(String),
}

impl StepError {
    /// The error for a number of torques that differs from environments times joints.
    pub(crate) fn torques(found: usize, environments: usize, joints: usize) -> Self {
        Self::Solver(format!("{found} torques for {environments} environments of {joints} joints"))
    }

    /// The faults, for a caller that continues with the other environments; the error itself if nothing was stepped.
    pub fn faults(self) -> Result<Vec<Fault>, Self> {
        match self {
            Self::Environments(faults) => Ok(faults),
            other => Err(other),
        }
    }
}

/// An environment that could not be stepped.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    /// Index of the environment.
    pub env: usize,
    /// Frame, counted from the environment's reset.
    pub frame: u64,
    /// Reason, in one line.
    pub reason: String,
}

fn line(faults: &[Fault]) -> String {
    let Some(Fault { env, frame, reason }) = faults.first() else { return "no environment failed".into() };
    let others =
        if faults.len() > 1 { format!(" (and {} environments more)", faults.len() - 1) } else { String::new() };
    format!("environment {env}, frame {frame}: {reason}{others}")
}

/// Result of [`super::Solver::vjp`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Gradients {
    /// States after the frame, `[env][q, qd]`.
    pub next: Vec<f64>,
    /// Gradients with respect to the states before the frame, `[env][row][2 nv]`.
    pub states: Vec<f64>,
    /// Gradients with respect to the torques, `[env][row][joint]`.
    pub torques: Vec<f64>,
    /// Gradients with respect to parameters of robot and scene, `[env][row][number]`; empty unless requested.
    pub numbers: Vec<f64>,
}

impl Gradients {
    /// Jacobian-vector products of a frame from [`super::Solver::linearise`]: change of the next states, `[env][2 nv]`,
    /// for changes of the states, `[env][2 nv]`, and torques, `[env][joint]`.
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
