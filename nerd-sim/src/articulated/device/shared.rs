//! States on a GPU that other libraries read and write between frames.

use nerd_cuda::Arg::{Int, Long, Ptr};
use nerd_cuda::{Beside, Buffer, Device, DeviceError};

use super::program::fault;
use crate::prelude::*;
use crate::solver::Fault;
use crate::solver::device::{Resident, failed};

/// Kernels that copy states and torques, one number per thread. `give` also counts the frames that each environment
/// completed.
const KERNELS: &str = "
extern \"C\" __global__ void take(const double* states, const double* torques, double* held, double* tau, unsigned long long s, unsigned long long t) {
    const unsigned long long i = (unsigned long long)blockIdx.x * blockDim.x + threadIdx.x;
    if (i < s) held[i] = states[i];
    if (i < t) tau[i] = torques[i];
}
extern \"C\" __global__ void give(const double* held, const int* faults, double* states, unsigned* went, unsigned long long s, int n) {
    const unsigned long long i = (unsigned long long)blockIdx.x * blockDim.x + threadIdx.x;
    if (i < s) states[i] = held[i];
    if (i < n && !faults[i]) went[i]++;
}";
const THREADS: usize = 128;

/// States of a simulation with its solver on a GPU, at an address that never changes.
pub struct SharedStates {
    device: Device,
    /// `[env][q, qd]`.
    pub states: Arc<Buffer<f64>>,
    /// Frames that each environment completed since the last `pull`; whether any frame was stepped.
    went: Buffer<u32>,
    stepped: bool,
}

fn resident(solver: &mut Box<dyn Solver>) -> Result<&mut dyn Resident, StepError> {
    solver
        .resident()
        .ok_or_else(|| StepError::Refused("this solver does not stay on a card: step it on the CPU".into()))
}

impl SharedStates {
    /// Uploads the states of a simulation.
    pub fn new(simulation: &mut Simulation) -> Result<Self, StepError> {
        let device = Device::open(KERNELS, &["take", "give"]).map_err(failed)?;
        let states = device.zeros(simulation.batch.states.len());
        let went = device.zeros(simulation.batch.len());
        let mut shared =
            Self { states: Arc::new(states.map_err(failed)?), went: went.map_err(failed)?, stepped: false, device };
        shared.hold(simulation)?;
        Ok(shared)
    }

    /// Uploads the batch to a solver that does not have it yet.
    ///
    /// # Errors
    /// A part of the batch without a kernel, no GPU, or not enough memory.
    pub fn hold(&mut self, Simulation { batch, solver }: &mut Simulation) -> Result<(), StepError> {
        if solver.capabilities().forces {
            batch.watch()
        } else {
            batch.forces.clear()
        }
        let resident = resident(solver)?;
        resident.hold(batch)?;
        if let Some((theirs, _)) = resident.held() {
            self.device.join(theirs).map_err(failed)?;
        }
        self.device.write(&self.states, &batch.states).map_err(failed)
    }

    /// The stream of the frames.
    pub fn beside(&self) -> Beside {
        self.device.beside()
    }

    /// Steps one frame under torques `[env][joint]` at a GPU address. Waits neither for the frame nor for its faults.
    pub fn step(&mut self, simulation: &mut Simulation, torques: u64) -> Result<(), StepError> {
        let resident = resident(&mut simulation.solver)?;
        let work = || -> Result<(), DeviceError> {
            let Some((_, held)) = resident.held() else { return Ok(()) };
            let states = self.states.len;
            let tau = held.n * held.joints;
            let over = |kernel, entries: usize, args: &[nerd_cuda::Arg]| {
                self.device.launch(kernel, (entries.div_ceil(THREADS), 1), (THREADS, 1), 0, args)
            };
            let [from, to] = [[self.states.ptr, torques], [held.states.ptr, held.torques.ptr]].map(|of| of.map(Ptr));
            over("take", states.max(tau), &[&from[..], &to, &[states, tau].map(|x| Long(x as u64))].concat())?;
            resident.frame()?;
            let found = [held.states.ptr, held.faults.ptr, self.states.ptr, self.went.ptr].map(Ptr);
            over("give", states.max(held.n), &[&found[..], &[Long(states as u64), Int(held.n)]].concat())
        };
        self.stepped = true;
        work().map_err(failed)
    }

    /// Downloads the states into the batch. Returns the environments that the last frame left unchanged.
    pub fn pull(&mut self, Simulation { batch, solver }: &mut Simulation) -> Result<Vec<Fault>, StepError> {
        let resident = resident(solver)?;
        let Some((device, held)) = resident.held() else { return Ok(Vec::new()) };
        let mut faults = Vec::new();
        if self.stepped {
            let codes = held.give(device, batch, &mut Vec::new()).map_err(failed)?;
            let went = device.download(&self.went).map_err(failed)?;
            batch.frames.iter_mut().zip(went).for_each(|(frames, went)| *frames += u64::from(went));
            device.write(&self.went, &vec![0; held.n]).map_err(failed)?;
            let reason = |code| fault(&batch.system.robot, code);
            let wrong = codes.iter().enumerate().filter(|(_, (code, _))| *code != 0);
            faults.extend(wrong.map(|(env, (code, _))| Fault { env, frame: batch.frames[env], reason: reason(*code) }));
        }
        device.read(&self.states, &mut batch.states).map_err(failed)?;
        Ok(faults)
    }

    /// Uploads the batch's states again, after `envs` were restarted: clears the faults and memory of these
    /// environments.
    pub fn begin(
        &mut self,
        Simulation { batch, solver }: &mut Simulation,
        envs: impl Iterator<Item = usize>,
    ) -> Result<(), StepError> {
        let resident = resident(solver)?;
        let (memory, Some((device, held))) = (resident.memory(), resident.held()) else { return Ok(()) };
        for env in envs {
            for word in [held.faults.at(env), memory + 4 * env as u64].into_iter().take(1 + usize::from(memory != 0)) {
                device.set_word(word, 0).map_err(failed)?;
            }
        }
        device.write(&self.states, &batch.states).map_err(failed)
    }
}
