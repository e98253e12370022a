//! Tables of policy rewards.

use crate::experiments::games::{Compared, Reward, gap};
use crate::{paper::policy_reward, prelude::*};

#[derive(Serialize, Deserialize)]
pub struct Row {
    pub task: String,
    pub policy: String,
    pub trained_in: String,
    pub truth: String,
    pub model: Option<String>,
    pub games: usize,
    /// Gap (%) of the reward in the truth at half its substeps, compared with the truth.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub half: Option<f64>,
    #[serde(flatten)]
    pub rewards: Compared,
    /// Share of episodes that ended early; for families and for tasks outside the built-in list.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fell: Option<f64>,
    /// Tolerance on the task's error, and its unit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tolerance: Option<(f64, String)>,
    /// Reward terms in the truth, as (name, mean per step).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub terms: Vec<(String, f64)>,
}

const NOTE: &str = "Reward of a game under mean actions. Gap: (reward in NeRD - in the truth) / |reward in the truth|.";

/// Writes the gap (%) with its standard error, if known.
fn percent(rewards: &Compared) -> Option<String> {
    let error = rewards.gap_error.map_or_else(String::new, |error| format!(" +- {error:.2}"));
    rewards.gap.map(|gap| format!("{gap:+.2}{error}"))
}

/// Returns the name of a policy's folder; for `RUN/policy`, the name of the run.
pub fn short(policy: &str) -> String {
    policy.strip_suffix("/policy").unwrap_or(policy).rsplit('/').next().unwrap_or_default().into()
}

pub fn each(rows: &[Row]) -> Table {
    let reward = |r: &Reward| format!("{:.1} +- {:.1}", r.mean, r.spread);
    let lines = rows.iter().map(|r| {
        vec![
            r.task.clone(),
            short(&r.policy),
            r.trained_in.clone(),
            r.games.to_string(),
            reward(&r.rewards.real),
            or_dash(r.rewards.learned.as_ref().map(reward)),
            or_dash(percent(&r.rewards)),
            or_dash(policy_reward(&r.task).map(|[a, b]| format!("{a} / {b} ({:+.2} %)", gap(a, b)))),
        ]
    });
    let header =
        ["task", "policy", "trained in", "games", "reward in truth", "in NeRD", "gap (%)", "paper: truth / NeRD"];
    let note = format!("{NOTE} +-: of a reward its standard deviation over games, of a gap its standard error.");
    let mut table = Table::new("policies", header).with(lines).noted(note);
    if rows.iter().any(|r| r.fell.is_some()) {
        table.column("robots", rows.iter().map(|row| row.truth.clone()));
        table.column("fell (%)", rows.iter().map(|row| or_dash(row.fell.map(|share| format!("{:.1}", 100.0 * share)))));
        table.note += " Robots: of the truth; fell: games that were over before their time.";
    }
    if rows.iter().any(|r| r.rewards.real.success.is_some()) {
        let share = |reward: &Reward| reward.success.map(|share| format!("{:.0}", 100.0 * share));
        table.column("success in truth (%)", rows.iter().map(|row| or_dash(share(&row.rewards.real))));
        table.column(
            "success in NeRD (%)",
            rows.iter().map(|row| or_dash(row.rewards.learned.as_ref().and_then(share))),
        );
        table.note += " Success: games whose task says that they succeeded.";
    }
    if rows.iter().any(|r| r.rewards.real.error.is_some()) {
        let error = |row: &Row| row.rewards.real.error.map(|error| in_unit(row, error));
        table.column("error in truth", rows.iter().map(|row| or_dash(error(row))));
        table.note += " Error: mean over games of the mean error over a game's last half.";
    }
    table
}

