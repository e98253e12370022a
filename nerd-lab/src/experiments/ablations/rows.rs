//! Bars: errors divided by NeRD's, beside the paper's.

use super::bars::{Bar, NERD};
use crate::prelude::*;

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Measurement {
    /// Seed of data, weights and windows.
    pub seed: u64,
    /// Mean |difference| over steps and starts by quantity (rad or m; [`nerd_train::evaluate::summary`]).
    pub error: Vec<f64>,
    /// Mean |difference| after one frame, averaged over the joints and the root's place and orientation: what the first
    /// prediction, from a window of one token, is wrong by.
    pub one_frame: f64,
    pub diverged: usize,
    /// Of running policies, |reward in the model - in the truth| over the latter, mean over policies; the Ant's alone.
    pub gap: Option<f64>,
    /// The floor that repeats the start, by quantity.
    pub hold: Vec<f64>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Row {
    pub robot: String,
    pub name: String,
    parameters: usize,
    /// Windows of an update, and tokens of a window.
    windows: [usize; 2],
    /// SHA-256 of the data by seed.
    pub data: Vec<String>,
    pub measured: Vec<Measurement>,
    pub paper: Option<f64>,
}

type Errors = fn(&Measurement) -> Option<&[f64]>;

const ROLLED: Errors = |m| Some(&m.error);
/// Of running policies' rewards.
const GAP: Errors = |m| m.gap.as_ref().map(std::slice::from_ref);
const ONE_FRAME: Errors = |m| Some(std::slice::from_ref(&m.one_frame));
const HOLD: Errors = |m| Some(&m.hold);

impl Row {
    pub fn new(robot: &str, bar: &Bar, trained: &[(ModelConfig, Measurement)]) -> Option<Self> {
        let (config, _) = trained.first()?;
        Some(Self {
            robot: robot.into(),
            name: bar.name.into(),
            parameters: config.network.parameters(),
            windows: [config.batch, config.network.history],
            data: trained.iter().map(|(config, _)| config.data_sha256.clone()).collect(),
            measured: trained.iter().map(|(_, measured)| measured.clone()).collect(),
            paper: bar.paper(robot),
        })
    }

    fn mean(&self, of: Errors) -> Option<Vec<f64>> {
        let all: Vec<&[f64]> = self.measured.iter().map(of).collect::<Option<_>>()?;
        Some((0..all.first()?.len()).map(|k| all.iter().map(|e| e[k]).sum::<f64>() / all.len() as f64).collect())
    }

    /// Error divided by NeRD's `nerds`: of the mean, and least and largest over seeds. Angles alone are averaged first, as in the
    /// paper; quantities of unlike units are divided first.
    fn ratio(&self, rows: &[Row], of: Errors, nerds: Errors) -> Option<[f64; 3]> {
        let nerd = rows.iter().find(|r| r.robot == self.robot && r.name == NERD)?.mean(nerds)?;
        let divided = |e: &[f64]| match e.len() {
            2 => (e[0] + e[1]) / (nerd[0] + nerd[1]),
            n => e.iter().zip(&nerd).map(|(e, n)| e / n).sum::<f64>() / n as f64,
        };
        let by_seed = self.measured.iter().map(|m| of(m).map(divided)).collect::<Option<Vec<f64>>>()?;
        Some([divided(&self.mean(of)?), by_seed.iter().copied().fold(f64::MAX, f64::min), by_seed.iter().copied().fold(0.0, f64::max)])
    }
}

/// Refuses to compare what did not learn from the same data.
pub(super) fn check(rows: &[Row]) -> Result<()> {
    for row in rows {
        if let Some(other) = rows.iter().find(|r| r.robot == row.robot && r.data != row.data) {
            bail!("{}: {} and {} learned from different data; move out/ablations away", row.robot, row.name, other.name);
        }
    }
    Ok(())
}

/// What the predictor that repeats the start errs by.
pub(super) fn hold(rows: &[Row], robot: &str) -> String {
    rows.iter().find(|r| r.robot == robot).map_or_else(String::new, |r| shown(r, HOLD))
}

fn shown(row: &Row, of: Errors) -> String {
    row.mean(of).map_or_else(|| "-".into(), |e| pair(&e))
}

pub(super) fn table(rows: &[Row], robot: &str) -> Table {
    let running = robot == "ant";
    let mut header =
        vec!["variant", "parameters", "windows x tokens", "error", "one frame", "diverged", "error / NeRD's", "one frame / NeRD's"];
    header.extend(running.then_some(["gap (%)", "gap / NeRD's"]).into_iter().flatten());
    header.push("paper");
    let ratio = |row: &Row, of: Errors| match row.ratio(rows, of, of) {
        Some([mean, least, most]) if row.measured.len() > 1 => format!("{} ({} to {})", digits(mean), digits(least), digits(most)),
        Some([mean, ..]) => digits(mean),
        None => "-".into(),
    };
    let lines = rows.iter().filter(|r| r.robot == robot).map(|r| {
        let [batch, history] = r.windows;
        let diverged = r.measured.iter().map(|m| m.diverged).sum::<usize>().to_string();
        let mut cells =
            vec![r.name.clone(), r.parameters.to_string(), format!("{batch} x {history}"), shown(r, ROLLED), shown(r, ONE_FRAME)];
        cells.extend([diverged, ratio(r, ROLLED), ratio(r, ONE_FRAME)]);
        if running {
            cells.extend([r.mean(GAP).map_or_else(|| "-".into(), |gap| format!("{:.1}", 100.0 * gap[0])), ratio(r, GAP)]);
        }
        cells.push(or_dash(r.paper));
        cells
    });
    Table::new(robot, &header).with(lines)
}

pub(super) fn figure(rows: &[Row], robots: &[String]) -> Figure {
    let panel = |robot: &String| {
        let rows_of: Vec<&Row> = rows.iter().filter(|r| r.robot == *robot).collect();
        let bars = |of: Errors| {
            let height = |(k, r): (usize, &&Row)| Some((k as f64, r.ratio(rows, of, of)?[0]));
            rows_of.iter().enumerate().filter_map(height).collect::<Vec<_>>()
        };
        let paper = rows_of.iter().enumerate().filter_map(|(k, r)| Some((k as f64, r.paper?)));
        let mut series: Vec<Series> = [("ours, rewards", GAP), ("ours, passive motion", ROLLED), ("ours, one frame", ONE_FRAME)]
            .map(|(name, of): (&str, Errors)| Series::new(name, Style::Bars, bars(of)))
            .into();
        series.push(Series::new("paper, Figure A.2", Style::Bars, paper));
        series.retain(|s| !s.points.is_empty());
        let ceiling = rows_of.first().and_then(|r| r.ratio(rows, HOLD, ROLLED));
        let levels = ceiling.map(|c| (c[0], "ours, repeating the start".to_string())).into_iter().collect();
        let title = if robot == "ant" { "Ant, rewards of running policies" } else { "Double pendulum, contact-free passive motion" };
        let x = Axis::named(rows_of.iter().map(|r| r.name.clone()).collect());
        Panel { title: title.into(), x, y: Axis::log("error / NeRD's"), series, levels }
    };
    Figure { title: "NeRD with one design decision taken back".into(), columns: 1, panels: robots.iter().map(panel).collect() }
}

#[cfg(test)]
mod tests {
    use super::super::bars::BARS;
    use super::*;

    /// A pendulum's rows whose errors are to each other as the paper's.
    fn papers() -> Vec<Row> {
        let row = |bar: &Bar| {
            let error = 0.005 * bar.paper("pendulum").unwrap_or(1.0);
            let (error, hold) = (vec![0.8 * error, 1.2 * error], vec![1.0, 1.0]);
            let measured = Measurement { seed: 0, one_frame: error[0], error, diverged: 0, gap: None, hold };
            Row {
                robot: "pendulum".into(),
                name: bar.name.into(),
                parameters: 1,
                windows: [1, 1],
                data: vec!["same".into()],
                measured: vec![measured],
                paper: bar.paper("pendulum"),
            }
        };
        BARS.iter().map(row).collect()
    }

    #[test]
    fn the_papers_own_errors_give_the_papers_bars() {
        let rows = papers();
        for row in &rows {
            let Some(paper) = row.paper else { continue };
            let ratio = row.ratio(&rows, ROLLED, ROLLED).expect("measured")[0];
            assert!((ratio / paper - 1.0).abs() < 1e-9, "{}: {ratio} in place of {paper}", row.name);
        }
        let ceiling = rows[0].ratio(&rows, HOLD, ROLLED).expect("measured")[0];
        assert!((ceiling - 200.0).abs() < 1e-9, "{ceiling}");
    }

    #[test]
    fn variants_of_different_data_are_not_compared() {
        let mut rows = papers();
        check(&rows).expect("the same data");
        rows[3].data[0] = "other".into();
        assert!(check(&rows).expect_err("different").to_string().contains("E2E"));
    }
}
