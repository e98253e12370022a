//! The articulated solver on a GPU.

use std::sync::Arc;

use nalgebra::Vector3;
use nerd_cuda::{Arg, Buffer, Device, DeviceError};

use super::super::ArticulatedConfig;
use super::program::{Reach, Real, fault, packed, program, record};
use crate::batch::Batch;
use crate::scene::Scene;
use crate::solver::{Fault, Solver, StepError, commit, sound};
use crate::system::System;

/// Environments of a block: a full warp, since an access of local memory costs as much for fewer; no more, so that a small batch spreads
/// over the whole device. Measured on an H200 with 2 to 64.
const BLOCK: usize = 32;

/// [`super::super::Articulated`] on a GPU, one thread an environment: the same frame, the same settings, any robot.
///
/// Along deep trees the CPU's solver looks for whips and cuts their substeps; the kernels do not, and go by the matrix. It refuses what it has
/// no kernel for: scenes with other shapes than planes and boxes, for explicit steps with more than one plane, robots
/// that differ by environment.
pub struct CudaArticulated {
    config: ArticulatedConfig,
    real: Real,
    made: Option<Made>,
    next: Vec<f64>,
    faults: Vec<Fault>,
}

/// Kernels of one robot, and what they work on.
struct Made {
    system: Arc<System>,
    reach: Reach,
    device: Device,
    memory: Memory,
    /// The scenes that the device knows, in order.
    scenes: Vec<Arc<Scene>>,
    records: Option<Buffer<f64>>,
}

/// Memory for so many environments.
struct Memory {
    n: usize,
    states: Buffer<f64>,
    drives: Buffer<f64>,
    forces: Buffer<f64>,
    scene_of: Buffer<i32>,
    faults: Buffer<i32>,
    done: Buffer<u32>,
    torques: Option<Buffer<f64>>,
}

fn failed(error: DeviceError) -> StepError {
    StepError::Solver(error.to_string())
}

impl CudaArticulated {
    /// A solver with these settings; the device is opened at its first step.
    pub fn new(config: ArticulatedConfig, real: Real) -> Self {
        Self { config, real, made: None, next: Vec::new(), faults: Vec::new() }
    }

    /// So many frames in a row without leaving the device. `torques` are `[env][joint]`, held over all of them, or `[frame][env][joint]`.
    ///
    /// # Errors
    /// As [`Solver::step`]. An environment that fails stands where it stood before the frame in which it did, which the error names.
    pub fn roll(&mut self, batch: &mut Batch, torques: &[f64], frames: usize) -> Result<(), StepError> {
        let (n, width) = (batch.len(), batch.len() * batch.system.robot.joint_count());
        let held = torques.len() == width;
        if frames == 0 || (!held && torques.len() != frames * width) {
            return Err(StepError::Torques { found: torques.len(), environments: n, joints: batch.system.robot.joint_count() });
        }
        self.config.check().map_err(StepError::Solver)?;
        sound(batch, &torques[..width], &mut self.faults)?;
        if let Some(at) = torques[width..].iter().position(|x| !x.is_finite()) {
            let (frame, env) = (1 + at / width, at % width / batch.system.robot.joint_count());
            return Err(StepError::Solver(format!(
                "a torque of environment {env} in frame {frame} of the roll is {}",
                torques[width + at]
            )));
        }
        if let Some(joint) = batch.system.robot.joints().find(|j| j.stiffness > 0.0) {
            let text = format!("joint `{}` has a spring (stiffness), which has no kernel; step it with articulated on the CPU", joint.name);
            return Err(StepError::Solver(text));
        }
        if !batch.systems.is_empty() {
            let text = "on a device all environments are of one robot: leave `systems` empty, or step with articulated on the CPU";
            return Err(StepError::Solver(text.into()));
        }
        if n == 0 {
            return Ok(());
        }
        self.prepare(batch)?;
        let Some(made) = &mut self.made else { return Ok(()) };
        let done = made.launch(batch, torques, frames, held, &mut self.next).map_err(failed)?;
        for (env, (code, went)) in done.into_iter().enumerate() {
            batch.frames[env] += u64::from(went.saturating_sub(u32::from(code == 0)));
            if code != 0 && self.faults.iter().all(|f| f.env != env) {
                // What it reached before the frame that failed is kept.
                let d = made.system.robot.state_dim();
                batch.states[env * d..(env + 1) * d].copy_from_slice(&self.next[env * d..(env + 1) * d]);
                self.faults.push(Fault { env, frame: batch.frames[env], reason: fault(&made.system.robot, code) });
            }
        }
        let points = if batch.forces.is_empty() { 0 } else { batch.system.robot.contact_points.len() };
        for fault in &self.faults {
            batch.forces[fault.env * points..][..points].fill(Vector3::zeros());
        }
        commit(batch, &mut self.next, &mut self.faults)
    }

