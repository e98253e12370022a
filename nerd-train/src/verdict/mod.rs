//! Verdict on a model: compares its errors and time with those of baselines and the analytic solver. The baselines are
//! the base without the network, and a linear map of the same inputs. `articulated` runs with 1, 2, 4, .. substeps, up
//! to the fewest with no larger mean error than the model. With rapier as truth, cheaper settings of rapier are
//! compared, too.
//!
//! All solvers roll out from equal starts under equal torques, on one CPU core; time and error come from the same
//! steps.

mod linear;
pub mod recorded;
mod words;

use nerd_model::solver::learned;
use nerd_sim::instruments::Shaken;

use crate::comparison::Comparison;
use crate::cost::{on_one_core, powers, timed};
use crate::evaluate::{Action, PassiveConfig, PassiveReport, summary, summary_names};
use crate::prelude::*;
use crate::spec::{RapierSpec, SolverSpec};
use crate::stats::mean;

/// The network pays off if both baselines have at least this multiple of the model's error, in every quantity.
pub const WORTH: f64 = 5.0;
/// Offset of the seed of the linear map's data from the seed of the starts.
const ELSEWHERE: u64 = 7_000_003;
/// Most substeps of `articulated` if another solver is the truth.
const MOST: usize = 64;
/// Noise (rad/s or m/s) on the velocities of a shaken truth after every frame, of the size of rounding errors.
const SHAKE: f64 = 1e-6;

/// A model's verdict in a scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Verdict {
    /// Name of the robot.
    pub robot: String,
    /// Name of the scene.
    pub scene: String,
    /// The model's truth, the reference of all errors.
    pub truth: String,
    /// Starts, frames, seed and torques of the rollouts.
    pub protocol: PassiveConfig,
    /// Compared quantities, with units ([`summary_names`]).
    pub quantities: Vec<String>,
    /// Errors and time of the model.
    pub model: Row,
    /// Errors and time of the base of the predictions, without the network.
    pub base: Row,
    /// On recorded motion with another base than the state: a predictor that repeats the start.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hold: Option<Row>,
    /// The linear map from normalised token to normalised target, fitted to other motions of the truth.
    pub linear: Row,
    /// `articulated` with 1, 2, 4, .. substeps, up to the first row with no larger mean error than the model. On
    /// recorded motion: `articulated` as the robot's file describes it, and as calibrated.
    pub articulated: Vec<Row>,
    /// On recorded motion: another log of the same motions, by another simulator or with another step. With rapier as
    /// truth: rapier with half of the steps and with a quarter, the truth itself, and the truth with noise. The last
    /// shows how sensitive the motion is.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub beside: Vec<Row>,
}

/// Errors and time of one solver.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Name of the solver.
    pub of: String,
    /// Mean absolute difference from the truth over all frames and starts, by quantity.
    pub errors: Vec<f64>,
    /// Time per frame on one core (us); 0 if unknown.
    pub microseconds: f64,
    /// Number of rollouts that diverged or could not be continued.
    pub diverged: usize,
}

impl Row {
    fn new(of: impl Into<String>, system: &System, (report, microseconds): (PassiveReport, f64)) -> Self {
        let PassiveReport { error, diverged, .. } = report;
        Self { of: of.into(), errors: summary(system, &error), microseconds, diverged }
    }
    /// Mean of the errors over the compared quantities.
    pub fn mean(&self) -> f64 {
        mean(&self.errors)
    }
}

