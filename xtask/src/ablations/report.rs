//! What the ablations say: rows, their order against the paper's, `ablations.json` and `ablations.md`.

use anyhow::{Result, bail};
use nerd_model::folder::ModelConfig;
use serde::{Deserialize, Serialize};

use super::entry::Entry;
use super::measure::{AWAY, STEPS};
use super::{AblationArgs, BATCH, Measured, NERD};
use crate::provenance::Provenance;
use crate::table::{digits, markdown, pair};

/// A margin of the paper's bars that ours are held to.
const MARGIN: f64 = 1.5;

/// One variant of one robot.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Row {
    /// Robot.
    pub robot: String,
    /// Under its bar.
    pub name: String,
    /// Column of the figure.
    pub group: char,
    /// Parameters of its network.
    pub parameters: usize,
    /// Tokens of a window.
    pub history: usize,
    /// Windows of an update.
    pub batch: usize,
    /// Minutes of its trainings, as their cards say.
    pub minutes: Vec<String>,
    /// SHA-256 of the data by seed.
    pub data: Vec<String>,
    /// Errors by seed.
    pub measured: Vec<Measured>,
    /// The paper's error divided by NeRD's.
    pub paper: Option<f64>,
}

impl Row {
    /// The first seed's.
    pub fn new(robot: &str, entry: &Entry, config: &ModelConfig, measured: Measured) -> Self {
        let network = config.network;
        Self {
            robot: robot.into(),
            name: entry.name.into(),
            group: entry.group,
            parameters: network.parameters(),
            history: network.history,
            batch: config.batch,
            minutes: vec![minutes(config)],
            data: vec![config.data_sha256.clone()],
            measured: vec![measured],
            paper: entry.paper.map(|p| p[usize::from(robot == "ant")]),
        }
    }

    /// Another seed's.
    pub fn add(&mut self, config: &ModelConfig, measured: Measured) -> Result<()> {
        if config.network.parameters() != self.parameters {
            bail!("{} of {}: seeds with different networks", self.name, self.robot);
        }
        self.minutes.push(minutes(config));
        self.data.push(config.data_sha256.clone());
        self.measured.push(measured);
        Ok(())
    }

    /// Means over seeds, by quantity.
    fn mean(&self, of: Errors) -> Option<Vec<f64>> {
        let all: Vec<&[f64]> = self.measured.iter().map(of).collect::<Option<_>>()?;
        Some((0..all[0].len()).map(|k| all.iter().map(|e| e[k]).sum::<f64>() / all.len() as f64).collect())
    }

    /// Error divided by NeRD's: mean, least and largest over seeds.
    ///
    /// Angles alone are averaged first, as in the paper; quantities of unlike units are divided first.
    pub fn ratio(&self, rows: &[Row], of: Errors) -> Option<[f64; 3]> {
        let nerd = rows.iter().find(|r| r.robot == self.robot && r.name == NERD)?.mean(of)?;
        let divided = |e: &[f64]| match e.len() {
            2 => (e[0] + e[1]) / (nerd[0] + nerd[1]),
            n => e.iter().zip(&nerd).map(|(e, n)| e / n).sum::<f64>() / n as f64,
        };
        let by_seed = self.measured.iter().map(|m| of(m).map(divided)).collect::<Option<Vec<f64>>>()?;
        Some([divided(&self.mean(of)?), by_seed.iter().copied().fold(f64::MAX, f64::min), by_seed.iter().copied().fold(0.0, f64::max)])
    }
}

/// Which errors of a measurement.
pub type Errors = fn(&Measured) -> Option<&[f64]>;

/// Where the data lies.
pub fn here(m: &Measured) -> Option<&[f64]> {
    Some(&m.error)
}

/// [`AWAY`] from there.
pub fn away(m: &Measured) -> Option<&[f64]> {
    m.away.as_deref()
}

fn one_frame(m: &Measured) -> Option<&[f64]> {
    Some(std::slice::from_ref(&m.one_frame))
}

fn minutes(config: &ModelConfig) -> String {
    config.provenance.get("minutes").cloned().unwrap_or_else(|| "?".into())
}

/// Refuses to compare what did not learn from the same data.
pub fn check(rows: &[Row]) -> Result<()> {
    for row in rows {
        if let Some(other) = rows.iter().find(|r| r.robot == row.robot && r.data != row.data) {
            bail!("{}: {} and {} learned from different data; move out/ablations away", row.robot, row.name, other.name);
        }
    }
    Ok(())
}

