//! A race: policies learn from random weights, by samples and by slopes, in a model and in the exact solver, and their reward in truth is told
//! by the time that they had.
//!
//! The clock begins where a run is ready to: kernels were compiled by an iteration of another run before it. It stands while policies are set
//! aside, and they are played in the truth after it. A run that was made is not made again, and processes that are given the same command make
//! each what no other does.

use super::games::{depend, input_of};
use crate::prelude::*;

mod run;
mod settings;
mod tables;

pub use run::Run;
pub use settings::Race;
pub use tables::Row;

impl Race {
    /// All runs, those of one seed one after the other: where time is short, whole races come first.
    fn plan(&self) -> Result<Vec<Run>> {
        let (mut all, tasks) = (Vec::new(), || self.task.iter());
        for seed in &self.seeds {
            for (task, entrant) in tasks().flat_map(|task| self.entrant.iter().map(move |entrant| (task, entrant))) {
                all.push(Run::new(self, task, entrant, *seed)?);
            }
        }
        Ok(all)
    }
}

impl Experiment for Race {
    fn about(&self) -> Result<About> {
        let (mut inputs, runs) = (Inputs::default(), self.plan()?);
        for run in &runs {
            depend(&mut inputs, &run.task, Truth::Articulated)?;
            inputs.add(input_of(&run.task, &run.arena)?);
        }
        Ok(About { name: self.name.clone(), seed: self.seed, effort: self.seconds * (self.games * runs.len()) as f64, inputs })
    }

    fn measure(&self) -> Result<Measured> {
        let runs = self.plan()?;
        for (k, run) in runs.iter().enumerate() {
            tell!("run {} of {}: {}", k + 1, runs.len(), run.out.display());
            run.make()?;
        }
        let rows = runs.iter().map(|run| Row::of(run, self.games, self.seed)).collect::<Result<Vec<_>>>()?;
        let figure = tables::figure(&rows);
        Ok(Measured::new(&serde_json::json!({ "rows": rows }), vec![tables::race(&rows), tables::each(&rows)])?.with("race", figure))
    }
}
