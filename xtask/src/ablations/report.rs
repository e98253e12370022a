//! What the ablations say: rows, their order against the paper's, `ablations.json` and `ablations.md`.

use anyhow::{Result, bail};
use nerd_model::folder::ModelConfig;
use serde::{Deserialize, Serialize};

use super::entry::Entry;
use super::measure::steps;
use super::{AblationArgs, BATCH, Measured, NERD};
use nerd_train::report::Provenance;
use nerd_train::report::table::{digits, markdown, pair};

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

    /// Validation loss, mean over seeds.
    pub fn loss(&self) -> f64 {
        self.measured.iter().map(|m| m.loss).sum::<f64>() / self.measured.len() as f64
    }

    /// Factor by which the training loss still fell from the third quarter of the run to the last, mean over seeds.
    pub fn falling(&self) -> f64 {
        self.measured.iter().map(|m| m.falling).sum::<f64>() / self.measured.len() as f64
    }

    /// How a predictor that repeats the start would stand among the bars.
    pub fn ceiling(&self, rows: &[Row]) -> Option<f64> {
        let mut still = self.clone();
        still.measured.iter_mut().for_each(|m| m.error.clone_from(&m.hold));
        Some(still.ratio(rows, here)?[0])
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

/// Of running policies' rewards.
pub fn gap(m: &Measured) -> Option<&[f64]> {
    m.gap.as_ref().map(std::slice::from_ref)
}

/// Validation loss of what has the same targets as NeRD, and so the same unit.
pub fn loss(m: &Measured) -> Option<&[f64]> {
    Some(std::slice::from_ref(&m.loss))
}

/// Variants whose targets are not NeRD's.
const OTHER_TARGETS: [&str; 4] = ["E2E", "Abs Pred", "World Frame", "No Out. Norm"];

/// Of the first prediction.
pub fn one_frame(m: &Measured) -> Option<&[f64]> {
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
pub fn write(args: &AblationArgs, rows: &[Row], policies: usize) -> Result<()> {
    let stamp = Provenance::now(args.seed[0]);
    let ratios = |r: &Row| serde_json::json!({ "robot": r.robot, "name": r.name, "here": r.ratio(rows, here), "one_frame": r.ratio(rows, one_frame), "gap": r.ratio(rows, gap), "paper": r.paper });
    let json = serde_json::json!({
        "provenance": stamp,
        "updates": args.updates,
        "transitions": args.transitions,
        "starts": args.starts,
        "seeds": args.seed,
        "frames": args.robot.iter().map(|r| (r.clone(), steps(r))).collect::<std::collections::BTreeMap<_, _>>(),
        "games": args.games,
        "ratios": rows.iter().map(ratios).collect::<Vec<_>>(),
        "rows": rows,
    });
    crate::files::write(&args.out.join("ablations.json"), (serde_json::to_string_pretty(&json)? + "\n").as_bytes())?;
    let mut text = format!(
        "# The paper's ablations (Figure A.2)\n\n\
         Each variant is NeRD with one decision taken back: same data, {} updates of {BATCH} windows, networks of equal parameter\n\
         counts, Muon for hidden matrices and Adam for the rest. Passive motion, {} starts, errors divided by NeRD's (`{NERD}`). Seeds: {}.\n",
        args.updates,
        args.starts,
        args.seed.iter().map(u64::to_string).collect::<Vec<_>>().join(", "),
    );
    for robot in &args.robot {
        text.push_str(&section(robot, rows, &format!("{policies} running policies, {} games of each", args.games)));
    }
    text.push_str(&super::reasons::text(rows, &args.robot));
    text.push_str(&format!("\n`{}`, commit {}, {}, {}\n", stamp.command, stamp.commit, stamp.machine, stamp.date));
    println!("{text}");
    crate::files::write(&args.out.join("ablations.md"), text.as_bytes())
}

/// Table and order of one robot.
fn section(robot: &str, all: &[Row], runners: &str) -> String {
    let rows: Vec<&Row> = all.iter().filter(|r| r.robot == robot).collect();
    let frames = steps(robot);
    let running = rows.iter().all(|r| r.measured.iter().all(|m| m.gap.is_some()));
    let mut text = if running {
        format!(
            "\n## {robot}, running policies\n\nThe paper's test case: {runners}; the gap is |reward in the variant - in the truth| over the latter, mean over policies.\n\
             Beside it, passive motion on the ground for {frames} frames: position (m) / orientation / joints (rad).\n\n"
        )
    } else {
        format!("\n## {robot}, contact-free passive motion, {frames} frames\n\nErrors: joints (rad).\n\n")
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
            digits(r.loss()),
            shown(r, one_frame),
            r.measured.iter().map(|m| m.diverged).sum::<usize>().to_string(),
            ratio(r, here),
            ratio(r, one_frame),
        ];
        if running {
            cells.insert(4, r.mean(gap).map_or_else(|| "-".into(), |g| format!("{:.1} %", 100.0 * g[0])));
            cells.push(ratio(r, gap));
        }
        cells.push(r.paper.map_or_else(|| "-".into(), |p| format!("{p}")));
        cells
    });
    let mut header = vec![
        "variant",
        "parameters",
        "windows x tokens",
        "minutes",
        "error",
        "validation loss",
        "one frame",
        "diverged",
        "error / NeRD's",
        "one frame / NeRD's",
    ];
    if running {
        header.insert(4, "gap");
        header.push("gap / NeRD's");
    }
    header.push("paper");
    text.push_str(&markdown(&header, &cells.collect::<Vec<_>>()));
    let hold = rows.first().and_then(|r| r.mean(|m| Some(&m.hold))).unwrap_or_default();
    text.push_str(&format!("\nA predictor that repeats the start: {}.\n", pair(&hold)));
    let rollout = pairs(&rows, all, if running { gap } else { here });
    let first = pairs(&rows, all, one_frame);
    let kept = |pairs: &[(&Row, &Row, f64, f64)]| pairs.iter().filter(|p| p.3 > 1.0).count();
    let same: Vec<&Row> = rows.iter().filter(|r| !OTHER_TARGETS.contains(&r.name.as_str())).copied().collect();
    let losses = pairs(&same, all, loss);
    let rolled = if running { "the gap" } else { "the error of rollouts" };
    text.push_str(&format!(
        "\nOf {} pairs of bars that the paper sets apart by more than {MARGIN}x, {} stand in the same order by {rolled}, {} by\n\
         the error of one frame. Of the {} between variants that learn the same targets, {} do by validation loss.\n",
        rollout.len(),
        kept(&rollout),
        kept(&first),
        losses.len(),
        kept(&losses),
    ));
    let one = |a: &Row, b: &Row| first.iter().find(|p| p.0.name == a.name && p.1.name == b.name).map(|p| p.3);
    let wrong: Vec<_> = rollout.iter().filter(|p| p.3 <= 1.0 || one(p.0, p.1).is_some_and(|ours| ours <= 1.0)).collect();
    if !wrong.is_empty() {
        let cells = wrong.iter().map(|(a, b, theirs, ours)| {
            vec![format!("{} over {}", a.name, b.name), digits(*theirs), digits(*ours), one(a, b).map_or_else(|| "-".into(), digits)]
        });
        text.push_str("Margins of those that do not by both:\n\n");
        text.push_str(&markdown(&["pair", "paper", rolled, "one frame"], &cells.collect::<Vec<_>>()));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::super::entry::ENTRIES;
    use super::*;

    /// A pendulum's rows whose errors stand to each other as the paper's.
    fn papers() -> Vec<Row> {
        let row = |entry: &Entry| {
            let error = 0.005 * entry.paper.map_or(1.0, |p| p[0]);
            let measured = Measured {
                seed: 0,
                loss: 0.1,
                falling: 1.0,
                scales: [1.0; 2],
                error: vec![0.8 * error, 1.2 * error],
                standard_error: vec![0.0; 2],
                one_frame: error,
                diverged: 0,
                gap: None,
                hold: vec![1.0, 1.0],
            };
            Row {
                robot: "pendulum".into(),
                name: entry.name.into(),
                group: entry.group,
                parameters: 1,
                history: entry.history,
                batch: 1,
                minutes: Vec::new(),
                data: vec!["same".into()],
                measured: vec![measured],
                paper: entry.paper.map(|p| p[0]),
            }
        };
        ENTRIES.iter().map(row).collect()
    }

    #[test]
    fn the_papers_own_errors_give_the_papers_bars_in_its_order() {
        let rows = papers();
        for row in &rows {
            let Some(paper) = row.paper else { continue };
            let ratio = row.ratio(&rows, here).expect("measured")[0];
            assert!((ratio / paper - 1.0).abs() < 1e-9, "{}: {ratio} in place of {paper}", row.name);
        }
        let all: Vec<&Row> = rows.iter().collect();
        let found = pairs(&all, &rows, here);
        assert!(found.iter().all(|p| p.3 > MARGIN) && found.len() > 30, "{} pairs", found.len());
        assert!((rows[0].ceiling(&rows).expect("measured") - 200.0).abs() < 1e-9);
    }

    #[test]
    fn a_pair_the_other_way_round_is_found() {
        let mut rows = papers();
        let (mlp, gru) = (2, 1);
        let errors = rows[mlp].measured[0].error.clone();
        rows[mlp].measured[0].error = std::mem::replace(&mut rows[gru].measured[0].error, errors);
        let all: Vec<&Row> = rows.iter().collect();
        let wrong: Vec<_> =
            pairs(&all, &rows, here).into_iter().filter(|p| p.3 <= 1.0).map(|p| (p.0.name.clone(), p.1.name.clone())).collect();
        // 4.8 and 8.9 change places; nothing lies between them.
        assert_eq!(wrong, [("MLP".to_string(), "GRU".to_string())]);
    }

    #[test]
    fn variants_of_different_data_are_not_compared() {
        let mut rows = papers();
        check(&rows).expect("the same data");
        rows[3].data[0] = "other".into();
        assert!(check(&rows).expect_err("different").to_string().contains("E2E"));
    }
}
