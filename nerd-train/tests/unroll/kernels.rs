//! Kernels of training through rollouts against the CPU's, without a GPU: their text is compiled as C++ for the CPU.

use nerd_model::device::padded;
use nerd_train::unroll::chain::View;

pub use crate::common::models::{some, worse, worst as apart};
use crate::*;

const ROLLOUTS: usize = 24;
/// Index of the frame in its rollouts, and the weight of its loss.
const FRAME: usize = 3;
const WEIGHT: f64 = 0.7;

/// A state or a gradient as numbers.
fn numbers(rods: &Rods) -> Vec<f64> {
    rods.gripper.numbers().chain(rods.along.iter().chain(&rods.rates).flatten().copied()).collect()
}

/// Every kernel of an update in turn, for frame K of N rollouts. Inputs: rollouts at the start and at frame K, recorded
/// states and truths, torques, scenes. Then states, outputs, gradients by tokens and by later states. Results:
/// gradients by the states after and before, tokens, losses, contacts, gradients by outputs, and which rollouts are
/// near the truth.
const LAUNCHES: &str = "
#define WORLD_OF(rollouts) b[rollouts], b[3], b[4], b[5], FRAMES
#define EVERY for (blockIdx.x = 0; blockIdx.x < N; blockIdx.x++)
    gridDim.x = N;
    for (blockIdx.x = 0; blockIdx.x < COUNT; blockIdx.x++) unroll_truths(b[2], b[3], COUNT);
    EVERY unroll_begin(WORLD_OF(1), (double*)b[6] + K * N * WIDTH, 0);
    EVERY unroll_look(WORLD_OF(0), b[6], K, b[11]);
    EVERY unroll_advance(WORLD_OF(0), b[6], K, b[7]);
    EVERY unroll_behind(WORLD_OF(0), b[6], K, 1 + blockIdx.x, WEIGHT, b[9], b[12], b[11], b[13]);
    for (int i = 0; i < N * WIDTH; i++) ((double*)b[10])[i] = ((double*)b[9])[i];
    EVERY unroll_said(b[6], K, b[7], b[9], b[14]);
    EVERY unroll_back(WORLD_OF(0), b[6], K, b[7], b[13], b[8], b[9]);
    EVERY unroll_end(WORLD_OF(0), b[6], K + 1, b[15]);
";

