//! Tests models of the log's robot, or of its family, on the test rollouts of the calibrated solvers. Each model is
//! tested with the frames before a rollout as history, and without.

use nerd_model::solver::learned;
use nerd_sim::calibrate::{Distance, Trial, distance};
use nerd_sim::instruments::Recorder;
use nerd_sim::log::{Log, Trajectory};
use nerd_sim::truth::RECORDED;
use nerd_train::evaluate::Pieces;

use super::{Calibration, Parts, Scored};
use crate::prelude::*;

/// A model's errors on the test part of every split.
#[derive(Serialize, Deserialize)]
pub struct Modelled {
    /// The model's folder; the first folder if each split has its own model.
    pub model: String,
    /// Most frames before a rollout on which the model's predictions may depend.
    pub before: usize,
    /// Errors with the frames before each rollout as history, at most `before`.
    pub shown: Vec<Scored>,
    /// Errors without earlier frames.
    pub withheld: Vec<Scored>,
    /// Errors on whole trajectories, without earlier frames.
    pub whole: Vec<Scored>,
}

struct Judged<'a> {
    folder: &'a Path,
    own: Arc<System>,
    model: Model,
    /// Ids of the held-out trajectories of a model of recorded motion; `None` for other models.
    held_out: Option<Vec<u64>>,
}

impl<'a> Judged<'a> {
    fn new(log: &Log, folder: &'a Path) -> Result<Self> {
        let config = ModelConfig::read(folder)?;
        let own = if config.robot == log.system.name { log.system.clone() } else { System::named(&config.robot)? };
        own.alike(&log.system).map_err(|e| anyhow!("{}: of another robot than the log: {e}", folder.display()))?;
        let held_out = config.truth.starts_with(RECORDED).then(|| nerd_train::measured::Measured::named(&config));
        Ok(Self { folder, model: Model::load(folder, &own, None)?, own, held_out })
    }

    /// Whether the model's training data exclude the trajectories it is evaluated on.
    fn fair(&self, part: &Parts) -> bool {
        self.held_out.as_ref().is_none_or(|ids| part.judged.iter().all(|trial| ids.contains(&trial.id)))
    }
}

impl Calibration {
    /// Tests the models, one row for each. Models of recorded motion share one row: each split uses a model that held
    /// out the split's test part.
    pub(super) fn modelled(&self, log: &Log, parts: &[Parts]) -> Result<Vec<Modelled>> {
        let all = self.model.iter().map(|folder| Judged::new(log, folder)).collect::<Result<Vec<_>>>()?;
        let mut rows: Vec<Vec<&Judged>> =
            all.iter().filter(|m| m.held_out.is_none()).map(|m| vec![m; parts.len()]).collect();
        if let Some(first) = all.iter().find(|m| m.held_out.is_some()) {
            let of = |(k, part): (usize, &Parts)| {
                let found = all.iter().find(|m| m.held_out.is_some() && m.fair(part));
                let split = k + 1;
                found.with_context(|| {
                    format!("--model {}: none held out what split {split} is judged on", first.folder.display())
                })
            };
            rows.push(parts.iter().enumerate().map(of).collect::<Result<_>>()?);
        }
        rows.iter().map(|models| self.judge(log, models, parts)).collect()
    }

    fn judge(&self, log: &Log, models: &[&Judged], parts: &[Parts]) -> Result<Modelled> {
        let mut names = models.iter().map(|m| shipped::from_root(m.folder)).collect_vec();
        names.dedup();
        let name = match &names[..] {
            [first, others @ ..] if !others.is_empty() => {
                format!("{first} and {} more, each on its split", others.len())
            }
            _ => names.concat(),
        };
        let before = models.iter().map(|m| m.model.config.network.reach() - 1).max().unwrap_or(0);
        let bar = bar(&name, 3 * parts.len() as u64);
        let scored = |of: fn(&Parts) -> &[Trial], before: usize| {
            let one = |((part, model), seed): ((&Parts, &&Judged), u64)| -> Result<Scored> {
                let distances = rolled(log, model, of(part), before)?;
                bar.add(1);
                Ok(Scored::new(of(part), &distances, seed))
            };
            parts.iter().zip(models).zip(self.seed..).map(one).collect::<Result<Vec<_>>>()
        };
        let withheld = scored(|part| &part.judged, 0)?;
        let shown = if before > 0 { scored(|part| &part.judged, before)? } else { withheld.clone() };
        let whole = scored(|part| &part.whole, 0)?;
        bar.finish();
        Ok(Modelled { model: name, before, shown, withheld, whole })
    }
}

/// Distance between every trial and a model's rollout, with at most `before` frames of history.
fn rolled(log: &Log, Judged { own, model, .. }: &Judged, trials: &[Trial], before: usize) -> Result<Vec<Distance>> {
    let mut groups: BTreeMap<(usize, usize), Vec<usize>> = BTreeMap::new();
    for (k, trial) in trials.iter().enumerate() {
        groups.entry((trial.first.min(before), trial.torques.len())).or_default().push(k);
    }
    let d = own.robot.state_dim();
    let nq = own.robot.nq();
    let mut found = vec![Distance::default(); trials.len()];
    for ((shown, frames), group) in groups {
        // Finds the trajectory by id and start state, since several pieces may share an id.
        let from = |k: &usize| -> Result<(&Trajectory, usize)> {
            let trial = &trials[*k];
            let begins = |t: &&Trajectory| t.id == trial.id && t.states.get(trial.first) == Some(&trial.start);
            let found = log.trajectories.iter().find(begins);
            let found = found.with_context(|| format!("trajectory {}: not in the log any more", trial.id))?;
            Ok((found, trial.first - shown))
        };
        let from = group.iter().map(from).collect::<Result<Vec<_>>>()?;
        let mut all = log.cut(from, shown + frames)?;
        all.scenes = vec![own.scene(&log.scene)?; group.len()];
        let pieces = Pieces { system: own.clone(), before: shown, all };
        let mut recorder = Recorder::new(learned(model.clone(), own)?);
        pieces.compare(&mut recorder)?;
        for (piece, k) in group.into_iter().enumerate() {
            let rolled = recorder.frames[shown..].iter().map(|states| &states[piece * d..]);
            let motion = [pieces.all.state(piece, shown)]
                .into_iter()
                .chain(rolled)
                .map(|state| state[..nq].to_vec())
                .collect_vec();
            found[k] = distance(own, &motion, &trials[k].measured);
        }
    }
    Ok(found)
}
