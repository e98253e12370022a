//! A row: one question with a measured answer, a limit, and the source of the limit.

use super::cell::Cell;
use super::error::Error;
use super::method::Method;
use super::trial::Trial;
use crate::solver::StepError;

/// One scene and what is measured in it.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct Row {
    /// Name.
    pub name: &'static str,
    /// What the figure is.
    pub figure: &'static str,
    /// Its unit, or what it is a share of; empty for a pure number.
    pub unit: &'static str,
    /// The source of the limit: an equation, or published tests.
    pub source: &'static str,
    /// Why it is asked, in one sentence.
    pub why: &'static str,
    /// Largest figure that passes; up to ten times as much is degraded.
    pub limit: f64,
    /// Measures; an error is a scene that could not be made.
    pub(super) measure: fn(&Trial) -> Result<f64, Error>,
}

impl Row {
    pub(super) const fn new(
        name: &'static str,
        figure: &'static str,
        unit: &'static str,
        limit: f64,
        measure: fn(&Trial) -> Result<f64, Error>,
    ) -> Self {
        Self { name, figure, unit, source: "", why: "", limit, measure }
    }

    pub(super) const fn source(self, source: &'static str) -> Self {
        Self { source, ..self }
    }

    pub(super) const fn why(self, why: &'static str) -> Self {
        Self { why, ..self }
    }

    /// Asks a method.
    pub fn cell(&self, method: &Method) -> Cell {
        let trial = Trial::new(method);
        match (self.measure)(&trial) {
            Err(Error::NoFiner | Error::Step(StepError::Refused(_))) => Cell::unasked(),
            measured => Cell::new(measured, trial.lost.take(), self.limit),
        }
    }

    /// Whether a correct solver must pass. Three rows drive a robot past what any step can follow, to show what becomes of it.
    pub fn must_pass(&self) -> bool {
        !matches!(self.name, "ANYmal kp 200" | "ANYmal kp 2000" | "ANYmal kp 5000")
    }
}