/// The verdict on a model in a scene, with the protocol's starts; progress goes to standard error. None for a chain,
/// since it has no linear map.
///
/// # Errors
/// If the truth cannot step.
pub fn verdict(
    system: &Arc<System>,
    scene: &Arc<Scene>,
    model: &Model,
    protocol: PassiveConfig,
) -> Result<Option<Verdict>> {
    if model.config.network.architecture == Architecture::Chain {
        return Ok(None);
    }
    let truth = Truth::named(&model.config.truth)?;
    let maps = linear::maps(model, linear::windows(model, system, truth, protocol.seed.wrapping_add(ELSEWHERE))?);
    let own = SolverSpec::from(truth).config(system);
    let config = own.unwrap_or_else(|| ArticulatedConfig::accurate(system));
    let most = own.map_or(MOST, |own| own.substeps.max(own.contact_substeps));
    let counts = powers(most).chain((!most.is_power_of_two()).then_some(most)).collect_vec();
    let bar =
        bar("verdict: solvers", (2 + maps.len() + counts.len() + if truth == Truth::Rapier { 4 } else { 0 }) as u64);
    let found = on_one_core(|| {
        let comparison = Comparison::with(truth.solver(system), system, scene, protocol)?;
        let row = |of: &str, solver: Box<dyn Solver>| -> Result<Row> {
            bar.add(1);
            Ok(Row::new(of, system, timed(solver, comparison.work(), |solver| comparison.errors(solver))?))
        };
        let mut found = common(model, system, (scene, truth.name(), protocol), maps, &row)?;
        for n in counts {
            if found.articulated.last().is_none_or(|last| last.mean() > found.model.mean()) {
                let config = ArticulatedConfig { substeps: n, contact_substeps: n, ..config };
                let mut next = row(&format!("articulated x{n}"), Box::new(Articulated::new(config)))?;
                if next.errors.iter().all(|e| *e == 0.0) {
                    next.of += " (the truth)";
                }
                found.articulated.push(next);
            }
        }
        if truth == Truth::Rapier {
            for share in [2, 4, 1] {
                let spec = SolverSpec::rapier(RapierSpec::default().steps / share);
                let name = format!("{spec}{}", if share == 1 { " (the truth)" } else { "" });
                found.beside.push(row(&name, spec.solver(system, 1)?)?);
            }
            let shaken = Shaken::new(truth.solver(system), SHAKE, protocol.seed);
            found.beside.push(row(&format!("the truth, shaken by {SHAKE:.0e}"), Box::new(shaken))?);
        }
        Ok::<_, Error>(found)
    })?;
    bar.finish();
    Ok(Some(found))
}

/// Function that evaluates a solver and gives its row this name.
type Rower<'a> = dyn Fn(&str, Box<dyn Solver>) -> Result<Row> + 'a;

/// A verdict with the rows of the base alone, of the model and of the best linear map.
fn common(
    model: &Model,
    system: &Arc<System>,
    (scene, truth, protocol): (&Scene, String, PassiveConfig),
    maps: Vec<linear::Linear>,
    row: &Rower,
) -> Result<Verdict> {
    let name = match model.config.base {
        Base::State => "base alone (hold last)",
        Base::Trapezoid => "base alone (constant velocity)",
    };
    let base = row(name, linear::base(model, system))?;
    let own = row("model", learned(model.clone(), system)?)?;
    let maps = maps.into_iter().map(|map| row("linear map", linear::with(model, map)));
    let maps = maps.collect::<Result<Vec<_>>>()?;
    let Some(linear) = maps.into_iter().min_by(|a, b| a.mean().total_cmp(&b.mean())) else {
        refuse!("no linear map fits the motions of `{}`: one of the model's inputs is not a number", system.name);
    };
    let (robot, scene, quantities) = (system.name.clone(), scene.name.clone(), summary_names(system));
    let (hold, articulated, beside) = Default::default();
    Ok(Verdict { robot, scene, truth, protocol, quantities, model: own, base, hold, linear, articulated, beside })
}

impl Verdict {
    /// The cheapest solver with known time and no larger mean error than the model. Candidates are all rows of
    /// `articulated`, and the first such row of `beside`.
    pub fn equal(&self) -> Option<&Row> {
        let as_good = |row: &&Row| row.microseconds > 0.0 && row.mean() <= self.model.mean();
        // Of rapier's rows only the first that is as good: a shaken truth comes last.
        let found = self.articulated.iter().filter(as_good).chain(self.beside.iter().find(as_good));
        found.min_by(|a, b| a.microseconds.total_cmp(&b.microseconds))
    }

    /// Whether the verdict is on recorded motion.
    pub fn recorded(&self) -> bool {
        matches!(self.protocol.action, Action::Recorded(_))
    }

    /// A solver's errors as multiples of the model's, by quantity; 1 where both are equal.
    pub fn times(&self, row: &Row) -> Vec<f64> {
        let ratio = |(a, b): (&f64, &f64)| if a == b { 1.0 } else { a / b };
        row.errors.iter().zip(&self.model.errors).map(ratio).collect()
    }

    /// Describes the first quantity where a baseline errs less than [`WORTH`] times as much as the model, if any.
    /// Recorded motion has no such bound: there the model need only beat the calibrated solver.
    pub fn shortfall(&self) -> Option<String> {
        if self.recorded() {
            return None;
        }
        for row in [&self.base, &self.linear] {
            for (quantity, times) in self.quantities.iter().zip(self.times(row)) {
                if times.is_nan() || times < WORTH {
                    return Some(format!(
                        "{} errs {times:.2} times as much as the model in {quantity}: {WORTH} are needed",
                        row.of
                    ));
                }
            }
        }
        None
    }
}
