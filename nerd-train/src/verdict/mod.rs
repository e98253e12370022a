//! Compares a model's errors and time with its base alone, with a linear map on the same inputs, and of the analytic
//! solver at one substep and at the fewest that err no more; where rapier is the truth, beside its own cheaper settings, too.
//!
//! All roll out from equal starts under equal torques, on one core of the CPU, and each one's time and error are of the same steps.

mod linear;
pub mod recorded;
mod words;

use nerd_model::pick::learned;
use nerd_sim::instruments::{Hold, Recorder, Replay, Shaken};

use crate::cost::{on_one_core, powers, timed};
use crate::evaluate::{Action, PassiveConfig, passive, summary, summary_names};
use crate::prelude::*;
use crate::stats::mean;

/// The network pays off if the errors of its base alone and of a linear map are at least this many times the model's error.
pub const WORTH: f64 = 5.0;
/// Offset of the seed of the linear map's data from the seed of the starts.
const ELSEWHERE: u64 = 7_000_003;
/// Most substeps beside a truth that is not `articulated`.
const MOST: usize = 64;
/// Noise (rad/s or m/s) after every frame of a shaken truth, as rounding might be.
const SHAKE: f64 = 1e-6;

/// What a model is worth on a scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Verdict {
    /// Which robot.
    pub robot: String,
    /// Where.
    pub scene: String,
    /// The truth that it learned, and everything is compared with.
    pub truth: String,
    /// Starts, frames, seed, torques.
    pub protocol: PassiveConfig,
    /// What is compared, with units ([`summary_names`]).
    pub quantities: Vec<String>,
    /// The model.
    pub model: Row,
    /// What its predictions are added to, without them.
    pub base: Row,
    /// Where the motion was recorded and the base is another: what repeats the start.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hold: Option<Row>,
    /// A linear map from its normalised token to its normalised target, of least squares over other motions of the truth.
    pub linear: Row,
    /// `articulated` at one substep and at more, as many as were asked for until one errs no more than the model in the mean of the
    /// quantities. Where the motion was recorded, as the robot is described and calibrated.
    pub articulated: Vec<Row>,
    /// What another log has of the same motions: another simulator, or the recorded one in other steps. Of rapier its next cheaper setting
    /// (half of its steps), the next after that, itself, and itself shaken, which says how sensitive it is.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub beside: Vec<Row>,
}

/// One solver's errors and time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Which.
    pub of: String,
    /// Mean |difference| from the truth over all frames and starts, by quantity.
    pub errors: Vec<f64>,
    /// Of a frame, on one core.
    pub microseconds: f64,
    /// Rollouts that diverged or could not be continued.
    pub diverged: usize,
}

impl Row {
    /// Mean over the quantities.
    pub fn mean(&self) -> f64 {
        mean(&self.errors)
    }
}

