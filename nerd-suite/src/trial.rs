//! Methods (solvers with settings, the columns of the suite), and motions under a method.

use std::cell::RefCell;

use nerd_sim::prelude::*;

/// Errors of the suite.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// No row's name contains a word. Fields: the word, and the names of all rows.
    #[error("no row has `{0}` in its name; choose from {1}")]
    Row(String, String),
    /// The system or scene of a row cannot be made.
    #[error(transparent)]
    System(#[from] SystemError),
    /// The solver refused the system or scene before anything was measured.
    #[error(transparent)]
    Step(#[from] StepError),
    /// The row needs the method with four times the substeps, and the method has no such setting.
    #[error("the method names no finer setting (`Method::finer`)")]
    NoFiner,
}

pub(super) type Result<T, E = Error> = std::result::Result<T, E>;

type Make = Arc<dyn Fn(&Arc<System>) -> Box<dyn Solver> + Send + Sync>;

/// A solver with settings and a name: a column of the suite's tables.
#[derive(Clone)]
pub struct Method {
    /// Name of the method, as the head of its column.
    pub name: String,
    make: Make,
    finer: Option<Make>,
    pub(super) rigid: bool,
    kin: Option<&'static str>,
}

impl Method {
    /// Makes a method of any solver; `make` builds a new solver for each motion of a system.
    pub fn new(
        name: impl Into<String>,
        make: impl Fn(&Arc<System>) -> Box<dyn Solver> + Send + Sync + 'static,
    ) -> Self {
        Self { name: name.into(), make: Arc::new(make), finer: None, rigid: false, kin: None }
    }

    /// Adds the solver with four times the substeps, for self-convergence; without it, rows of self-convergence are
    /// skipped.
    #[must_use]
    pub fn finer(mut self, make: impl Fn(&Arc<System>) -> Box<dyn Solver> + Send + Sync + 'static) -> Self {
        self.finer = Some(Arc::new(make));
        self
    }

    /// Makes a new solver for a motion of a system.
    pub fn solver(&self, system: &Arc<System>) -> Box<dyn Solver> {
        (self.make)(system)
    }

    /// Makes a new solver with four times the method's substeps.
    pub(super) fn finer_solver(&self, system: &Arc<System>) -> Result<Box<dyn Solver>> {
        self.finer.as_ref().map(|make| make(system)).ok_or(Error::NoFiner)
    }

    /// Wraps each solver of the method, for example to round its states.
    #[must_use]
    pub fn around(self, wrap: impl Fn(Box<dyn Solver>) -> Box<dyn Solver> + Send + Sync + 'static) -> Self {
        let wrap = Arc::new(wrap);
        let both = |make: Make| -> Make {
            let wrap = wrap.clone();
            Arc::new(move |system| wrap(make(system)))
        };
        Self { make: both(self.make), finer: self.finer.map(&both), ..self }
    }

    /// Marks contacts as rigid: a body at rest lies on the surface instead of `m g / k` below it.
    #[must_use]
    pub fn rigid(mut self) -> Self {
        self.rigid = true;
        self
    }

    /// Gives built-in robots the materials and substeps of `NAME-{kin}`, for example `paper` for the reference
    /// simulator's.
    #[must_use]
    pub fn made_as(mut self, kin: &'static str) -> Self {
        self.kin = Some(kin);
        self
    }
}

/// A method under test, which rolls out the systems of a row.
pub struct Trial<'a> {
    pub method: &'a Method,
    /// The solver's error, if it failed. The motion then keeps its last state for all further frames.
    pub lost: RefCell<Option<String>>,
}

/// A motion: states after 0, 1, 2, ... frames.
pub struct Motion {
    pub system: Arc<System>,
    scene: Arc<Scene>,
    pub states: Vec<Vec<f64>>,
    /// Work (J) of the motors up to each state. A torque held constant over a frame does the work `tau dq`.
    pub work: Vec<f64>,
}

impl Motion {
    /// Mass, momentum and energy of every state.
    pub fn totals(&self) -> Vec<Totals> {
        let mut data = Data::new(&self.system.robot);
        self.states.iter().map(|s| totals(&self.system.robot, s, &mut data)).collect()
    }

    /// Energy (J) of every state.
    pub fn energies(&self) -> Vec<f64> {
        self.totals().iter().map(|t| t.energy(&self.scene.gravity)).collect()
    }

    /// Energy (J) stored in springs at each state ([`System::stored`]).
    pub fn stored(&self) -> Vec<f64> {
        let mut data = Data::new(&self.system.robot);
        self.states.iter().map(|s| self.system.stored(&self.scene, s, &mut data)).collect()
    }

