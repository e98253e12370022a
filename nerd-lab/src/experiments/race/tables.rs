//! What a race came to, as people read it.

use nerd_train::stats::percentile;

use super::super::games::Reward;
use super::run::{Kept, Run};
use super::settings::GOALS;
use crate::prelude::*;

/// Seconds after which rewards are told.
const TOLD: [f64; 5] = [5.0, 10.0, 15.0, 20.0, 60.0];

/// A run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    pub task: String,
    pub entrant: String,
    pub seed: u64,
    /// Where it ran.
    pub machine: String,
    /// Before it began: compiled, once it had begun: iterations, and episodes that its solver could not go on with.
    pub compiled: f64,
    /// That it was given.
    pub seconds: f64,
    pub iterations: u64,
    pub failed: usize,
    /// Minutes that its model's own training took, the runs that it went on from included.
    pub model: Option<f64>,
    pub kept: Vec<Kept>,
    /// In truth, of each policy that was kept; empty if none has played.
    pub rewards: Vec<Reward>,
}

impl Row {
    pub fn of(run: &Run, games: usize, seed: u64) -> Result<Self> {
        let Some(done) = run.done()? else {
            bail!("{} is being made by another process: give the same command again once it is done", run.out.display())
        };
        let rewards = if games == 0 { Vec::new() } else { run.play(&done, games, seed)? };
        let model = match &run.arena {
            Arena::Model { folder, .. } => minutes(&ModelConfig::read(folder)?),
            _ => None,
        };
        let (task, entrant, machine) = (run.task.clone(), run.entrant.clone(), done.provenance.machine);
        let (compiled, seconds, iterations, failed) = (done.compiled, done.seconds, done.iterations, done.failed);
        Ok(Self { task, entrant, seed: run.seed, machine, compiled, seconds, iterations, failed, model, kept: done.kept, rewards })
    }

    /// Seconds and rewards of its policies: in truth, or where none has played those of training.
    fn path(&self) -> Vec<(f64, f64)> {
        let trained = |kept: &Kept| kept.trained.unwrap_or(f64::NAN);
        let reward = |(k, kept)| self.rewards.get(k).map_or_else(|| trained(kept), |reward: &Reward| reward.mean);
        self.kept.iter().enumerate().map(|(k, kept)| (kept.seconds, reward((k, kept)))).filter(|point| point.1.is_finite()).collect()
    }

    /// Reward of the policy that it had after so many seconds, if it had begun by then and had so many or ended by itself.
    fn after(&self, seconds: f64) -> Option<f64> {
        // Policies are kept at the end of an iteration.
        let path = self.path();
        let late = |point: &&(f64, f64)| point.0 >= seconds;
        path.iter()
            .find(late)
            .filter(|point| point.0 < 1.2 * seconds + 0.5)
            .or(path.last().filter(|last| last.0 < seconds.min(self.seconds)))
            .map(|point| point.1)
    }

    /// Seconds until its reward had come to so much.
    fn reached(&self, goal: f64) -> Option<f64> {
        self.path().into_iter().find(|point| point.1 >= goal).map(|point| point.0)
    }
}

/// Minutes of a model's training, by its card.
fn minutes(model: &ModelConfig) -> Option<f64> {
    let own = model.provenance.get("minutes")?.parse::<f64>().ok()?;
    let before = model.provenance.get("started from").map_or("", String::as_str).split(" minutes on").map(|text| {
        // The number that the words end with; behind the last there is none.
        text.rsplit(' ').next().and_then(|word| word.parse::<f64>().ok()).unwrap_or_default()
    });
    Some(own + before.sum::<f64>())
}

/// Runs of one task and entrant.
fn groups(rows: &[Row]) -> Vec<Vec<&Row>> {
    let mut groups: Vec<Vec<&Row>> = Vec::new();
    for row in rows {
        match groups.iter_mut().find(|group| (&group[0].task, &group[0].entrant) == (&row.task, &row.entrant)) {
            Some(group) => group.push(row),
            None => groups.push(vec![row]),
        }
    }
    groups.sort_by_key(|group| rows.iter().position(|row| row.task == group[0].task));
    groups
}

