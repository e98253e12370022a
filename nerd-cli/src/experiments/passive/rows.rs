//! Results of passive motion, and their tables.

use nerd_train::evaluate::{quantities, summary, summary_names};
use nerd_train::verdict::Verdict;

use crate::prelude::*;

#[derive(Serialize, Deserialize)]
pub struct Rows {
    pub rows: Vec<Row>,
}

#[derive(Serialize, Deserialize)]
pub struct Row {
    pub robot: String,
    /// Solver; for a model, its form and size.
    pub method: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub model: Option<String>,
    pub scene: String,
    pub truth: String,
    pub protocol: PassiveConfig,
    pub report: PassiveReport,
    /// The paper's errors; only for the truth that is the reference simulator's preset.
    pub paper: Option<Vec<f64>>,
    /// The model's verdict, measured from the first of the starts.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub verdict: Option<Verdict>,
}

impl Rows {
    pub fn table(&self) -> Table {
        let header = [
            "robot",
            "method",
            "scene",
            "starts x steps",
            "error (rad or m)",
            "standard error",
            "paper",
            "hold last",
            "diverged",
        ];
        let cells = self.rows.iter().map(|r| {
            let p = &r.report;
            vec![
                r.whose(),
                r.method.clone(),
                r.scene.clone(),
                format!("{} x {}{}", r.protocol.starts, r.protocol.steps, r.protocol.action),
                r.shown(&p.error),
                r.shown(&p.standard_error),
                or_dash(r.paper.as_deref().map(pair)),
                r.shown(&p.hold),
                p.diverged.to_string(),
            ]
        });
        Table::new("passive", header).with(cells).noted(
            "Mean |dq| over all frames and trajectories, by joint; of more than two joints the mean, before it position (m) and \
             orientation (rad) of a floating base. Where no truth is named it is the robot's own: `articulated accurate`, of a robot \
             `NAME-paper` the reference simulator's preset, which alone the paper's figures can stand beside.",
        )
    }

    /// Tables the models' verdicts, with a line for each in the note; `None` without verdicts.
    pub fn verdicts(&self) -> Option<Table> {
        let verdicts = self.rows.iter().filter_map(|r| r.verdict.as_ref()).collect_vec();
        let quantities = verdicts.first()?.quantities.join(" / ");
        let alike = verdicts.iter().map(|v| &v.quantities).all_equal();
        let starts = verdicts.iter().map(|v| v.protocol.starts).all_equal_value();
        let place = |v: &Verdict| format!("{}, {}", v.robot, v.scene);
        let cells = verdicts.iter().flat_map(|v| v.cells().into_iter().map(|cells| [vec![place(v)], cells].concat()));
        let note = format!(
            "Error: {}, from the first{} starts; time and error are of the same steps on one core.\n\n{}",
            if alike { &quantities } else { "as above" },
            starts.map_or_else(|_| String::new(), |starts| format!(" {starts}")),
            verdicts.iter().map(|v| format!("* {}: {}.", place(v), v.line())).join("\n")
        );
        Some(Table::new("verdict", ["robot, scene"].iter().chain(&Verdict::HEADER)).with(cells).noted(note))
    }

    /// Tables the default model of each robot and truth. Of a robot's scenes with contact, only the one with the
    /// largest error is listed.
    pub fn summary(&self) -> Table {
        let usual = |r: &&Row| {
            let default = |truth: Truth| shipped::from_root(&shipped::model(truth, &r.robot));
            r.model.as_ref().is_none_or(|m| Truth::named(&r.truth).is_ok_and(|truth| default(truth) == *m))
        };
        let mut rows = self.rows.iter().filter(usual).collect_vec();
        if rows.is_empty() {
            rows = self.rows.iter().collect();
        }
        // Gives contact-free motion a row of its own.
        fn group(row: &Row) -> (&str, &str, &str, bool) {
            (&row.robot, &row.method, &row.truth, row.scene == "free")
        }
        let lines = rows.chunk_by(|a, b| group(a) == group(b)).filter_map(|grounds| {
            let r = *grounds.iter().max_by(|a, b| mean(&a.report.error).total_cmp(&mean(&b.report.error)))?;
            let n = grounds.len();
            let scene = if n > 1 { format!("{}, the largest of {n}", r.scene) } else { r.scene.clone() };
            Some(vec![
                r.whose(),
                scene + &r.protocol.action.to_string(),
                r.system().map_or_else(String::new, |system| summary_names(&system).join(" / ")),
                r.bounded(),
                or_dash(r.paper.as_deref().map(pair)),
                r.shown(&r.report.hold),
                or_dash(r.verdict.as_ref().map(|v| v.worth())),
            ])
        });
        let header =
            ["robot", "scene", "mean error of", "NeRD (± standard error)", "paper", "hold last", "what it is worth"];
        Table::new("summary", header).with(lines)
    }

