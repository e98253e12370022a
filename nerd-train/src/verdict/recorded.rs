//! Verdict on a model of recorded motion. The model is compared with its base, a linear map and `articulated`, as
//! described or as calibrated.

use nerd_sim::calibrate::{Engine, Subject};
use nerd_sim::instruments::{Hold, Replay};

use super::{Row, Verdict, common, linear};
use crate::cost::{on_one_core, timed};
use crate::evaluate::{Action, PassiveConfig, Pieces};
use crate::measured::Measured;
use crate::prelude::*;
use crate::prepare::tokens;

/// Frames of a piece for fitting the linear map.
const FRAMES: usize = 64;
/// Frames that suffice to fit the linear map. If the log has at least twice as many, trajectories are skipped evenly.
const ENOUGH: usize = 65_536;

/// Another solver's result on the same pieces.
pub struct Beside {
    /// Name of the solver.
    pub of: String,
    /// States `[frame][piece][q, qd]` after each frame of the rollout.
    pub states: Vec<Vec<f64>>,
    /// Time per frame (us); 0 if unknown.
    pub microseconds: f64,
}

/// The verdict on a model of a log, from rollouts over `pieces`, with the `analytic` solvers (name, subject) for
/// comparison. A solver that cannot step is left out and reported. None for a chain.
pub fn recorded(
    measured: &Measured,
    pieces: &Pieces,
    model: &Model,
    analytic: &[(&str, Subject)],
    beside: Option<Beside>,
) -> Result<Option<Verdict>> {
    if model.config.network.architecture == Architecture::Chain {
        return Ok(None);
    }
    let system = &measured.log.system;
    let some = measured.learned.iter().step_by((measured.size()[1] / ENOUGH).max(1)).cloned().collect_vec();
    let windows = tokens(system, &measured.recording(&some, FRAMES, 1)?, 1, model.config.form());
    let maps = linear::maps(model, windows);
    let bar = bar("verdict: solvers", (3 + maps.len() + analytic.len()) as u64);
    let of = |pieces: &Pieces, of: &str, solver: Box<dyn Solver>| -> Result<Row> {
        bar.add(1);
        let frames = pieces.count() * pieces.all.frames;
        Ok(Row::new(of, system, timed(solver, frames, |solver| pieces.compare(solver))?))
    };
    let row = |name: &str, solver: Box<dyn Solver>| of(pieces, name, solver);
    let action = Action::Recorded(pieces.before);
    let protocol = PassiveConfig { starts: pieces.count(), steps: pieces.frames(), seed: 0, action };
    let found = on_one_core(|| {
        let mut found = common(model, system, (&pieces.all.scenes[0], measured.truth.clone(), protocol), maps, &row)?;
        if model.config.base != Base::State {
            found.hold = Some(row("hold last", Box::new(Hold))?);
        }
        for (name, subject) in analytic {
            let pieces = seen(pieces, subject);
            let Engine::Articulated(config) = subject.engine else { continue };
            match of(&pieces, &format!("articulated, {name}"), Box::new(Articulated::new(config))) {
                Ok(row) => found.articulated.push(row),
                Err(reason) => tell!("articulated, {name}: left out, {reason}"),
            }
        }
        if let Some(Beside { of, states, microseconds }) = beside {
            let report = pieces.seen(0).compare(&mut Replay::new(&states))?;
            found.beside.push(Row::new(of, system, (report, microseconds)));
        }
        Ok::<_, Error>(found)
    })?;
    bar.finish();
    Ok(Some(found))
}

/// Pieces as `subject` needs them: shifted by its joint zeros, with delayed torques and without history, since
/// `subject` has no memory.
fn seen(pieces: &Pieces, subject: &Subject) -> Pieces {
    let (d, nq) = (subject.system.robot.state_dim(), subject.system.robot.nq());
    let mut all = pieces.all.after(pieces.before);
    all.states.chunks_exact_mut(d).for_each(|state| subject.shift(&mut state[..nq], 1.0));
    let late = |(piece, frame): (usize, usize)| {
        subject.late(&[0, 1, 2].map(|back| pieces.all.torques(piece, frame.saturating_sub(back))))
    };
    let frames = pieces.before..pieces.all.frames;
    all.torques = (0..all.count).cartesian_product(frames).flat_map(late).collect();
    all.scenes = vec![subject.scene.clone(); all.count];
    all.systems.clear();
    Pieces { system: subject.system.clone(), before: 0, all }
}
