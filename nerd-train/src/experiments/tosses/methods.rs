//! Solvers at named settings.

use std::sync::Arc;
use std::time::{Duration, Instant};

use nerd_sim::articulated::Refresh;
use nerd_sim::calibrate::Engine;
use nerd_sim::measured::{Cube, Motion, RESTITUTION, Trial, roll};
use nerd_sim::prelude::*;
use nerd_sim::rapier::FrictionModel;

use crate::error::Result;
use crate::experiments::cost::{Repeat, each, on_one_core};

/// A solver of one body.
#[derive(Clone)]
pub struct Method {
    /// Name in tables.
    pub name: String,
    /// The body.
    pub system: Arc<System>,
    /// The solver.
    pub setting: Engine,
}

impl Method {
    /// For the published cube.
    pub fn new(name: &str, cube: &Cube, setting: Engine) -> Result<Self> {
        Ok(Self { name: name.into(), system: cube.system()?, setting })
    }

    /// Its motions, and how many it lost.
    pub fn roll(&self, trials: &[Trial]) -> Result<(Vec<Motion>, usize)> {
        Ok(roll(&self.system, &|_| self.setting.solver(), trials)?)
    }

    /// Microseconds a frame on one core: some of the trials, the fastest of three times.
    pub fn microseconds(&self, trials: &[Trial]) -> Result<f64> {
        let some: Vec<Trial> = trials.iter().step_by(trials.len().div_ceil(64).max(1)).cloned().collect();
        let pass = || -> Result<Duration> {
            let started = Instant::now();
            self.roll(&some)?;
            Ok(started.elapsed())
        };
        let best = on_one_core(|| Repeat::times(3).best(pass))?;
        Ok(each(best, some.iter().map(|t| t.measured.len() - 1).sum()))
    }
}

/// Implicit contact.
pub fn implicit(substeps: usize) -> Engine {
    Engine::Articulated(ArticulatedConfig::implicit(substeps, Friction::Coulomb))
}

/// Explicit contact.
pub fn explicit(substeps: usize) -> Engine {
    Engine::Articulated(ArticulatedConfig::explicit(substeps, Friction::Coulomb))
}

/// rapier with the published restitution, `steps` outer steps of `iterations`.
fn rapier(iterations: usize, steps: usize) -> RapierConfig {
    RapierConfig { iterations, steps, restitution: RESTITUTION, ..Default::default() }
}

/// What rapier does when nothing is chosen.
fn untouched() -> RapierConfig {
    RapierConfig { steps: 1, contact_frequency_hz: 60.0, friction: FrictionModel::Simplified, length_unit: 1.0, ..Default::default() }
}

/// The two that are taken apart in [`super::changes`], for a cube; `finer` times their substeps, `other` friction than theirs.
pub fn pair(cube: &Cube, finer: usize, other: bool) -> Result<[Method; 2]> {
    let friction = if other { FrictionModel::Simplified } else { FrictionModel::Coulomb };
    let rapier = RapierConfig { restitution: cube.restitution, friction, ..rapier(4, finer) };
    let law = if other { Friction::Huber } else { Friction::Coulomb };
    let implicit = Engine::Articulated(ArticulatedConfig::implicit(16 * finer, law));
    Ok([Method::new("rapier 4 x 1", cube, Engine::Rapier(rapier))?, Method::new("articulated implicit x16", cube, implicit)?])
}

/// All of the first table.
pub fn all() -> Result<Vec<Method>> {
    let cube = Cube::default();
    let stiff = Cube { stiffness: 1e5, ..cube };
    let [best, ours] = pair(&cube, 1, false)?;
    let reference = System::named("cube-paper")?;
    let paper = ArticulatedConfig::paper(&reference, Friction::Coulomb);
    let new = |name: &str, setting: Engine| Method::new(name, &cube, setting);
    Ok(vec![
        best,
        new("rapier 4 x 1, no restitution", Engine::Rapier(RapierConfig { restitution: 0.0, ..rapier(4, 1) }))?,
        new("rapier 4 x 4", Engine::Rapier(rapier(4, 4)))?,
        new("rapier 4 x 4, no restitution", Engine::Rapier(RapierConfig::default()))?,
        new("rapier out of the box", Engine::Rapier(untouched()))?,
        new("articulated implicit x1", implicit(1))?,
        new("articulated implicit x4", implicit(4))?,
        new("articulated implicit x8", implicit(8))?,
        ours,
        Method::new("articulated implicit x4, 1e5 N/m", &stiff, implicit(4))?,
        Method::new("articulated implicit x16, 1e5 N/m", &stiff, implicit(16))?,
        new("articulated explicit x20", Engine::Articulated(ArticulatedConfig { refresh: Refresh::Substep, ..paper }))?,
        new("articulated explicit x64", explicit(64))?,
        new("articulated explicit x256", explicit(256))?,
        new("articulated converged (implicit x128)", implicit(128))?,
        Method { name: "articulated paper, its own cube".into(), system: reference, setting: Engine::Articulated(paper) },
    ])
}
