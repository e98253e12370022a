//! Bars: errors divided by NeRD's, and their order against the paper's.

use nerd_model::folder::ModelConfig;
use serde::{Deserialize, Serialize};

use super::bars::{BARS, NERD};
use crate::error::{Result, refuse};

/// Errors of one trained model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// Seed of data, weights and windows.
    pub seed: u64,
    /// Validation loss after the last update, normalised MSE: comparable between variants of the same targets.
    pub loss: f64,
    /// Training loss of the third quarter of the run over that of the last.
    pub falling: f64,
    /// Least and largest scale of the inputs that are no constants; of a variant without input normalisation 1 and 1.
    pub scales: [f64; 2],
    /// Mean |difference| over steps and starts by quantity (rad or m; [`nerd_train::evaluate::summary`]).
    pub error: Vec<f64>,
    /// Standard error of that mean over starts, by quantity.
    pub standard_error: Vec<f64>,
    /// Mean |difference| after one frame, averaged over the joints and the root's place and orientation: what the first
    /// prediction, from a window of one token, is wrong by.
    pub one_frame: f64,
    /// Rollouts that diverged.
    pub diverged: usize,
    /// Of running policies, |reward in the model - in the truth| over the latter, mean over policies; the Ant's alone.
    pub gap: Option<f64>,
    /// The floor that repeats the start, by quantity.
    pub hold: Vec<f64>,
}

/// One variant of one robot.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
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

/// Which errors of a measurement.
pub type Errors = fn(&Measured) -> Option<&[f64]>;

/// Of rollouts.
pub const ROLLED: Errors = |m| Some(&m.error);
/// Of running policies' rewards.
pub const GAP: Errors = |m| m.gap.as_ref().map(std::slice::from_ref);
/// Of the first prediction.
pub const ONE_FRAME: Errors = |m| Some(std::slice::from_ref(&m.one_frame));
/// Validation loss, which has NeRD's unit where the targets are NeRD's.
pub const LOSS: Errors = |m| Some(std::slice::from_ref(&m.loss));
/// Fall of the training loss.
pub const FALLING: Errors = |m| Some(std::slice::from_ref(&m.falling));
/// The floor that repeats the start.
pub const HOLD: Errors = |m| Some(&m.hold);

impl Row {
    /// Of trainings that differ in their seeds.
    pub fn new(robot: &str, name: &str, trainings: &[(ModelConfig, Measured)]) -> Option<Self> {
        let (config, _) = trainings.first()?;
        let bar = BARS.iter().find(|bar| bar.change.name == name)?;
        let minutes = |c: &ModelConfig| c.provenance.get("minutes").cloned().unwrap_or_else(|| "?".into());
        Some(Self {
            robot: robot.into(),
            name: name.into(),
            group: bar.group,
            parameters: config.network.parameters(),
            history: config.network.history,
            batch: config.batch,
            minutes: trainings.iter().map(|(config, _)| minutes(config)).collect(),
            data: trainings.iter().map(|(config, _)| config.data_sha256.clone()).collect(),
            measured: trainings.iter().map(|(_, measured)| measured.clone()).collect(),
            paper: bar.paper.map(|p| p[usize::from(robot == "ant")]),
        })
    }

    /// Means over seeds, by quantity.
    pub fn mean(&self, of: Errors) -> Option<Vec<f64>> {
        let all: Vec<&[f64]> = self.measured.iter().map(of).collect::<Option<_>>()?;
        Some((0..all.first()?.len()).map(|k| all.iter().map(|e| e[k]).sum::<f64>() / all.len() as f64).collect())
    }

    /// Error divided by NeRD's: mean, least and largest over seeds.
    ///
    /// Angles alone are averaged first, as in the paper; quantities of unlike units are divided first.
    pub fn ratio(&self, rows: &[Row], of: Errors) -> Option<[f64; 3]> {
        self.over(rows, of, of)
    }

    /// How a predictor that repeats the start would stand among the bars of rollouts.
    pub fn ceiling(&self, rows: &[Row]) -> Option<f64> {
        Some(self.over(rows, HOLD, ROLLED)?[0])
    }

