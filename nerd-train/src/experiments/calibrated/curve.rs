//! Errors against the number of trajectories that are fitted to and learned from, on the first split.

use nerd_sim::calibrate::FitConfig;
use nerd_sim::log::Log;
use serde::{Deserialize, Serialize};

use super::pupil::Pupil;
use super::split::{Parts, Scored};
use super::{CalibratedAll, Calibration};
use crate::error::Result;
use crate::report::Table;
use crate::report::table::digits;

/// One number of trajectories.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Few {
    /// How many.
    pub trajectories: usize,
    /// Calibrated solvers, in their order.
    pub fitted: Vec<Scored>,
    /// What was learned beyond the first, by way.
    pub learned: Vec<Scored>,
}

impl Calibration {
    /// All numbers asked for, below that of the whole part.
    pub(super) fn curve(&self, log: &Log, parts: &[Parts]) -> Result<Vec<Few>> {
        let Some(part) = parts.first() else { return Ok(Vec::new()) };
        let few = |n: &u64| {
            let part = part.first(*n as usize);
            let mut found = Few { trajectories: part.trained.len(), fitted: Vec::new(), learned: Vec::new() };
            for (k, solver) in self.solvers.iter().enumerate() {
                let (subject, parameters) = self.subject(log, solver)?;
                let config = FitConfig { evaluations: self.evaluations, trials: self.trials, seed: self.seed };
                let fit = subject.fit(&parameters, &part.train, config, &mut |_, _| ())?;
                let calibrated = subject.with(&parameters, &fit.values)?;
                found.fitted.push(Scored::new(&part.judged, &calibrated.distances(&part.judged)?, self.seed));
                if k == 0 && !self.learn.is_empty() {
                    let effort = self.effort(self.seed);
                    let pupil = Pupil { log, subject: &calibrated, parameters: &parameters, values: &fit.values, parts: &part, effort };
                    for model in pupil.learn(&self.learn)? {
                        found.learned.push(pupil.judged(&model, self.seed)?.0);
                    }
                }
            }
            eprintln!("{n} trajectories: {}", found.words().join(", "));
            Ok(found)
        };
        self.curve.iter().map(few).collect()
    }
}

impl Few {
    fn words(&self) -> Vec<String> {
        let of = |s: &Scored| format!("{} / {}", digits(s.mean.position), digits(s.mean.rotation));
        self.fitted.iter().chain(&self.learned).map(of).collect()
    }
}

impl CalibratedAll {
    /// Errors by number of trajectories.
    pub(super) fn few(&self) -> Table {
        let names = self.fitted.iter().map(|f| format!("{}, calibrated", f.solver)).chain(self.settings.learn.iter().cloned());
        let header: Vec<String> = ["trajectories".to_string()].into_iter().chain(names).collect();
        let rows = self.curve.iter().map(|few| [few.trajectories.to_string()].into_iter().chain(few.words()).collect());
        Table::new("curve", &header.iter().map(String::as_str).collect::<Vec<_>>()).with(rows).noted(
            "Mean distance (m) / angle (rad) on the judged part of the first split, by how many of the other trajectories were used.",
        )
    }
}
