//! Measures solver errors on held-out robots of a family, by the number of frames seen before the rollout.
//!
//! Starts and torques are the same for every number of frames seen. An error that falls with this number thus shows
//! knowledge of the robot. Baselines are `articulated` on the robot as described, and on the robot with all drawn
//! parameters except torque ripple. The latter is the best that the equations can do. A solver adapts to a robot in one
//! of two ways. A network with memory sees the robot's frames; `articulated` is calibrated to them.

mod calibrated;

use nerd_sim::dataset::GenerateConfig;
use nerd_sim::instruments::{Hold, Timed};
use nerd_train::evaluate::{Pieces, summary, summary_names};

use crate::prelude::*;
use nerd_cli::error::unused;

settings! {
    /// Settings: robots of a family under models conditioned on their parameters, or inferring them from frames seen.
    pub struct Family {
        /// Name of the result
        name: String = "family".into(), Text;
        /// Family of robots: the name or path of a robot with `[vary]`, from which parameters are drawn
        robot: String = "pendulum-family".into(), Text;
        /// Folders of models, comma-separated, of the family or of the robot that the family varies [default: none]
        model: Vec<PathBuf> = Vec::new(), Texts;
        /// Number of trajectories, each of another robot of the family
        trajectories: usize = 256, Whole(STARTS);
        /// Frames that a solver sees before a rollout, comma-separated [default: 1,5,10,30,60,120]
        context_frames: Vec<usize> = vec![1, 5, 10, 30, 60, 120], Wholes(0..=10_000);
        /// Frames of a rollout
        frames: usize = 100, Whole(FRAMES);
        /// Factor on random torques, drawn as in the training data
        torque_scale: f64 = 1.0, Number(0.0..=1e3);
        /// Largest number of frames over which a random torque stays constant
        hold: usize = 8, Whole(FRAMES);
        /// Evaluations of the objective that calibrates `articulated` on the frames seen of each robot. With 0, it is
        /// not calibrated
        evaluations: usize = 300, Whole(0..=1_000_000);
        /// Device of the models: cpu, cuda (NVIDIA GPU) or cuda-f32 (NVIDIA GPU with f32 matrix products)
        device: Device = Device::Cpu, Words(&["cpu", "cuda", "cuda-f32"]);
        /// Seed of robots, starts and torques, other than the seeds of the training data
        seed: u64 = 500, Whole(SEEDS);
    }
}

#[derive(Serialize)]
pub struct Row {
    pub of: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub model: Option<String>,
    /// Errors by the number of frames seen, in the order of `context_frames`; `None` without a result.
    pub reports: Vec<Option<PassiveReport>>,
    /// Wall time of a frame of one robot on all threads (us).
    pub microseconds: f64,
    /// Calibration time of one robot from the most frames seen, on one core (s).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seconds: Option<f64>,
}

impl Row {
    /// Mean error over the quantities at the k-th number of frames seen, and the largest standard error of a quantity.
    fn error(&self, k: usize) -> Option<[f64; 2]> {
        let report = self.reports[k].as_ref()?;
        Some([mean(&report.error), report.standard_error.iter().copied().fold(0.0, f64::max)])
    }
}

impl Family {
    fn system(&self) -> Result<Arc<System>> {
        let system = System::named(&self.robot)?;
        if system.spec.vary.is_none() {
            bail!("--robot {}: nothing of it is drawn; give its TOML a [vary]", self.robot);
        }
        Ok(system)
    }

    /// Loads the robot `name` that a family varies. For a family from a file, a file of that name beside it comes
    /// first.
    fn beside(&self, name: &str) -> Result<Arc<System>> {
        let file = Path::new(&self.robot)
            .extension()
            .map(|kind| Path::new(&self.robot).with_file_name(name).with_extension(kind));
        Ok(System::named(file.filter(|file| file.exists()).as_deref().and_then(Path::to_str).unwrap_or(name))?)
    }

    /// Records the robots' motions in the truth, with the longest history of `context_frames`.
    pub fn pieces(&self) -> Result<Pieces> {
        let system = self.system()?;
        let before = self.context_frames.iter().copied().max().unwrap_or(0);
        let frames = before + self.frames;
        let torque_scale = Range { low: self.torque_scale, high: self.torque_scale };
        bounds::time(&[("--trajectories", self.trajectories), ("frames", frames), ("substeps", system.spec.substeps)])?;
        let config = GenerateConfig {
            transitions: self.trajectories * frames,
            frames,
            torque_scale,
            seed: self.seed,
            hold: self.hold,
            resets: 1.0,
            ..Default::default()
        };
        Ok(Pieces::drawn(&system, system.spec.truth, &config, before)?)
    }

