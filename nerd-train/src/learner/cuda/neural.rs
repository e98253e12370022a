//! [`CudaNeural`]: a model as a solver whose frames never leave the device.

use std::sync::Arc;

use nerd_cuda::Arg::{Int, Ptr};
use nerd_cuda::{Buffer, Device, DeviceError, Replay};
use nerd_model::device::{program, settings};
use nerd_model::folder::Model;
use nerd_sim::articulated::ArticulatedConfig;
use nerd_sim::articulated::device::{BLOCK, Held, Motion, OnDevice, Reach, Real, failed};
use nerd_sim::batch::Batch;
use nerd_sim::solver::StepError;
use nerd_sim::system::System;

use super::Precision;
use super::plan::Plan;
use super::stream::CudaStream;

/// [`nerd_model::neural::Neural`] on a GPU: contacts, draft, token, network and the state that follows are one captured graph a frame.
///
/// It refuses what it has no kernel for: networks that see windows, other bases than the state and drafts, other views than the robot's
/// own, and what [`nerd_sim::articulated::device::CudaArticulated`] refuses.
pub type CudaNeural = OnDevice<Network>;

/// A frame as a graph: `neural_tell`, the stream of the network, `neural_apply`.
pub struct Network {
    model: Model,
    config: ArticulatedConfig,
    real: Real,
    precision: Precision,
    made: Option<Made>,
}

struct Made {
    stream: CudaStream,
    bases: Buffer<f64>,
    hold: Buffer<u32>,
    replay: Replay<[u64; 2]>,
    /// The frame that each environment's next token must be of, to follow on those that are remembered.
    next: Vec<u64>,
}

/// A model of `system` as a solver; the device is opened at its first step.
///
/// # Errors
/// What of the model has no kernel.
pub fn neural(model: Model, system: &Arc<System>, real: Real, precision: Precision) -> Result<CudaNeural, String> {
    Plan::stream(&model.config.network).map_err(|e| e.to_string())?;
    let (config, _) = settings(&model, system)?;
    Ok(OnDevice::by(Network { model, config, real, precision, made: None }))
}

impl Motion for Network {
    fn config(&self) -> &ArticulatedConfig {
        &self.config
    }

    fn open(&mut self, batch: &Batch, reach: Reach) -> Result<(), StepError> {
        self.made = None;
        let solver = |e: &dyn std::fmt::Display| StepError::Solver(e.to_string());
        let text = program(&self.model, &batch.system, self.real, reach.colliders).map_err(StepError::Solver)?;
        let mut stream = CudaStream::new(&self.model.weights, self.precision, batch.len()).map_err(|e| solver(&e))?;
        let device = stream.device_mut();
        device.add(&text, &["neural_tell", "neural_apply"]).map_err(failed)?;
        let (bases, hold) = (device.zeros(batch.states.len()).map_err(failed)?, device.zeros(1).map_err(failed)?);
        self.made = Some(Made { stream, bases, hold, replay: Replay::default(), next: vec![u64::MAX; batch.len()] });
        Ok(())
    }

    fn device(&self) -> Option<&Device> {
        self.made.as_ref().map(|made| made.stream.device())
    }

    fn advance(&mut self, held: &Held, first: &[u64], frames: usize, hold: bool) -> Result<(), DeviceError> {
        let Some(made) = &mut self.made else { return Ok(()) };
        made.follow(first, hold)?;
        let device = made.stream.device();
        device.write(&held.faults, &vec![0; held.n])?;
        device.write(&held.done, &vec![0; held.n])?;
        (0..frames).try_for_each(|_| made.go(held))?;
        let device = made.stream.device();
        let (mut went, mut faults) = (vec![0u32; held.n], vec![0i32; held.n]);
        device.read(&held.done, &mut went)?;
        device.read(&held.faults, &mut faults)?;
        for (env, next) in made.next.iter_mut().enumerate() {
            *next = if faults[env] == 0 { first[env] + u64::from(went[env]) } else { u64::MAX };
        }
        Ok(())
    }

    fn follow(&mut self, first: &[u64]) -> Result<(), DeviceError> {
        let Some(made) = &mut self.made else { return Ok(()) };
        made.follow(first, true)?;
        made.next.fill(u64::MAX);
        Ok(())
    }

    fn memory(&self) -> u64 {
        self.made.as_ref().map_or(0, |made| made.stream.taken())
    }

    fn frame(&mut self, held: &Held) -> Result<(), DeviceError> {
        self.made.as_ref().map_or(Ok(()), |made| made.go(held))
    }

    fn reset(&mut self, env: usize) {
        if let Some(next) = self.made.as_mut().and_then(|made| made.next.get_mut(env)) {
            *next = u64::MAX;
        }
    }
}

impl Made {
    /// Clears memory that these frames do not continue; returns whether torques are held.
    fn follow(&mut self, first: &[u64], hold: bool) -> Result<(), DeviceError> {
        let begins = |(env, frame): (usize, &u64)| (*frame == 0 || self.next[env] != *frame).then_some(env);
        let fresh: Vec<usize> = first.iter().enumerate().filter_map(begins).collect();
        self.stream.forget(&fresh)?;
        self.stream.device().write(&self.hold, &[u32::from(hold)])
    }

    /// One frame, as a graph from the second on.
    fn go(&self, held: &Held) -> Result<(), DeviceError> {
        self.replay.run(self.stream.device(), "frame", [held.torques.ptr, held.records.ptr], || self.frame(held))
    }

    /// What of a frame the device does.
    fn frame(&self, held: &Held) -> Result<(), DeviceError> {
        let (device, stream) = (self.stream.device(), &self.stream);
        let grid = |kernel, args: &[nerd_cuda::Arg]| device.launch(kernel, (held.n.div_ceil(BLOCK), 1), (BLOCK, 1), 0, args);
        let Held { states, torques, records, scene_of, faults, done, .. } = held;
        let world = [states.ptr, torques.ptr, records.ptr, scene_of.ptr, self.bases.ptr, stream.tokens(), faults.ptr, done.ptr].map(Ptr);
        grid("neural_tell", &[&world[..], &[Int(held.n), Ptr(self.hold.ptr)]].concat())?;
        stream.pass()?;
        let after = [states.ptr, self.bases.ptr, stream.predictions(), stream.taken(), faults.ptr, done.ptr].map(Ptr);
        grid("neural_apply", &[&after[..], &[Int(held.n)]].concat())
    }
}
