//! Gaps against rounds, by task: their mean size, and that of the largest.

use super::{Rounds, TaskGaps};
use crate::report::figure::{Axis, Figure, Panel, Series, Style};

/// What is smaller is drawn here (percent).
const SMALLEST: f64 = 0.01;

/// A figure of a task's gaps.
type Size = fn(&TaskGaps) -> f64;

impl Rounds {
    /// A line for each task and size; what is infinite is left out.
    pub(super) fn figure(&self) -> Figure {
        let tasks = self.rounds.first().map_or(&[][..], |round| &round.tasks);
        let sizes: [(Size, &str); 2] = [(TaskGaps::mean, "mean"), (TaskGaps::largest, "largest")];
        let line = |task: &str, (of, name): (Size, &str)| {
            let point = |round: &super::Round| {
                let size = round.tasks.iter().find(|t| t.task == task).map(of)?;
                size.is_finite().then_some((round.round as f64, size.max(SMALLEST), String::new()))
            };
            let points = self.rounds.iter().filter_map(point).collect();
            Series { name: format!("{task}, {name}"), points, style: Style::Marked }
        };
        let series = tasks.iter().flat_map(|task| sizes.map(|size| line(&task.task, size))).collect();
        let levels = vec![(self.mean, "mean allowed".into()), (self.most, "most allowed".into())];
        let x = Axis::named((0..self.rounds.len()).map(|round| format!("round {round}")).collect());
        let panel = Panel { x, y: Axis::log("size of the gap of the reward (%)"), series, levels, ..Panel::default() };
        Figure::single("Policies of new seeds: gap by round".into(), panel)
    }
}
