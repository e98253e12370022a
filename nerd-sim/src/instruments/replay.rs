//! Recorded states as a solver: a truth that costs nothing to ask again.

use crate::batch::Batch;
use crate::solver::{Solver, StepError};

/// Plays recorded states back, whatever the torques.
#[derive(Clone, Debug)]
pub struct Replay<'a> {
    /// States `[env][q, qd]` by frame, as [`super::Recorder`] keeps them.
    pub frames: &'a [Vec<f64>],
    /// The frame to come.
    pub next: usize,
}

impl<'a> Replay<'a> {
    /// From the first frame on.
    pub fn new(frames: &'a [Vec<f64>]) -> Self {
        Self { frames, next: 0 }
    }
}

impl Solver for Replay<'_> {
    fn step(&mut self, batch: &mut Batch, _torques: &[f64]) -> Result<(), StepError> {
        let refused = |why: String| Err(StepError::Solver(format!("frame {} of a replay: {why}", self.next)));
        match self.frames.get(self.next) {
            None => return refused(format!("only {} were recorded", self.frames.len())),
            Some(frame) if frame.len() != batch.states.len() => {
                return refused(format!("{} numbers were recorded, the batch has {}", frame.len(), batch.states.len()));
            }
            Some(frame) => batch.states.copy_from_slice(frame),
        }
        self.next += 1;
        batch.frames.iter_mut().for_each(|f| *f += 1);
        Ok(())
    }
}
