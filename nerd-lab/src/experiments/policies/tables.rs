//! What policies earned, as people read it.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::experiments::games::{Compared, Reward, gap};
use crate::paper::policy_reward;
use crate::report::{Axis, Figure, Panel, Series, Style, Table, or_dash};

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    pub task: String,
    pub policy: String,
    pub trained_in: String,
    pub truth: String,
    pub model: Option<String>,
    pub games: usize,
    /// The gap (percent) of the truth itself at half its substeps.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub half: Option<f64>,
    #[serde(flatten)]
    pub rewards: Compared,
    /// On robots of a family, and of tasks for any robot: share of games that were over before their time.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fell: Option<f64>,
    /// How much of the miss is allowed, and its unit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub allowed: Option<(f64, String)>,
    /// What the reward in the truth is made of: means a step.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub terms: Vec<(String, f64)>,
}

const NOTE: &str = "Reward of a game under mean actions. Gap: (reward in NeRD - in the truth) / |reward in the truth|.";

/// A gap with its standard error, where that is known.
fn percent(gap: f64, error: Option<f64>) -> String {
    match error.filter(|e| e.is_finite()) {
        Some(error) => format!("{gap:+.2} +- {error:.2}"),
        None => format!("{gap:+.2}"),
    }
}

/// Name of a policy's folder, or of its run where it is the run's own.
pub fn short(policy: &str) -> String {
    policy.strip_suffix("/policy").unwrap_or(policy).rsplit('/').next().unwrap_or_default().into()
}

pub fn each(rows: &[Row]) -> Table {
    let reward = |r: &Reward| format!("{:.1} +- {:.1}", r.mean, r.spread);
    let lines = rows.iter().map(|r| {
        let paper = policy_reward(&r.task);
        vec![
            r.task.clone(),
            short(&r.policy),
            r.trained_in.clone(),
            r.games.to_string(),
            reward(&r.rewards.real),
            or_dash(r.rewards.learned.as_ref().map(reward)),
            r.rewards.gap.map_or_else(|| "-".into(), |g| percent(g, r.rewards.gap_error)),
            paper.map_or_else(|| "-".into(), |p| format!("{} / {} ({:+.2} %)", p[0], p[1], gap(p[0], p[1]))),
        ]
    });
    let header = ["task", "policy", "trained in", "games", "reward in truth", "in NeRD", "gap (%)", "paper: truth / NeRD"];
    let note = format!("{NOTE} +-: of a reward its standard deviation over games, of a gap its standard error.");
    let mut table = Table::new("policies", &header).with(lines).noted(&note);
    if rows.iter().any(|r| r.fell.is_some()) {
        table.header.extend(["robots", "fell (%)"].map(String::from));
        let fell = |row: &Row| row.fell.map_or("-".into(), |share| format!("{:.1}", 100.0 * share));
        table.rows.iter_mut().zip(rows).for_each(|(line, row)| line.extend([row.truth.clone(), fell(row)]));
        table.note += " Robots: of the truth; fell: games that were over before their time.";
    }
    if rows.iter().any(|r| r.rewards.real.success.is_some()) {
        table.header.extend(["success in truth (%)", "success in NeRD (%)"].map(String::from));
        let share = |reward: Option<&Reward>| reward.and_then(|r| r.success).map_or("-".into(), |share| format!("{:.0}", 100.0 * share));
        table
            .rows
            .iter_mut()
            .zip(rows)
            .for_each(|(line, row)| line.extend([share(Some(&row.rewards.real)), share(row.rewards.learned.as_ref())]));
        table.note += " Success: games whose task says that they succeeded.";
    }
    if rows.iter().any(|r| r.rewards.real.miss.is_some()) {
        table.header.push("miss in truth".into());
        table.rows.iter_mut().zip(rows).for_each(|(line, row)| line.push(or_dash(row.rewards.real.miss.map(|miss| missed(row, miss)))));
        table.note += " Miss: mean over games of the mean miss over a game's last half.";
    }
    table
}

/// Terms of rewards, a line each and a column by policy, if there are any. Who keeps still has one column for all tasks; policies of a task
/// whose folders are called alike have their paths.
pub fn terms(rows: &[Row]) -> Option<Table> {
    let alike = |a: &Row, b: &Row| a.task == b.task && a.policy != b.policy && short(&a.policy) == short(&b.policy);
    let called = |row: &Row| if rows.iter().any(|other| alike(row, other)) { row.policy.clone() } else { short(&row.policy) };
    let rows: Vec<(&Row, String)> = rows.iter().filter(|row| !row.terms.is_empty()).map(|row| (row, called(row))).collect();
    let names = once(rows.iter().flat_map(|(row, _)| row.terms.iter().map(|term| (&*row.task, &*term.0))));
    let policies = once(rows.iter().map(|(_, policy)| &**policy));
    let cell = |task: &str, name: &str, policy: &str| {
        let row = rows.iter().find(|(row, own)| row.task == task && own == policy);
        or_dash(row.and_then(|(row, _)| row.terms.iter().find(|term| term.0 == name)).map(|term| format!("{:.3}", term.1)))
    };
    let line = |(task, name): (&str, &str)| {
        [task.into(), name.into()].into_iter().chain(policies.iter().map(|policy| cell(task, name, policy))).collect()
    };
    let header: Vec<&str> = ["task", "term"].into_iter().chain(policies.iter().copied()).collect();
    let lines = names.into_iter().map(line);
    (!rows.is_empty()).then(|| Table::new("terms", &header).with(lines).noted("In the truth, mean of all steps."))
}

