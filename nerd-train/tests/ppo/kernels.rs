//! Kernels of PPO's rollouts against the CPU's engine, without a GPU: their text is compiled as C++ for the CPU.

use nerd_sim::articulated::device::RANDOM;

use crate::*;

/// Environments, sizes of an observation and of an action, steps. N A is odd, so that a draw of two numbers may span
/// two rows.
const N: usize = 37;
const SEEN: usize = 5;
/// Stride of rows on the GPU.
const PADDED: usize = 8;
const A: usize = 3;
const HORIZON: usize = 6;
/// Discount and lambda (the constant of GAE), the step with an action, its noise stream, and the number of partial
/// sums.
const LAW: (f64, f64) = (0.97, 0.95);
const STEP: usize = 4;
const NOISE: (u64, u64) = (0x1234_5678_9abc_def0, (1 << 40) + 7);
const PARTS: usize = 7;

/// Names that the kernels' text expects.
const NAMES: &str = "
typedef unsigned long long u64;
#define __device__
#define FN static inline
#define INDEX ((u64)blockIdx.x)
";
/// Every kernel in turn, over a few more threads than it has work for. An environment is truncated at most twice.
const LAUNCHES: &str = "
#define RUN(threads, call) for (blockIdx.x = 0; blockIdx.x < (threads) + 5; blockIdx.x++) call;
    const int STEPS = N * HORIZON, SLOTS = 2;
    const u64 *key = b[0], later = 3, first = key[4] - later;
    const double* law = b[1];
    float *means = b[12], *slow = b[31];
    RUN(STEPS * SEEN, normalize(b[2], b[3], b[4], b[11], STEPS * SEEN, SEEN, PADDED))
    RUN(N, act(b[8], b[9], key[0], key[1], key[2], key[3], &first, later, law, means, b[13], b[14], b[15], b[20], b[16], N, A, A + 1))
    RUN(N, gae(b[5], b[10], b[6], b[7], b[21], N, HORIZON, law[2], law[3]))
    RUN(PARTS * SEEN, columns(b[2], nullptr, STEPS, SEEN, PARTS, b[22]))
    RUN(SEEN, mean(b[22], STEPS, SEEN, PARTS, b[23]))
    RUN(PARTS * SEEN, columns(b[2], b[23], STEPS, SEEN, PARTS, b[22]))
    RUN(SEEN, mean(b[22], STEPS, SEEN, PARTS, b[24]))
    RUN(STEPS, loss_inputs(b[21], b[6], STEPS, law[4], law[5], law[6], law[7], law[8], law[9], b[17], b[18], b[19]))
    RUN(N, reached(b[10], b[27], N, HORIZON, SLOTS))
    RUN(N, shac_ahead(b[5], b[10], b[32], law, b[25], b[28], b[30], b[26], b[29], N, HORIZON, SLOTS, A, A + 1, law[2], law[3]))
    for (int i = 0; i < N * A; i++) slow[i] = means[i];
    RUN(N * A, shac_follow(slow, b[13], 0.25f, N * A))
";

/// A rollout of the CPU's engine: rewards, ends, values of truncated and last states, and the bounded actions of one
/// step.
struct Rolled {
    policy: Policy,
    engine: OnCpu,
    rewards: Vec<f64>,
    ends: Vec<u8>,
    cut: Vec<f64>,
    last: Vec<f64>,
    kept: Vec<f64>,
}

