//! [`CudaSlopes`]: slopes of a model's frame on the device, in f32 around the network in f64.

use nerd_cuda::Arg::{Int, Ptr};
use nerd_cuda::{Arg, Buffer, DeviceError};
use nerd_model::device::{settings, slope_program};
use nerd_model::program::Slot;
use nerd_sim::articulated::device::{Reach, failed, record};
use nerd_sim::solver::Slopes;

use super::Precision;
use super::network::Network;
use super::plan::Plan;
use crate::prelude::*;

/// Threads of a block, an environment each.
const THREADS: usize = 32;

/// Memory for the slopes of as many environments of one system, in the scenes of a batch.
pub struct CudaSlopes {
    network: Network,
    weights: Buffer<f32>,
    scenes: Vec<Arc<Scene>>,
    records: Buffer<f64>,
    scene_of: Buffer<i32>,
    states: Buffer<f64>,
    torques: Buffer<f64>,
    next: Buffer<f64>,
    /// Gradients by weights, which nobody asks for, and by tokens.
    by_weights: Buffer<f32>,
    by_tokens: Buffer<f32>,
}

impl CudaSlopes {
    /// For batches like this one.
    ///
    /// # Errors
    /// If the network sees more than one frame, or a scene has no kernel; or the device fails.
    pub fn new(model: &Model, batch: &Batch) -> Result<Self, StepError> {
        let (config, system, n) = (model.config.network, &batch.system, batch.len());
        if config.architecture != Architecture::Residual {
            return Err(StepError::Refused("this model has no slopes: its network sees more than one frame".into()));
        }
        let solver = |e: LearnError| StepError::Solver(e.to_string());
        let plan = Plan::of(&config, 1).map_err(solver)?;
        let (mut network, weights) = Network::with_weights(plan, &model.weights.flat, n, Precision::F32, true).map_err(solver)?;
        let reach = Reach::of(batch);
        let (mut records, mut of) = (Vec::new(), Vec::new());
        for (env, scene) in batch.scenes.iter().enumerate() {
            if env == 0 || !Arc::ptr_eq(scene, &batch.scenes[env - 1]) {
                records.push(record(scene, system, &settings(), reach).map_err(StepError::Refused)?);
            }
            of.push(records.len() as i32 - 1);
        }
        let text = slope_program(model.config.form(), &model.normalizer, system, reach.colliders);
        let make = || -> Result<Self, DeviceError> {
            network.device.add(&text, &["slopes_look", "slopes_said", "slopes_back"])?;
            let d = &network.device;
            Ok(Self {
                scenes: batch.scenes.clone(),
                records: d.upload(&records.concat())?,
                scene_of: d.upload(&of)?,
                states: d.zeros(batch.states.len())?,
                torques: d.zeros(n * system.robot.joint_count())?,
                next: d.zeros(batch.states.len())?,
                by_weights: d.zeros(weights.len)?,
                by_tokens: d.zeros(n * config.inputs)?,
                weights,
                network,
            })
        };
        make().map_err(failed)
    }

    /// Whether it is for this batch.
    pub fn fits(&self, batch: &Batch) -> bool {
        self.scenes.len() == batch.len() && self.scenes.iter().zip(&batch.scenes).all(|(a, b)| Arc::ptr_eq(a, b))
    }

    /// As [`Solver::back`].
    pub fn back(&self, batch: &Batch, torques: &[f64], rows: usize, by_next: &[f64]) -> Result<Slopes, StepError> {
        let (robot, n) = (&batch.system.robot, batch.len());
        let (wide, joints) = (n * rows * 2 * robot.nv(), n * robot.joint_count());
        if by_next.len() != wide || torques.len() != joints {
            let (found, held) = (by_next.len(), torques.len());
            return Err(StepError::Solver(format!("{found} numbers of gradients and {held} torques, {wide} and {joints} are needed")));
        }
        let mut found = Slopes { next: vec![0.0; batch.states.len()], states: vec![0.0; wide], torques: vec![0.0; rows * joints] };
        self.found(batch, torques, (rows, by_next), &mut found).map_err(failed)?;
        Ok(found)
    }

    fn found(&self, batch: &Batch, held: &[f64], (rows, by_next): (usize, &[f64]), out: &mut Slopes) -> Result<(), DeviceError> {
        let Self { network, weights, records, scene_of, states, torques, next, by_weights, by_tokens, .. } = self;
        let (d, n) = (&network.device, batch.len());
        d.write(states, &batch.states)?;
        d.write(torques, held)?;
        let (upstream, slopes, by_torques) = (d.upload(by_next)?, d.zeros::<f64>(out.states.len())?, d.zeros::<f64>(out.torques.len())?);
        let each = |kernel: &str, args: &[Arg]| d.launch(kernel, (n.div_ceil(THREADS), 1), (THREADS, 1), 0, args);
        let (said, scenes) = (Ptr(network.predictions().ptr), [Ptr(records.ptr), Ptr(scene_of.ptr)]);
        for row in 0..rows {
            let which = [rows, row, n].map(Int);
            each("slopes_look", &[&[Ptr(states.ptr), Ptr(torques.ptr)], &scenes[..], &[Ptr(network.at(Slot(0))), Int(n)]].concat())?;
            network.forward(weights.ptr, n)?;
            let written = [upstream.ptr, next.ptr, network.targets.ptr].map(Ptr);
            each("slopes_said", &[&[Ptr(states.ptr), said][..], &written, &which].concat())?;
            network.backward(weights.ptr, by_weights.ptr, n, Some(by_tokens.ptr))?;
            let written = [by_tokens.ptr, upstream.ptr, slopes.ptr, by_torques.ptr].map(Ptr);
            each("slopes_back", &[&[Ptr(states.ptr)], &scenes[..], &[said], &written, &which].concat())?;
        }
        d.read(next, &mut out.next)?;
        d.read(&slopes, &mut out.states)?;
        d.read(&by_torques, &mut out.torques)
    }
}
