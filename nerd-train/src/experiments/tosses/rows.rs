//! The first table: every method on every set of starts.

use nerd_sim::calibrate::Engine;
use nerd_sim::measured::*;
use serde::{Deserialize, Serialize};

use super::methods::Method;
use crate::error::Result;

/// What is predicted.
pub(super) struct Trials {
    /// Windows as measured; the same with starts lifted out of the table; these in metres.
    pub raw: Vec<Trial>,
    pub lifted: Vec<Trial>,
    pub metric: Vec<Trial>,
    /// Whole tosses, as measured and in metres.
    pub whole: Vec<Trial>,
    pub whole_metric: Vec<Trial>,
}

/// One method's errors.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Row {
    /// Name.
    pub method: String,
    /// The solver, if it is one.
    pub setting: Option<Engine>,
    /// A frame of one cube on one core.
    pub microseconds: Option<f64>,
    /// Windows as measured; left out, as other sets, where a frame is too dear.
    pub raw: Option<Score>,
    /// Windows with starts lifted out of the table.
    pub lifted: Score,
    /// These in metres.
    pub metric: Option<Score>,
    /// Whole tosses.
    pub whole: Score,
    /// These in metres.
    pub whole_metric: Option<Score>,
    /// Rollouts, of all sets, that the solver could not finish.
    pub lost: usize,
}

/// A frame that takes longer (us) is taken for the lifted windows and whole tosses only.
const DEAR: f64 = 150.0;

impl Trials {
    pub fn new(tosses: &[Toss], every: usize) -> Self {
        let raw = windows(tosses, every, 1.0);
        Self {
            lifted: lifted(&raw),
            raw,
            metric: lifted(&windows(tosses, every, METRIC)),
            whole: whole(tosses, 1.0),
            whole_metric: whole(tosses, METRIC),
        }
    }
}

impl Row {
    pub(super) fn floor(name: &str, trials: &Trials, predict: fn(&Trial) -> Motion) -> Self {
        let score = |trials: &[Trial]| against(trials, &trials.iter().map(predict).collect::<Vec<_>>());
        Self {
            method: name.into(),
            setting: None,
            microseconds: None,
            raw: Some(score(&trials.raw)),
            lifted: score(&trials.lifted),
            metric: Some(score(&trials.metric)),
            whole: score(&trials.whole),
            whole_metric: Some(score(&trials.whole_metric)),
            lost: 0,
        }
    }

    pub(super) fn of(method: &Method, trials: &Trials) -> Result<Self> {
        let mut lost = 0;
        let mut score = |trials: &[Trial]| -> Result<Score> {
            let (motions, n) = method.roll(trials)?;
            lost += n;
            Ok(against(trials, &motions))
        };
        let microseconds = method.microseconds(&trials.lifted)?;
        let mut cheap = |trials: &[Trial]| if microseconds < DEAR { score(trials).map(Some) } else { Ok(None) };
        let (raw, metric, whole_metric) = (cheap(&trials.raw)?, cheap(&trials.metric)?, cheap(&trials.whole_metric)?);
        let (lifted, whole) = (score(&trials.lifted)?, score(&trials.whole)?);
        Ok(Self {
            method: method.name.clone(),
            setting: Some(method.setting),
            microseconds: Some(microseconds),
            raw,
            lifted,
            metric,
            whole,
            whole_metric,
            lost,
        })
    }
}
