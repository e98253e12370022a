//! A batch of environments with the solver that steps it.

use std::fmt::Display;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use nerd_sim::drive::{Drive, holding, specified};
use nerd_sim::prelude::{Batch, Isometry3, Start, System as Robot, start, stream};
use nerd_sim::solver::{Fault, StepError};
use nerd_sim::vary;
use nerd_train::device::Device;
use numpy::ndarray::ArrayView2;
use numpy::{PyArray2, PyArrayDyn, PyUntypedArray};
use pyo3::prelude::*;

use crate::arrays::{Floats, made, numbers};
#[cfg(feature = "cuda")]
use crate::card_states::Card;
use crate::error::{alike, room, seeded, step, value};
use crate::solver;
use crate::system::{Named, System};
use crate::threads;

/// n environments of one system, and the solver that steps them.
///
/// Methods may be called from several threads; they wait for each other. `states` has no lock: do not read or write it
/// while another thread steps.
///
/// Simulation(system, scene=None, n=1, solver=None, device="cpu", seed=0, xp=None, vary=False)
///
/// system: a System, or its name or path. scene: a name; None means the scene of the robot's data, or free space.
/// solver: a solver's text, such as "articulated(substeps=4)", "rapier", "neural" (the shipped model), or the path of a
/// model's folder; None means the robot's own truth. "articulated(settled)" solves each substep to convergence, for
/// exact gradients. seed: seed of the random starts, here and in reset(). xp: with device="cuda", the array library on
/// the GPU, such as torch: states and tau are its arrays. Everything else is copied to the host. vary: if true, each
/// environment has its own robot, drawn by the [vary] section of the robot's TOML.
///
/// Raises ValueError, in one line, for incompatible arguments.
#[pyclass(frozen, module = "nerd")]
pub struct Simulation {
    /// The robot.
    #[pyo3(get, name = "system")]
    named: System,
    pub system: Arc<Robot>,
    /// Number of environments.
    #[pyo3(get)]
    pub n: usize,
    /// Address of the batch's states. Solvers write to this memory and never move it.
    states: usize,
    seed: u64,
    device: Device,
    #[cfg(feature = "cuda")]
    card: Option<Card>,
    inner: Mutex<Inner>,
}

/// The part of a simulation that one thread at a time works with.
pub struct Inner {
    pub simulation: nerd_sim::prelude::Simulation,
    /// Number of random starts drawn so far, `[env]`.
    drawn: Vec<u64>,
    faults: Vec<Fault>,
}

impl Simulation {
    /// Runs `work` on the locked state without Python's GIL, after copying results from the GPU.
    pub fn with<T: Send>(&self, py: Python<'_>, work: impl FnOnce(&mut Inner) -> T + Send) -> PyResult<T> {
        threads::here(self.n)?;
        let done = py.detach(|| {
            let mut inner = self.inner.lock().unwrap_or_else(PoisonError::into_inner);
            #[cfg(feature = "cuda")]
            if let Some(card) = &self.card {
                inner.faults = card.shared().pull(&mut inner.simulation)?;
            }
            Ok::<_, StepError>(work(&mut inner))
        });
        done.map_err(step)
    }

    /// Changes the simulation by `turn`, which undoes itself when applied twice. If the GPU refuses the changed
    /// simulation, `turn` is applied again.
    fn change(&self, py: Python<'_>, mut turn: impl FnMut(&mut nerd_sim::prelude::Simulation) + Send) -> PyResult<()> {
        let done = self.with(py, |inner| -> Result<(), StepError> {
            turn(&mut inner.simulation);
            #[cfg(feature = "cuda")]
            if let Some(card) = &self.card {
                card.hold(&mut inner.simulation).inspect_err(|_| turn(&mut inner.simulation))?;
            }
            Ok(())
        });
        done?.map_err(step)
    }

