//! Planners: actions found by looking ahead in a model, or in the truth's own method at few substeps, and acted in the truth; beside a policy,
//! and beside doing nothing.

use nerd_tasks::Episodes;
use nerd_tasks::plan::{Ilqr, IlqrConfig, Mppi, MppiConfig, Planner};
use nerd_train::ppo::{Actor, Game, folder, plan, play};

use rayon::prelude::*;

use super::games::{Reward, arena_of, depend, input_of, policy_of};
use crate::prelude::*;

/// Steps by which a pace is measured.
const PACED: u32 = 60;
/// Answers by which a policy's pace is measured.
const ANSWERS: u32 = 100_000;

settings! {
    /// Planners that look ahead in one solver and act in the truth.
    pub struct Plans {
        /// Name of the result
        name: String = "plans".into(), Text;
        /// Tasks, comma-separated
        task: Vec<String> = ["cartpole-swingup", "ant-point", "franka-reach-torque"].map(String::from).into(), Texts;
        /// Planners, comma-separated: mppi, ilqr
        planner: Vec<String> = ["mppi", "ilqr"].map(String::from).into(), Texts;
        /// Where they look ahead, comma-separated: neural (the model that comes with the project), or x1, x2, x4 and so on (articulated
        /// with so many substeps), or truth
        ahead: Vec<String> = ["neural", "x1", "x2", "x4"].map(String::from).into(), Texts;
        /// Where that is computed: cpu, or cuda
        device: Device = Device::Cpu, Words(&["cpu", "cuda"]);
        /// Games of each
        games: usize = 100, Whole(STARTS);
        /// Seed of the starts
        seed: u64 = 500, Whole(SEEDS);
        /// Plans that are compared for an action, instead of a task's own number
        samples: Option<usize> = None, Whole(2..=65_536);
        /// Steps of a plan, instead of a task's own number
        steps: Option<usize> = None, Whole(1..=1000);
    }
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    pub task: String,
    pub planner: String,
    pub ahead: String,
    pub games: usize,
    /// Share of games that stayed where they were asked to be ([`Game::stayed`]).
    pub success: f64,
    /// Of games that were not broken off.
    pub reward: Option<Reward>,
    /// Games broken off since a start could not be stepped, none of them a success.
    pub lost: usize,
    /// Actions a second, for one environment.
    pub hertz: f64,
    /// Compared for an action, and their steps.
    pub plans: usize,
    pub steps: usize,
}

/// Actions a second of a planner for one environment, as far as that can be stepped.
fn paced(mut planner: Box<dyn Planner>, truth: &mut Episodes) -> Result<f64> {
    let (mut spent, mut done) = (Duration::ZERO, 0_u32);
    while done < PACED {
        let begun = Instant::now();
        let stepped = planner.act(truth).map(|actions| (begun.elapsed(), actions)).and_then(|(own, a)| truth.step(&a).map(|_| own));
        match stepped {
            Ok(own) => (spent, done) = (spent + own, done + 1),
            Err(error) => {
                error.faults()?;
                break;
            }
        }
    }
    Ok(f64::from(done) / spent.as_secs_f64().max(f64::MIN_POSITIVE))
}

/// Does nothing.
struct Still;

impl Planner for Still {
    fn act(&mut self, present: &Episodes) -> Result<Vec<f64>, StepError> {
        Ok(vec![0.0; present.len() * present.task.action_dim()])
    }
}

impl Plans {
    fn mppi(&self, task: &str) -> MppiConfig {
        let shared = MppiConfig { seed: self.seed, ..MppiConfig::default() };
        let own = match task {
            // What swings a pole up takes .8 s of looking ahead.
            "cartpole-swingup" => MppiConfig { samples: 16, steps: 48, noise: 0.15, hold: 4, temperature: 3.0, ..shared },
            _ => MppiConfig { steps: 16, hold: 4, temperature: 0.3, ..shared },
        };
        MppiConfig { samples: self.samples.unwrap_or(own.samples), steps: self.steps.unwrap_or(own.steps), ..own }
    }