/// Pairs of bars that the paper sets apart by more than [`MARGIN`]: (larger, smaller, its margin, ours).
fn pairs<'a>(rows: &[&'a Row], all: &[Row], of: Errors) -> Vec<(&'a Row, &'a Row, f64, f64)> {
    let bars: Vec<_> = rows.iter().filter_map(|r| Some((*r, r.paper?, r.ratio(all, of)?[0]))).collect();
    let with = |a: &(&'a Row, f64, f64)| bars.iter().map(|b| (a.0, b.0, a.1 / b.1, a.2 / b.2)).collect::<Vec<_>>();
    let mut pairs: Vec<_> = bars.iter().flat_map(with).filter(|p| p.2 > MARGIN).collect();
    pairs.sort_by(|a, b| b.2.total_cmp(&a.2));
    pairs
}

/// Writes `ablations.json` and `ablations.md`.
pub fn write(args: &AblationArgs, rows: &[Row]) -> Result<()> {
    let stamp = Provenance::now(args.seed[0]);
    let ratios = |r: &Row| serde_json::json!({ "robot": r.robot, "name": r.name, "here": r.ratio(rows, here), "away": r.ratio(rows, away), "paper": r.paper });
    let json = serde_json::json!({
        "provenance": stamp,
        "updates": args.updates,
        "transitions": args.transitions,
        "starts": args.starts,
        "steps": STEPS,
        "seeds": args.seed,
        "away_m": AWAY,
        "ratios": rows.iter().map(ratios).collect::<Vec<_>>(),
        "rows": rows,
    });
    crate::files::write(&args.out.join("ablations.json"), (serde_json::to_string_pretty(&json)? + "\n").as_bytes())?;
    let mut text = format!(
        "# The paper's ablations (Figure A.2)\n\n\
         Each variant is NeRD with one decision taken back: same data, {} updates of {BATCH} windows, networks of equal parameter\n\
         counts, Muon for hidden matrices and Adam for the rest. Passive motion, {} starts x {STEPS} frames, errors divided by NeRD's (`{NERD}`). Seeds: {}.\n",
        args.updates,
        args.starts,
        args.seed.iter().map(u64::to_string).collect::<Vec<_>>().join(", "),
    );
    for robot in &args.robot {
        text.push_str(&section(robot, rows));
    }
    text.push_str(&super::reasons::text(rows));
    text.push_str(&format!("\n`{}`, commit {}, {}, {}\n", stamp.command, stamp.commit, stamp.machine, stamp.date));
    println!("{text}");
    crate::files::write(&args.out.join("ablations.md"), text.as_bytes())
}

/// Table and order of one robot.
fn section(robot: &str, all: &[Row]) -> String {
    let rows: Vec<&Row> = all.iter().filter(|r| r.robot == robot).collect();
    let floating = rows.iter().all(|r| r.measured.iter().all(|m| m.away.is_some()));
    let mut text = if floating {
        format!(
            "\n## {robot}, passive motion on its ground\n\n\
             It stands in for the paper's three running policies, whose reward gap the paper's bars are. Since a runner leaves the\n\
             data's box, the same rollouts are made {AWAY} m away. Errors: position (m) / orientation / joints (rad).\n\n"
        )
    } else {
        format!("\n## {robot}, contact-free passive motion\n\nErrors: joints (rad).\n\n")
    };
    let ratio = |r: &Row, of: Errors| {
        r.ratio(all, of).map_or_else(
            || "-".into(),
            |[mean, least, most]| {
                if r.measured.len() > 1 { format!("{} ({} to {})", digits(mean), digits(least), digits(most)) } else { digits(mean) }
            },
        )
    };
    let shown = |r: &Row, of: Errors| r.mean(of).map_or_else(|| "-".into(), |e| pair(&e));
    let cells = rows.iter().map(|r| {
        let mut cells = vec![
            r.name.clone(),
            r.parameters.to_string(),
            format!("{} x {}", r.batch, r.history),
            r.minutes.join(" / "),
            shown(r, here),
            shown(r, one_frame),
            r.measured.iter().map(|m| m.diverged).sum::<usize>().to_string(),
            ratio(r, here),
        ];
        if floating {
            cells.push(ratio(r, away));
        }
        cells.push(r.paper.map_or_else(|| "-".into(), |p| format!("{p}")));
        cells
    });
    let mut header = vec!["variant", "parameters", "windows x tokens", "minutes", "error", "one frame", "diverged", "of NeRD's"];
    let far = format!("{AWAY} m away");
    if floating {
        header.push(&far);
    }
    header.push("paper");
    text.push_str(&markdown(&header, &cells.collect::<Vec<_>>()));
    let hold = rows.first().and_then(|r| r.mean(|m| Some(&m.hold))).unwrap_or_default();
    text.push_str(&format!("\nA predictor that repeats the start: {}.\n", pair(&hold)));
    let of: Errors = if floating { away } else { here };
    let pairs = pairs(&rows, all, of);
    let wrong: Vec<_> = pairs.iter().filter(|p| p.3 <= 1.0).collect();
    text.push_str(&format!(
        "\nOf {} pairs of bars that the paper sets apart by more than {MARGIN}x, {} stand in the same order here{}.\n",
        pairs.len(),
        pairs.len() - wrong.len(),
        if floating { format!(" ({AWAY} m away)") } else { String::new() }
    ));
    if !wrong.is_empty() {
        let cells = wrong.iter().map(|(a, b, theirs, ours)| vec![format!("{} over {}", a.name, b.name), digits(*theirs), digits(*ours)]);
        text.push_str("The others:\n\n");
        text.push_str(&markdown(&["pair", "paper", "here"], &cells.collect::<Vec<_>>()));
    }
    text
}