fn rolled() -> Rolled {
    let mut rng = stream(2, 0);
    let mut draw =
        |n: usize, by: f64| -> Vec<f64> { (0..n).map(|k| 0.5 * k as f64 % 3.0 + by * normal(&mut rng)).collect() };
    let mut policy = crate::policy(SEEN, 1, A, &[8], Activation::Elu);
    let inner = policy.flat.len() - A;
    policy.flat[inner..].copy_from_slice(&[0.2, -0.4, 0.1]);
    policy.seen.update(&draw(200 * SEEN, 2.0));
    policy.returns.update(&draw(200, 3.0));
    let (mut engine, mut actions, mut kept) = (OnCpu::default(), Vec::new(), Vec::new());
    let (mut rewards, mut ends, mut cut) = (Vec::new(), Vec::new(), vec![f64::NAN; N * HORIZON]);
    engine.begin(&policy).expect("the CPU");
    for t in 0..HORIZON {
        engine
            .act(
                &draw(N * SEEN, 4.0),
                StreamKey { seed: NOISE.0, number: NOISE.1 - STEP as u64 + t as u64 },
                &mut actions,
            )
            .expect("the CPU");
        if t == STEP {
            kept.clone_from(&actions);
        }
        let ended: Vec<u8> = (0..N).map(|env| [0, 0, 1, 0, 2, 0, 0][(env + 3 * t) % 7]).collect();
        let reached: Vec<Vec<f64>> = ended.iter().filter(|end| **end == 2).map(|_| draw(SEEN, 2.0)).collect();
        for (row, env) in reached.iter().zip((0..N).filter(|env| ended[*env] == 2)) {
            cut[t * N + env] = policy.values(&policy.answer(row))[0];
        }
        let truncated: Vec<bool> = ended.iter().map(|end| *end == 2).collect();
        rewards.extend(draw(N, 1.0));
        engine.arrive(&reached.concat(), &truncated).expect("the CPU");
        ends.extend(ended);
    }
    let rows = draw(N * SEEN, 4.0);
    let law = PpoConfig { gamma: LAW.0, ..PpoConfig::default() };
    engine.finish(&rows, &rewards, &ends, &law).expect("the CPU");
    let last = policy.values(&policy.answer(&rows));
    Rolled { engine, rewards, ends, cut, last, kept, policy }
}

fn scale(moments: &RunningMoments, k: usize) -> f64 {
    moments.restore(k, 1.0) - moments.restore(k, 0.0)
}

fn near(what: &str, found: &[f64], expected: &[f64], most: f64) {
    assert_eq!(found.len(), expected.len(), "{what}");
    let apart = found.iter().zip(expected).map(|(a, b)| (a - b).abs() / (1.0 + b.abs())).fold(0.0, f64::max);
    assert!(apart <= most, "{what}: {apart:.1e} apart, at most {most:.1e}");
}