    fn ilqr(&self, task: &str) -> IlqrConfig {
        let steps = if task == "cartpole-swingup" { 56 } else { 24 };
        IlqrConfig { steps: self.steps.unwrap_or(steps), search: self.samples.unwrap_or(4), ..IlqrConfig::default() }
    }

    /// Plans that a planner compares, and their steps.
    fn sizes(&self, name: &str, task: &str) -> Result<[usize; 2]> {
        let (mppi, ilqr) = (self.mppi(task), self.ilqr(task));
        Ok(match name {
            "mppi" => [mppi.samples, mppi.steps],
            "ilqr" => [ilqr.search, ilqr.steps],
            _ => bail!("--set planner={name}: mppi or ilqr is needed"),
        })
    }

    /// A planner for so many environments.
    fn planner(&self, name: &str, task: &str, arena: &Arena, n: usize) -> Result<Box<dyn Planner>> {
        let [plans, _] = self.sizes(name, task)?;
        let mut episodes = arena.episodes(task, n * plans, 0)?;
        episodes.remember(0);
        Ok(if name == "mppi" { Box::new(Mppi::new(episodes, self.mppi(task))) } else { Box::new(Ilqr::new(episodes, self.ilqr(task))?) })
    }

    fn arena(&self, task: &str, ahead: &str) -> Result<Arena> {
        arena_of(task, ahead, self.device).map_err(|e| Error::msg(format!("--set ahead={e}")))
    }

    /// What a planner that looks ahead somewhere reaches in the truth.
    pub fn row(&self, task: &str, name: &str, arena: &Arena) -> Result<Row> {
        let truth = Arena::Truth(Truth::Articulated);
        let (planner, [plans, steps]) = (self.planner(name, task, arena, 1)?, self.sizes(name, task)?);
        let mut one = truth.episodes(task, 1, self.seed)?;
        let hertz = rayon::ThreadPoolBuilder::new().num_threads(1).build()?.install(|| paced(planner, &mut one))?;
        let title = arena.title()?;
        let bar = bar(&format!("games of {task}, {name} in {title}"), self.games as u64);
        // Alone each, so that all cores have something to do, or all at once on a card; what is drawn is the game's own.
        let each = if arena.on_gpu() { self.games } else { 1 };
        let some = |k: usize| -> Result<Vec<Game>> {
            let range = k * each..(k + 1) * each;
            let mut episodes = truth.part(nerd_tasks::named(task)?, range, self.seed)?;
            let games = plan(&mut *self.planner(name, task, arena, each)?, &mut episodes, &mut |_| ());
            bar.add(each as u64);
            games.or_else(|error| Ok(error.faults().map(|_| Vec::new())?))
        };
        let games = (0..self.games / each).into_par_iter().map(some).collect::<Result<Vec<_>>>()?.concat();
        bar.finish();
        Ok(Row { planner: name.into(), hertz, plans, steps, ..row(task, &title, &games, self.games) })
    }

    /// The first policy of a task that was trained in a model, if one comes with the project.
    fn policy(&self, task: &str) -> Result<Option<PathBuf>> {
        Ok(shipped::policies(&format!("{task}-neural"))?.into_iter().next())
    }

    fn still(&self, task: &str) -> Result<Row> {
        let mut episodes = Arena::Truth(Truth::Articulated).episodes(task, self.games, self.seed)?;
        let games = plan(&mut Still, &mut episodes, &mut |_| ())?;
        Ok(Row { planner: "nothing".into(), ..row(task, "-", &games, self.games) })
    }

    fn policy_row(&self, task: &str, path: &Path) -> Result<Row> {
        let (policy, truth) = (policy_of(path, task)?, Arena::Truth(Truth::Articulated));
        let actor = Actor::new(policy.clone());
        let seen = vec![0.1; policy.shape.stack * nerd_tasks::named(task)?.observation_dim()];
        let begun = Instant::now();
        (0..ANSWERS).for_each(|_| drop(std::hint::black_box(actor.mean(&seen))));
        let hertz = f64::from(ANSWERS) / begun.elapsed().as_secs_f64();
        let games = play(&policy, &mut truth.episodes(task, self.games, self.seed)?, &mut |_| ())?;
        Ok(Row { planner: "policy".into(), hertz, ..row(task, &folder::load(path)?.0.solver, &games, self.games) })
    }
}

