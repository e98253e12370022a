//! Contents of a chart: the Pareto front, table and figure.

use nerd_train::evaluate::summary;

use crate::prelude::*;
use nerd_cli::report::{Mark, unbeaten};

#[derive(Serialize)]
pub(super) struct ChartData {
    pub robot: String,
    pub scene: String,
    pub protocol: PassiveConfig,
    pub reference: String,
    /// Error of the reference: its mean |dq| (rad or m) from itself at half the substeps.
    pub reference_error: f64,
    /// Mean |dq| (rad or m) of the predictor that repeats the start.
    pub hold: f64,
    pub points: Vec<Point>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mujoco: Option<Against>,
    /// Number of environments stepped together, if timed on a GPU.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub environments: Option<usize>,
}

/// One mark on the chart: a solver at one setting.
#[derive(Serialize)]
pub(super) struct Point {
    series: String,
    /// The solver; `None` for another engine.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub spec: Option<SolverSpec>,
    substeps: Option<usize>,
    /// Wall time of a frame of one environment (us). On one core, it is the fastest of a few runs; on a GPU, a share of
    /// many environments' time.
    microseconds: f64,
    pub error: f64,
    /// Mean |dq| from the reference, by quantity (m or rad).
    by_coordinate: Vec<f64>,
    diverged: usize,
    front: bool,
    /// Whether the error is against another reference than the chart's; such a point is never on the front.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    own: bool,
    /// GPU memory of the process (MiB).
    #[serde(skip_serializing_if = "Option::is_none")]
    memory: Option<f64>,
}

#[derive(Serialize)]
pub(super) struct Against {
    pub version: String,
    pub reference: String,
    /// Error of a reference that is MuJoCo's own: its mean |dq| from itself at half the substeps.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reference_error: Option<f64>,
}

impl Point {
    /// Makes a measured point; `own` is true if its reference is not the chart's.
    pub fn new(
        series: &str,
        substeps: Option<usize>,
        Timed { report, microseconds, memory }: Timed,
        own: bool,
    ) -> Self {
        Self {
            series: series.into(),
            spec: None,
            substeps,
            microseconds,
            error: mean(&report.error),
            diverged: report.diverged,
            by_coordinate: report.error,
            front: false,
            own,
            memory,
        }
    }
}

impl ChartData {
    /// Marks the points on the Pareto front; points with another reference than the chart's are excluded.
    pub fn mark(&mut self) {
        let race = self.points.iter().map(|p| (!p.own).then_some((p.microseconds, p.error))).collect_vec();
        self.points.iter_mut().zip(unbeaten(&race)).for_each(|(p, front)| p.front = front);
    }

    /// Time of a point with another reference, as a multiple of the front's time at the same error (log-log
    /// interpolation). `None` for other points, and for errors outside the front's range.
    fn times(&self, p: &Point) -> Option<f64> {
        let mut ours = self.points.iter().filter(|p| p.front).collect_vec();
        ours.sort_by(|a, b| a.error.total_cmp(&b.error));
        let k =
            ours.windows(2).position(|pair| (pair[0].error..=pair[1].error).contains(&p.error)).filter(|_| p.own)?;
        let [(x, low), (y, high)] = [ours[k], ours[k + 1]].map(|p| (p.error.ln(), p.microseconds.ln()));
        Some(p.microseconds / (low + (p.error.ln() - x) / (y - x) * (high - low)).exp())
    }

    pub fn table(&self, system: &System) -> Table {
        let card = self.environments.is_some();
        let rows = self.points.iter().map(|p| {
            let mut row = vec![
                p.series.clone(),
                or_dash(p.substeps),
                digits(p.microseconds),
                pair(&summary(system, &p.by_coordinate)),
                p.diverged.to_string(),
                if p.front { "*" } else { "" }.into(),
            ];
            if card {
                row.extend([digits(1e6 / p.microseconds), or_dash(p.memory), or_dash(self.times(p).map(digits))]);
            }
            row
        });
        let header = ["solver", "substeps", "us a frame", "error (rad or m)", "diverged", "front"];
        let of_card = ["frames/s", "MiB", "times ours"].into_iter().filter(|_| card);
        let header = header.into_iter().chain(of_card);
        let Self { robot, scene, protocol, reference, .. } = self;
        let mut note = format!(
            "{robot} {scene}, mean |dq| over {} frames{}, reference: {reference}",
            protocol.steps, protocol.action
        );
        if let Some(n) = self.environments {
            note += &format!(
                "; us: of {n} environments together on a GPU, with 32 bits where no other arithmetic is named, transfers counted"
            );
        }
        if let Some(Against { version, reference, reference_error }) = &self.mujoco {
            let error = reference_error.map_or_else(String::new, |e| format!(", whose own error is {}", digits(e)));
            note += &format!(". MuJoCo {version} is compared with {reference}{error}");
        }
        Table::new(&format!("chart-{robot}-{scene}"), header).with(rows).noted(note + ".")
    }

    pub fn figure(&self) -> Figure {
        // Leaves out solvers whose error is twice that of repeating the start, which would flatten the figure.
        let shown = self.points.iter().filter(|p| p.error < 2.0 * self.hold);
        let marks = shown.map(|p| Mark {
            series: &p.series,
            cost: p.microseconds,
            error: p.error,
            label: p.word(),
            front: p.front,
        });
        // Leaves out the reference's error if it is far below every solver's, which would stretch the figure.
        let least = self.points.iter().map(|p| p.error).fold(f64::MAX, f64::min);
        let mut levels = vec![(self.hold, "hold last".to_string())];
        levels.extend(
            (self.reference_error > 0.1 * least).then(|| (self.reference_error, "error of the reference".into())),
        );
        let of = self.environments.map_or_else(|| ", one core".into(), |n| format!(" of {n} on a GPU"));
        let axes = [
            format!("microseconds a frame, one environment{of}"),
            format!("mean |dq| over {} frames (rad or m)", self.protocol.steps),
        ];
        let title = format!("{}, {}: speed against accuracy (x4: four substeps a frame)", self.robot, self.scene);
        Figure::speed(title, axes, marks, levels)
    }
}

impl Point {
    fn word(&self) -> String {
        match (&self.spec, self.substeps) {
            (_, Some(n)) => format!("x{n}"),
            (Some(spec), None) => match spec.folder() {
                Some(folder) => format!("NeRD {}", folder.file_name().unwrap_or_default().to_string_lossy()),
                None => spec.to_string(),
            },
            (None, None) => String::new(),
        }
    }
}