    pub fn rows(&self) -> Result<Vec<Row>> {
        let pieces = self.pieces()?;
        let system = self.system()?;
        let bar = bar("solvers of a family", (4 + self.model.len()) as u64);
        let row = |of: String, model: Option<&Path>, pieces: &Pieces, solver: Box<dyn Solver>| -> Result<Row> {
            bar.say(&of);
            let mut timed = Timed::new(solver);
            let report = |seen: &usize| pieces.seen(*seen).compare(&mut timed).map(Some);
            let reports = self.context_frames.iter().map(report).collect::<Result<Vec<_>, _>>()?;
            bar.add(1);
            Ok(Row {
                of,
                model: model.map(shipped::from_root),
                reports,
                microseconds: self.pace(timed.spent),
                seconds: None,
            })
        };
        let analytic = || system.spec.truth.solver(&system);
        let mut rows = vec![
            row("hold last".into(), None, &pieces.described(), Box::new(Hold))?,
            row("analytic, as described".into(), None, &pieces.described(), analytic())?,
            row("analytic, told".into(), None, &pieces.told(), analytic())?,
        ];
        if self.evaluations > 0 {
            rows.push(self.calibrated(&pieces)?);
        }
        bar.add(1);
        for folder in &self.model {
            let config = ModelConfig::read(folder)?;
            let own = config.robot == system.name;
            // Runs a model of the base robot on the robot as described, without drawn parameters.
            let (pieces, like) = if own {
                (pieces.clone(), system.clone())
            } else {
                let like = self.beside(&config.robot)?;
                system
                    .alike(&like)
                    .map_err(|e| anyhow!("{}: of another robot than the family: {e}", folder.display()))?;
                (Pieces { system: like.clone(), ..pieces.described() }, like)
            };
            let solver = self.device.neural(folder, &like, None, pieces.count())?;
            let kind = match (own, config.told) {
                (false, _) => "nominal",
                (true, true) => "told",
                (true, false) => "guessed",
            };
            let of = format!(
                "NeRD {kind}, sees {} frames, {:.2} M",
                config.network.reach(),
                config.network.parameters() as f64 / 1e6
            );
            rows.push(row(of, Some(folder), &pieces, solver)?);
        }
        bar.finish();
        Ok(rows)
    }

    /// Wall time of a frame of one robot (us), from the time spent on all steps.
    fn pace(&self, spent: Duration) -> f64 {
        let steps = self.context_frames.iter().map(|seen| seen + self.frames).sum::<usize>() * self.trajectories;
        1e6 * spent.as_secs_f64() / steps as f64
    }

    /// Measures the analytic solver, calibrated anew for each number of frames seen.
    fn calibrated(&self, pieces: &Pieces) -> Result<Row> {
        let mut reports = Vec::new();
        let mut seconds = 0.0f64;
        let mut timed = Timed::new(pieces.system.spec.truth.solver(&pieces.system));
        for seen in &self.context_frames {
            let begun = Instant::now();
            let fitted = calibrated::calibrated(&pieces.seen(*seen), self.evaluations)?;
            let threads = rayon::current_num_threads().min(self.trajectories);
            seconds = seconds.max(begun.elapsed().as_secs_f64() * threads as f64 / self.trajectories as f64);
            reports.push(fitted.map(|pieces| pieces.compare(&mut timed)).transpose()?);
        }
        let of = format!("analytic, calibrated on what is seen in {} evaluations", self.evaluations);
        Ok(Row { of, model: None, reports, microseconds: self.pace(timed.spent), seconds: Some(seconds) })
    }

    fn table(&self, system: &System, rows: &[Row]) -> Table {
        let shown = self.context_frames.iter().map(|seen| format!("{seen} seen"));
        let last = ["by quantity", "diverged", "us a frame", "s to know a robot"].map(String::from);
        let header = ["solver".into()].into_iter().chain(shown).chain(last);
        let cells = rows.iter().map(|row| {
            let bounded = |[error, spread]: [f64; 2]| format!("{} ± {}", digits(error), digits(spread));
            let errors = (0..self.context_frames.len()).map(|k| or_dash(row.error(k).map(bounded)));
            let last = row.reports.iter().flatten().next_back();
            let rest = [
                or_dash(last.map(|last| pair(&summary(system, &last.error)))),
                or_dash(last.map(|last| last.diverged.to_string())),
                format!("{:.1}", row.microseconds),
                or_dash(row.seconds.map(digits)),
            ];
            [row.of.clone()].into_iter().chain(errors).chain(rest).collect_vec()
        });
        Table::new("family", header).with(cells).noted(format!(
            "Mean |dq| over rollouts of {} frames of {} robots of `{}` that no model learned from, and over all quantities, ± the largest \
             standard error of one; by the frames that a solver was shown before. By quantity at the last: {}. Told: what was drawn, but for \
             ripples. Torques are {} times those of the training data, held for {} frames at most.",
            self.frames,
            self.trajectories,
            self.robot,
            summary_names(system).join(" / "),
            self.torque_scale,
            self.hold
        ))
    }

    fn figure(&self, rows: &[Row]) -> Figure {
        let line = |row: &Row| {
            let point = |(k, seen): (usize, &usize)| Some((*seen.max(&1) as f64, row.error(k)?[0]));
            Series::new(row.of.clone(), Style::Line, self.context_frames.iter().enumerate().filter_map(point))
        };
        let axes = ["frames seen", "mean error (rad or m)"].map(Axis::log);
        Figure::lines(format!("{}: error by frames seen", self.robot), axes, rows.iter().map(line).collect())
    }
}

impl Experiment for Family {
    fn about(&self) -> Result<About> {
        let mut inputs = Inputs::default();
        bounds::once("--context-frames", &self.context_frames.iter().map(ToString::to_string).collect_vec())?;
        unused(&[("--device", self.device != Device::Cpu && self.model.is_empty())], "without models")?;
        inputs.add(Input::robot(&*self.system()?));
        inputs.models(&self.model)?;
        let effort = (self.trajectories * self.frames * self.context_frames.len()) as f64;
        Ok(About { name: self.name.clone(), seed: self.seed, effort, inputs })
    }

    fn measure(&self) -> Result<Measured> {
        let rows = self.rows()?;
        let table = self.table(&*self.system()?, &rows);
        let data = serde_json::json!({ "settings": self, "rows": rows });
        Ok(Measured::new(&data, vec![table])?.with("seen", self.figure(&rows)))
    }
}
