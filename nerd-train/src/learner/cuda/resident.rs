//! A model as a solver with its batch on the GPU. A captured graph steps one frame: contacts, tokens, network and next
//! state.

use nerd_model::chain::{Chain, ChainSolver, OUTPUTS, chain_program, numbers};
use nerd_model::device::{LANES, program};
use nerd_sim::articulated::device::{BLOCK, Back, Held, Motion, OnDevice, Reach, Real, Trail};

use super::gradients::{FramesBack, goes_back};
use super::*;

/// Frames of a model: a kernel for tokens, the network, and a kernel for the next state.
pub struct Frames {
    model: Model,
    /// The chain of a cable's model, with the scales of its outputs.
    chain: Option<(Chain, [f64; OUTPUTS])>,
    real: Real,
    precision: Precision,
    made: Option<Made>,
}

struct Made {
    engine: Engine,
    hold: Buffer<u32>,
    replay: Replay<[u64; 2]>,
    /// Backward pass over frames, once requested.
    back: Option<FramesBack>,
    /// By environment, number of the frame that continues the remembered frames; `u64::MAX` if none does.
    next: Vec<u64>,
}

enum Engine {
    /// One token per environment and frame.
    Stream(CudaStream),
    /// One token per rod: network, weights, and what `chain_tell` stores for `chain_apply`.
    Chain(Network, Buffer<f32>, Buffer<f64>),
}

/// A model as a solver of `system`; the device is opened at the first step. Around a chain's network the arithmetic is
/// f64, whatever `real`.
///
/// # Errors
/// If the network sees windows, the model is conditioned on parameters, or the kernels do not cover it.
pub fn resident(
    model: Model,
    system: &Arc<System>,
    real: Real,
    precision: Precision,
) -> Result<OnDevice<Frames>, String> {
    let network = model.config.network;
    if model.config.told {
        return Err("what is told of each robot has no kernel: the network alone is on the card".into());
    }
    let refused = |e: LearnError| e.to_string();
    let chain = if network.architecture == Architecture::Chain {
        // Refuse the same models as the CPU's solver.
        ChainSolver::new(&model.weights, &model.normalizer, system).map_err(|e| e.to_string())?;
        let chain = Chain::of(system).map_err(|e| e.to_string())?;
        Plan::of(&network, chain.rods).map_err(refused)?;
        Some((chain, ChainSolver::scale(&model.normalizer)?))
    } else {
        Plan::stream(&network).map_err(refused)?;
        None
    };
    Ok(OnDevice::by(Frames { model, chain, real, precision, made: None }))
}

impl Motion for Frames {
    fn check(&self, batch: &Batch) -> Result<(), StepError> {
        let Some((chain, _)) = &self.chain else { return Ok(()) };
        let joints = batch.system.robot.joint_count();
        let gravity = batch.system.gravity();
        if joints != 6 + 2 * chain.rods {
            return Err(StepError::Refused(format!(
                "a chain of {} rods was learned, the robot has {joints} joints",
                chain.rods
            )));
        }
        match batch.scenes.iter().position(|scene| scene.gravity != gravity) {
            Some(env) => Err(StepError::Refused(format!(
                "gravity of environment {env} is not what was learned; step it on the CPU"
            ))),
            None => Ok(()),
        }
    }

    fn open(&mut self, batch: &Batch, reach: Reach) -> Result<(), StepError> {
        self.made = None;
        let weights = &self.model.weights;
        let envs = batch.len();

        let engine = match &self.chain {
            Some(_) if reach.fields => {
                return Err(StepError::Refused(
                    "a cable's model does not know terrain on a device; step it on the CPU".into(),
                ));
            }
            Some((chain, scale)) => {
                let plan = Plan::of(&weights.config, chain.rods)?;
                let (mut network, weights) = Network::with_weights(plan, &weights.flat, envs, self.precision, false)?;
                let text = chain_program(chain, scale, &batch.system, reach.colliders);
                network.device.add(&text, &["chain_tell", "chain_apply"])?;
                let rods = network.device.zeros(envs * numbers(chain))?;
                Engine::Chain(network, weights, rods)
            }
            None => {
                let text = program(self.model.config.form(), &self.model.normalizer, &batch.system, self.real, reach);
                let mut stream = CudaStream::new(weights, self.precision, envs)?;
                stream.network.device.add(&text, &["neural_tell", "neural_apply"])?;
                Engine::Stream(stream)
            }
        };
        let hold = engine.network().device.zeros(1)?;
        self.made = Some(Made { engine, hold, replay: Replay::default(), back: None, next: vec![u64::MAX; envs] });
        Ok(())
    }

    fn device(&self) -> Option<&Device> {
        self.made.as_ref().map(|made| &made.engine.network().device)
    }

