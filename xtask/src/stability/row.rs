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
    /// Measures; an error is a motion that the solver could not finish.
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
    /// The figure; none if the solver gave up.
    pub figure: Option<f64>,
    /// What the solver said then.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lost: Option<String>,
    pub verdict: Verdict,
}

impl Row {
    /// Measures this row.
    pub fn cell(&self, trial: &Trial) -> Cell {
        match (self.measure)(trial) {
            Ok(x) if x.is_finite() => {
                let verdict = match x {
                    x if x <= self.limit => Verdict::Pass,
                    x if x <= 10.0 * self.limit => Verdict::Degraded,
                    _ => Verdict::Fail,
                };
                Cell { figure: Some(x), lost: None, verdict }
            }
            Ok(_) => Cell { figure: None, lost: Some("the figure is no number".into()), verdict: Verdict::Fail },
            Err(said) => Cell { figure: None, lost: Some(said), verdict: Verdict::Fail },
        }
    }
}

/// All rows.
pub fn rows() -> impl Iterator<Item = &'static Row> {
    super::flight::ROWS.iter().chain(&super::joints::ROWS).chain(&super::contact::ROWS).chain(&super::robots::ROWS)
}
