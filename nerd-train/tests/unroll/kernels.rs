//! The kernels of rollouts against the CPU's, without a device: their text is compiled as C++ and run on the CPU.

use nerd_model::device::padded;
use nerd_train::unroll::chain::View;

pub use crate::common::models::{some, worse, worst as apart};
use crate::*;

/// Rollouts of a body that are compared.
pub const ROLLOUTS: usize = 24;
/// Frame whose loss is counted, counted from 0; the share of it that the programs take, too.
const FRAME: usize = 3;
const WEIGHT: f64 = 0.7;

/// A state or a slope as numbers.
pub trait Numbers {
    fn numbers(&self) -> Vec<f64>;
    fn set(&mut self, numbers: &[f64]);
}

impl Numbers for Vec<f64> {
    fn numbers(&self) -> Vec<f64> {
        self.clone()
    }

    fn set(&mut self, numbers: &[f64]) {
        self.copy_from_slice(numbers);
    }
}

impl Numbers for Rods {
    fn numbers(&self) -> Vec<f64> {
        let vectors = self.along.iter().chain(&self.rates).flat_map(|v| [v.x, v.y, v.z]);
        self.gripper.numbers().chain(vectors).collect()
    }

    fn set(&mut self, numbers: &[f64]) {
        let vectors = self.along.iter_mut().chain(&mut self.rates).flat_map(|v| v.iter_mut());
        self.gripper.numbers_mut().chain(vectors).zip(numbers).for_each(|(x, n)| *x = *n);
    }
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

/// A body's rollouts by its kernels against the CPU's, from these places on: largest differences of the state after a frame, its tokens,
/// the loss, its slopes, those by outputs and by the state before; and the CPU's tokens. Some programs tell that state, too, which is then
/// part of the first, and whether the next is near the truth. `rows` tokens have so many `inputs` and `outputs`.
pub fn apart_on_cpu<B: Body<State: Numbers, Slope: Numbers>>(
    compiler: &cpp::Compiler,
    (body, system, motions): (&B, &Arc<System>, &Motions),
    starts: &[Place<B::View>],
    (rows, inputs, outputs): (usize, usize, usize),
    told: bool,
) -> ([f64; 6], Vec<f64>) {
    let colliders = motions.scenes.iter().map(|scene| scene.colliders.len()).max().unwrap_or(0);
    let (state, slope) = (body.truth(motions, &starts[0]).numbers().len(), body.level().numbers().len());
    let single = |n: usize, size: f64| some(n, size).into_iter().map(|x| x as f32).collect::<Vec<f32>>();
    let (predicted, by_tokens) = (single(ROLLOUTS * rows * outputs, 0.3), single(ROLLOUTS * rows * inputs, 0.01));
    let upstreams = some(ROLLOUTS * slope, 5.0);
    let head = [ROLLOUTS, motions.len(), motions.frames, FRAME];
    let mut input: Vec<u8> = head.iter().flat_map(|x| (*x as i32).to_le_bytes()).collect();
    let frames = (0..motions.len()).flat_map(|i| (0..motions.frames).map(move |k| (i, k)));
    let torques = frames.flat_map(|(i, k)| motions.torques(i, k)[..body.widths().torques].to_vec());
    let scenes = motions.scenes.iter().flat_map(|scene| body.record(system, scene, colliders).expect("a scene with kernels"));
    let placed = starts.iter().flat_map(|place| B::row(place, true));
    input.extend(placed.chain(motions.states().iter().copied()).chain(torques).chain(scenes).flat_map(f64::to_le_bytes));
    input.extend(predicted.iter().chain(&by_tokens).flat_map(|x| x.to_le_bytes()));
    input.extend(upstreams.iter().flat_map(|x| x.to_le_bytes()));
    let output = compiler.run(&body.program(system, ROLLOUTS, colliders), input);
    let mut output = Output { bytes: &output };
    let judgements = if told { 2 } else { 1 };
    let before = told.then(|| output.doubles(ROLLOUTS * state));
    let after = output.doubles(ROLLOUTS * state);
    let (tokens, judged) = (output.floats(ROLLOUTS * rows * padded(inputs)), output.doubles(ROLLOUTS * judgements));
    let slopes = output.doubles(ROLLOUTS * slope);
    let (by_outputs, fronts) = (output.floats(ROLLOUTS * rows * outputs), output.doubles(ROLLOUTS * slope));
    assert!(output.bytes.is_empty());

    let wide = |x: Vec<f32>| x.into_iter().map(f64::from).collect::<Vec<f64>>();
    let (mut worst, mut all_tokens, mut memory) = ([0.0f64; 6], Vec::new(), body.memory());
    for (i, start) in starts.iter().enumerate() {
        let place = |k: usize| Place { frame: start.frame + k, ..*start };
        let (own, mut expected) = (body.truth(motions, &place(FRAME)), Vec::new());
        let look = body.look(&own, (motions, &place(FRAME)), &mut memory, &mut expected);
        let predicted = &predicted[i * rows * outputs..][..rows * outputs];
        let moved = body.advance(&own, &look, predicted, &mut memory);
        let truth = body.truth(motions, &place(FRAME + 1));
        let (mut all, mut upstream, mut front) = (body.level(), body.level(), body.level());
        upstream.set(&upstreams[i * slope..][..slope]);
        let cost = body.loss([&moved, &truth], FRAME + 1, WEIGHT, &mut all);
        body.join(&mut all, &upstream, 1 + i);
        let wanted = body.advance_back(&own, predicted, &all, &mut front);
        body.look_back(&own, &look, &by_tokens[i * rows * inputs..][..rows * inputs], &all, &mut front, &mut memory);
        let seen = tokens[i * rows * padded(inputs)..][..rows * padded(inputs)].chunks(padded(inputs));
        let seen: Vec<f64> = seen.flat_map(|token| token[..inputs].to_vec()).collect();
        let expected = wide(expected);
        let begun = before.as_ref().map_or(0.0, |before| apart(&before[i * state..][..state], &own.numbers()));
        let found = [
            worse(begun, apart(&after[i * state..][..state], &moved.numbers())),
            apart(&seen, &expected),
            apart(&judged[judgements * i..][..1], &[cost]),
            apart(&slopes[i * slope..][..slope], &all.numbers()),
            apart(&by_outputs[i * rows * outputs..][..rows * outputs], &wide(wanted)),
            apart(&fronts[i * slope..][..slope], &front.numbers()),
        ];
        worst.iter_mut().zip(found).for_each(|(worst, found)| *worst = worse(*worst, found));
        assert!(!told || (judged[2 * i + 1] != 0.0) == body.near(&moved, &truth), "rollout {i}");
        all_tokens.extend(expected);
    }
    (worst, all_tokens)
}

/// Whether these are roundings: of numbers of 64 bits, and of 32.
pub fn exact([after, tokens, loss, slopes, by_outputs, front]: [f64; 6], most: f64) -> bool {
    [after, loss, slopes, front].into_iter().fold(0.0, worse) < most && worse(tokens, by_outputs) < 1e-6
}

#[test]
fn kernels_roll_cables_out_and_back_as_the_cpu_does() {
    let Some(compiler) = cpp::Compiler::find() else { return };
    let system = System::named("lead-pegs").expect("built in");
    let chain = Chain::of(&system).expect("a chain");
    let config = GenerateConfig { transitions: 6 * 60, frames: 60, seed: 3, ..GenerateConfig::default() };
    let solver = || -> Box<dyn Solver> { Box::new(Articulated::new(ArticulatedConfig::implicit(4, Friction::Coulomb))) };
    let motions = Motions::record(&system, &solver, &config, &|_| ()).expect("motions");
    let (normalizer, velocity) = scales(&chain, &motions);
    let scale = ChainSolver::scale(&normalizer).expect("a chain's");
    let body = Cable { chain, scale, loss: Loss::new(&scale, velocity, 16) };
    let start = |k: usize| Place { motion: k % 6, frame: 2 * k, view: View::new(0.4 * k as f64, k.is_multiple_of(2)) };
    let starts: Vec<_> = (0..ROLLOUTS).map(start).collect();
    let shape = (body.chain.rods, INPUTS, OUTPUTS);
    let (worst, tokens) = apart_on_cpu(&compiler, (&body, &system, &motions), &starts, shape, true);
    let touching = tokens.as_chunks::<INPUTS>().0.iter().filter(|token| token[17] > 0.0).count();
    println!("{touching} ends of rods near a surface; states, tokens, loss, its slopes, by outputs, by the chain: {worst:?} off");
    assert!(touching > 100 && exact(worst, 1e-9), "{touching}, {worst:?}");
}
