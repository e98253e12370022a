//! [`CudaSlopes`]: slopes of a model's frame on the device, in f32 around the network in f64.

use nerd_cuda::Arg::{Int, Ptr};
use nerd_cuda::{Arg, Buffer, DeviceError, Replay};
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
    /// Gradients by the next states, by states and by torques, of so many rows.
    upstream: Buffer<f64>,
    slopes: Buffer<f64>,
    by_torques: Buffer<f64>,
    rows: usize,
    replay: Replay<usize>,
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
                upstream: d.zeros(1)?,
                slopes: d.zeros(1)?,
                by_torques: d.zeros(1)?,
                rows: 0,
                replay: Replay::default(),
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
    pub fn back(&mut self, batch: &Batch, torques: &[f64], rows: usize, by_next: &[f64]) -> Result<Slopes, StepError> {
        let (robot, n) = (&batch.system.robot, batch.len());
        let (wide, joints) = (n * rows * 2 * robot.nv(), n * robot.joint_count());
        if by_next.len() != wide || torques.len() != joints {
            let (found, held) = (by_next.len(), torques.len());
            return Err(StepError::Solver(format!("{found} numbers of gradients and {held} torques, {wide} and {joints} are needed")));
        }
        let mut found = Slopes { next: vec![0.0; batch.states.len()], states: vec![0.0; wide], torques: vec![0.0; rows * joints] };
        self.run(batch, torques, (rows, by_next), &mut found).map_err(failed)?;
        Ok(found)
    }

    fn run(&mut self, batch: &Batch, held: &[f64], (rows, by_next): (usize, &[f64]), out: &mut Slopes) -> Result<(), DeviceError> {
        if self.rows != rows {
            let d = &self.network.device;
            (self.upstream, self.slopes) = (d.zeros(by_next.len())?, d.zeros(by_next.len())?);
            (self.by_torques, self.rows, self.replay) = (d.zeros(out.torques.len())?, rows, Replay::default());
        }
        let d = &self.network.device;
        d.write(&self.states, &batch.states)?;
        d.write(&self.torques, held)?;
        d.write(&self.upstream, by_next)?;
        self.replay.run(d, "slopes", rows, || self.pass(batch.len(), rows))?;
        d.read(&self.next, &mut out.next)?;
        d.read(&self.slopes, &mut out.states)?;
        d.read(&self.by_torques, &mut out.torques)
    }

    /// Forth and back, row by row.
    fn pass(&self, n: usize, rows: usize) -> Result<(), DeviceError> {
        let Self { network, weights, .. } = self;
        let each = |kernel: &str, args: &[Arg]| network.device.launch(kernel, (n.div_ceil(THREADS), 1), (THREADS, 1), 0, args);
        let [states, torques, records, scene_of, said] =
            [self.states.ptr, self.torques.ptr, self.records.ptr, self.scene_of.ptr, network.predictions().ptr].map(Ptr);
        let [upstream, by_tokens] = [self.upstream.ptr, self.by_tokens.ptr].map(Ptr);
        for row in 0..rows {
            let which = [rows, row, n].map(Int);
            each("slopes_look", &[states, torques, records, scene_of, Ptr(network.at(Slot(0))), Int(n)])?;
            network.forward(weights.ptr, n)?;
            let written = [Ptr(self.next.ptr), Ptr(network.targets.ptr)];
            each("slopes_said", &[&[states, said, upstream][..], &written, &which].concat())?;
            network.backward(weights.ptr, self.by_weights.ptr, n, Some(self.by_tokens.ptr))?;
            let written = [Ptr(self.slopes.ptr), Ptr(self.by_torques.ptr)];
            each("slopes_back", &[&[states, records, scene_of, said, by_tokens, upstream][..], &written, &which].concat())?;
        }
        Ok(())
    }
}
