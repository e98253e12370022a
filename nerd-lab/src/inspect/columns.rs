//! The columns of a data set: what each is called, and what its numbers are like.

use nerd_model::base::Base;
use nerd_model::features::Features;
use nerd_sim::prelude::*;
use serde::{Deserialize, Serialize};

/// What a column is part of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Block {
    /// The state, without what is the same under all motions of the world.
    State,
    /// Normals of contact points.
    Normal,
    /// Contact points of the scene.
    Point,
    /// Distances of contact points.
    Depth,
    /// Joint torques.
    Torque,
    /// Direction of gravity.
    Gravity,
    /// Change of the state over the frame.
    Target,
}

impl Block {
    /// All, in order.
    pub const ALL: [Self; 7] = [Self::State, Self::Normal, Self::Point, Self::Depth, Self::Torque, Self::Gravity, Self::Target];

    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Self::State => "state",
            Self::Normal => "contact normals",
            Self::Point => "contact points",
            Self::Depth => "contact depths",
            Self::Torque => "torques",
            Self::Gravity => "gravity",
            Self::Target => "targets: change over the frame",
        }
    }
}

/// Bars of a histogram.
pub(super) const BINS: usize = 40;

/// One number of a token or of a target.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Column {
    /// The table's name of it, `\u{394}` before a target's.
    pub name: String,
    /// What it is part of.
    pub block: Block,
    /// Contact point whose mask decides whether the number is there.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub contact: Option<usize>,
    /// Numbers that are there, of all tokens.
    pub count: u64,
    /// Least of the numbers that are there.
    pub min: f64,
    /// Largest of them.
    pub max: f64,
    /// Their mean.
    pub mean: f64,
    /// Their standard deviation.
    pub std: f64,
    /// That of all, with zeros for those that are not there: what a normaliser divides by.
    pub std_of_all: f64,
    /// Lower end of the histogram: 4 standard deviations below the mean, at most the range. Numbers beyond are in its end bars.
    pub low: f64,
    /// Upper end.
    pub high: f64,
    /// Numbers by bar.
    pub bars: Vec<u64>,
    #[serde(skip)]
    square: f64,
}

impl Column {
    fn new(name: String, block: Block, contact: Option<usize>) -> Self {
        Self {
            name,
            block,
            contact,
            count: 0,
            min: f64::MAX,
            max: f64::MIN,
            mean: 0.0,
            std: 0.0,
            std_of_all: 0.0,
            low: 0.0,
            high: 0.0,
            bars: vec![0; BINS],
            square: 0.0,
        }
    }

    /// Takes a number into range, mean and spread.
    pub(super) fn add(&mut self, x: f64) {
        self.count += 1;
        (self.min, self.max) = (self.min.min(x), self.max.max(x));
        // Welford's update: stable at millions of rows.
        let gap = x - self.mean;
        self.mean += gap / self.count as f64;
        self.square += gap * (x - self.mean);
    }

    /// After the last [`Self::add`] of `tokens` tokens: spreads, and the histogram's ends.
    pub(super) fn close(&mut self, tokens: u64) {
        if self.count == 0 {
            (self.min, self.max) = (0.0, 0.0);
        }
        let (n, all) = (self.count.max(1) as f64, tokens.max(1) as f64);
        self.std = (self.square / n).sqrt();
        let absent = all - self.count as f64;
        self.std_of_all = ((self.square + self.mean * self.mean * n * absent / all) / all).sqrt();
        (self.low, self.high) = ((self.mean - 4.0 * self.std).max(self.min), (self.mean + 4.0 * self.std).min(self.max));
    }

    /// Takes a number into the histogram.
    pub(super) fn bin(&mut self, x: f64) {
        let share = if self.high > self.low { (x - self.low) / (self.high - self.low) } else { 0.5 };
        self.bars[((share * BINS as f64) as usize).min(BINS - 1)] += 1;
    }

    /// Whether nothing can be learned from it.
    pub fn constant(&self) -> bool {
        self.max - self.min <= 1e-6 * self.max.abs().max(1.0)
    }
}

/// The columns of a token, then those of a target, in [`Features`]' order.
pub(super) fn columns(system: &System) -> Vec<Column> {
    let (spec, robot) = (&system.spec, &system.robot);
    let (mut out, axes) = (Vec::new(), ["x", "y", "z"]);
    let mut push = |name: String, block: Block, contact: Option<usize>| out.push(Column::new(name, block, contact));
    spec.state_columns.iter().for_each(|c| push(c.clone(), Block::State, None));
    let situated = Features::inputs(system, Base::State) > robot.state_dim() + robot.joint_count();
    let points = if situated { robot.contact_points.len() } else { 0 };
    for block in [Block::Normal, Block::Point] {
        let letter = if block == Block::Normal { "n" } else { "p" };
        (0..points).for_each(|k| axes.iter().for_each(|a| push(format!("{letter}{k} {a}"), block, Some(k))));
    }
    (0..points).for_each(|k| push(format!("depth {k}"), Block::Depth, Some(k)));
    spec.torque_columns.iter().for_each(|c| push(c.clone(), Block::Torque, None));
    if situated {
        axes.iter().for_each(|a| push(format!("down {a}"), Block::Gravity, None));
    }
    spec.state_columns.iter().for_each(|c| push(format!("\u{394} {c}"), Block::Target, None));
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_robot_has_a_name_for_every_input_and_target() {
        for robot in System::built_in() {
            let system = System::named(robot).expect("built in");
            assert_eq!(columns(&system).len(), Features::inputs(&system, Base::State) + Features::outputs(&system), "{robot}");
        }
    }

    #[test]
    fn figures_of_a_column_against_sums() {
        let mut column = Column::new("x".into(), Block::Depth, Some(0));
        let numbers = [0.5, 2.0, -1.0, 0.5];
        numbers.iter().for_each(|x| column.add(*x));
        column.close(8);
        numbers.iter().for_each(|x| column.bin(*x));
        // Four of eight are there: mean 0.5, squares 0, 2.25, 2.25, 0; of all: mean 0.25, mean square 5.5 / 8.
        assert!((column.mean - 0.5).abs() < 1e-12 && (column.std - (4.5f64 / 4.0).sqrt()).abs() < 1e-12);
        assert!((column.std_of_all - (5.5f64 / 8.0 - 0.0625).sqrt()).abs() < 1e-12);
        assert_eq!((column.low, column.high, column.bars.iter().sum::<u64>()), (-1.0, 2.0, 4));
        assert_eq!((column.bars[0], column.bars[20], column.bars[BINS - 1]), (1, 2, 1));
    }
}
