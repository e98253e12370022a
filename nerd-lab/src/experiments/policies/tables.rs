//! Tables of policy rewards.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::experiments::games::{Compared, Reward, gap};
use crate::paper::policy_reward;
use crate::report::{Axis, Figure, Panel, Series, Style, Table, or_dash};
use nerd_train::stats::mean;

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
    /// Share of episodes that ended early; for families and for tasks outside the built-in list.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fell: Option<f64>,
    /// The task's tolerance and its unit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tolerance: Option<(f64, String)>,
    /// Terms of the reward in the truth, mean per step.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub terms: Vec<(String, f64)>,
}

const NOTE: &str = "Reward of a game under mean actions. Gap: (reward in NeRD - in the truth) / |reward in the truth|.";

/// A gap with its standard error, if known.
fn percent(gap: f64, error: Option<f64>) -> String {
    match error.filter(|e| e.is_finite()) {
        Some(error) => format!("{gap:+.2} +- {error:.2}"),
        None => format!("{gap:+.2}"),
    }
}

/// Name of a policy's folder; of a run's own `policy` folder, the run's name.
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
    let header =
        ["task", "policy", "trained in", "games", "reward in truth", "in NeRD", "gap (%)", "paper: truth / NeRD"];
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
        let share = |reward: Option<&Reward>| {
            reward.and_then(|r| r.success).map_or("-".into(), |share| format!("{:.0}", 100.0 * share))
        };
        table
            .rows
            .iter_mut()
            .zip(rows)
            .for_each(|(line, row)| line.extend([share(Some(&row.rewards.real)), share(row.rewards.learned.as_ref())]));
        table.note += " Success: games whose task says that they succeeded.";
    }
    if rows.iter().any(|r| r.rewards.real.error.is_some()) {
        table.header.push("error in truth".into());
        table
            .rows
            .iter_mut()
            .zip(rows)
            .for_each(|(line, row)| line.push(or_dash(row.rewards.real.error.map(|error| in_unit(row, error)))));
        table.note += " Error: mean over games of the mean error over a game's last half.";
    }
    table
}

/// Reward terms, a line each and a column for each policy; `None` without terms. The zero-action policy shares one
/// column over all tasks. Policies of one task with equal short names appear by path.
pub fn terms(rows: &[Row]) -> Option<Table> {
    let alike = |a: &Row, b: &Row| a.task == b.task && a.policy != b.policy && short(&a.policy) == short(&b.policy);
    let called =
        |row: &Row| if rows.iter().any(|other| alike(row, other)) { row.policy.clone() } else { short(&row.policy) };
    let rows: Vec<(&Row, String)> =
        rows.iter().filter(|row| !row.terms.is_empty()).map(|row| (row, called(row))).collect();
    let names = once(rows.iter().flat_map(|(row, _)| row.terms.iter().map(|term| (&*row.task, &*term.0))));
    let policies = once(rows.iter().map(|(_, policy)| &**policy));
    let cell = |task: &str, name: &str, policy: &str| {
        let row = rows.iter().find(|(row, own)| row.task == task && own == policy);
        or_dash(
            row.and_then(|(row, _)| row.terms.iter().find(|term| term.0 == name))
                .map(|term| format!("{:.3}", (term.1 * 1e3).round() / 1e3 + 0.0)),
        )
    };
    let line = |(task, name): (&str, &str)| {
        [task.into(), name.into()].into_iter().chain(policies.iter().map(|policy| cell(task, name, policy))).collect()
    };
    let header: Vec<&str> = ["task", "term"].into_iter().chain(policies.iter().copied()).collect();
    let lines = names.into_iter().map(line);
    (!rows.is_empty()).then(|| Table::new("terms", &header).with(lines).noted("In the truth, mean of all steps."))
}

/// Distinct values, in order of first appearance.
fn once<T: PartialEq>(all: impl Iterator<Item = T>) -> Vec<T> {
    all.fold(Vec::new(), |mut all, x| {
        if !all.contains(&x) {
            all.push(x);
        }
        all
    })
}

/// An error in the task's unit; for a task without one, as a share of the tolerance.
fn in_unit(row: &Row, error: f64) -> String {
    let (tolerance, unit) = row.tolerance.as_ref().map_or((1.0, ""), |(tolerance, unit)| (*tolerance, unit));
    format!("{:.3}{}{unit}", error * tolerance, if unit.is_empty() { "" } else { " " })
}

/// `gaps` without the last column, the gaps by seed.
pub fn summary(rows: &[Row]) -> Table {
    let mut table = gaps(rows);
    table.name = "summary".into();
    table.rows.iter_mut().chain([&mut table.header]).for_each(|row| drop(row.pop()));
    table
}

/// Gaps by task and seed, and rewards in the truth.
pub fn gaps(rows: &[Row]) -> Table {
    let lines = once(rows.iter().map(|r| &*r.task)).into_iter().map(|task| {
        let own = || rows.iter().filter(|r| r.task == task && r.trained_in.starts_with("neural"));
        let word = |of: Vec<f64>, decimals: usize| {
            if of.is_empty() { "-".into() } else { format!("{:.decimals$}", mean(&of)) }
        };
        let sizes: Vec<f64> = own().filter_map(|r| r.rewards.gap.map(f64::abs)).collect();
        let most = sizes.iter().copied().reduce(f64::max).map(|most| format!("{most:.2}"));
        let seeds = own().filter_map(|r| r.rewards.gap.map(|gap| percent(gap, r.rewards.gap_error)));
        let (halves, earned) = (own().filter_map(|r| r.half.map(f64::abs)), own().map(|r| r.rewards.real.mean));
        let seeds = seeds.collect::<Vec<_>>().join(", ");
        vec![task.into(), word(sizes, 2), or_dash(most), word(halves.collect(), 2), word(earned.collect(), 1), seeds]
    });
    let header = [
        "task",
        "mean gap (%)",
        "largest (%)",
        "mean gap of the truth at half its substeps (%)",
        "trained in NeRD, reward in the truth",
        "gaps of policies trained in NeRD",
    ];
    let note = "Policies of seeds that the model never met. Gap: (reward in NeRD - in the truth) / |reward in the truth|, +- its standard \
                error over games; means and largest are of sizes, without sign. The truth at half its substeps (two of Runge-Kutta where \
                nothing touches) plays the same policies.";
    Table::new("fresh", &header).with(lines).noted(note)
}

/// Mean episode reward over seconds of training, from `curve.csv` in the policies' folders; older folders have none.
pub fn curves(folders: &[PathBuf]) -> Option<Figure> {
    let series = folders.iter().filter_map(|folder| {
        let text = nerd_sim::files::read_text(&folder.join("curve.csv")).ok()?;
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
