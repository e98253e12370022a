//! The methods under test: the columns of the stability map.

use nerd_suite::Method;
use nerd_train::spec::Method as Stepping;

use crate::{mujoco::Mujoco, prelude::*};

/// Articulated dynamics at presets and numbers of substeps, and rapier at two numbers of steps.
pub fn known() -> Vec<Method> {
    let euler = |n: usize| method(format!("Euler x{n}"), SolverSpec::articulated(Stepping::Euler, n));
    let implicit = |n: usize| method(format!("implicit x{n}"), SolverSpec::implicit(n));
    let rapier = |n: usize| method(format!("rapier {n}x4"), SolverSpec::rapier(n)).rigid();
    [paper(), accurate(), euler(4), euler(16), euler(64), implicit(4), implicit(16), converged(), rapier(4), rapier(16)]
        .into()
}

/// The default truth of models: the implicit method with the robot's own number of substeps.
pub fn accurate() -> Method {
    method("accurate", SolverSpec::default())
}

pub fn converged() -> Method {
    method("converged", SolverSpec::implicit(128))
}

/// The reference simulator's method, with its materials and substeps.
pub fn paper() -> Method {
    method("paper", Truth::Paper.into()).made_as("paper")
}

/// Makes a method of a solver; rows of self-convergence use the solver at four times its substeps.
pub fn method(name: impl Into<String>, spec: SolverSpec) -> Method {
    made(name.into(), spec, |spec, system| Ok(spec.solver(system, 1)?))
}

/// The articulated solver on a GPU.
#[cfg(feature = "cuda")]
pub(super) fn on_gpu(name: String, spec: SolverSpec, real: nerd_sim::articulated::device::Real) -> Method {
    use nerd_train::{learner::cuda::Precision, spec::resident};
    made(name, spec, move |spec, system| Ok(resident(spec, system, real, Precision::F32)?))
}

fn made(
    name: String,
    spec: SolverSpec,
    make: impl Fn(&SolverSpec, &Arc<System>) -> Result<Box<dyn Solver>> + Copy + Send + Sync + 'static,
) -> Method {
    let at = |times: usize| {
        let spec = spec.clone();
        move |system: &Arc<System>| {
            make(&spec.refined(times, system), system).unwrap_or_else(|e| Box::new(Absent(e.to_string())))
        }
    };
    Method::new(name, at(1)).finer(at(4))
}

/// A solver that could not be made: it refuses every step, and says why.
struct Absent(String);

impl Solver for Absent {
    fn step(&mut self, _: &mut Batch, _: &[f64]) -> Result<(), StepError> {
        Err(StepError::Refused(self.0.clone()))
    }
}

/// MuJoCo with `substeps` steps per frame.
pub(super) fn mujoco(python: &Path, substeps: usize) -> Method {
    let python: Arc<Path> = python.into();
    let at = |substeps| {
        let python = python.clone();
        move |_: &Arc<System>| -> Box<dyn Solver> { Box::new(Mujoco::new(&python, substeps)) }
    };
    Method::new(format!("MuJoCo x{substeps}"), at(substeps)).finer(at(4 * substeps)).rigid()
}