    fn over(&self, rows: &[Row], of: Errors, nerds: Errors) -> Option<[f64; 3]> {
        let nerd = rows.iter().find(|r| r.robot == self.robot && r.name == NERD)?.mean(nerds)?;
        let divided = |e: &[f64]| match e.len() {
            2 => (e[0] + e[1]) / (nerd[0] + nerd[1]),
            n => e.iter().zip(&nerd).map(|(e, n)| e / n).sum::<f64>() / n as f64,
        };
        let by_seed = self.measured.iter().map(|m| of(m).map(divided)).collect::<Option<Vec<f64>>>()?;
        Some([divided(&self.mean(of)?), by_seed.iter().copied().fold(f64::MAX, f64::min), by_seed.iter().copied().fold(0.0, f64::max)])
    }
}

/// Robots of some rows, in their order.
pub fn robots(rows: &[Row]) -> Vec<&str> {
    let mut robots: Vec<&str> = rows.iter().map(|r| r.robot.as_str()).collect();
    robots.dedup();
    robots
}

/// Refuses to compare what did not learn from the same data.
pub fn check(rows: &[Row]) -> Result<()> {
    for row in rows {
        if let Some(other) = rows.iter().find(|r| r.robot == row.robot && r.data != row.data) {
            refuse!("{}: {} and {} learned from different data; move out/ablations away", row.robot, row.name, other.name);
        }
    }
    Ok(())
}

/// A margin of the paper's bars that ours are held to.
pub const MARGIN: f64 = 1.5;

/// Two bars that the paper sets apart by more than [`MARGIN`].
pub struct Pair<'a> {
    /// The paper's larger one.
    pub larger: &'a Row,
    /// Its smaller one.
    pub smaller: &'a Row,
    /// The paper's margin.
    pub paper: f64,
    /// Ours; below 1 the order is the other way round.
    pub ours: f64,
}

/// All such pairs of a robot's rows, the widest margin first.
pub fn pairs<'a>(rows: &[&'a Row], all: &[Row], of: Errors) -> Vec<Pair<'a>> {
    let bars: Vec<_> = rows.iter().filter_map(|r| Some((*r, r.paper?, r.ratio(all, of)?[0]))).collect();
    let with = |a: &(&'a Row, f64, f64)| {
        let pair = |b: &(&'a Row, f64, f64)| Pair { larger: a.0, smaller: b.0, paper: a.1 / b.1, ours: a.2 / b.2 };
        bars.iter().map(pair).collect::<Vec<_>>()
    };
    let mut pairs: Vec<_> = bars.iter().flat_map(with).filter(|p| p.paper > MARGIN).collect();
    pairs.sort_by(|a, b| b.paper.total_cmp(&a.paper));
    pairs
}

#[cfg(test)]
mod tests {
    use super::super::bars::Bar;
    use super::*;

    /// A pendulum's rows whose errors stand to each other as the paper's.
    fn papers() -> Vec<Row> {
        let row = |bar: &Bar| {
            let error = 0.005 * bar.paper.map_or(1.0, |p| p[0]);
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
                name: bar.change.name.into(),
                group: bar.group,
                parameters: 1,
                history: 1,
                batch: 1,
                minutes: Vec::new(),
                data: vec!["same".into()],
                measured: vec![measured],
                paper: bar.paper.map(|p| p[0]),
            }
        };
        BARS.iter().map(row).collect()
    }

    #[test]
    fn the_papers_own_errors_give_the_papers_bars_in_its_order() {
        let rows = papers();
        for row in &rows {
            let Some(paper) = row.paper else { continue };
            let ratio = row.ratio(&rows, ROLLED).expect("measured")[0];
            assert!((ratio / paper - 1.0).abs() < 1e-9, "{}: {ratio} in place of {paper}", row.name);
        }
        let all: Vec<&Row> = rows.iter().collect();
        let found = pairs(&all, &rows, ROLLED);
        assert!(found.iter().all(|p| p.ours > MARGIN) && found.len() > 30, "{} pairs", found.len());
        let ceiling = rows[0].ceiling(&rows).expect("measured");
        assert!((ceiling - 200.0).abs() < 1e-9, "{ceiling}");
    }

    #[test]
    fn a_pair_the_other_way_round_is_found() {
        let mut rows = papers();
        let (mlp, gru) = (2, 1);
        let errors = rows[mlp].measured[0].error.clone();
        rows[mlp].measured[0].error = std::mem::replace(&mut rows[gru].measured[0].error, errors);
        let all: Vec<&Row> = rows.iter().collect();
        let wrong = pairs(&all, &rows, ROLLED).into_iter().filter(|p| p.ours <= 1.0);
        let wrong: Vec<_> = wrong.map(|p| (p.larger.name.clone(), p.smaller.name.clone())).collect();
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