/// Judges a model in a scene, from the starts that an evaluation of this protocol has; progress goes to standard error. There is no verdict
/// on a network along a chain, which has no linear map.
///
/// # Errors
/// If the truth cannot step.
pub fn verdict(system: &Arc<System>, scene: &Arc<Scene>, model: &Model, protocol: PassiveConfig) -> Result<Option<Verdict>> {
    if model.config.network.architecture == Architecture::Chain {
        return Ok(None);
    }
    let truth = Truth::named(&model.config.truth).map_err(Error::Refused)?;
    let maps = linear::maps(model, linear::windows(model, system, truth, protocol.seed.wrapping_add(ELSEWHERE))?);
    let own = Setting::from(truth).articulated(system);
    let config = own.unwrap_or_else(|| ArticulatedConfig::accurate(system));
    let most = own.map_or(MOST, |own| own.substeps.max(own.contact_substeps));
    let counts: Vec<usize> = powers(most).chain((!most.is_power_of_two()).then_some(most)).collect();
    let bar = bar("verdict: solvers", (2 + maps.len() + counts.len() + if truth == Truth::Rapier { 4 } else { 0 }) as u64);
    let found = on_one_core(|| {
        let mut recorder = Recorder::new(truth.solver(system));
        passive(system, scene, &mut recorder, &mut Hold, protocol, &mut |_| ())?;
        let row = |of: &str, solver: Box<dyn Solver>| -> Result<Row> {
            bar.add(1);
            let compare =
                |solver: &mut dyn Solver| passive(system, scene, &mut Replay::new(&recorder.frames), solver, protocol, &mut |_| ());
            let (report, microseconds) = timed(solver, protocol.starts * protocol.steps, compare)?;
            Ok(Row { of: of.into(), errors: summary(system, &report.error), microseconds, diverged: report.diverged })
        };
        let [base, own, linear] = common(model, system, maps, &row)?;
        let mut articulated: Vec<Row> = Vec::new();
        for n in counts {
            if articulated.last().is_none_or(|last| last.mean() > own.mean()) {
                let config = ArticulatedConfig { substeps: n, contact_substeps: n, ..config };
                let mut next = row(&format!("articulated x{n}"), Box::new(Articulated::new(config)))?;
                if next.errors.iter().all(|e| *e == 0.0) {
                    next.of += " (the truth)";
                }
                articulated.push(next);
            }
        }
        let (hold, mut beside) = (None, Vec::new());
        if truth == Truth::Rapier {
            for share in [2, 4, 1] {
                let setting = Setting::RapierOwn(Truth::rapier().steps / share);
                beside.push(row(&format!("{setting}{}", if share == 1 { " (the truth)" } else { "" }), setting.solver(system)?)?);
            }
            let shaken = Shaken::new(truth.solver(system), SHAKE, protocol.seed);
            beside.push(row(&format!("the truth, shaken by {SHAKE:.0e}"), Box::new(shaken))?);
        }
        let (robot, quantities) = (system.name.clone(), summary_names(system));
        let (scene, truth) = (scene.name.clone(), truth.name());
        Ok::<_, Error>(Verdict { robot, scene, truth, protocol, quantities, model: own, base, hold, linear, articulated, beside })
    })?;
    bar.finish();
    Ok(Some(found))
}

/// Rolls a solver out under a name.
type Rower<'a> = dyn Fn(&str, Box<dyn Solver>) -> Result<Row> + 'a;

/// The base alone, the model and the best of some linear maps.
fn common(model: &Model, system: &Arc<System>, maps: Vec<linear::Linear>, row: &Rower) -> Result<[Row; 3]> {
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
    Ok([base, own, linear])
}

impl Verdict {
    /// The cheapest solver that errs no more than the model in the mean of the quantities: `articulated` at the fewest substeps that do, or
    /// rapier's setting with the fewest steps; none if there is none whose time is known.
    pub fn equal(&self) -> Option<&Row> {
        let as_good = |row: &&Row| row.microseconds > 0.0 && row.mean() <= self.model.mean();
        // Of rapier's settings the first: a shaken truth comes last.
        let found = self.articulated.iter().filter(as_good).chain(self.beside.iter().find(as_good));
        found.min_by(|a, b| a.microseconds.total_cmp(&b.microseconds))
    }

    /// Whether it is on recorded motion.
    pub fn recorded(&self) -> bool {
        matches!(self.protocol.action, Action::Recorded(_))
    }

    /// A solver's errors as multiples of the model's, by quantity; of two that are 0 it is 1.
    pub fn times(&self, row: &Row) -> Vec<f64> {
        let ratio = |(a, b): (&f64, &f64)| if a == b { 1.0 } else { a / b };
        row.errors.iter().zip(&self.model.errors).map(ratio).collect()
    }

    /// Where base alone or linear map do not err [`WORTH`] times as much as the model, in words; none if they do in every quantity. Of
    /// recorded motion nothing better than the calibrated solver may be known: there it is enough to be better than that.
    pub fn shortfall(&self) -> Option<String> {
        if self.recorded() {
            return None;
        }
        for row in [&self.base, &self.linear] {
            for (quantity, times) in self.quantities.iter().zip(self.times(row)) {
                if times.is_nan() || times < WORTH {
                    return Some(format!("{} errs {times:.2} times as much as the model in {quantity}: {WORTH} are needed", row.of));
                }
            }
        }
        None
    }
}