/// The median; of those who have none it counts as beyond all.
fn median(of: &[&Row], what: impl Fn(&Row) -> Option<f64>, none: f64) -> Option<f64> {
    Some(percentile(of.iter().map(|row| what(row).unwrap_or(none)).collect(), 0.5)).filter(|x| x.is_finite())
}

fn goal(task: &str) -> Option<f64> {
    GOALS.iter().find(|goal| goal.0 == task).map(|goal| goal.1)
}

fn where_(rows: &[Row]) -> &'static str {
    if rows.iter().any(|row| row.rewards.is_empty()) { "in training, with noise" } else { "in the truth, by mean actions" }
}

pub fn race(rows: &[Row]) -> Table {
    let line = |of: Vec<&Row>| {
        let (goal, seeds) = (goal(&of[0].task), of.len().to_string());
        let seconds = goal.and_then(|goal| median(&of, |row| row.reached(goal), f64::INFINITY)).map(|s| format!("{s:.1}"));
        let told = TOLD.map(|s| or_dash(median(&of, |row| row.after(s), f64::NAN).map(|reward| format!("{reward:.0}"))));
        let rate = |row: &Row| row.kept.last().map(|last| last.frames as f64 / last.seconds);
        let rate = median(&of, rate, f64::NAN).map(|rate| format!("{rate:.0}"));
        let minutes = of[0].model.map(|minutes| format!("{minutes:.1}"));
        let head = [of[0].task.clone(), of[0].entrant.clone(), seeds, or_dash(goal), or_dash(seconds)];
        head.into_iter().chain(told).chain([or_dash(rate), or_dash(minutes)]).collect()
    };
    let header = ["task", "by, in", "seeds", "goal", "reached (s)", "after 5 s", "10 s", "15 s", "20 s", "60 s", "frames/s", "NeRD (min)"];
    let note = format!(
        "Reward {}; medians of seeds. From random weights, kernels compiled before. Reached: seconds until the first policy that was set aside \
         earned the goal; a dash where half of the seeds have none. A run that ended before a time has its last policy there. NeRD: minutes that \
         the model's own training took, by its card; runs on two GPUs count once.",
        where_(rows)
    );
    Table::new("race", &header).with(groups(rows).into_iter().map(line)).noted(&note)
}

pub fn each(rows: &[Row]) -> Table {
    let line = |row: &Row| {
        let path = row.path();
        let best = path.iter().map(|point| point.1).reduce(f64::max).map(|reward| format!("{reward:.0}"));
        let last = row.kept.last().map(|last| format!("{:.1}", last.seconds));
        let reached = goal(&row.task).and_then(|goal| row.reached(goal)).map(|s| format!("{s:.1}"));
        let end = path.last().map(|point| format!("{:.0}", point.1));
        let head = [row.task.clone(), row.entrant.clone(), row.seed.to_string(), row.iterations.to_string(), or_dash(last)];
        let tail =
            [or_dash(reached), or_dash(best), or_dash(end), format!("{:.1}", row.compiled), row.failed.to_string(), row.machine.clone()];
        head.into_iter().chain(tail).collect()
    };
    let header =
        ["task", "by, in", "seed", "iterations", "seconds", "reached (s)", "best", "last", "compiled (s)", "failed episodes", "machine"];
    Table::new("runs", &header).with(rows.iter().map(line)).noted(&format!("Reward {}.", where_(rows)))
}

/// A panel a task, a line a run.
pub fn figure(rows: &[Row]) -> Figure {
    let mut panels: Vec<Panel> = Vec::new();
    for row in rows {
        let series = Series::new(row.entrant.clone(), Style::Line, row.path());
        match panels.iter_mut().find(|panel| panel.title == row.task) {
            Some(panel) => panel.series.push(series),
            None => panels.push(Panel {
                title: row.task.clone(),
                x: Axis::log("seconds"),
                y: Axis::linear("reward"),
                series: vec![series],
                levels: goal(&row.task).map(|goal| (goal, format!("{goal}"))).into_iter().collect(),
            }),
        }
    }
    Figure { title: format!("Reward {}, by time of learning", where_(rows)), columns: 2, panels }
}
