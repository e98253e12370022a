//! The predictor of no motion: its error is that of knowing nothing.
//!
//! ```
//! # use nerd_sim::{instruments::Hold, prelude::*};
//! # let system = System::named("ant")?;
//! # let mut batch = Batch::new(&system, &system.scene("ground")?, 1);
//! let before = batch.states.clone();
//! Hold.step(&mut batch, &[0.0; 8])?;
//! assert_eq!(batch.states, before);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use crate::batch::Batch;
use crate::solver::{Solver, StepError, commit};

/// Stays where it is.
#[derive(Clone, Copy, Debug, Default)]
pub struct Hold;

impl Solver for Hold {
    fn step(&mut self, batch: &mut Batch, _torques: &[f64]) -> Result<(), StepError> {
        let mut next = batch.states.clone();
        commit(batch, &mut next, &mut Vec::new())
    }
}
