//! Models of the log's robot, or of a family that it is like, on what the calibrated solvers are judged by: shown the frames before each
//! rollout, and shown none.

use nerd_model::pick::learned;
use nerd_sim::calibrate::{Distance, Trial, distance};
use nerd_sim::instruments::Recorder;
use nerd_sim::log::{Log, Trajectory};
use nerd_train::evaluate::Pieces;

use super::{Calibration, Parts, Scored};
use crate::prelude::*;

/// A model's errors on the judged part of every split.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Modelled {
    pub model: String,
    /// Frames before a rollout on which its predictions may depend.
    pub before: usize,
    /// Shown as many of them as there are.
    pub shown: Vec<Scored>,
    /// Shown none.
    pub withheld: Vec<Scored>,
    /// Whole trajectories, before which there are none.
    pub whole: Vec<Scored>,
}

impl Calibration {
    pub(super) fn modelled(&self, log: &Log, folder: &Path, parts: &[Parts]) -> Result<Modelled> {
        let config = ModelConfig::read(folder)?;
        let own = if config.robot == log.system.name { log.system.clone() } else { System::named(&config.robot)? };
        own.alike(&log.system).map_err(|e| anyhow::anyhow!("{}: of another robot than the log: {e}", folder.display()))?;
        let (model, before) = (Model::load(folder, &own, None)?, config.network.reach() - 1);
        let bar = bar(&format!("{}", folder.display()), 3 * parts.len() as u64);
        let scored = |of: fn(&Parts) -> &[Trial], before: usize| {
            let one = |(part, seed): (&Parts, u64)| -> Result<Scored> {
                let distances = rolled(log, &own, &model, of(part), before)?;
                bar.add(1);
                Ok(Scored::new(of(part), &distances, seed))
            };
            parts.iter().zip(self.seed..).map(one).collect::<Result<Vec<_>>>()
        };
        let (shown, withheld) = (scored(|part| &part.judged, before)?, scored(|part| &part.judged, 0)?);
        let whole = scored(|part| &part.whole, 0)?;
        bar.finish();
        Ok(Modelled { model: shipped::from_root(folder), before, shown, withheld, whole })
    }
}

/// Distance of every trial from a model's rollout, shown at most so many frames before it.
fn rolled(log: &Log, own: &Arc<System>, model: &Model, trials: &[Trial], before: usize) -> Result<Vec<Distance>> {
    let mut groups: BTreeMap<(usize, usize), Vec<usize>> = BTreeMap::new();
    for (k, trial) in trials.iter().enumerate() {
        groups.entry((trial.first.min(before), trial.torques.len())).or_default().push(k);
    }
    let (d, nq, mut found) = (own.robot.state_dim(), own.robot.nq(), vec![Distance::default(); trials.len()]);
    for ((shown, frames), group) in groups {
        // A trajectory that was cut is several of one name.
        let from = |k: &usize| -> Result<(&Trajectory, usize)> {
            let trial = &trials[*k];
            let begins = |t: &&Trajectory| t.id == trial.id && t.states.get(trial.first) == Some(&trial.start);
            let Some(t) = log.trajectories.iter().find(begins) else { bail!("trajectory {}: not in the log any more", trial.id) };
            Ok((t, trial.first - shown))
        };
        let from = group.iter().map(from).collect::<Result<Vec<_>>>()?;
        let rows = |of: &dyn Fn(&Trajectory) -> &[Vec<f64>], count: usize| -> Vec<Vec<f64>> {
            (0..count).map(|frame| from.iter().flat_map(|(t, first)| of(t)[first + frame].clone()).collect()).collect()
        };
        let pieces = Pieces {
            system: own.clone(),
            systems: Vec::new(),
            scenes: vec![own.scene(&log.scene)?; group.len()],
            before: shown,
            states: rows(&|t| &t.states, shown + frames + 1),
            torques: rows(&|t| &t.torques, shown + frames),
        };
        let mut recorder = Recorder::new(learned(model.clone(), own)?);
        pieces.compare(&mut recorder)?;
        for (piece, k) in group.into_iter().enumerate() {
            let pose = |states: &Vec<f64>| states[piece * d..][..nq].to_vec();
            let motion: Vec<_> = [&pieces.states[shown]].into_iter().chain(&recorder.frames[shown..]).map(pose).collect();
            found[k] = distance(own, &motion, &trials[k].measured);
        }
    }
    Ok(found)
}