    fn advance(&mut self, held: &Held, first: &[u64], frames: usize, hold: bool) -> DeviceResult {
        let Some(made) = &mut self.made else { return Ok(()) };
        made.follow(first, hold)?;
        let device = &made.engine.network().device;
        device.write(&held.faults, &vec![0; held.n])?;
        device.write(&held.done, &vec![0; held.n])?;
        (0..frames).try_for_each(|_| made.go(held))?;
        made.remember(held, first)
    }

    fn follow(&mut self, first: &[u64]) -> DeviceResult {
        let Some(made) = &mut self.made else { return Ok(()) };
        made.follow(first, true)?;
        made.next.fill(u64::MAX);
        Ok(())
    }

    fn memory(&self) -> u64 {
        match self.made.as_ref().map(|made| &made.engine) {
            Some(Engine::Stream(stream)) => stream.taken.0.ptr,
            _ => 0,
        }
    }

    fn frame(&self, held: &Held) -> DeviceResult {
        self.made.as_ref().map_or(Ok(()), |made| made.go(held))
    }

    fn goes_back(&self, _: &Batch) -> Result<(), StepError> {
        goes_back(&self.model)
    }

    fn keep(&mut self, batch: &Batch, frames: usize) -> Result<(), StepError> {
        let Some(made) = &mut self.made else { return Ok(()) };
        let back = match made.back.take().filter(|back| back.fits(frames)) {
            Some(back) => back,
            None => FramesBack::new(&self.model, batch, frames)?,
        };
        Ok(made.back.insert(back).join(&made.engine.network().device)?)
    }

    fn recall(&self, held: &Held, trail: Trail) -> DeviceResult {
        self.made.iter().flat_map(|made| &made.back).try_for_each(|back| back.recall(held, trail))
    }

    fn back(&self, held: &Held, trail: Trail, back: Back) -> DeviceResult {
        self.made.iter().flat_map(|made| &made.back).try_for_each(|all| all.back(held, trail, back))
    }

    fn reset(&mut self, env: usize) {
        if let Some(next) = self.made.as_mut().and_then(|made| made.next.get_mut(env)) {
            *next = u64::MAX;
        }
    }
}

impl Made {
    /// Clears the memory of each environment whose frame in `first` does not continue the remembered frames. `hold`:
    /// torques are constant over the frames.
    fn follow(&mut self, first: &[u64], hold: bool) -> DeviceResult {
        if let Engine::Stream(stream) = &mut self.engine {
            let begins = |(env, frame): (usize, &u64)| (*frame == 0 || self.next[env] != *frame).then_some(env);
            stream.forget(&first.iter().enumerate().filter_map(begins).collect_vec())?;
        }
        self.engine.network().device.write(&self.hold, &[u32::from(hold)])
    }

    /// Stores the number of the frame that would continue each environment.
    fn remember(&mut self, held: &Held, first: &[u64]) -> DeviceResult {
        let Engine::Stream(CudaStream { network: Network { device, .. }, .. }) = &self.engine else { return Ok(()) };
        let (went, faults) = (device.download(&held.done)?, device.download(&held.faults)?);
        for (env, next) in self.next.iter_mut().enumerate() {
            *next = if faults[env] == 0 { first[env] + u64::from(went[env]) } else { u64::MAX };
        }
        Ok(())
    }

    /// Steps one frame; from the second call on, launches a captured graph.
    fn go(&self, held: &Held) -> DeviceResult {
        self.replay
            .run(&self.engine.network().device, "frame", [held.torques.ptr, held.records.ptr], || self.frame(held))
    }

    /// Launches the kernels of one frame.
    fn frame(&self, held: &Held) -> DeviceResult {
        let Held { states, torques, records, scene_of, faults, done, n, .. } = held;
        let network = self.engine.network();
        let n = *n;
        let hold = &self.hold;
        let tokens = network.at(Slot(0));
        let predictions = network.predictions();
        let each = |kernel, threads, args: &[Arg]| network.device.launch_each(kernel, threads, BLOCK, args);
        match &self.engine {
            Engine::Stream(stream) => {
                let look = args![states, torques, records, scene_of, tokens, faults, done, n, hold];
                each("neural_tell", n * LANES, &look)?;
                stream.pass()?;
                each("neural_apply", n, &args![states, predictions, &stream.taken.0, faults, done, n])
            }
            Engine::Chain(_, weights, rods) => {
                let look = args![states, torques, records, scene_of, rods, tokens, faults, done, n, hold];
                each("chain_tell", n, &look)?;
                network.predict(weights.ptr, n)?;
                each("chain_apply", n, &args![states, rods, predictions, faults, done, n])
            }
        }
    }
}

impl Engine {
    fn network(&self) -> &Network {
        match self {
            Self::Stream(stream) => &stream.network,
            Self::Chain(network, ..) => network,
        }
    }
}