/// Those that differ, in their order.
fn once<T: PartialEq>(all: impl Iterator<Item = T>) -> Vec<T> {
    all.fold(Vec::new(), |mut all, x| {
        if !all.contains(&x) {
            all.push(x);
        }
        all
    })
}

/// A miss in its task's own unit; without one, as a share of what is allowed.
fn missed(row: &Row, miss: f64) -> String {
    let (allowed, unit) = row.allowed.as_ref().map_or((1.0, ""), |(allowed, unit)| (*allowed, unit));
    format!("{:.3}{}{unit}", miss * allowed, if unit.is_empty() { "" } else { " " })
}

/// The same without seeds.
pub fn summary(rows: &[Row]) -> Table {
    let mut table = gaps(rows);
    table.name = "summary".into();
    for row in table.rows.iter_mut().chain([&mut table.header]) {
        *row = [0, 1, 2, 9, 6].map(|column| row[column].clone()).into();
    }
    table
}

/// The policies of a task that were trained in a learned simulator, or those of the truth.
fn of<'a>(rows: &'a [Row], task: &str, learned: bool) -> Vec<&'a Row> {
    rows.iter().filter(|r| r.task == task && r.trained_in.starts_with("neural") == learned).collect()
}

/// Gaps by task and seed, and what policies earn in the truth by where they were trained.
pub fn gaps(rows: &[Row]) -> Table {
    let given = |task: &&str| rows.iter().any(|r| r.task == *task);
    let tasks = once(nerd_tasks::names().into_iter().filter(given).chain(rows.iter().map(|r| &*r.task)));
    let lines = tasks.into_iter().map(|task| {
        let (learned, truth) = (of(rows, task, true), of(rows, task, false));
        let gaps = |rows: &[&Row]| rows.iter().filter_map(|r| r.rewards.gap).collect::<Vec<_>>();
        let sizes = |rows: &[&Row]| gaps(rows).iter().map(|g| g.abs()).collect::<Vec<_>>();
        let mean = |of: &[f64]| if of.is_empty() { f64::NAN } else { of.iter().sum::<f64>() / of.len() as f64 };
        let most = |of: &[f64]| of.iter().copied().fold(f64::NAN, f64::max);
        let seeds = |rows: &[&Row]| {
            rows.iter().filter_map(|r| r.rewards.gap.map(|g| percent(g, r.rewards.gap_error))).collect::<Vec<_>>().join(", ")
        };
        let earned = |rows: &[&Row]| mean(&rows.iter().map(|r| r.rewards.real.mean).collect::<Vec<_>>());
        let word = |x: f64, digits: usize| if x.is_finite() { format!("{x:.digits$}") } else { "-".into() };
        let share = 100.0 * earned(&learned) / earned(&truth);
        let (l, t) = (sizes(&learned), sizes(&truth));
        let halves: Vec<f64> = learned.iter().filter_map(|r| r.half.map(f64::abs)).collect();
        let head = vec![task.to_string(), word(mean(&l), 2), word(most(&l), 2), seeds(&learned), word(most(&t), 2), seeds(&truth)];
        head.into_iter().chain([word(earned(&learned), 1), word(earned(&truth), 1), word(share, 1), word(mean(&halves), 2)]).collect()
    });
    let header = [
        "task",
        "mean gap (%)",
        "largest (%)",
        "gaps of policies trained in NeRD",
        "largest of the truth's (%)",
        "gaps of policies trained in the truth",
        "trained in NeRD, reward in the truth",
        "trained in the truth",
        "share (%)",
        "mean gap of the truth at half its substeps (%)",
    ];
    let note = "Policies of seeds that the model never met. Gap: (reward in NeRD - in the truth) / |reward in the truth|, +- its standard \
                error over games; means and largest are of sizes, without sign. Share: what NeRD's policies earn in the truth, of what \
                the truth's own earn there after as many steps. The truth at half its substeps (two of Runge-Kutta where nothing touches) \
                plays the same policies.";
    Table::new("fresh", &header).with(lines).noted(note)
}

/// Rewards of episodes while policies learned, over seconds of that, from the curves that their folders have; none of older ones.
pub fn curves(folders: &[PathBuf]) -> Option<Figure> {
    let series = folders.iter().filter_map(|folder| {
        let text = std::fs::read_to_string(folder.join("curve.csv")).ok()?;
        let mut lines = text.lines().map(|line| line.split(',').collect::<Vec<_>>());
        let header = lines.next()?;
        let [x, y] = ["seconds", "reward"].map(|name| header.iter().position(|column| *column == name));
        let ((x, y), number) = (x.zip(y)?, |line: &[&str], k: usize| line.get(k).and_then(|text| text.parse().ok()));
        let points = lines.filter_map(|line| number(&line, x).zip(number(&line, y)));
        Some(Series::new(short(&folder.display().to_string()), Style::Line, points))
    });
    let [x, y] = ["seconds of learning", "mean reward of the last episodes"].map(Axis::linear);
    let panel = Panel { x, y, series: series.collect(), ..Panel::default() };
    (!panel.series.is_empty()).then(|| Figure::single("Policies while they learn".into(), panel))
}