#[test]
fn kernels_answer_and_judge_as_the_cpu_does() {
    let Some(compiler) = cpp::Compiler::find() else { return };
    let text = [
        NAMES,
        RANDOM,
        include_str!("../../src/ppo/cuda/acting.cu"),
        include_str!("../../src/ppo/cuda/shac/kernels.cu"),
    ]
    .concat();
    let Rolled { policy, engine, rewards, ends, cut, last, kept } = rolled();
    let (r, steps) = (&engine.rollout, N * HORIZON);
    let returns: Vec<f64> = r.advantages.iter().zip(&r.values).map(|(a, v)| a + v).collect();
    let average = |x: &mut dyn Iterator<Item = f64>| x.sum::<f64>() / steps as f64;
    let mean = average(&mut r.advantages.iter().copied());
    let spread = average(&mut r.advantages.iter().map(|a| (a - mean).powi(2))).sqrt() + 1e-8;
    let mut moved = policy.returns.clone();
    moved.update(&returns);
    let units = |m: &RunningMoments| [m.mean[0], scale(m, 0)];
    let laws = [units(&policy.returns), [LAW.0, LAW.1], [mean, spread], units(&moved), units(&policy.returns)].concat();
    let columns = &policy.seen;
    let inverse: Vec<f64> = (0..SEEN).map(|k| scale(columns, k).recip()).collect();
    let values = [&r.values[..], &last].concat();
    let said = policy.answer(&r.observations[STEP * N * SEEN..][..N * SEEN]);
    let rows = said.mean.chunks(A).zip(&said.value).flat_map(|(mean, value)| mean.iter().chain([value]));

    let key = [stream(NOISE.0, NOISE.1).get_seed().to_vec(), NOISE.1.to_le_bytes().to_vec()].concat();
    let numbers = [&laws, &r.observations, &columns.mean, &inverse, &rewards, &values, &cut]
        .map(|x| cpp::bytes(x, f64::to_le_bytes));
    let said = cpp::bytes(&rows.copied().collect::<Vec<f32>>(), f32::to_le_bytes);
    let given =
        [vec![key], numbers.into(), vec![said, cpp::bytes(policy.spread(), f32::to_le_bytes), ends.clone()]].concat();
    let singles = [steps * PADDED, N * A, N * A, N * A, N, N * A, steps, steps, steps].map(|n| vec![0; 4 * n]);
    let wide = [N, 2 * steps, PARTS * SEEN, SEEN, SEEN, steps, N].map(|n| vec![0; 8 * n]);
    // Memory that is not written is not zero.
    let rest = [3 * N, steps, N, 3 * N * (A + 1), N * A].map(|n| vec![0x40; 4 * n]);
    let all = cpp::bytes(&[&values[..], &cut].concat(), f64::to_le_bytes);
    let buffers = [given, singles.into(), wide.into(), rest.into(), vec![all]].concat();
    let sizes =
        format!("const int N = {N}, SEEN = {SEEN}, A = {A}, HORIZON = {HORIZON}, PARTS = {PARTS}, PADDED = {PADDED};");
    let found = compiler.launch(&text, &(sizes + LAUNCHES), &buffers);
    let double = |k: usize| cpp::doubles(&found[k]);
    let single = |k: usize| cpp::floats(&found[k]).into_iter().map(f64::from).collect::<Vec<f64>>();
    let f64s = |x: &[f32]| x.iter().copied().map(f64::from).collect::<Vec<_>>();
    let at = |x: &[f32]| f64s(&x[STEP * N * A..][..N * A]);

    let mut seen = Vec::new();
    policy.seen.rows(&r.observations, &mut seen);
    let seen: Vec<f64> = seen.chunks(SEEN).flat_map(|row| f64s(&[row, &[0.0; PADDED - SEEN]].concat())).collect();
    near("inputs", &single(11), &seen, 1e-6);
    near("means", &single(12), &at(&r.mean), 0.0);
    near("spreads", &single(13), &at(&r.spread), 0.0);
    near("actions", &single(14), &at(&r.actions), 1e-6);
    near("neg_log_prob", &single(15), &f64s(&r.neg_log_prob[STEP * N..][..N]), 1e-5);
    near("actions kept within their bounds", &single(16), &kept, 1e-6);
    let by = |x: &[f64], mean: f64, scale: f64| x.iter().map(|x| (x - mean) / scale).collect::<Vec<_>>();
    near("advantages, normalised", &single(17), &by(&r.advantages, mean, spread), 1e-6);
    let normalised = |x: &[f64], m: &RunningMoments| x.iter().map(|x| m.normalize(0, *x)).collect::<Vec<_>>();
    near("value targets", &single(18), &normalised(&returns, &moved), 1e-6);
    near("values, normalised", &single(19), &normalised(&r.values, &policy.returns), 1e-6);
    near("values", &double(20), &r.values[STEP * N..][..N], 1e-12);
    let both: Vec<f64> = r.advantages.iter().zip(&returns).flat_map(|(a, r)| [*a, *r]).collect();
    near("advantages and returns", &double(21), &both, 1e-12);
    let of = |k: usize, about: f64, power: i32| {
        average(&mut r.observations.iter().skip(k).step_by(SEEN).map(|x| (x - about).powi(power)))
    };
    let means: Vec<f64> = (0..SEEN).map(|k| of(k, 0.0, 1)).collect();
    near("means of columns", &double(23), &means, 1e-12);
    near("variances of columns", &double(24), &(0..SEEN).map(|k| of(k, means[k], 2)).collect::<Vec<_>>(), 1e-12);
    let ahead = Ahead::of(&rewards, &ends, [&values, &cut], units(&policy.returns)[1]);
    near("what rewards count", &double(25), &ahead.shares, 1e-12);
    near("J by environment", &double(26), &ahead.earned, 1e-12);
    let whole = found[27..30].concat().as_chunks().0.iter().map(|b| i32::from_le_bytes(*b)).collect::<Vec<_>>();
    assert_eq!(
        whole,
        [&ahead.which[..], &ahead.asked, &[0; N]].concat(),
        "where values go, rows that are asked for, environments without gradients"
    );
    near("gradients by values", &single(30), &ahead.by, 1e-6);
    let (mean, spread) = (at(&r.mean), at(&r.spread));
    let followed: Vec<f64> = mean.iter().zip(spread).map(|(slow, now)| 0.25 * slow + 0.75 * now).collect();
    near("the slower critic", &single(31), &followed, 1e-6);
}