/// Tables reward terms, with a row for each term and a column for each policy; `None` without terms. The zero-action
/// policies of all tasks share one column. Policies of one task with equal short names are named by path.
pub fn terms(rows: &[Row]) -> Option<Table> {
    let alike = |a: &Row, b: &Row| a.task == b.task && a.policy != b.policy && short(&a.policy) == short(&b.policy);
    let called =
        |row: &Row| if rows.iter().any(|other| alike(row, other)) { row.policy.clone() } else { short(&row.policy) };
    let rows = rows.iter().filter(|row| !row.terms.is_empty()).map(|row| (row, called(row))).collect_vec();
    let names = rows.iter().flat_map(|(row, _)| row.terms.iter().map(|term| (&*row.task, &*term.0))).unique();
    let policies = rows.iter().map(|(_, policy)| &**policy).unique().collect_vec();
    let cell = |task: &str, name: &str, policy: &str| {
        let row = rows.iter().find(|(row, own)| row.task == task && own == policy);
        or_dash(
            row.and_then(|(row, _)| row.terms.iter().find(|term| term.0 == name))
                .map(|term| format!("{:.3}", (term.1 * 1e3).round() / 1e3 + 0.0)),
        )
    };
    let line = |(task, name): (&str, &str)| {
        [task.into(), name.into()]
            .into_iter()
            .chain(policies.iter().map(|policy| cell(task, name, policy)))
            .collect_vec()
    };
    let header = ["task", "term"].into_iter().chain(policies.iter().copied()).collect_vec();
    let lines = names.map(line);
    (!rows.is_empty()).then(|| Table::new("terms", header).with(lines).noted("In the truth, mean of all steps."))
}

/// Writes an error times its tolerance, in the task's unit; without a stored tolerance, the error itself.
fn in_unit(row: &Row, error: f64) -> String {
    let (tolerance, unit) = row.tolerance.as_ref().map_or((1.0, ""), |(tolerance, unit)| (*tolerance, unit));
    format!("{:.3}{}{unit}", error * tolerance, if unit.is_empty() { "" } else { " " })
}

/// Returns the table of `gaps` without its last column, which lists the gap of each seed.
pub fn summary(rows: &[Row]) -> Table {
    let mut table = gaps(rows);
    table.name = "summary".into();
    table.rows.iter_mut().chain([&mut table.header]).for_each(|row| drop(row.pop()));
    table
}

/// Tables gaps by task and seed, and rewards in the truth.
pub fn gaps(rows: &[Row]) -> Table {
    let lines = rows.iter().map(|r| &*r.task).unique().map(|task| {
        let own = || rows.iter().filter(|r| r.task == task && r.trained_in.starts_with("neural"));
        let word = |of: Vec<f64>, decimals: usize| {
            if of.is_empty() { "-".into() } else { format!("{:.decimals$}", mean(&of)) }
        };
        let sizes = own().filter_map(|r| r.rewards.gap.map(f64::abs)).collect_vec();
        let most = sizes.iter().copied().reduce(f64::max).map(|most| format!("{most:.2}"));
        let seeds = own().filter_map(|r| percent(&r.rewards)).join(", ");
        let halves = own().filter_map(|r| r.half.map(f64::abs));
        let earned = own().map(|r| r.rewards.real.mean);
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
    Table::new("fresh", header).with(lines).noted(note)
}

/// Plots mean episode reward against training time (s), from `curve.csv` in the policies' folders. Older folders have
/// no such file.
pub fn curves(folders: &[PathBuf]) -> Option<Figure> {
    let series = folders.iter().filter_map(|folder| {
        let text = nerd_sim::files::read_text(&folder.join("curve.csv")).ok()?;
        let mut lines = text.lines().map(|line| line.split(',').collect_vec());
        let header = lines.next()?;
        let [x, y] = ["seconds", "reward"].map(|name| header.iter().position(|column| *column == name));
        let ((x, y), number) = (x.zip(y)?, |line: &[&str], k: usize| line.get(k).and_then(|text| text.parse().ok()));
        let points = lines.filter_map(|line| number(&line, x).zip(number(&line, y)));
        Some(Series::new(short(&folder.display().to_string()), Style::Line, points))
    });
    let series = series.collect_vec();
    let axes = ["seconds of learning", "mean reward of the last episodes"].map(Axis::linear);
    (!series.is_empty()).then(|| Figure::lines("Policies while they learn".into(), axes, series))
}
