//! Compares a model of recorded motion with held-out trajectories.

use nerd_train::evaluate::Pieces;
use nerd_train::measured::Measured as Log;
use nerd_train::verdict::recorded::{Beside, recorded};
use nerd_train::verdict::{Row, Verdict};

use super::Protocol;
#[cfg(feature = "cuda")]
use crate::experiments::{Timed, card};
use crate::{error::unused, prelude::*};

/// Number of environments stepped together on a GPU.
#[cfg(feature = "cuda")]
const TOGETHER: usize = 8192;

pub struct Recorded {
    name: String,
    folder: PathBuf,
    asked: Protocol,
    log: Log,
    model: Model,
    /// Whether to time the model on a GPU too.
    #[cfg(feature = "cuda")]
    card: bool,
}

#[derive(Serialize)]
pub struct Found {
    #[serde(flatten)]
    verdict: Verdict,
    /// The model on a GPU, by number format; time is per frame of one environment among many.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    card: Vec<Row>,
}

impl Recorded {
    /// Loads the model in `folder` and the log at `path`. With `card`, the model is also timed on a GPU.
    pub fn new(name: &str, path: &Path, folder: &Path, asked: &Protocol, card: bool) -> Result<Self> {
        built_for(card)?;
        let usual = Protocol::default();
        let missing = || format!("--data {}: name the TOML of a log, or its folder (log.toml)", path.display());
        let path = Log::path(path).with_context(missing)?;
        let idle = [
            ("--scene", !asked.scene.is_empty()),
            ("--torque-scale", asked.torque_scale != usual.torque_scale),
            ("--velocity-noise", asked.velocity_noise != usual.velocity_noise),
            ("--seed", asked.seed != usual.seed),
            ("--verdict", asked.verdict != usual.verdict),
        ];
        unused(&idle, "beside --data, whose motion was recorded")?;
        unused(
            &[("--every", asked.every.is_some() && asked.beside.is_some())],
            "with --beside, which has starts of its own",
        )?;
        let (_, system) = nerd_sim::log::specified(&path)?;
        let model = Model::load(folder, &system, None)?;
        let log = Log::of(&path, &model)?;
        Ok(Self {
            name: name.into(),
            folder: folder.into(),
            asked: asked.clone(),
            log,
            model,
            #[cfg(feature = "cuda")]
            card,
        })
    }

    pub fn found(&self) -> Result<Found> {
        let Self { asked, log, model, .. } = self;
        let usual = log.rollouts(&log.held_out, &model.config.network, 1)?;
        let before = asked.context_frames.unwrap_or(usual.before);
        let frames = asked.frames.unwrap_or(usual.frames());
        let (pieces, beside) = match &asked.beside {
            None => {
                (log.pieces(&log.held_out, [before, frames, asked.every.unwrap_or(frames)], asked.trajectories)?, None)
            }
            Some(path) => {
                let missing = || format!("--beside {}: name the TOML of a log, or its folder", path.display());
                let path = Log::path(path).with_context(missing)?;
                let other = nerd_sim::log::Log::read(&path, None)?;
                let (pieces, states) = log.beside(&other, before, asked.frames, asked.trajectories)?;
                let of = other.about.unwrap_or_else(|| Log::name(&path));
                (pieces, Some(Beside { of, states, microseconds: other.cost.unwrap_or(0.0) }))
            }
        };
        let frames = pieces.frames();
        let mut analytic = vec![("as described", log.described()?)];
        if asked.evaluations > 0 {
            analytic.push(("calibrated", log.calibrated(frames, asked.evaluations)?));
        }
        let Some(verdict) = recorded(log, &pieces, model, &analytic, beside)? else {
            bail!("{}: there is no verdict on a network along a chain", self.folder.display());
        };
        Ok(Found { verdict, card: self.on_card(&pieces)? })
    }

    #[cfg(not(feature = "cuda"))]
    fn on_card(&self, _: &Pieces) -> Result<Vec<Row>> {
        Ok(Vec::new())
    }

    #[cfg(feature = "cuda")]
    fn on_card(&self, pieces: &Pieces) -> Result<Vec<Row>> {
        let setting = SolverSpec::neural(&self.folder);
        let system = &pieces.system;
        let begun = pieces.seen(0).all.begun(system);
        let row = |(precision, word): &(_, &str)| {
            let compare = |solver: &mut dyn Solver| pieces.compare(solver);
            let Timed { report, microseconds, .. } =
                card::timed(&begun, &setting, *precision, [TOGETHER, pieces.frames()], None, &compare)?;
            let errors = nerd_train::evaluate::summary(system, &report.error);
            Ok(Row { of: format!("model on a GPU{word}"), errors, microseconds, diverged: report.diverged })
        };
        let all = card::arithmetics(&setting).iter().filter(|_| self.card);
        all.map(row).collect()
    }

    pub fn tables(&self, Found { verdict, card }: &Found) -> Vec<Table> {
        let line = |row: &Row| {
            let lost = if row.diverged > 0 { format!(", {} diverged", row.diverged) } else { String::new() };
            vec![
                row.of.clone() + &lost,
                pair(&row.errors),
                digits(row.microseconds),
                format!("{:.3e}", 1e6 / row.microseconds),
            ]
        };
        let header = ["arithmetic", "error", "us a frame, among many", "frames/s"];
        let card = (!card.is_empty()).then(|| Table::new("card", header).with(card.iter().map(line)));
        [self.table(verdict)].into_iter().chain(card).collect()
    }

    fn table(&self, verdict: &Verdict) -> Table {
        let (text, [trajectories, frames]) = (verdict.to_string(), self.log.size());
        let first = text.lines().next().unwrap_or_default();
        let note = format!(
            "{first}\n\nError: {}. Held out: {}; {trajectories} trajectories of {frames} frames were learned from. {}.",
            verdict.quantities.join(" / "),
            self.log.held_out(),
            verdict.line()
        );
        Table::new("verdict", Verdict::HEADER).with(verdict.cells()).noted(note)
    }
}

impl Experiment for Recorded {
    fn about(&self) -> Result<About> {
        let log = Input::Data { name: self.log.truth.clone(), sha256: self.log.sha256.clone() };
        let inputs = Inputs(vec![log, Input::model(&self.folder)?]);
        let effort = (self.asked.trajectories * self.asked.frames.unwrap_or(1)) as f64;
        Ok(About { name: self.name.clone(), seed: 0, effort, inputs })
    }

    fn measure(&self) -> Result<Measured> {
        let found = self.found()?;
        Measured::new(&found, self.tables(&found))
    }
}
