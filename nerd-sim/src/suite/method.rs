//! The columns: solvers and their settings.

use crate::internal::*;

type Make = Arc<dyn Fn(&Arc<System>) -> Box<dyn Solver> + Send + Sync>;

/// A solver at certain settings, under a name.
#[derive(Clone)]
pub struct Method {
    /// Name of the column.
    pub name: String,
    pub(super) make: Make,
    pub(super) finer: Option<Make>,
    pub(super) rigid: bool,
    pub(super) kin: Option<&'static str>,
}

impl Method {
    /// Any solver: `make` builds a new one for each motion of a system.
    pub fn new(name: impl Into<String>, make: impl Fn(&Arc<System>) -> Box<dyn Solver> + Send + Sync + 'static) -> Self {
        Self { name: name.into(), make: Arc::new(make), finer: None, rigid: false, kin: None }
    }

    /// The same solver with four times the substeps, for the rows of self-convergence; without it they are not asked.
    #[must_use]
    pub fn finer(mut self, make: impl Fn(&Arc<System>) -> Box<dyn Solver> + Send + Sync + 'static) -> Self {
        self.finer = Some(Arc::new(make));
        self
    }

    /// The same with something around its solver.
    #[must_use]
    pub fn around(self, wrap: impl Fn(Box<dyn Solver>) -> Box<dyn Solver> + Send + Sync + 'static) -> Self {
        let wrap = Arc::new(wrap);
        let both = |make: Make| -> Make {
            let wrap = wrap.clone();
            Arc::new(move |system| wrap(make(system)))
        };
        Self { make: both(self.make), finer: self.finer.map(&both), ..self }
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
}