/// Inputs of SHAC's backward pass, for a rollout with at most two truncations an environment.
struct Ahead {
    shares: Vec<f64>,
    earned: Vec<f64>,
    which: Vec<i32>,
    asked: Vec<i32>,
    by: Vec<f64>,
}

impl Ahead {
    fn of(rewards: &[f64], ends: &[u8], [values, cut]: [&[f64]; 2], unit: f64) -> Self {
        let ((gamma, scale), steps) = (LAW, N * HORIZON);
        let (mut which, mut asked, mut by) = (vec![-1; 3 * N], vec![-1; steps], vec![0.0; 3 * N * (A + 1)]);
        let (mut shares, mut earned) = (vec![1.0; steps], vec![0.0; N]);
        for env in 0..N {
            which[env] = (steps + env) as i32;
            let mut out = 0;
            for t in 0..HORIZON {
                let i = t * N + env;
                if t > 0 && ends[i - N] == 0 {
                    shares[i] = gamma * shares[i - N];
                }
                earned[env] += scale * shares[i] * rewards[i];
                let row = match ends[i] {
                    2 => {
                        out += 1;
                        which[out * N + env] = (steps + N + i) as i32;
                        out * N + env
                    }
                    0 if t + 1 == HORIZON => env,
                    _ => continue,
                };
                asked[i] = row as i32;
                by[row * (A + 1) + A] = -gamma * shares[i] * scale * unit;
                earned[env] += scale * gamma * shares[i] * if ends[i] == 2 { cut[i] } else { values[steps + env] };
            }
        }
        Self { shares, earned, which, asked, by }
    }
}

#[test]
fn learners_beside_the_library_are_shown_what_came_of_their_actions() {
    let Some(compiler) = cpp::Compiler::find() else { return };
    let (asked, ends) = ([0.5, -7.0, 1.5, -1.0, f32::NAN, 1.0f32], [0u8, 1, 2]);
    let [rows, cut] = [0.0, 100.0].map(|first| (0..6).map(|k| first + f64::from(k)).collect::<Vec<_>>());
    let numbers = |x: &[f64]| cpp::bytes(x, f64::to_le_bytes);
    let given = [
        cpp::bytes(&asked, f32::to_le_bytes),
        vec![9; 24],
        vec![9; 12],
        numbers(&rows),
        numbers(&cut),
        numbers(&[1.5, 2.5, 3.5]),
    ];
    let found = [ends.to_vec(), vec![9; 24], vec![9; 24], vec![9; 12], vec![9; 3], vec![9; 3]];
    // More threads than there are numbers.
    let launches = "for (blockIdx.x = 0; blockIdx.x < 9; blockIdx.x++) {
        offer(b[0], b[1], b[2], 6, 3);
        show(b[3], b[4], b[5], b[6], b[7], b[8], b[9], b[10], b[11], 6, 2);
    }";
    let found = compiler.launch(include_str!("../../src/ppo/cuda/episodes.cu"), launches, &[given, found].concat());
    let actions = cpp::floats(&found[1]);
    assert!(
        actions[..4] == [0.5, -1.0, 1.0, -1.0] && actions[4].is_nan() && actions[5] == 1.0,
        "within their bounds: {actions:?}"
    );
    assert_eq!(found[2], [0; 12], "no time has run out");
    assert_eq!(cpp::floats(&found[7]), [0.0, 1.0, 2.0, 3.0, 4.0, 5.0], "what is seen");
    assert_eq!(cpp::floats(&found[8]), [0.0, 1.0, 2.0, 3.0, 104.0, 105.0], "what was seen where time ran out");
    assert_eq!(
        (cpp::floats(&found[9]), &found[10][..], &found[11][..]),
        (vec![1.5, 2.5, 3.5], &[0, 1, 0][..], &[0, 0, 1][..])
    );
}
