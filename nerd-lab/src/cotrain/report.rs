//! All rounds as a result: tables, and gaps against rounds.

use serde::{Deserialize, Serialize};

use super::{CoTrain, Round};
use crate::error::Result;
use crate::experiments::games::truth_of;
use crate::experiments::{Experiment, Measured, conduct};
use crate::report::{Input, Inputs, Table};

/// All rounds that are done, and the rule that they were held to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Rounds {
    /// Below this must be the mean size of every task's gaps (percent).
    pub mean: f64,
    /// And none above this (percent).
    pub most: f64,
    /// In order.
    pub rounds: Vec<Round>,
}

/// What was measured before, as an experiment writes it.
struct Done<'a> {
    of: &'a CoTrain,
    data: Rounds,
}

impl CoTrain {
    /// Writes `rounds.json`, `.md` and the picture; all rounds that are done, and their tables.
    pub(super) fn report(&self) -> Result<(Vec<Round>, Vec<Table>)> {
        let mut rounds = Vec::new();
        while let Some(round) = Round::read(&self.folder(rounds.len()))? {
            rounds.push(round);
        }
        if rounds.is_empty() {
            return Ok((rounds, Vec::new()));
        }
        let data = Rounds { mean: self.config.mean, most: self.config.most, rounds: rounds.clone() };
        let written = conduct(&Done { of: self, data }, &self.out)?;
        Ok((rounds, written.tables))
    }
}

impl Experiment for Done<'_> {
    fn name(&self) -> String {
        "rounds".into()
    }

    fn seed(&self) -> u64 {
        self.of.config.seed
    }

    fn effort(&self) -> f64 {
        let policies = self.data.rounds.iter().flat_map(|r| &r.tasks).map(|t| t.policies.len()).sum::<usize>();
        (policies * self.of.config.games) as f64
    }

    fn inputs(&self) -> Result<Inputs> {
        let mut inputs = Inputs::default();
        inputs.add(Input::robot(&self.of.system));
        for task in &self.of.tasks {
            inputs.add(truth_of(task, self.of.truth)?);
        }
        for round in &self.data.rounds {
            inputs.add(Input::model(&self.of.model_of(round.round))?);
            for policy in self.of.judged(round.round) {
                inputs.add(Input::policy(&policy)?);
            }
        }
        Ok(inputs)
    }

    fn measure(&self) -> Result<Measured> {
        let Rounds { mean, most, rounds } = &self.data;
        let each = || rounds.iter().flat_map(|r| r.tasks.iter().map(move |t| (r, t)));
        let percent = |x: f64| if x.is_finite() { format!("{x:.3}") } else { "-".into() };
        let lines = each().map(|(r, t)| {
            let verdict = if t.passes(*mean, *most) { "passes" } else { "does not" };
            let model = r.model.get(..12).unwrap_or("-");
            vec![r.round.to_string(), model.into(), t.task.clone(), percent(t.mean()), percent(t.largest()), verdict.into()]
        });
        let note = format!(
            "Sizes of the gaps of {} policies of new seeds, trained in the round's frozen model: reward in it beside that in the truth, \
             {} games from the same starts. A task passes below {mean} % in the mean with none above {most} %.",
            self.of.config.seeds, self.of.config.games,
        );
        let header = ["round", "model", "task", "mean gap (%)", "largest gap (%)", "verdict"];
        let summary = Table::new("rounds", &header).with(lines).noted(&note);
        let line = |round: usize, task: &str, p: &super::Gap| {
            let rewards = [p.real, p.learned].map(|r| format!("{:.1} ± {:.1}", r.mean, r.standard_error));
            let gap = p.gap.map_or("-".into(), |gap| format!("{gap:+.3} ± {:.3}", p.gap_error.unwrap_or(f64::NAN)));
            [&[round.to_string(), task.to_string(), p.seed.to_string()], &rewards[..], &[gap]].concat()
        };
        let lines = each().flat_map(|(r, t)| t.policies.iter().map(move |p| line(r.round, &t.task, p)));
        let header = ["round", "task", "seed", "reward in the truth", "in the model", "gap (%)"];
        let seeds = Table::new("seeds", &header).with(lines).noted("± standard error over games, of the gap over pairs of games.");
        Ok(Measured::new(&self.data, vec![summary, seeds])?.with("rounds", self.data.figure()))
    }
}
