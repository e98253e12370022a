//! What predictions are held against beside each other: falling through the ground, and what the noise of starts alone makes.

use nerd_sim::calibrate::{Distance, Subject, Trial, distance};
use nerd_sim::log::Log;
use nerd_sim::scene::Scene;

use super::{Calibrated, Calibration, Scored, split::Parts};
use crate::error::Result;

impl Calibration {
    /// The first solver with nothing to touch, on the judged part of every split.
    pub(super) fn falling(&self, log: &Log, parts: &[Parts]) -> Result<Vec<Scored>> {
        // What is fixed to the ground does not fall.
        let Some(solver) = self.solvers.first().filter(|_| log.system.robot.floating()) else { return Ok(Vec::new()) };
        let (subject, _) = self.subject(log, solver)?;
        let subject = Subject { scene: Scene::free(log.system.gravity()).into(), ..subject };
        let of = |(k, part): (usize, &Parts)| Ok(Scored::new(&part.judged, &subject.distances(&part.judged)?, self.seed + k as u64));
        parts.iter().enumerate().map(of).collect()
    }

    /// Two rollouts of one stretch of time, one of them begun at the frame after: a perfect solver would be that far off at most by the
    /// noise of its starts, where that noise is new in every frame.
    pub(super) fn noise(&self, log: &Log, fitted: &[Calibrated], parts: &[Parts]) -> Result<Vec<Scored>> {
        let (Some(first), Some(solver)) = (fitted.first(), self.solvers.first()) else { return Ok(Vec::new()) };
        let (subject, parameters) = self.subject(log, solver)?;
        let of = |(k, (part, split)): (usize, (&Parts, &super::Split))| {
            let subject = subject.with(&parameters, &split.fit.values)?;
            let (early, late): (Vec<Trial>, Vec<Trial>) = part.judged.iter().filter_map(|t| later(log, t)).unzip();
            let (a, b) = (subject.roll(&early)?, subject.roll(&late)?);
            let apart: Vec<Distance> = a.iter().zip(&b).map(|(a, b)| distance(&subject.system, &a[1..], b)).collect();
            Ok(Scored::new(&early, &apart, self.seed + k as u64))
        };
        parts.iter().zip(&first.splits).enumerate().map(of).collect()
    }
}

/// A trial, and the one that begins a frame later and ends with it.
fn later(log: &Log, trial: &Trial) -> Option<(Trial, Trial)> {
    let trajectory = log.trajectories.iter().find(|t| t.id == trial.id && t.states.contains(&trial.start))?;
    let first = 1 + trajectory.states.iter().position(|s| *s == trial.start)?;
    let (start, measured) = (trajectory.states.get(first)?.clone(), trial.measured.get(1..)?.to_vec());
    Some((trial.clone(), Trial { id: trial.id, start, measured, torques: trial.torques.get(1..)?.to_vec() }))
}
