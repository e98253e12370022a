//! Errors against the number of trajectories that are fitted to and learned from, on the first split.

use nerd_sim::log::Log;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::learning::Learning;
use super::split::{Parts, Scored};
use super::{CalibratedAll, Calibration};
use crate::error::{Result, refuse};
use crate::report::Table;

/// One number of trajectories.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CurvePoint {
    /// How many.
    pub trajectories: usize,
    /// Calibrated solvers, in their order.
    pub fitted: Vec<Scored>,
    /// What was learned beyond the first, by way.
    pub learned: Vec<Scored>,
}

impl Calibration {
    /// All numbers asked for that are smaller than the whole part that is trained on.
    pub(super) fn curve(&self, log: &Log, parts: &[Parts]) -> Result<Vec<CurvePoint>> {
        let Some(part) = parts.first() else { return Ok(Vec::new()) };
        let of = |n: usize| -> Result<CurvePoint> {
            let part = part.few(n);
            let mut found = CurvePoint { trajectories: n, fitted: Vec::new(), learned: Vec::new() };
            for (k, solver) in self.solvers.iter().enumerate() {
                let (subject, parameters) = self.subject(log, solver)?;
                let fit = subject.fit(&parameters, &part.train, self.fit_config(0), &mut |_, _| ())?;
                let (values, calibrated) = (&fit.values[..], subject.with(&parameters, &fit.values)?);
                found.fitted.push(Scored::new(&part.judged, &calibrated.distances(&part.judged)?, self.seed));
                if k == 0 && !self.learn.is_empty() {
                    let (parameters, effort) = (&parameters[..], self.effort(self.seed));
                    let learning = Learning { log, subject: &calibrated, parameters, values, parts: &part, effort };
                    for model in learning.learn(&self.learn)? {
                        found.learned.push(learning.judged(&model, self.seed)?.0);
                    }
                }
            }
            eprintln!("{n} trajectories: {}", found.words().join(", "));
            Ok(found)
        };
        self.numbers(part).into_par_iter().map(of).collect()
    }

    /// Numbers of trajectories below that of the whole part.
    fn numbers(&self, part: &Parts) -> Vec<usize> {
        self.curve.iter().map(|n| *n as usize).filter(|n| *n < part.trained.len()).collect()
    }

    /// Refuses numbers of trajectories that give nothing to fit to.
    pub(super) fn curved(&self, parts: &[Parts]) -> Result<()> {
        let Some(part) = parts.first() else { return Ok(()) };
        match self.numbers(part).into_iter().find(|n| part.few(*n).train.is_empty()) {
            Some(n) => refuse!("--curve {n}: so few trajectories have no rollout of --frames {}", self.frames),
            None => Ok(()),
        }
    }
}

impl CurvePoint {
    fn words(&self) -> Vec<String> {
        self.fitted.iter().chain(&self.learned).map(Scored::words).collect()
    }
}

impl CalibratedAll {
    /// Errors by number of trajectories.
    pub(super) fn few(&self) -> Table {
        let names = self.fitted.iter().map(|f| format!("{}, calibrated", f.solver)).chain(self.settings.learn.iter().cloned());
        let header: Vec<String> = ["trajectories".to_string()].into_iter().chain(names).collect();
        let rows = self.curve.iter().map(|few| [few.trajectories.to_string()].into_iter().chain(few.words()).collect());
        Table::new("curve", &header.iter().map(String::as_str).collect::<Vec<_>>()).with(rows).noted(
            "Mean errors on the judged part of the first split, by how many of the other trajectories were fitted to and trained on. The best \
             weights are chosen by the whole validation part.",
        )
    }
}