    /// The figure of a motion that must stay above the ground. Infinity (a failure) if a contact point was ever deeper
    /// than 0.3 m: the robot fell through the ground. A correct motion in these rows penetrates at most 0.13 m (the tip
    /// of a pendulum on impact).
    pub fn above(&self, figure: f64) -> f64 {
        let robot = &self.system.robot;
        let mut data = Data::new(&self.system.robot);
        let mut events = Vec::new();
        let fell = self.states.iter().any(|state| {
            contacts(&self.system, &self.scene, state, &mut data, &mut events);
            robot.contact_points.iter().zip(&events).any(|(point, event)| point.radius - event.distance > 0.3)
        });
        if fell { f64::INFINITY } else { figure }
    }

    /// Returns the last state of the motion.
    pub fn last(&self) -> &[f64] {
        &self.states[self.states.len() - 1]
    }
}

/// Largest increase of an energy (J) over its previous minimum.
pub fn rise(energies: impl IntoIterator<Item = f64>) -> f64 {
    let mut least = f64::INFINITY;
    energies.into_iter().fold(0.0, |rise, e| {
        least = least.min(e);
        rise.max(e - least)
    })
}

/// Sets the torques of a frame from the state: `(state, torques)`.
pub(super) type Drive<'a> = dyn FnMut(&[f64], &mut [f64]) + 'a;

/// Leaves all torques at 0: a `Drive` of passive motion.
pub(super) fn limp(_: &[f64], _: &mut [f64]) {}

impl<'a> Trial<'a> {
    pub fn new(method: &'a Method) -> Self {
        Self { method, lost: RefCell::new(None) }
    }

    /// Loads a built-in robot. Only its materials, scenes and substeps may depend on the method.
    pub fn robot(&self, name: &str) -> Result<Arc<System>> {
        let system = System::named(name)?;
        let Some(kin) = self.method.kin else { return Ok(system) };
        let mut system = (*system).clone();
        let kin = System::named(&format!("{name}-{kin}"))?.spec.clone();
        system.spec.material = kin.material;
        system.spec.scenes = kin.scenes;
        system.spec.substeps = kin.substeps;
        system.spec.refresh = kin.refresh;
        Ok(Arc::new(system))
    }

    /// Rolls out `frames` frames without torques.
    pub fn passive(&self, system: &Arc<System>, scene: &str, start: &[f64], frames: usize) -> Result<Motion> {
        self.driven(system, scene, start, frames, &mut limp)
    }

    /// Rolls out `frames` frames under torques (N m or N) set by `drive(state, torques)`.
    pub fn driven(
        &self,
        system: &Arc<System>,
        scene: &str,
        start: &[f64],
        frames: usize,
        drive: &mut Drive,
    ) -> Result<Motion> {
        self.under(&mut *self.method.solver(system), system, scene, start, frames, drive)
    }

    /// Rolls out `frames` frames with `solver` from the state `start`, under torques set by `drive`. Stores an error of
    /// the solver in `lost`.
    pub fn under(
        &self,
        solver: &mut dyn Solver,
        system: &Arc<System>,
        scene: &str,
        start: &[f64],
        frames: usize,
        drive: &mut Drive,
    ) -> Result<Motion> {
        let scene = system.scene(scene)?;
        let mut batch = Batch::new(system, &scene, 1);
        batch.reset(0, start);
        let mut torques = vec![0.0; system.robot.joint_count()];
        let mut states = vec![start.to_vec()];
        let mut work = vec![0.0];
        for _ in 0..frames {
            drive(batch.state(0), &mut torques);
            if let Err(error) = solver.step(&mut batch, &torques) {
                if matches!(error, StepError::Refused(_)) {
                    return Err(error.into());
                }
                self.lost.borrow_mut().get_or_insert(error.to_string());
                states.resize(frames + 1, batch.state(0).to_vec());
                work.resize(frames + 1, work[work.len() - 1]);
                break;
            }
            work.push(work[work.len() - 1] + done(system, &torques, [&states[states.len() - 1], batch.state(0)]));
            states.push(batch.state(0).to_vec());
        }
        Ok(Motion { system: system.clone(), scene, states, work })
    }
}

/// Work (J) of joint torques held constant from state `before` to state `after`.
fn done(system: &System, torques: &[f64], [before, after]: [&[f64]; 2]) -> f64 {
    let at = system.robot.root_coords();
    let ways = after[at..].iter().zip(&before[at..]).zip(system.robot.joints());
    let ways = ways.map(|((after, before), joint)| if joint.wraps() { wrap(after - before) } else { after - before });
    torques.iter().zip(ways).map(|(torque, way)| torque * way).sum()
}
