//! Trains policies and their model in turn, until policies of new seeds earn in the model what they earn in its truth.
//!
//! ```text
//! model ─▶ policies of new seeds, trained in it ─▶ games in it and in the truth ─▶ gaps ─ small ─▶ done
//!   ▲                                                                               │
//!   └── trained on, on fresh data in which the policies of all rounds act ◀── large ┘
//! ```
//!
//! A policy in training moves to where reward is, and reward beyond a model's data is usually the model's error. So those policies act in
//! the next round's data. A round's seeds are new and its model was frozen before, so its gaps are an honest measure.
//!
//! ```text
//! OUT/co-train.json                                       what the loop is; the same command goes on, another one is refused
//! OUT/round-K/model                                       the model of round K, from 1 on
//! OUT/round-K/policies/TASK-SEED/{policy,gap.json,...}    what was trained in it, and what it earns
//! OUT/round-K/gaps.json                                   all gaps; there once the round is done
//! OUT/rounds.md                                           all rounds in a table
//! ```

mod plan;
mod round;

use nerd_train::records::claimed;

pub use plan::CoTrainConfig;
pub use round::{Gap, Round};

use plan::Plan;

use crate::prelude::*;
use crate::report::read_json_of;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    Passed(usize),
    /// All rounds were made, and none is good enough.
    Rounds,
    Time,
}

pub struct CoTrained {
    pub end: End,
    pub rounds: Vec<Round>,
    pub table: Table,
    pub said: String,
}

/// Runs, or goes on with, a loop of tasks of one robot in the folder `out` [default: `out/co-train-ROBOT`], until the rule, the number of
/// rounds or the minutes stop it.
pub fn co_train(tasks: Vec<String>, config: CoTrainConfig, out: Option<PathBuf>) -> Result<CoTrained> {
    let plan = Plan::new(tasks, config, out)?;
    let _claim = claimed(&plan.out)?;
    plan.hold()?;
    let mut rounds: Vec<Round> = Vec::new();
    let end = loop {
        let k = rounds.len();
        if let Some(last) = rounds.last().filter(|last| passes(&plan, last)) {
            break End::Passed(last.round);
        }
        if k == plan.config.rounds {
            break End::Rounds;
        }
        let done = read_json_of(&plan.done(k))?;
        let Some(done) = done.map_or_else(|| plan.round(k), |done| Ok(Some(done)))? else { break End::Time };
        rounds.push(done);
        write(&plan.out.join("rounds.md"), table(&plan, &rounds).markdown().as_bytes())?;
    };
    let said = match end {
        End::Passed(k) => format!("round {k} passes; its model is {}", plan.model_of(k).display()),
        End::Rounds => {
            let last = plan.model_of(plan.config.rounds - 1);
            format!("no round passes; the model of the last one is {}; more --rounds continue from it", last.display())
        }
        End::Time => format!("time is over in round {}; the same command continues", rounds.len()),
    };
    Ok(CoTrained { end, table: table(&plan, &rounds), rounds, said })
}

fn near(plan: &Plan, [mean, largest]: [f64; 2]) -> bool {
    mean < plan.config.mean && largest <= plan.config.most
}

fn passes(plan: &Plan, round: &Round) -> bool {
    plan.tasks.iter().all(|task| near(plan, round.sizes(task)))
}

fn table(plan: &Plan, rounds: &[Round]) -> Table {
    let percent = |x: f64| if x.is_finite() { format!("{x:.3}") } else { "-".into() };
    let lines = rounds.iter().flat_map(|round| plan.tasks.iter().map(move |task| (round, task))).map(|(round, task)| {
        let sizes = round.sizes(task);
        let model = round.model.get(..12).unwrap_or("-");
        let verdict = if near(plan, sizes) { "passes" } else { "does not" };
        [&[round.round.to_string(), model.into(), task.clone()], &sizes.map(percent)[..], &[verdict.into()]].concat()
    });
    let note = format!(
        "Sizes of the gaps of {} policies of new seeds, trained in the round's frozen model: reward in it beside that in the truth, {} games \
         from the same starts. A task passes below {} % in the mean with none above {} %.",
        plan.config.seeds, plan.config.games, plan.config.mean, plan.config.most,
    );
    Table::new("rounds", &["round", "model", "task", "mean gap (%)", "largest gap (%)", "verdict"]).with(lines).noted(&note)
}