/// Rollouts by kernels against the CPU's, from these starts. Largest differences of: states before and after a frame,
/// tokens, loss, its gradient, gradients by outputs and by the state before. Also returns the CPU's tokens.
fn apart_on_cpu(
    compiler: &cpp::Compiler,
    (body, system, motions): (&Cable, &Arc<System>, &Trajectories),
    starts: &[Place<View>],
) -> ([f64; 6], Vec<f64>) {
    let colliders = motions.scenes.iter().map(|scene| scene.colliders.len()).max().unwrap_or(0);
    let (rows, inputs, outputs, state) = (body.chain.rods, INPUTS, OUTPUTS, body.width());
    let gradient = numbers(&body.level()).len();
    let single = |n: usize, size: f64| some(n, size).into_iter().map(|x| x as f32).collect::<Vec<f32>>();
    let (predicted, by_tokens) = (single(ROLLOUTS * rows * outputs, 0.3), single(ROLLOUTS * rows * inputs, 0.01));
    let (upstreams, count) = (some(ROLLOUTS * state, 5.0), motions.count * (motions.frames + 1));
    let frames = (0..motions.count).flat_map(|i| (0..motions.frames).map(move |k| (i, k)));
    let seen: Vec<f64> = frames.flat_map(|(i, k)| motions.torques(i, k)[..6].to_vec()).collect();
    let scenes =
        motions.scenes.iter().flat_map(|scene| body.record(system, scene, colliders).expect("a scene with kernels"));
    let placed = |later: usize| {
        starts.iter().flat_map(|p| Cable::row(&Place { frame: p.frame + later, ..*p }, true)).collect::<Vec<f64>>()
    };
    let doubles = |numbers: &[f64]| cpp::bytes(numbers, f64::to_le_bytes);
    let zeros = |size: usize, numbers: usize| vec![0; size * ROLLOUTS * numbers];
    let read = [placed(0), placed(FRAME), motions.states.clone(), vec![0.0; count * state], seen, scenes.collect()];
    let mut buffers = read.map(|numbers| doubles(&numbers)).to_vec();
    let singles = [&predicted, &by_tokens].map(|numbers| cpp::bytes(numbers, f32::to_le_bytes));
    buffers.extend(
        [vec![zeros(8, (FRAME + 2) * state)], singles.into(), vec![doubles(&upstreams), zeros(8, state)]].concat(),
    );
    buffers.extend([
        zeros(4, rows * padded(inputs)),
        zeros(8, 1),
        zeros(8, 4 * rows),
        zeros(4, rows * outputs),
        zeros(4, 1),
    ]);
    let sizes = format!(
        "const int N = {ROLLOUTS}, K = {FRAME}, FRAMES = {}, WIDTH = {state}, COUNT = {count};",
        motions.frames
    );
    let launches = format!("{sizes}\nconst double WEIGHT = {WEIGHT};{LAUNCHES}");
    let found = compiler.launch(&body.program(system, colliders), &launches, &buffers);
    let wide = |x: Vec<f32>| x.into_iter().map(f64::from).collect::<Vec<f64>>();
    let [states, gradients, losses, fronts] = [6, 10, 12, 9].map(|k| cpp::doubles(&found[k]));
    let [tokens, by_outputs] = [11, 14].map(|k| wide(cpp::floats(&found[k])));

    let (mut worst, mut all_tokens) = ([0.0f64; 6], Vec::new());
    for (i, start) in starts.iter().enumerate() {
        let place = |k: usize| Place { frame: start.frame + k, ..*start };
        let (own, mut expected) = (body.truth(motions, &place(FRAME)), Vec::new());
        let look = body.look(&own, (motions, &place(FRAME)), &mut (), &mut expected);
        let predicted = &predicted[i * rows * outputs..][..rows * outputs];
        let moved = body.advance(&own, &look, predicted, &mut ());
        let truth = body.truth(motions, &place(FRAME + 1));
        let (mut all, mut upstream, mut front) = (body.level(), body.level(), body.level());
        let vectors = upstream.along.iter_mut().chain(&mut upstream.rates).flat_map(|v| v.iter_mut());
        upstream
            .gripper
            .numbers_mut()
            .chain(vectors)
            .zip(&upstreams[i * state..][..gradient])
            .for_each(|(x, n)| *x = *n);
        let cost = body.loss([&moved, &truth], FRAME + 1, WEIGHT, &mut all);
        body.join(&mut all, &upstream, 1 + i);
        let wanted = body.advance_back(&own, predicted, &all, &mut front);
        body.look_back(&own, &look, &by_tokens[i * rows * inputs..][..rows * inputs], &all, &mut front, &mut ());
        let seen = tokens[i * rows * padded(inputs)..][..rows * padded(inputs)].chunks(padded(inputs));
        let seen: Vec<f64> = seen.flat_map(|token| token[..inputs].to_vec()).collect();
        let expected = wide(expected);
        let after = |frame: usize, now: &Rods| apart(&states[(frame * ROLLOUTS + i) * state..][..state], &numbers(now));
        let off = [
            worse(after(FRAME, &own), after(FRAME + 1, &moved)),
            apart(&seen, &expected),
            apart(&losses[i..][..1], &[cost]),
            apart(&gradients[i * state..][..gradient], &numbers(&all)),
            apart(&by_outputs[i * rows * outputs..][..rows * outputs], &wide(wanted)),
            apart(&fronts[i * state..][..gradient], &numbers(&front)),
        ];
        worst.iter_mut().zip(off).for_each(|(worst, off)| *worst = worse(*worst, off));
        assert_eq!(found[15][4 * i] != 0, body.near(&moved, &truth), "rollout {i}");
        all_tokens.extend(expected);
    }
    (worst, all_tokens)
}

#[test]
fn kernels_roll_cables_out_and_back_as_the_cpu_does() {
    let Some(compiler) = cpp::Compiler::find() else { return };
    let system = System::named("lead-pegs").expect("built in");
    let chain = Chain::of(&system).expect("a chain");
    let config = GenerateConfig { transitions: 6 * 60, frames: 60, seed: 3, ..GenerateConfig::default() };
    let solver =
        || -> Box<dyn Solver> { Box::new(Articulated::new(ArticulatedConfig::implicit(4, Friction::Coulomb))) };
    let motions = motions(&system, &solver, &config, &|_| ()).expect("motions");
    let (normalizer, velocity) = scales(&chain, &motions);
    let scale = ChainSolver::scale(&normalizer).expect("a chain's");
    let body = Cable { chain, scale, loss: Loss::new(&scale, velocity, 16) };
    let start = |k: usize| Place { motion: k % 6, frame: 2 * k, view: View::new(0.4 * k as f64, k.is_multiple_of(2)) };
    let starts: Vec<_> = (0..ROLLOUTS).map(start).collect();
    let (worst, tokens) = apart_on_cpu(&compiler, (&body, &system, &motions), &starts);
    let touching = tokens.as_chunks::<INPUTS>().0.iter().filter(|token| token[17] > 0.0).count();
    println!(
        "{touching} ends of rods near a surface; states, tokens, loss, its gradients, by outputs, by the chain: {worst:?} off"
    );
    // Rounding of f64, and of f32.
    let bounds = [1e-9, 1e-6, 1e-9, 1e-9, 1e-6, 1e-9];
    assert!(touching > 100 && worst.iter().zip(bounds).all(|(off, most)| *off < most), "{touching}, {worst:?}");
}