    /// Kernels and memory that fit the batch, and its scenes on the device.
    fn prepare(&mut self, batch: &Batch) -> Result<(), StepError> {
        let asked = Reach::of(batch);
        let fits = |m: &Made| {
            let enough = m.reach.colliders >= asked.colliders && m.reach.driven == asked.driven;
            enough && Arc::ptr_eq(&m.system, &batch.system)
        };
        if !self.made.as_ref().is_some_and(fits) {
            self.made = None;
            let text = program(&batch.system, &self.config, self.real, asked);
            self.made = Some(Made::new(batch, &text, asked).map_err(failed)?);
        }
        let Some(made) = &mut self.made else { return Ok(()) };
        if made.memory.n != batch.len() {
            made.memory = Memory::new(&made.device, batch).map_err(failed)?;
            made.scenes.clear();
        }
        made.know(batch, &self.config)
    }
}

impl Memory {
    fn new(device: &Device, batch: &Batch) -> Result<Self, DeviceError> {
        let (n, robot) = (batch.len(), &batch.system.robot);
        Ok(Self {
            n,
            states: device.zeros(n * robot.state_dim())?,
            drives: device.zeros(5 * batch.drives.len())?,
            forces: device.zeros(3 * n * robot.contact_points.len())?,
            scene_of: device.zeros(n)?,
            faults: device.zeros(n)?,
            done: device.zeros(n)?,
            torques: None,
        })
    }
}

impl Made {
    fn new(batch: &Batch, text: &str, reach: Reach) -> Result<Self, DeviceError> {
        let device = Device::open(text, &["advance"])?;
        let memory = Memory::new(&device, batch)?;
        Ok(Self { system: batch.system.clone(), reach, device, memory, scenes: Vec::new(), records: None })
    }

    /// Takes over the batch's scenes, if they are not those that are there.
    fn know(&mut self, batch: &Batch, config: &ArticulatedConfig) -> Result<(), StepError> {
        let same = self.scenes.len() == batch.len() && self.scenes.iter().zip(&batch.scenes).all(|(a, b)| Arc::ptr_eq(a, b));
        if same && self.records.is_some() {
            return Ok(());
        }
        self.scenes.clear();
        let (mut records, mut of, mut last): (Vec<f64>, Vec<i32>, Option<&Arc<Scene>>) = (Vec::new(), Vec::new(), None);
        let width = 3 + 20 * self.reach.colliders;
        for scene in &batch.scenes {
            // Environments mostly share one.
            if !last.is_some_and(|known| Arc::ptr_eq(known, scene)) {
                records.extend(record(scene, &self.system, config, self.reach).map_err(StepError::Solver)?);
                last = Some(scene);
            }
            of.push((records.len() / width) as i32 - 1);
        }
        self.records = Some(self.device.upload(&records).map_err(failed)?);
        self.device.write(&self.memory.scene_of, &of).map_err(failed)?;
        self.scenes.clone_from(&batch.scenes);
        Ok(())
    }

    /// Runs the kernel; each environment's fault and the frames that it made.
    fn launch(
        &mut self,
        batch: &mut Batch,
        torques: &[f64],
        frames: usize,
        held: bool,
        next: &mut Vec<f64>,
    ) -> Result<Vec<(i32, u32)>, DeviceError> {
        let (device, memory) = (&self.device, &mut self.memory);
        let n = memory.n;
        device.write(&memory.states, &batch.states)?;
        if memory.torques.as_ref().is_none_or(|t| t.len < torques.len()) {
            memory.torques = Some(device.zeros(torques.len())?);
        }
        let Some((tau, records)) = memory.torques.as_ref().zip(self.records.as_ref()) else { return Ok(Vec::new()) };
        device.write(tau, torques)?;
        device.write(&memory.drives, &packed(&batch.drives))?;
        let told = if batch.forces.is_empty() { 0 } else { memory.forces.ptr };
        let Memory { states, scene_of, drives, faults, done, .. } = memory;
        let buffers = [states.ptr, tau.ptr, records.ptr, scene_of.ptr, drives.ptr, told, faults.ptr, done.ptr];
        let numbers = [n, frames, usize::from(held)];
        let args: Vec<Arg> = buffers.into_iter().map(Arg::Ptr).chain(numbers.into_iter().map(Arg::Int)).collect();
        device.launch("advance", (n.div_ceil(BLOCK), 1), (BLOCK, 1), 0, &args)?;
        next.resize(batch.states.len(), 0.0);
        device.read(states, next)?;
        let (mut wrong, mut went) = (vec![0i32; n], vec![0u32; n]);
        device.read(faults, &mut wrong)?;
        device.read(done, &mut went)?;
        if told != 0 {
            let mut forces = vec![0.0; 3 * batch.forces.len()];
            device.read(&memory.forces, &mut forces)?;
            batch.forces.iter_mut().zip(forces.as_chunks::<3>().0).for_each(|(f, x)| *f = Vector3::from(*x));
        }
        Ok(wrong.into_iter().zip(went).collect())
    }
}

impl Solver for CudaArticulated {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        self.roll(batch, torques, 1)
    }
}
