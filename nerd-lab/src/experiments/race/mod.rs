//! A race: policies learn from random weights, by samples and by slopes, in a model and in the exact solver, and their reward in truth is told
//! by the time that they had.
//!
//! The clock begins where a run is ready to: kernels were compiled by an iteration of another run before it. It stands while policies are set
//! aside, and they are played in the truth after it. A run that was made is not made again, and processes that are given the same command make
//! each what no other does.

use super::games::{Reward, arena_of, input_of, truth_of};
use crate::prelude::*;

mod run;
mod tables;

pub use run::Run;
pub use tables::Row;

/// Seconds after which a policy is set aside.
const AT: [f64; 17] = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0, 15.0, 20.0, 25.0, 30.0, 40.0, 50.0, 60.0, 120.0];

/// Rewards that are to be reached.
const GOALS: [(&str, f64); 4] = [("cartpole-swingup", 1100.0), ("ant-run", 3000.0), ("ant-spin-track", 2000.0), ("anymal-forward", 1400.0)];

settings! {
    /// Policies that learn against the clock.
    pub struct Race {
        /// Name of the result
        name: String = "race".into(), Text;
        /// Tasks, comma-separated
        task: Vec<String> = GOALS.map(|goal| goal.0.to_string()).into(), Texts;
        /// Who races, comma-separated: ppo or shac, a hyphen, and where it learns: neural (the model that comes with the project), truth, or x1, x4
        /// and so on (articulated with so many substeps)
        entrant: Vec<String> = ["ppo-neural", "shac-neural", "ppo-x4", "shac-x4"].map(String::from).into(), Texts;
        /// Seeds, comma-separated: each makes a run of every entrant and task
        seeds: Vec<u64> = vec![0, 1, 2], Wholes(SEEDS);
        /// Seconds that a run has
        seconds: f64 = 60.0, Positive;
        /// Environments, instead of the settings'
        environments: Option<usize> = None, Whole(1..=1_048_576);
        /// Iterations of shac, over which its rate falls, instead of the settings'
        iterations: Option<u64> = None, Whole(1..=1_000_000_000);
        /// Folder of TOMLs that go before the project's own settings: TASK-ALGORITHM.toml
        settings: Option<PathBuf> = None, Text;
        /// Games of each policy in the truth; with 0 runs are made, and a later command plays
        games: usize = 64, Whole(0..=65_536);
        /// Seed of the starts
        seed: u64 = 500, Whole(SEEDS);
        /// Where runs are computed (cpu or cuda)
        device: Device = Device::Cpu, Words(&["cpu", "cuda"]);
        /// Folder of the runs
        runs: PathBuf = "out/race".into(), Text;
    }
}

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
            inputs.add(Input::robot(&*System::named(nerd_tasks::named(&run.task)?.robot())?));
            inputs.add(truth_of(&run.task, Truth::Articulated)?);
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
