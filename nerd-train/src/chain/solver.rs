//! [`CudaChain`]: a chain's model as a solver whose frames never leave the device.

use std::sync::Arc;

use nerd_cuda::Arg::{Int, Ptr};
use nerd_cuda::{Buffer, Device, DeviceError, Replay};
use nerd_model::chain::{Chain, ChainSolver, OUTPUTS, chain_program, numbers};
use nerd_model::folder::Model;
use nerd_model::program::Slot;
use nerd_model::transformer::Weights;
use nerd_sim::articulated::device::{BLOCK, Held, Motion, OnDevice, Reach, failed};
use nerd_sim::articulated::{ArticulatedConfig, Friction};
use nerd_sim::batch::Batch;
use nerd_sim::solver::StepError;
use nerd_sim::system::System;

use crate::learner::cuda::{Network, Plan, Precision};

/// [`ChainSolver`] on a GPU: rods, contacts, tokens, network and the state that follows are one captured graph a frame. All but the network
/// has 64 bits.
///
/// It refuses scenes with other shapes than planes, boxes and pegs, and with another gravity than the robot's own.
pub type CudaChain = OnDevice<Along>;

/// A frame as a graph: `chain_tell`, the network over windows of rods, `chain_apply`.
pub struct Along {
    chain: Chain,
    scale: [f64; OUTPUTS],
    weights: Weights,
    config: ArticulatedConfig,
    precision: Precision,
    made: Option<Made>,
}

struct Made {
    network: Network,
    weights: Buffer<f32>,
    memos: Buffer<f64>,
    hold: Buffer<u32>,
    replay: Replay<[u64; 2]>,
}

/// A chain's model as a solver of `system`; the device is opened at its first step.
///
/// # Errors
/// If the robot is not a chain or another one, or the kernels do not cover the network.
pub fn chain(model: Model, system: &Arc<System>, precision: Precision) -> Result<CudaChain, String> {
    // What the CPU's solver refuses.
    ChainSolver::new(&model.weights, &model.normalizer, system).map_err(|e| e.to_string())?;
    let chain = Chain::of(system).map_err(|e| e.to_string())?;
    let scale = ChainSolver::scale(&model.normalizer)?;
    Plan::of(&model.weights.config, chain.rods).map_err(|e| e.to_string())?;
    let config = ArticulatedConfig::implicit(1, Friction::Coulomb);
    Ok(OnDevice::by(Along { chain, scale, weights: model.weights, config, precision, made: None }))
}

impl Motion for Along {
    fn check(&self, batch: &Batch) -> Result<(), StepError> {
        let (joints, gravity) = (batch.system.robot.joint_count(), batch.system.gravity());
        let refuse = |reason: String| Err(StepError::Refused(reason));
        if joints != 6 + 2 * self.chain.rods {
            return refuse(format!("a chain of {} rods was learned, the robot has {joints} joints", self.chain.rods));
        }
        match batch.scenes.iter().position(|scene| scene.gravity != gravity) {
            Some(env) => refuse(format!("gravity of environment {env} is not what was learned; step it on the CPU")),
            None => Ok(()),
        }
    }

    fn config(&self) -> &ArticulatedConfig {
        &self.config
    }

    fn open(&mut self, batch: &Batch, reach: Reach) -> Result<(), StepError> {
        self.made = None;
        let solver = |e: &dyn std::fmt::Display| StepError::Solver(e.to_string());
        let plan = Plan::of(&self.weights.config, self.chain.rods).map_err(|e| solver(&e))?;
        let mut network = Network::new(nerd_cuda::ordinal(), plan, batch.len(), self.precision, false).map_err(|e| solver(&e))?;
        let text = chain_program(&self.chain, &self.scale, &batch.system, reach.colliders);
        network.device.add(&text, &["chain_tell", "chain_apply"]).map_err(failed)?;
        let device = &network.device;
        let (weights, hold) = (device.upload(&self.weights.flat).map_err(failed)?, device.zeros(1).map_err(failed)?);
        let memos = device.zeros(batch.len() * numbers(&self.chain)).map_err(failed)?;
        network.fold(weights.ptr).map_err(failed)?;
        self.made = Some(Made { network, weights, memos, hold, replay: Replay::default() });
        Ok(())
    }

    fn device(&self) -> Option<&Device> {
        self.made.as_ref().map(|made| &made.network.device)
    }

    fn advance(&mut self, held: &Held, _: &[u64], frames: usize, hold: bool) -> Result<(), DeviceError> {
        let Some(made) = &self.made else { return Ok(()) };
        let device = &made.network.device;
        device.write(&made.hold, &[u32::from(hold)])?;
        device.write(&held.faults, &vec![0; held.n])?;
        device.write(&held.done, &vec![0; held.n])?;
        (0..frames).try_for_each(|_| made.go(held))
    }

    fn follow(&mut self, _: &[u64]) -> Result<(), DeviceError> {
        self.made.as_ref().map_or(Ok(()), |made| made.network.device.write(&made.hold, &[1]))
    }

    fn frame(&mut self, held: &Held) -> Result<(), DeviceError> {
        self.made.as_ref().map_or(Ok(()), |made| made.go(held))
    }
}

impl Made {
    /// One frame, as a graph from the second on.
    fn go(&self, held: &Held) -> Result<(), DeviceError> {
        self.replay.run(&self.network.device, "frame", [held.torques.ptr, held.records.ptr], || self.frame(held))
    }

    /// What of a frame the device does.
    fn frame(&self, held: &Held) -> Result<(), DeviceError> {
        let net = &self.network;
        let grid = |kernel, args: &[nerd_cuda::Arg]| net.device.launch(kernel, (held.n.div_ceil(BLOCK), 1), (BLOCK, 1), 0, args);
        let Held { states, torques, records, scene_of, faults, done, n, .. } = held;
        let world = [states.ptr, torques.ptr, records.ptr, scene_of.ptr, self.memos.ptr, net.at(Slot(0)), faults.ptr, done.ptr].map(Ptr);
        grid("chain_tell", &[&world[..], &[Int(*n), Ptr(self.hold.ptr)]].concat())?;
        net.predict(self.weights.ptr, *n, None)?;
        let after = [states.ptr, self.memos.ptr, net.predictions().ptr, faults.ptr, done.ptr].map(Ptr);
        grid("chain_apply", &[&after[..], &[Int(*n)]].concat())
    }
}
