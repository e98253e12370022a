//! The learned solver of chains: contacts, one pass of the network, one step of the rods.
//!
//! The solver has no memory: the next state is a function of state, torques and scene.

use nerd_sim::solver::{Fault, check, commit};
use rayon::prelude::*;

use super::{Chain, Look, NoChain, OUTPUTS, Outputs};
use crate::normalizer::{Moments, Normalizer};
use crate::prelude::*;
use crate::program::cpu::{Loaded, Memory, Pass};
use crate::transformer::Weights;

/// A chain's model as a [`Solver`].
pub struct ChainSolver {
    chain: Chain,
    network: Loaded,
    scale: [f64; OUTPUTS],
    /// Indices of the rows of a window that have predictions: all rods.
    rows: Vec<usize>,
    /// Working memory, one entry per thread.
    work: Vec<Work>,
    next: Vec<f64>,
    faults: Vec<Fault>,
}

#[derive(Default)]
struct Work {
    memory: Memory,
    tokens: Vec<f32>,
}

impl ChainSolver {
    /// A solver for `system`, with as many rods as in training. `normalizer` scales outputs; tokens are not normalised.
    pub fn new(weights: &Weights, normalizer: &Normalizer, system: &System) -> Result<Self, NoChain> {
        let chain = Chain::of(system)?;
        let wrong = |reason: String| NoChain { robot: system.name.clone(), reason };
        if weights.config.block != chain.rods {
            return Err(wrong(format!("it has {} rods, the network is of {}", chain.rods, weights.config.block)));
        }
        let scale = Self::scale(normalizer).map_err(wrong)?;
        let network = Loaded::new(weights.config.program(), &weights.flat);
        let rows = (0..chain.rods).collect();
        Ok(Self { chain, network, scale, rows, work: Vec::new(), next: Vec::new(), faults: Vec::new() })
    }

    /// The scale of each output. An error if the normaliser shifts or scales tokens, or shifts outputs: a chain's
    /// numbers are in fixed units, about 0.
    pub fn scale(normalizer: &Normalizer) -> Result<[f64; OUTPUTS], String> {
        let Normalizer { inputs, outputs } = normalizer;
        let scale: Vec<f64> = outputs.scale().collect();
        match scale.try_into() {
            Ok(scale) if *inputs == Moments::identity(inputs.mean.len()) && outputs.mean.iter().all(|m| *m == 0.0) => {
                Ok(scale)
            }
            _ => Err("its normaliser is of another kind of model".into()),
        }
    }
}

impl Solver for ChainSolver {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        check(batch, torques, &mut self.faults)?;
        let gravity = batch.system.gravity();
        let d = batch.system.robot.state_dim();
        let joints = batch.system.robot.joint_count();
        if joints != 6 + 2 * self.chain.rods {
            return Err(StepError::Solver(format!(
                "a chain of {} rods was learned, the robot has {joints} joints",
                self.chain.rods
            )));
        }
        for (env, scene) in batch.scenes.iter().enumerate() {
            if scene.gravity != gravity && self.faults.iter().all(|fault| fault.env != env) {
                let reason = format!("gravity {:?} (m/s^2) is not what was learned", scene.gravity.as_slice());
                self.faults.push(Fault { env, frame: batch.frames[env], reason });
            }
        }
        self.next.clear();
        self.next.extend_from_slice(&batch.states);
        let size = batch.len().div_ceil(rayon::current_num_threads()).max(1);
        self.work.resize_with(batch.len().div_ceil(size), Work::default);
        let chain = &self.chain;
        let network = &self.network;
        let scale = &self.scale;
        let rows = &self.rows;
        let before = &*batch;
        let aside = &self.faults;
        self.next.par_chunks_mut(size * d).zip(&mut self.work).enumerate().for_each(
            |(i, (next, Work { memory, tokens }))| {
                for (env, next) in (i * size..).zip(next.chunks_exact_mut(d)) {
                    if aside.iter().any(|fault| fault.env == env) {
                        continue;
                    }
                    let rods = chain.rods(before.state(env));
                    let look = Look::at(chain, &rods, &torques[env * joints..][..joints], |place| {
                        before.scenes[env].contact(place)
                    });
                    tokens.clear();
                    look.tokens(chain, &rods, tokens);
                    let numbers = network.forward(tokens, memory, Pass::Windows(chain.rods, rows));
                    chain.state(&chain.advance(&rods, &look.glided, Outputs { numbers, scale }), next);
                }
            },
        );
        commit(batch, &mut self.next, &mut self.faults)
    }
}
