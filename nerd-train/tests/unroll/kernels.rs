//! The kernels of rollouts against the CPU's, without a device: their text is compiled as C++ and run on the CPU.

use nerd_model::chain::{Chain, ChainSolver, INPUTS, OUTPUTS, Rods, numbers};
use nerd_model::device::padded;
use nerd_sim::articulated::device::{Reach, record};
use nerd_sim::dataset::GenerateConfig;
use nerd_sim::prelude::*;
use nerd_train::unroll::chain::{Cable, Loss, View, scales};
use nerd_train::unroll::{Body, Motions, OnCard, Place};

use crate::cpp;

const ROLLOUTS: usize = 24;
/// Frame whose loss is counted, counted from 0; the share of it that the program takes, too.
const FRAME: usize = 3;
const WEIGHT: f64 = 0.7;

fn flat(rods: &Rods) -> Vec<f64> {
    let vectors = rods.along.iter().chain(&rods.rates).flat_map(|v| [v.x, v.y, v.z]);
    rods.gripper.numbers().chain(vectors).collect()
}

/// Numbers about 0 of about this size, always the same.
pub fn some(n: usize, size: f64) -> Vec<f64> {
    (0..n).map(|k| size * (1.7 * k as f64 + 0.3).sin()).collect()
}

/// The larger of two; what is not a number is the worst.
pub fn worse(most: f64, off: f64) -> f64 {
    if off > most || off.is_nan() { off } else { most }
}

/// Largest difference, as a share of the largest of the expected numbers or of 1.
pub fn apart(found: &[f64], expected: &[f64]) -> f64 {
    assert_eq!(found.len(), expected.len());
    let largest = expected.iter().fold(1e-9, |most: f64, x| most.max(x.abs()));
    found.iter().zip(expected).map(|(a, b)| (a - b).abs() / largest).fold(0.0, worse)
}

/// What a program wrote, read in order.
pub struct Output<'a> {
    pub bytes: &'a [u8],
}

impl Output<'_> {
    fn next(&mut self, bytes: usize) -> &[u8] {
        let (now, later) = self.bytes.split_at(bytes);
        self.bytes = later;
        now
    }

    pub fn doubles(&mut self, count: usize) -> Vec<f64> {
        self.next(8 * count).as_chunks::<8>().0.iter().map(|b| f64::from_le_bytes(*b)).collect()
    }

    pub fn floats(&mut self, count: usize) -> Vec<f64> {
        self.next(4 * count).as_chunks::<4>().0.iter().map(|b| f64::from(f32::from_le_bytes(*b))).collect()
    }
}

