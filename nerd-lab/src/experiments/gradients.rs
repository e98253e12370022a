//! How much a policy's gradient varies with how far back it goes: gradients of what a policy earns over a horizon, environment by environment,
//! through a model and through the exact solver, from states that the policy visits in the truth, under the same noise.

use nerd_tasks::{Episodes, named};
use nerd_train::ppo::{Actor, Algorithm, Engine, Policy, PpoConfig, Running, RunningMoments, Shac, Stage, StreamKey, folder};
use rayon::prelude::*;

use super::games::{arena_of, input_of, policy_of, truth_of};
use crate::prelude::*;

/// Horizons (steps).
const HORIZONS: [usize; 7] = [1, 2, 4, 8, 16, 32, 64];

settings! {
    /// The variance of a policy's gradient by its horizon.
    pub struct Gradients {
        /// Name of the result
        name: String = "gradients".into(), Text;
        /// Task
        task: String = "ant-run".into(), Text;
        /// Folder of the policy [default: the first of the task in models/policies]
        policy: Option<PathBuf> = None, Text;
        /// What it goes back through, comma-separated: neural (the model that comes with the project), truth, or x1, x4 and so on (articulated with
        /// so many substeps)
        through: Vec<String> = ["neural", "x4", "truth"].map(String::from).into(), Texts;
        /// Logarithm of the spread of actions, instead of the policy's own
        spread: Option<f64> = None, Number(-20.0..=2.0);
        /// Environments, each of which gives a gradient
        environments: usize = 256, Whole(2..=65_536);
        /// Steps in the truth before, from starts of the task
        before: u64 = 100, Whole(0..=10_000);
        /// Seed of starts and noise
        seed: u64 = 500, Whole(SEEDS);
        /// Where it is computed (cpu or cuda)
        device: Device = Device::Cpu, Words(&["cpu", "cuda"]);
    }
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    pub through: String,
    pub horizon: usize,
    /// Environments that have slopes.
    pub environments: usize,
    /// Reward of a step.
    pub earned: f64,
    /// Norm of the mean gradient of an environment's mean reward of a step.
    pub mean: f64,
    /// Root of the sum of its parameters' variances over environments.
    pub deviation: f64,
    /// That by the norm of the mean whose own scatter is taken out: environments it takes for the mean to be as large as its scatter, squared.
    pub noise: Option<f64>,
    /// Share of the largest environment in the sum of squared norms.
    pub largest: f64,
    /// Of the angle between the mean gradient and that through the truth at this horizon, if that is measured, too.
    pub cosine: Option<f64>,
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

impl Gradients {
    fn folder(&self) -> Result<PathBuf> {
        match &self.policy {
            Some(path) => Ok(path.clone()),
            None => shipped::policies(&self.task)?
                .into_iter()
                .find(|path| folder::load(path).is_ok_and(|found| found.0.task == self.task))
                .with_context(|| format!("models/policies holds no policy of {}: name one with --set policy=FOLDER", self.task)),
        }
    }

    fn policy(&self) -> Result<Policy> {
        let mut policy = policy_of(&self.folder()?, &self.task)?;
        if policy.shape.stack > 1 || policy.shape.spread_by_state {
            bail!("{}: a policy that sees one observation and has a spread of its own is needed", self.folder()?.display());
        }
        // The value of the end is 0.
        policy.returns = RunningMoments::new(1);
        if let Some(spread) = self.spread {
            let own = policy.flat.len() - policy.shape.spread();
            policy.flat[own..].fill(spread as f32);
        }
        Ok(policy)
    }

    /// Environments where the policy has taken them in the truth.
    fn visited(&self, policy: &Policy) -> Result<(Episodes, Running)> {
        let truth = Arena::Truth(Truth::Articulated);
        let mut episodes = truth.episodes(&self.task, self.environments, self.seed)?;
        let (mut running, mut cut) = (Running::new(&episodes, 1), Vec::new());
        let actor = Actor::new(policy.clone());
        for _ in 0..self.before {
            let actions = actor.mean(&running.stack.rows);
            running.step(&mut episodes, &actions, &mut cut)?;
        }
        Ok((episodes, running))
    }

    /// Gradients of the environments that have them, of minus their mean reward of a step; and that reward.
    fn found(&self, policy: &Policy, from: &(Episodes, Running), through: &str, horizon: usize) -> Result<(Vec<Vec<f64>>, f64)> {
        let (n, arena) = (self.environments, arena_of(&self.task, through, self.device)?);
        // All rewards count alike, and what comes later counts for nothing: the critic has learned nothing yet.
        let shac = PpoConfig { algorithm: Algorithm::Shac, environments: n, horizon, gamma: 1.0, iterations: 1, ..PpoConfig::default() };
        let mut episodes = arena.part(named(&self.task)?, 0..n, self.seed)?;
        (0..n).for_each(|env| episodes.place(env, &from.0, env));
        let mut running = from.1.clone();
        let mut engine = Shac::new(&mut episodes, &mut policy.clone(), &shac, self.seed, &Default::default())?;
        let noise = StreamKey { seed: self.seed, number: 0 };
        engine.roll(Stage { episodes: &mut episodes, running: &mut running, policy, config: &shac, noise })?;
        let own = engine.gradients(policy).into_par_iter().filter(|own| own.iter().any(|g| *g != 0.0));
        let own: Vec<Vec<f64>> = own.map(|own| own.into_iter().map(|g| f64::from(g) * n as f64).collect()).collect();
        if own.len() < 2 {
            bail!(
                "gradients of {} through {through}, {horizon} frames: {} of {n} environments have slopes, two are needed",
                self.task,
                own.len()
            );
        }
        Ok((own, engine.earned))
    }

    fn row(&self, through: &str, horizon: usize, (gradients, earned): &(Vec<Vec<f64>>, f64), truth: Option<&[f64]>) -> Row {
        let (n, mean) = (gradients.len() as f64, mean_of(gradients));
        let norms: Vec<f64> = gradients.iter().map(|own| dot(own, own)).collect();
        let (all, square) = (norms.iter().sum::<f64>(), dot(&mean, &mean));
        let variance = (all - n * square).max(0.0) / (n - 1.0);
        Row {
            through: through.into(),
            horizon,
            environments: gradients.len(),
            earned: *earned,
            mean: square.sqrt(),
            deviation: variance.sqrt(),
            // Of the mean's square the part that is its own scatter.
            noise: Some(square - variance / n).filter(|own| *own > 0.0).map(|own| (variance / own).sqrt()),
            largest: norms.iter().copied().fold(0.0, f64::max) / all,
            cosine: truth.map(|truth| dot(&mean, truth) / (square * dot(truth, truth)).sqrt()).filter(|x| x.is_finite()),
        }
    }
}

fn mean_of(gradients: &[Vec<f64>]) -> Vec<f64> {
    let mut mean = vec![0.0; gradients.first().map_or(0, Vec::len)];
    gradients.iter().for_each(|own| mean.iter_mut().zip(own).for_each(|(sum, g)| *sum += g / gradients.len() as f64));
    mean
}

impl Experiment for Gradients {
    fn about(&self) -> Result<About> {
        let mut inputs = Inputs::default();
        inputs.add(Input::robot(&*System::named(named(&self.task)?.robot())?));
        inputs.add(truth_of(&self.task, Truth::Articulated)?);
        inputs.add(Input::policy(&self.folder()?)?);
        let policy = self.policy()?;
        // Actions of every step, and a gradient of every environment, twice.
        let bytes = 24 * policy.flat.len() + 64 * HORIZONS[HORIZONS.len() - 1] * (policy.shape.inputs() + 8 * policy.shape.action);
        bounds::memory(&[("environments", self.environments)], bytes)?;
        for through in &self.through {
            inputs.add(input_of(&self.task, &arena_of(&self.task, through, self.device)?)?);
        }
        let effort = (self.environments * self.through.len()) as f64;
        Ok(About { name: self.name.clone(), seed: self.seed, effort, inputs })
    }

    fn measure(&self) -> Result<Measured> {
        let policy = self.policy()?;
        let from = self.visited(&policy)?;
        let bar = bar(&format!("gradients of {}", self.task), (HORIZONS.len() * self.through.len()) as u64);
        let mut rows = Vec::new();
        for horizon in HORIZONS {
            let found = self.through.iter().map(|through| {
                let found = self.found(&policy, &from, through, horizon)?;
                bar.add(1);
                Ok((through, found))
            });
            let found = found.collect::<Result<Vec<_>>>()?;
            let truth = found.iter().find(|(through, _)| *through == "truth").map(|(_, found)| mean_of(&found.0));
            rows.extend(found.iter().map(|(through, found)| self.row(through, horizon, found, truth.as_deref())));
        }
        bar.finish();
        let line = |r: &Row| {
            let noise = or_dash(r.noise.map(digits));
            let head = [r.through.clone(), r.horizon.to_string(), r.environments.to_string(), format!("{:.3}", r.earned), digits(r.mean)];
            let tail = [digits(r.deviation), noise, format!("{:.0}", 100.0 * r.largest), or_dash(r.cosine.map(|x| format!("{x:.3}")))];
            head.into_iter().chain(tail).collect()
        };
        let header = [
            "through",
            "horizon",
            "environments",
            "reward of a step",
            "|mean|",
            "deviation",
            "deviation / |mean|",
            "largest's share (%)",
            "cosine to truth's",
        ];
        let note = format!(
            "Gradients by the parameters of a policy of {}, of an environment's mean reward of a step over a horizon, from states that it visits \
             in the truth; the same noise everywhere. Deviation: root of the sum of variances over environments. In its ratio to the mean the \
             mean's own scatter is taken out: N environments find it to sqrt(1 / N) of that. Largest's share: of one environment in the sum of \
             squared norms. Cosine: between mean gradients. Environments without finite slopes are left out.",
            self.task
        );
        let table = Table::new("gradients", &header).with(rows.iter().map(line)).noted(&note);
        let panel = |title: &str, y: Axis, of: &dyn Fn(&Row) -> Option<f64>| {
            let series = self.through.iter().map(|through| {
                let own = rows.iter().filter(|row| row.through == *through);
                Series::new(through.clone(), Style::Marked, own.filter_map(|row| Some((row.horizon as f64, of(row)?))))
            });
            Panel { title: title.into(), x: Axis::log("horizon (steps)"), y, series: series.collect(), levels: Vec::new() }
        };
        let panels = vec![
            panel("Deviation of an environment's gradient", Axis::log("norm"), &|row| Some(row.deviation)),
            panel("The same by the mean's size", Axis::log("ratio"), &|row| row.noise),
        ];
        let figure = Figure { title: format!("Gradients of a policy of {} by horizon", self.task), columns: 2, panels };
        Ok(Measured::new(&serde_json::json!({ "rows": rows }), vec![table])?.with("gradients", figure))
    }
}
