//! A row: one question with a measured answer, a limit, and the source of the limit.

use serde::Serialize;

use super::trial::{Fault, Trial};

/// One scene and what is measured in it.
pub struct Row {
    /// Name.
    pub name: &'static str,
    /// What the figure is, with its unit.
    pub figure: &'static str,
    /// Where the limit is from: an equation, or somebody's tests.
    pub source: &'static str,
    /// Largest figure that passes; up to ten times as much is degraded.
    pub limit: f64,
    /// The faults that must turn this row red; all others must leave it green.
    pub reddens: &'static [Fault],
    /// Measures; an error is a scene that could not be made.
    pub measure: fn(&Trial) -> Result<f64, String>,
}

/// What became of a row under a method.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    Pass,
    Degraded,
    Fail,
}

/// A measured cell.
#[derive(Clone, Debug, Serialize)]
pub struct Cell {
    /// The figure; of the motion before the solver gave up, if it did.
    pub figure: f64,
    /// What the solver said then.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lost: Option<String>,
    pub verdict: Verdict,
}

impl Cell {
    /// What was measured, and what the solver said if it gave up before, against a limit.
    pub fn new(measured: Result<f64, String>, lost: Option<String>, limit: f64) -> Self {
        // Beyond all limits, and still a number.
        const HUGE: f64 = 1e300;
        let lost = measured.as_ref().err().cloned().or(lost);
        let lost = lost.or_else(|| measured.as_ref().ok().filter(|x| x.is_nan()).map(|_| "the figure is no number".into()));
        let figure = measured.ok().filter(|x| x.is_finite()).unwrap_or(HUGE);
        let verdict = match figure {
            _ if lost.is_some() => Verdict::Fail,
            x if x <= limit => Verdict::Pass,
            x if x <= 10.0 * limit => Verdict::Degraded,
            _ => Verdict::Fail,
        };
        Self { figure, lost, verdict }
    }
}

impl Row {
    /// Measures this row.
    pub fn cell(&self, trial: &Trial) -> Cell {
        let measured = (self.measure)(trial);
        Cell::new(measured, trial.lost.take(), self.limit)
    }
}

/// All rows.
pub fn rows() -> impl Iterator<Item = &'static Row> {
    super::flight::ROWS.iter().chain(&super::joints::ROWS).chain(&super::contact::ROWS).chain(&super::robots::ROWS)
}
