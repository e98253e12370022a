//! Errors of a chain's network: over whole motions and over single frames.

use nerd_model::chain::ChainSolver;

use super::*;

/// Mean distance of predicted nodes from the true nodes (m), over rollouts of all whole motions. Infinite if the solver
/// fails in a motion.
///
/// # Errors
/// If the robot is not a chain, or the network is not for its number of rods.
pub fn distance(
    system: &Arc<System>,
    motions: &Trajectories,
    weights: &Weights,
    normalizer: &Normalizer,
) -> Result<f64> {
    let chain = Chain::of(system)?;
    let mut solver = ChainSolver::new(weights, normalizer, system)?;
    if motions.count == 0 {
        return Ok(f64::INFINITY);
    }
    let mut batch = motions.begun(system);
    let mut total = 0.0;
    for frame in 0..motions.frames {
        let torques = motions.torques_at(frame);
        match solver.step(&mut batch, &torques) {
            Err(StepError::Environments(_)) => return Ok(f64::INFINITY),
            done => done?,
        }
        let off = |i: usize| {
            let [reached, truth] = [batch.state(i), motions.state(i, frame + 1)].map(|state| chain.rods(state));
            apart(&chain, &reached, &truth) / chain.rods as f64
        };
        // Sum in order, so that the bits do not depend on the number of threads.
        total += (0..motions.count).into_par_iter().map(off).collect::<Vec<_>>().iter().sum::<f64>();
    }
    Ok(total / (motions.count * motions.frames) as f64)
}

/// Sum over all nodes of the distance between their positions in `a` and in `b` (m).
pub(super) fn apart(chain: &Chain, a: &Rods, b: &Rods) -> f64 {
    let ([a, _], [b, _]) = (chain.nodes(a), chain.nodes(b));
    a.iter().zip(&b).map(|(a, b)| (a - b).norm()).sum()
}

/// Error of predicted rod rates after one frame, relative to their true change over the frame. Taken at `frames` evenly
/// spaced frames.
pub(super) fn missed(
    chain: &Chain,
    motions: &Trajectories,
    network: &Loaded,
    scale: &[f64; OUTPUTS],
    frames: usize,
) -> f64 {
    ratio(motions, frames, Memory::default, |memory, motion, frame| {
        let before = chain.rods(motions.state(motion, frame));
        let truth = chain.rods(motions.state(motion, frame + 1));
        let look =
            Look::at(chain, &before, motions.torques(motion, frame), |place| motions.scenes[motion].contact(place));
        let mut tokens = Vec::new();
        look.tokens(chain, &before, &mut tokens);
        let all = (0..chain.rods).collect_vec();
        let numbers = network.forward(&tokens, memory, Pass::Windows(chain.rods, &all));
        let after = chain.advance(&before, &look.glided, Outputs { numbers, scale });
        let off =
            |a: &[nalgebra::Vector3<f64>]| a.iter().zip(&truth.rates).map(|(a, b)| (a - b).abs().sum()).sum::<f64>();
        (off(&after.rates), off(&before.rates))
    })
}