/// What games say, of so many that were begun.
fn row(task: &str, ahead: &str, games: &[Game], begun: usize) -> Row {
    let success = games.iter().filter(|game| game.stayed).count() as f64 / begun as f64;
    let (reward, lost) = ((!games.is_empty()).then(|| Reward::of(games)), begun - games.len());
    let (task, ahead, planner) = (task.into(), ahead.into(), String::new());
    Row { task, planner, ahead, games: begun, success, reward, lost, hertz: 0.0, plans: 0, steps: 0 }
}

impl Experiment for Plans {
    fn about(&self) -> Result<About> {
        let mut inputs = Inputs::default();
        for (key, names) in [("task", &self.task), ("planner", &self.planner), ("ahead", &self.ahead)] {
            bounds::once(&format!("--set {key}"), names)?;
        }
        for task in &self.task {
            // States of every plan's steps, on every thread.
            let bytes = 64 * System::named(nerd_tasks::named(task)?.robot())?.robot.state_dim();
            depend(&mut inputs, task, Truth::Articulated)?;
            for planner in &self.planner {
                let [plans, steps] = self.sizes(planner, task)?;
                bounds::memory(&[("samples", plans), ("steps", steps), ("threads", rayon::current_num_threads())], bytes)?;
                if planner == "ilqr" {
                    self.planner(planner, task, &Arena::Judge(Setting::Accurate), 1)?;
                }
            }
            for ahead in &self.ahead {
                inputs.add(input_of(task, &self.arena(task, ahead)?)?);
            }
            if let Some(path) = self.policy(task)? {
                inputs.add(Input::policy(&path)?);
            }
        }
        let effort = (self.games * self.task.len() * self.planner.len() * self.ahead.len()) as f64;
        Ok(About { name: self.name.clone(), seed: self.seed, effort, inputs })
    }

    fn measure(&self) -> Result<Measured> {
        let mut rows = Vec::new();
        for task in &self.task {
            for (planner, ahead) in self.planner.iter().flat_map(|planner| self.ahead.iter().map(move |ahead| (planner, ahead))) {
                rows.push(self.row(task, planner, &self.arena(task, ahead)?)?);
            }
            rows.push(self.still(task)?);
            if let Some(path) = self.policy(task)? {
                rows.push(self.policy_row(task, &path)?);
            }
        }
        let line = |r: &Row| {
            let size = if r.steps == 0 { "-".into() } else { format!("{} x {}", r.plans, r.steps) };
            let cells = [r.task.clone(), r.planner.clone(), r.ahead.clone(), size];
            let reward = r.reward.map_or("-".into(), |reward| format!("{:.1} +- {:.1}", reward.mean, reward.standard_error));
            let hertz = if r.hertz == 0.0 { "-".into() } else { format!("{:.0}", r.hertz) };
            cells.into_iter().chain([r.games.to_string(), format!("{:.0}", 100.0 * r.success), reward, hertz]).collect()
        };
        let header = ["task", "by", "planned or trained in", "plans x steps", "games", "success (%)", "reward", "Hz on one core"];
        let note = "Acted in the truth. Success: the episode goes on to its end, and throughout its last quarter the pole is within 0.2 rad of \
                    upright, the torso within 0.5 m of its point, the hand within 0.05 m of its target; actions beyond a torque's limits are \
                    clamped. Hz: actions a second for one environment on one thread. +-: standard error over games.";
        let lost: usize = rows.iter().map(|r| r.lost).sum();
        let note = if lost == 0 { note.into() } else { format!("{note} {lost} were broken off, since a start could not be stepped.") };
        let table = Table::new("plans", &header).with(rows.iter().map(line)).noted(&note);
        Measured::new(&serde_json::json!({ "rows": rows }), vec![table])
    }
}
