//! The columns: solvers and their settings.

use std::fmt;
use std::sync::Arc;

use crate::articulated::{Articulated, ArticulatedConfig, Friction};
#[cfg(feature = "rapier")]
use crate::rapier::{Rapier, RapierConfig};
use crate::solver::Solver;
use crate::system::System;

type Make = Arc<dyn Fn(&Arc<System>) -> Box<dyn Solver> + Send + Sync>;

/// A solver at certain settings, under a name.
#[derive(Clone)]
pub struct Method {
    name: String,
    make: Make,
    finer: Option<Make>,
    rigid: bool,
    kin: Option<&'static str>,
}

impl fmt::Debug for Method {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Method").field("name", &self.name).finish_non_exhaustive()
    }
}

impl Method {
    /// Name of the column of the preset that known physics must pass.
    pub const CONVERGED: &str = "converged";

    /// Any solver: `make` makes it anew for each motion of a system.
    pub fn new(name: impl Into<String>, make: impl Fn(&Arc<System>) -> Box<dyn Solver> + Send + Sync + 'static) -> Self {
        Self { name: name.into(), make: Arc::new(make), finer: None, rigid: false, kin: None }
    }

    /// The same solver with four times the substeps, for the rows of self-convergence; without it they are not asked.
    #[must_use]
    pub fn finer(mut self, make: impl Fn(&Arc<System>) -> Box<dyn Solver> + Send + Sync + 'static) -> Self {
        self.finer = Some(Arc::new(make));
        self
    }

    /// Contacts do not give way as their material says: a body at rest lies on the surface, not `m g / k` below it.
    #[must_use]
    pub fn rigid(mut self) -> Self {
        self.rigid = true;
        self
    }

    /// A built-in robot has the materials and substeps of `NAME-kin`: those of `NAME-paper` are the reference simulator's.
    #[must_use]
    pub fn made_as(mut self, kin: &'static str) -> Self {
        self.kin = Some(kin);
        self
    }

    /// Name of the column.
    pub fn name(&self) -> &str {
        &self.name
    }

    pub(super) fn solver(&self, system: &Arc<System>) -> Box<dyn Solver> {
        (self.make)(system)
    }

    pub(super) fn finer_solver(&self, system: &Arc<System>) -> Option<Box<dyn Solver>> {
        self.finer.as_ref().map(|make| make(system))
    }

    pub(super) fn is_rigid(&self) -> bool {
        self.rigid
    }

    pub(super) fn kin(&self) -> Option<&'static str> {
        self.kin
    }

    /// The solvers of this crate: presets and substeps of [`Articulated`] and, with feature `rapier`, three of rapier.
    pub fn known() -> Vec<Self> {
        let euler = |n| Self::articulated(format!("Euler x{n}"), ArticulatedConfig::explicit, n);
        let implicit = |n| Self::articulated(format!("implicit x{n}"), ArticulatedConfig::implicit, n);
        [
            Self::paper(),
            Self::accurate(),
            euler(4),
            euler(16),
            euler(64),
            implicit(4),
            implicit(16),
            Self::converged(),
            #[cfg(feature = "rapier")]
            Self::rapier("rapier 4x4", 4),
            #[cfg(feature = "rapier")]
            Self::rapier("rapier 16x4", 16),
        ]
        .into()
    }

    /// What models are learned from: as many implicit substeps as the robot's specification says.
    pub fn accurate() -> Self {
        let accurate = |system: &System, times: usize| -> Box<dyn Solver> {
            Box::new(Articulated::new(ArticulatedConfig::implicit(times * system.spec.substeps, Friction::Coulomb)))
        };
        Self::new("accurate", move |system| accurate(system, 1)).finer(move |system| accurate(system, 4))
    }

    /// As accurate as can be.
    pub fn converged() -> Self {
        Self::new(Self::CONVERGED, |_| Box::new(Articulated::new(ArticulatedConfig::converged(Friction::Coulomb))))
            .finer(|_| Box::new(Articulated::new(ArticulatedConfig::implicit(512, Friction::Coulomb))))
    }

    /// The reference simulator's preset, with the materials and substeps that it has there.
    pub fn paper() -> Self {
        let paper = |system: &System, times: usize| -> Box<dyn Solver> {
            let config = ArticulatedConfig::paper(system, Friction::Coulomb);
            let (substeps, contact_substeps) = (times * config.substeps, times * config.contact_substeps);
            Box::new(Articulated::new(ArticulatedConfig { substeps, contact_substeps, ..config }))
        };
        Self::new("paper", move |system| paper(system, 1)).finer(move |system| paper(system, 4)).made_as("paper")
    }

    fn articulated(name: String, config: fn(usize, Friction) -> ArticulatedConfig, substeps: usize) -> Self {
        let solver = move |n: usize| -> Box<dyn Solver> { Box::new(Articulated::new(config(n, Friction::Coulomb))) };
        Self::new(name, move |_| solver(substeps)).finer(move |_| solver(4 * substeps))
    }

    #[cfg(feature = "rapier")]
    fn rapier(name: &str, steps: usize) -> Self {
        let solver = move |steps: usize| -> Box<dyn Solver> { Box::new(Rapier::new(RapierConfig { steps, ..Default::default() })) };
        Self::new(name, move |_| solver(steps)).finer(move |_| solver(4 * steps)).rigid()
    }
}
