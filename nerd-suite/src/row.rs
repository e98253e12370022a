//! A row: a question with a measured figure, a limit and the limit's source; cells with verdicts.

use std::fmt;

use super::trial::{Error, Method, Result, Trial};
use nerd_sim::prelude::*;
use serde::{Deserialize, Serialize};

/// Measures the figure of a row; an error means that the scene could not be made or stepped.
type Measure = fn(&Trial) -> Result<f64>;

/// A row of the suite: a scene, the figure measured in it, and the figure's limit.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    /// Name of the row.
    pub name: &'static str,
    /// What the figure measures, in a few words.
    pub figure: &'static str,
    /// Unit of the figure, or the quantity by which the figure is divided; empty for a pure number.
    pub unit: &'static str,
    /// Source of the limit: an equation, or published tests.
    pub source: &'static str,
    /// Why the row is in the suite, in one sentence.
    pub why: &'static str,
    /// Largest figure that passes; a figure up to ten times as large is degraded.
    pub limit: f64,
    measure: Measure,
}

/// Makes a row. `source` is the limit's, `why` the row's reason; `measure` computes the figure.
pub(super) const fn row(
    name: &'static str,
    figure: &'static str,
    unit: &'static str,
    limit: f64,
    source: &'static str,
    why: &'static str,
    measure: Measure,
) -> Row {
    Row { name, figure, unit, source, why, limit, measure }
}

impl Row {
    /// Puts the row and its cells, one for each method, into a line of results.
    pub(super) fn line(&self, cells: Vec<Cell>) -> Line {
        let [row, figure, unit, source, why] =
            [self.name, self.figure, self.unit, self.source, self.why].map(String::from);
        Line { row, figure, unit, source, why, limit: self.limit, cells }
    }

    /// Measures the row's figure under a method, and judges it by the limit.
    pub fn cell(&self, method: &Method) -> Cell {
        let trial = Trial::new(method);
        match (self.measure)(&trial) {
            Err(Error::NoFiner | Error::Step(StepError::Refused(_))) => {
                Cell { figure: None, lost: None, verdict: Verdict::Unasked }
            }
            measured => Cell::new(measured, trial.lost.take(), self.limit),
        }
    }

    /// Whether a correct solver must pass. Three rows use PD gains beyond the stability limit of any time step, to show
    /// the failure.
    pub fn must_pass(&self) -> bool {
        !matches!(self.name, "ANYmal kp 200" | "ANYmal kp 2000" | "ANYmal kp 5000")
    }
}

/// Verdict of a row under a method.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// The figure is at most the limit.
    Pass,
    /// The figure is at most ten times the limit.
    Degraded,
    /// The figure is more than ten times the limit, or the solver failed.
    Fail,
    /// The row does not apply to the method, so nothing was measured.
    Unasked,
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(&format!("{self:?}").to_lowercase())
    }
}

/// Result of one row under one method.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Cell {
    /// The measured figure; if the solver failed, that of the motion before the failure. `None` where nothing was
    /// measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub figure: Option<f64>,
    /// The solver's error, if it failed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lost: Option<String>,
    /// Verdict on the figure, compared with the row's limit.
    pub verdict: Verdict,
}

impl Cell {
    /// Compares a measured figure with a limit; `lost` is the solver's error, if it failed.
    fn new(measured: Result<f64>, lost: Option<String>, limit: f64) -> Self {
        // Replaces infinity, which files cannot store: beyond all limits, but finite.
        const HUGE: f64 = 1e300;
        let lost = match &measured {
            Err(error) => Some(error.to_string()),
            Ok(figure) if figure.is_nan() => lost.or(Some("the figure is not a number".into())),
            Ok(_) => lost,
        };
        let figure = measured.ok().filter(|x| x.is_finite()).unwrap_or(HUGE);
        let verdict = match figure {
            _ if lost.is_some() => Verdict::Fail,
            x if x <= limit => Verdict::Pass,
            x if x <= 10.0 * limit => Verdict::Degraded,
            _ => Verdict::Fail,
        };
        Self { figure: Some(figure), lost, verdict }
    }
}

impl fmt::Display for Cell {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let figure = self.figure.map_or_else(String::new, |figure| format!("{figure:<8.2e} "));
        f.pad(&format!("{figure}{}", self.verdict))
    }
}

/// A row with its results, as stored in files and shown in tables.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Line {
    /// Name of the row.
    pub row: String,
    /// What the figure measures, in a few words.
    pub figure: String,
    /// Unit of the figure, or the quantity by which the figure is divided; empty for a pure number.
    pub unit: String,
    /// Source of the limit.
    pub source: String,
    /// Why the row is in the suite.
    pub why: String,
    /// Largest figure that passes.
    pub limit: f64,
    /// Results of the row, one for each method, in the order of the methods.
    pub cells: Vec<Cell>,
}

impl Line {
    /// Writes the meaning of the figure, with its unit in brackets.
    pub fn asked(&self) -> String {
        if self.unit.is_empty() { self.figure.clone() } else { format!("{} ({})", self.figure, self.unit) }
    }
}
