//! What a data set holds, as people read it.

use super::{Block, Column, Inspection};
use crate::report::Table;
use crate::report::table::digits;

impl Inspection {
    /// The counts in words.
    pub fn words(&self) -> String {
        let Self { robot, counts, columns, bound, .. } = self;
        let of = |block: Block| columns.iter().filter(|c| c.block == block).count();
        let share = |n: u64, of: u64| format!("{:.3} %", 100.0 * n as f64 / of.max(1) as f64);
        let points = counts.tokens * of(Block::Depth) as u64;
        let mut text = format!(
            "{robot}: {} tokens of {} inputs and {} targets; {} of {} trajectories left out ({} not finite, {} beyond {bound})\n",
            counts.tokens,
            columns.len() - of(Block::Target),
            of(Block::Target),
            counts.not_finite + counts.beyond,
            counts.trajectories,
            counts.not_finite,
            counts.beyond,
        );
        if points > 0 {
            text += &format!(
                "contact: {} of tokens see a point within the mask, {} touch; {} of points are seen, {} touch\n",
                share(counts.tokens_seeing, counts.tokens),
                share(counts.tokens_touching, counts.tokens),
                share(counts.points_seen, points),
                share(counts.points_touching, points)
            );
        }
        for (joint, n) in &counts.wraps {
            text += &format!("angle of `{joint}` wraps in {} of transitions\n", share(*n, counts.tokens));
        }
        let constant: Vec<&str> = columns.iter().filter(|c| c.count > 0 && c.constant()).map(|c| c.name.as_str()).collect();
        if !constant.is_empty() {
            text += &format!("constant, nothing to learn from: {}\n", constant.join(", "));
        }
        text
    }

    /// Range, mean and spread; a kind of contact number takes one row for all points.
    pub fn table(&self) -> Table {
        let tokens = self.counts.tokens;
        let shared = |b: Block| matches!(b, Block::Normal | Block::Point | Block::Depth);
        let row = |name: &str, seen: f64, figures: [f64; 4]| {
            let seen = format!("{:.3}", 100.0 * seen);
            [name.to_string(), seen].into_iter().chain(figures.map(digits)).collect::<Vec<_>>()
        };
        let mut rows = Vec::new();
        for block in Block::ALL {
            let of: Vec<&Column> = self.columns.iter().filter(|c| c.block == block).collect();
            if !shared(block) {
                let seen = |c: &Column| c.count as f64 / tokens as f64;
                rows.extend(of.iter().map(|c| row(&c.name, seen(c), [c.min, c.mean, c.max, c.std])));
                continue;
            }
            let n = of.iter().map(|c| c.count as f64).sum::<f64>();
            let there = of.iter().filter(|c| c.count > 0);
            if n > 0.0 {
                let mean = there.clone().map(|c| c.mean * c.count as f64).sum::<f64>() / n;
                let square = there.clone().map(|c| (c.std * c.std + (c.mean - mean).powi(2)) * c.count as f64).sum::<f64>() / n;
                let ends = there.fold((f64::MAX, f64::MIN), |e, c| (e.0.min(c.min), e.1.max(c.max)));
                let name = format!("{} ({})", block.name(), of.len());
                rows.push(row(&name, n / (tokens * of.len() as u64) as f64, [ends.0, mean, ends.1, square.sqrt()]));
            }
        }
        Table::new("columns", &["column", "seen (%)", "least", "mean", "most", "std"]).with(rows)
    }
}