    /// Reads `width` numbers of each environment by `of` into an array [n, width].
    fn each<'py, E: Display + Send>(
        &self,
        py: Python<'py>,
        width: usize,
        of: impl Fn(&Batch, usize) -> Result<Vec<f64>, E> + Sync,
    ) -> PyResult<Floats<'py>> {
        let found = self
            .with(py, |inner| (0..self.n).map(|env| of(&inner.simulation.batch, env)).collect::<Result<Vec<_>, _>>())?;
        made(py, found.map_err(value)?.concat(), &[self.n, width])
    }

    /// Number of torques and of state numbers of one environment.
    pub fn widths(&self) -> [usize; 2] {
        [self.system.robot.joint_count(), self.system.robot.state_dim()]
    }
}

#[pymethods]
impl Simulation {
    #[new]
    #[pyo3(signature = (system, scene=None, n=1, solver=None, device="cpu", seed=0, xp=None, vary=false))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        py: Python<'_>,
        system: Named,
        scene: Option<&str>,
        n: i64,
        solver: Option<PathBuf>,
        device: &str,
        seed: i64,
        xp: Option<Py<PyAny>>,
        vary: bool,
    ) -> PyResult<Self> {
        let named = system.read()?;
        let system = named.system.clone();
        let spec = solver::spec(solver.as_deref(), device, &system)?;
        match (spec.device() != Device::Cpu, &xp) {
            (true, None) => return Err(value("device=\"cuda\": name the library of its arrays, too, as in xp=torch")),
            (false, Some(_)) => {
                return Err(value("xp: arrays of another library are on the card alone: device=\"cuda\""));
            }
            _ => {}
        }
        // Bytes per environment: those of two copies of the states, of contact forces, and of the solver's memory.
        let n = room(n, 32 * system.robot.state_dim() + 24 * system.robot.contact_points.len() + 1024)?;
        let (scene, seed) = (scene.unwrap_or(named.data_scene()), seeded(seed)?);
        let batch = match (vary, system.spec.vary.is_some()) {
            (true, false) => {
                return Err(value(format!("vary: nothing of `{}` is drawn; give its TOML a [vary]", system.name)));
            }
            (true, true) => vary::batch(&system, scene, n, !seed),
            (false, _) => system.scene(scene).map(|scene| Batch::new(&system, &scene, n)),
        };
        let batch = batch.map_err(value)?;
        if !vary {
            alike(&system, "vary=True")?;
        }
        let simulation = nerd_sim::prelude::Simulation { batch, solver: solver::solver(&spec, &system, n)? };
        let states = simulation.batch.states.as_ptr() as usize;
        let inner = Inner { simulation, drawn: vec![0; n], faults: Vec::new() };
        #[allow(unused_mut)]
        let mut made = Self {
            named,
            system,
            n,
            states,
            seed,
            device: spec.device(),
            #[cfg(feature = "cuda")]
            card: None,
            inner: Mutex::new(inner),
        };
        made.reset(py, None, None)?;
        #[cfg(feature = "cuda")]
        if let Some(xp) = xp {
            made.card = Some(made.with(py, |inner| Card::new(&mut inner.simulation, xp))?.map_err(step)?);
        }
        Ok(made)
    }

    /// step(tau): steps one frame under the torques tau [n, joints] (N m or N), held over the frame. tau is a numpy
    /// array of float64, or a GPU array of `xp`.
    ///
    /// Raises RuntimeError if some environments could not be stepped. `faults` lists these environments; they keep
    /// their states, and all others were stepped. On a GPU the call neither waits nor raises; a failed environment of a
    /// model stays in place until reset.
    fn step(&self, py: Python<'_>, tau: &Bound<'_, PyAny>) -> PyResult<()> {
        #[cfg(feature = "cuda")]
        if let Some(card) = &self.card {
            let tau = card.torques(tau, &[self.n, self.widths()[0]])?;
            let done = py.detach(|| {
                let mut inner = self.inner.lock().unwrap_or_else(PoisonError::into_inner);
                card.shared().step(&mut inner.simulation, tau)
            });
            done.map_err(step)?;
            // Makes the stream of `tau` wait until `tau` is read.
            return card.states(py, &[self.n, self.widths()[1]]).map(drop);
        }
        let tau = numbers::<f64>("tau", tau, &[&[self.n, self.widths()[0]]])?;
        let done = self.with(py, |inner| {
            let done = inner.simulation.step(&tau);
            inner.faults.clear();
            if let Err(StepError::Environments(faults)) = &done {
                inner.faults.clone_from(faults);
            }
            done
        });
        done?.map_err(step)
    }

    /// The states [q, qd], float64 [n, nq + nv]: a view of the memory that every step writes to, not a copy. Do not
    /// read or write it while another thread steps. A model of several frames remembers earlier frames: after writing
    /// to the states, call reset(states=states). On a GPU this is an array of `xp`, also a view.
    #[getter]
    fn states<'py>(this: Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        let own = this.get();
        let shape = (own.n, own.widths()[1]);
        #[cfg(feature = "cuda")]
        if let Some(card) = &own.card {
            return card.states(this.py(), &[shape.0, shape.1]);
        }
        // SAFETY: the memory is the batch's, which stays in place as long as `this`, the array's base, lives.
        unsafe {
            let view = ArrayView2::from_shape_ptr(shape, own.states as *const f64);
            Ok(PyArray2::borrow_from_array(&view, this.into_any()).into_any())
        }
    }

    /// reset(mask=None, states=None): restarts the environments of a mask, bool [n], or all. These environments start
    /// at states: float64 [n, nq + nv], or [nq + nv] for all. Without states, environments start at random within the
    /// robot's reset ranges. Raises ValueError for a quaternion of zeros.
    #[pyo3(signature = (mask=None, states=None))]
    fn reset(
        &self,
        py: Python<'_>,
        mask: Option<&Bound<'_, PyAny>>,
        states: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        let (n, [_, width]) = (self.n, self.widths());
        let mask = mask.map(|mask| numbers::<bool>("mask (states go by name: states=)", mask, &[&[n]])).transpose()?;
        let states = states.map(|states| numbers::<f64>("states", states, &[&[n, width], &[width]])).transpose()?;
        let begun = || (0..n).filter(|env| mask.as_ref().is_none_or(|mask| mask[*env]));
        let at = |env: usize, of: &[f64]| if of.len() == width { 0 } else { env * width };
        if self.system.robot.floating()
            && let Some(states) = &states
            && let Some(env) = begun().find(|env| states[at(*env, states) + 3..][..4] == [0.0; 4])
        {
            let line = "its quaternion (columns 3 to 6) has length 0; system.default_state has one";
            return Err(value(format!("states: environment {env}: {line}")));
        }
        let done = self.with(py, |Inner { simulation, drawn, .. }| -> Result<(), StepError> {
            for env in begun() {
                match &states {
                    Some(states) => simulation.reset(env, &states[at(env, states)..][..width]),
                    None => {
                        let mut draws = stream(self.seed, (env as u64) << 32 | drawn[env]);
                        drawn[env] += 1;
                        simulation.reset(env, &start(&self.system, Start::Reset, &mut draws));
                    }
                }
            }
            #[cfg(feature = "cuda")]
            if let Some(card) = &self.card {
                card.shared().begin(simulation, begun())?;
            }
            Ok(())
        });
        done?.map_err(step)
    }

    /// poses(name): world poses of a link or a frame, float64 [n, 7]: position (m), then quaternion x y z w.
    fn poses<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Floats<'py>> {
        let numbers = |p: Isometry3<f64>| [p.translation.vector.as_slice(), p.rotation.coords.as_slice()].concat();
        self.each(py, 7, |batch, env| batch.pose(env, name).map(numbers))
    }

    /// velocities(name): velocities of a link or a frame in world axes, float64 [n, 6]: angular velocity (rad/s), then
    /// velocity of its origin (m/s).
    fn velocities<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Floats<'py>> {
        self.each(py, 6, |batch, env| batch.velocity(env, name).map(|v| v.vector().as_slice().to_vec()))
    }

    /// contact_forces(link): contact force (N) of the scene on a moving link, in world axes, float64 [n, 3]. The force
    /// is the mean over the last frame. Raises ValueError before the first frame and after a frame of a solver that
    /// reports no forces.
    fn contact_forces<'py>(&self, py: Python<'py>, link: &str) -> PyResult<Floats<'py>> {
        self.each(py, 3, |batch, env| batch.contact_force(env, link).map(|f| f.as_slice().to_vec()))
    }

    /// drive(targets, kp=None, kd=None): from now on the force `kp (target - q) - kd qd` (N m or N) acts at every joint
    /// in addition to a step's torques. The solver evaluates this force in each substep, so stiff gains stay stable,
    /// and limits it to the joints' efforts. Each argument is float64 [n, joints], [joints], or a number. Default gains
    /// are from the robot's TOML, or else chosen to hold the robot's weight. drive(None) ends the drive.
    #[pyo3(signature = (targets, kp=None, kd=None))]
    fn drive(
        &self,
        py: Python<'_>,
        targets: Option<&Bound<'_, PyAny>>,
        kp: Option<&Bound<'_, PyAny>>,
        kd: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        let (n, [joints, _], system) = (self.n, self.widths(), &self.system);
        if kp.is_some() != kd.is_some() {
            return Err(value("kp, kd: give both of the gains, or neither"));
        }
        let given = |what, given: Option<&Bound<'_, PyAny>>| {
            let read = |given: &Bound<'_, PyAny>| match given.extract::<f64>() {
                Ok(number) if given.cast::<PyUntypedArray>().is_err() => Ok(vec![number]),
                _ => numbers::<f64>(what, given, &[&[n, joints], &[joints]]),
            };
            given.map(read).transpose()
        };
        let [targets, kp, kd] = [given("targets", targets)?, given("kp", kp)?, given("kd", kd)?];
        let mut usual = specified(system);
        if usual.is_empty() {
            usual = holding(system, &system.default_state());
        }
        let one = |k: usize| {
            let (usual, at) = (usual[k % joints], |all: &Option<Vec<f64>>| all.as_ref().map(|all| all[k % all.len()]));
            let [kp, kd] = [at(&kp).unwrap_or(usual.kp), at(&kd).unwrap_or(usual.kd)];
            Some(Drive { target: at(&targets)?, kp, kd, ..usual })
        };
        let mut drives = (0..n * joints).map_while(one).collect();
        self.change(py, |simulation| std::mem::swap(&mut simulation.batch.drives, &mut drives))
    }

    /// swap(solver): continues with another solver from the same states, on the same device.
    fn swap(&self, py: Python<'_>, solver: PathBuf) -> PyResult<()> {
        let device = if self.device.is_cuda() { "cuda" } else { "cpu" };
        let spec = solver::spec(Some(&solver), device, &self.system)?;
        let mut solver = solver::solver(&spec, &self.system, self.n)?;
        self.change(py, |simulation| std::mem::swap(&mut simulation.solver, &mut solver))
    }

    /// Frames stepped since each environment's reset, int [n].
    #[getter]
    fn frames<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<u64>>> {
        let frames = self.with(py, |inner| inner.simulation.batch.frames.clone())?;
        made(py, frames, &[self.n])
    }

    /// Environments that the last step could not step, as tuples (environment, frame, reason).
    #[getter]
    fn faults(&self, py: Python<'_>) -> PyResult<Vec<(usize, u64, String)>> {
        self.with(py, |inner| inner.faults.iter().map(|f| (f.env, f.frame, f.reason.clone())).collect())
    }

    fn __repr__(&self) -> String {
        format!("Simulation({:?}, n={})", self.system.name, self.n)
    }

    fn __len__(&self) -> usize {
        self.n
    }
}
