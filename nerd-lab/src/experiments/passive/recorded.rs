//! A model of recorded motion beside trajectories that it did not learn from.

use nerd_train::measured::Measured as Log;
use nerd_train::verdict::Verdict;
use nerd_train::verdict::recorded::{Beside, recorded};

use super::Protocol;
use crate::{error::unused, prelude::*};

pub struct Recorded {
    name: String,
    folder: PathBuf,
    asked: Protocol,
    log: Log,
    model: Model,
}

impl Recorded {
    /// The model in a folder and the log that `asked` names.
    pub fn new(name: &str, path: &Path, folder: &Path, asked: &Protocol) -> Result<Self> {
        let usual = Protocol::default();
        let Some(path) = Log::path(path) else { bail!("--data {}: name the TOML of a log, or its folder (log.toml)", path.display()) };
        let idle = [
            ("--scene", !asked.scene.is_empty()),
            ("--drive", asked.drive != usual.drive),
            ("--limp", asked.limp),
            ("--shake", asked.shake != usual.shake),
            ("--seed", asked.seed != usual.seed),
            ("--verdict", asked.verdict != usual.verdict),
        ];
        unused(&idle, "beside --data, whose motion was recorded")?;
        unused(&[("--every", asked.every.is_some() && asked.beside.is_some())], "with --beside, which has starts of its own")?;
        let (_, system) = nerd_sim::log::specified(&path)?;
        let model = Model::load(folder, &system, None)?;
        let log = Log::of(&path, &model)?;
        Ok(Self { name: name.into(), folder: folder.into(), asked: asked.clone(), log, model })
    }

    pub fn verdict(&self) -> Result<Verdict> {
        let Self { asked, log, model, .. } = self;
        let usual = log.rollouts(&log.held_out, &model.config.network, 1)?;
        let (before, frames) = (asked.before.unwrap_or(usual.before), asked.frames.unwrap_or(usual.frames()));
        let (pieces, beside) = match &asked.beside {
            None => (log.pieces(&log.held_out, [before, frames, asked.every.unwrap_or(frames)], asked.starts)?, None),
            Some(path) => {
                let Some(path) = Log::path(path) else { bail!("--beside {}: name the TOML of a log, or its folder", path.display()) };
                let other = nerd_sim::log::Log::read(&path, None)?;
                let (pieces, states) = log.beside(&other, before, asked.frames, asked.starts)?;
                let of = other.about.unwrap_or_else(|| Log::name(&path));
                (pieces, Some(Beside { of, states, microseconds: other.cost.unwrap_or(0.0) }))
            }
        };
        let frames = pieces.frames();
        let mut analytic = vec![("as described", log.described()?)];
        if asked.evaluations > 0 {
            analytic.push(("calibrated", log.calibrated(frames, asked.evaluations)?));
        }
        let found = recorded(log, &pieces, model, &analytic, beside)?;
        found.ok_or_else(|| anyhow::anyhow!("{}: there is no verdict on a network along a chain", self.folder.display()))
    }

    pub fn table(&self, verdict: &Verdict) -> Table {
        let (text, [trajectories, frames]) = (verdict.to_string(), self.log.size());
        let first = text.lines().next().unwrap_or_default();
        let note = format!(
            "{first}\n\nError: {}. Held out: {}; {trajectories} trajectories of {frames} frames were learned from. {}.",
            verdict.quantities.join(" / "),
            self.log.held_out(),
            verdict.line()
        );
        Table::new("verdict", &Verdict::HEADER).with(verdict.cells()).noted(&note)
    }
}

impl Experiment for Recorded {
    fn about(&self) -> Result<About> {
        let mut inputs = Inputs::default();
        inputs.add(Input::Data { name: self.log.truth.clone(), sha256: self.log.sha256.clone() });
        inputs.add(Input::model(&self.folder)?);
        let effort = (self.asked.starts * self.asked.frames.unwrap_or(1)) as f64;
        Ok(About { name: self.name.clone(), seed: 0, effort, inputs })
    }

    fn measure(&self) -> Result<Measured> {
        let verdict = self.verdict()?;
        Measured::new(&verdict, vec![self.table(&verdict)])
    }
}