#[test]
fn kernels_roll_out_and_back_as_the_cpu_does() {
    let Some(compiler) = cpp::Compiler::find() else { return };
    let system = System::named("lead-pegs").expect("built in");
    let chain = Chain::of(&system).expect("a chain");
    let config = GenerateConfig { transitions: 6 * 60, frames: 60, seed: 3, ..GenerateConfig::default() };
    let solver = || -> Box<dyn Solver> { Box::new(Articulated::new(ArticulatedConfig::implicit(4, Friction::Coulomb))) };
    let motions = Motions::record(&system, &solver, &config, &|_| ()).expect("motions");
    let (normalizer, velocity) = scales(&chain, &motions);
    let scale = ChainSolver::scale(&normalizer).expect("a chain's");
    let body = Cable { chain, scale, loss: Loss::new(&scale, velocity, 16) };
    let chain = &body.chain;
    let colliders = motions.scenes.iter().map(|scene| scene.colliders.len()).max().unwrap_or(0);

    let starts: Vec<(usize, usize, View)> = (0..ROLLOUTS).map(|k| (k % 6, 2 * k, View::new(0.4 * k as f64, k % 2 == 0))).collect();
    let outputs: Vec<f32> = some(ROLLOUTS * chain.rods * OUTPUTS, 0.3).into_iter().map(|x| x as f32).collect();
    let by_tokens: Vec<f32> = some(ROLLOUTS * chain.rods * INPUTS, 0.01).into_iter().map(|x| x as f32).collect();
    let upstreams = some(ROLLOUTS * numbers(chain), 5.0);
    let head = [ROLLOUTS, motions.len(), motions.frames, FRAME];
    let mut input: Vec<u8> = head.iter().flat_map(|x| (*x as i32).to_le_bytes()).collect();
    let rows = starts.iter().flat_map(|(motion, frame, view)| Cable::row(&Place { motion: *motion, frame: *frame, view: *view }, true));
    let (all, settings) = (0..motions.len(), ArticulatedConfig::implicit(1, Friction::Coulomb));
    let states = all.clone().flat_map(|i| (0..=motions.frames).flat_map(|k| motions.state(i, k).to_vec()).collect::<Vec<_>>());
    let torques = all.flat_map(|i| (0..motions.frames).flat_map(|k| motions.torques(i, k)[..6].to_vec()).collect::<Vec<_>>());
    let reach = Reach { colliders, ..Reach::default() };
    let scenes = motions.scenes.iter().flat_map(|scene| record(scene, &system, &settings, reach).expect("a scene with kernels"));
    input.extend(rows.chain(states).chain(torques).chain(scenes).flat_map(f64::to_le_bytes));
    input.extend(outputs.iter().chain(&by_tokens).flat_map(|x| x.to_le_bytes()));
    input.extend(upstreams.iter().flat_map(|x| x.to_le_bytes()));
    let output = compiler.run(&body.program(&system, ROLLOUTS, colliders).expect("it has kernels"), input);
    let mut output = Output { bytes: &output };
    let (wide, tokens_wide, outputs_wide) = (numbers(chain), chain.rods * padded(INPUTS), chain.rods * OUTPUTS);
    let (before, after) = (output.doubles(ROLLOUTS * wide), output.doubles(ROLLOUTS * wide));
    let (tokens, judged) = (output.floats(ROLLOUTS * tokens_wide), output.doubles(2 * ROLLOUTS));
    let (slopes, by_outputs, fronts) =
        (output.doubles(ROLLOUTS * wide), output.floats(ROLLOUTS * outputs_wide), output.doubles(ROLLOUTS * wide));

    let (mut worst, mut touching) = ([0.0f64; 7], 0);
    for (i, (motion, frame, view)) in starts.into_iter().enumerate() {
        let place = |k: usize| Place { motion, frame: frame + k, view };
        let truth = |k: usize| body.truth(&motions, &place(k));
        let (own, mut expected) = (truth(FRAME), Vec::new());
        let look = body.look(&own, &motions, &place(FRAME), &mut (), &mut expected);
        touching += expected.as_chunks::<INPUTS>().0.iter().filter(|token| token[17] > 0.0).count();
        let predicted = &outputs[i * outputs_wide..][..outputs_wide];
        let moved = body.advance(&own, &look, predicted, &mut ());
        let mut upstream = Rods::zeros(chain.rods);
        let given = &upstreams[i * wide..][..wide];
        upstream.gripper.numbers_mut().zip(given).for_each(|(x, g)| *x = *g);
        let vectors = upstream.along.iter_mut().chain(&mut upstream.rates).flat_map(|v| v.iter_mut());
        vectors.zip(&given[12..]).for_each(|(x, g)| *x = *g);
        let mut all = Rods::zeros(chain.rods);
        let cost = body.loss([&moved, &truth(FRAME + 1)], FRAME + 1, WEIGHT, &mut all);
        body.join(&mut all, &upstream, 1 + i);
        let mut front = Rods::zeros(chain.rods);
        let wanted = body.advance_back(&own, &look, predicted, &all, &mut front);
        body.look_back(&own, &look, &by_tokens[i * chain.rods * INPUTS..][..chain.rods * INPUTS], &all, &mut front, &mut ());

        let seen: Vec<f64> =
            tokens[i * tokens_wide..][..tokens_wide].chunks(padded(INPUTS)).flat_map(|token| token[..INPUTS].to_vec()).collect();
        let expected: Vec<f64> = expected.into_iter().map(f64::from).collect();
        let wanted: Vec<f64> = wanted.into_iter().map(f64::from).collect();
        let [a, b, c, d] = [&before, &after, &slopes, &fronts].map(|all| &all[i * wide..][..wide]);
        let found = [
            apart(a, &flat(&own)),
            apart(b, &flat(&moved)),
            apart(&seen, &expected),
            apart(&judged[2 * i..][..1], &[cost]),
            apart(c, &flat(&all)),
            apart(&by_outputs[i * outputs_wide..][..outputs_wide], &wanted),
            apart(d, &flat(&front)),
        ];
        worst.iter_mut().zip(found).for_each(|(worst, found)| *worst = worse(*worst, found));
        let nodes = |rods: &Rods| chain.nodes(rods)[0].clone();
        let mean = nodes(&moved).iter().zip(nodes(&truth(FRAME + 1))).map(|(a, b)| (a - b).norm()).sum::<f64>() / chain.rods as f64;
        assert_eq!(judged[2 * i + 1] != 0.0, mean <= 0.03, "rollout {i} is {mean} m off");
    }
    println!("{touching} ends of rods near a surface; before, after, tokens, loss, its slopes, by outputs, by the chain: {worst:?} off");
    let exact = [worst[0], worst[1], worst[3], worst[4], worst[6]].into_iter().fold(0.0, f64::max);
    assert!(touching > 100 && exact < 1e-9 && worst[2].max(worst[5]) < 1e-6, "{touching}, {worst:?}");
    assert!(output.bytes.is_empty());
}