    /// Plots error against frame, with a line for each row of the robot; `None` without rows.
    pub fn growth(&self, robot: &str) -> Option<Figure> {
        let line = |row: &Row| {
            let points = row.report.curve.iter().zip(1..).map(|(error, frame)| (f64::from(frame), *error));
            Series::new(format!("{}, {}", row.scene, row.method), Style::Line, points)
        };
        let series = self.rows.iter().filter(|row| row.robot == robot).map(line).collect_vec();
        let axes = ["frame", "mean error (rad or m)"].map(Axis::log);
        (!series.is_empty()).then(|| Figure::lines(format!("{robot}: passive motion"), axes, series))
    }

    /// Describes how far two measurements of the same rows agree; `None` if no row is in both.
    pub fn agreement(&self, other: &Self) -> Option<String> {
        let pairs = self.rows.iter().filter_map(|a| Some((a, other.rows.iter().find(|b| a.measures(b))?)));
        let apart = pairs.map(|(a, b)| (a.apart(b), a)).collect_vec();
        let (most, row) = *apart.iter().max_by(|a, b| a.0.total_cmp(&b.0))?;
        Some(format!(
            "{} of {} errors within three standard errors, the farthest {most:.1} ({} in {})",
            apart.iter().filter(|(by, _)| *by <= 3.0).count(),
            apart.len(),
            row.whose(),
            row.scene
        ))
    }
}

impl Row {
    /// Whether both rows measure the same model in the same scene, under the same torques.
    fn measures(&self, other: &Self) -> bool {
        let PassiveConfig { steps, action, .. } = self.protocol;
        [&self.robot, &self.method, &self.scene, &self.truth]
            == [&other.robot, &other.method, &other.scene, &other.truth]
            && (steps, action) == (other.protocol.steps, other.protocol.action)
            && (self.model.is_none() || other.model.is_none() || self.model == other.model)
    }

    /// Largest difference between the errors of both rows, in units of their combined standard error.
    fn apart(&self, other: &Self) -> f64 {
        let a = &self.report;
        let b = &other.report;
        let each = a.error.iter().zip(&b.error).zip(a.standard_error.iter().zip(&b.standard_error));
        each.map(|((x, y), (s, t))| if x == y { 0.0 } else { (x - y).abs() / s.hypot(*t) }).fold(0.0, f64::max)
    }

    fn shown(&self, figures: &[f64]) -> String {
        pair(&self.summary(figures))
    }

    fn summary(&self, figures: &[f64]) -> Vec<f64> {
        self.system().map_or_else(|| figures.to_vec(), |system| summary(&system, figures))
    }

    /// Returns the built-in robot with the row's name, if its quantities match. A user's file may have the same name.
    fn system(&self) -> Option<Arc<System>> {
        System::named(&self.robot).ok().filter(|system| quantities(system).len() == self.report.error.len())
    }

    fn bounded(&self) -> String {
        let error = self.summary(&self.report.error);
        let spread = self.summary(&self.report.standard_error);
        let two = |s: f64| format!("{s:.*}", (1 - s.log10().floor().max(-9.0) as i32).max(0) as usize);
        let shown = |s: f64| if s > 0.0 { two(s) } else { s.to_string() };
        error.into_iter().zip(spread).map(|(e, s)| format!("{} ± {}", digits(e), shown(s))).join(" / ")
    }

    fn whose(&self) -> String {
        let own = self.system().map_or_else(Truth::default, |system| system.spec.truth);
        if self.truth == own.name() { self.robot.clone() } else { format!("{} ({})", self.robot, self.truth) }
    }
}
