//! MuJoCo's points on a chart. Without contact, errors are measured against our converged reference. With contact
//! MuJoCo solves another problem (soft constraints). The reference is then MuJoCo's own rollout at four times the most
//! substeps. The errors then show convergence to MuJoCo's own answer, not distance from ours.

use nerd_sim::instruments::Replay;

use super::plan::Plan;
use super::shown::{Against, Point};
use crate::mujoco::{Referee, Scheme};
use crate::prelude::*;
use nerd_train::{comparison::Comparison, cost::powers, provenance::card_memory};

pub(super) fn referee(python: &Path, plan: &Plan) -> Result<Referee> {
    let Plan { system, protocol: config, environments, .. } = plan;
    Referee::held(python, &plan.begun(), config.steps, config.held(system).as_ref(), *environments)
}

/// Lists MuJoCo's settings to measure, as (integrator, series, substeps).
pub(super) fn settings(contact: bool, card: bool, most: usize) -> Vec<(Scheme, &'static str, usize)> {
    let schemes: &[(Scheme, &str, usize)] = match (contact, card) {
        (_, true) => &[(Scheme::ImplicitFast, "MuJoCo Warp (against itself)", most)],
        (true, _) => &[
            (Scheme::Euler, "MuJoCo Euler (against itself)", most),
            (Scheme::ImplicitFast, "MuJoCo implicitfast (against itself)", most),
        ],
        _ => &[
            (Scheme::Euler, "MuJoCo Euler", most),
            (Scheme::ImplicitFast, "MuJoCo implicitfast", most),
            (Scheme::Rk4, "MuJoCo RK4", 32),
        ],
    };
    schemes.iter().flat_map(|(scheme, name, last)| powers(most.min(*last)).map(move |n| (*scheme, *name, n))).collect()
}

/// Measures MuJoCo's points at powers of two of substeps. `ours` compares with our converged reference, called
/// `reference`.
pub(super) fn points(
    mujoco: &mut Referee,
    plan: &Plan,
    most: usize,
    ours: &Comparison,
    reference: &str,
) -> Result<(Vec<Point>, Against)> {
    let config = plan.protocol;
    let card = plan.environments.is_some();
    let own = plan.contact() || card;
    let mut against = Against { version: mujoco.version.clone(), reference: reference.into(), reference_error: None };
    let mut theirs = None;
    if own {
        let (scheme, name) = if card { (Scheme::ImplicitFast, "implicitfast") } else { (Scheme::Euler, "Euler") };
        let finest = ours.of(mujoco.play(scheme, 4 * most, false)?.frames);
        let half = mujoco.play(scheme, 2 * most, false)?;
        against.reference = format!("MuJoCo itself, {name}, {} substeps", 4 * most);
        against.reference_error = Some(mean(&finest.errors(&mut Replay::new(&half.frames))?.error));
        theirs = Some(finest);
    }
    let settings = settings(plan.contact(), card, most);
    let each = plan.environments.unwrap_or(config.starts);
    let bar = progress::bar("MuJoCo", settings.len() as u64);
    let mut points = Vec::new();
    for (k, (scheme, name, substeps)) in settings.into_iter().enumerate() {
        bar.set(k as u64);
        let played = mujoco.play(scheme, substeps, true)?;
        let report = theirs.as_ref().unwrap_or(ours).errors(&mut Replay::new(&played.frames))?;
        let Some(seconds) = played.seconds else {
            bar.line(&format!("{name} x{substeps}: left out, it gave environments up"));
            continue;
        };
        let memory = plan.environments.and_then(|_| card_memory(mujoco.process()));
        let microseconds = seconds * 1e6 / (each * config.steps) as f64;
        points.push(Point::new(name, Some(substeps), Timed { report, microseconds, memory }, own));
    }
    bar.finish();
    Ok((points, against))
}
