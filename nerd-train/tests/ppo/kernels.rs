//! The kernels of PPO's rollouts against the CPU's engine, without a device: their text is compiled as C++ and run on the CPU.

use nerd_sim::articulated::device::RANDOM;

use crate::*;

/// Environments, numbers of an observation and of an action (odd, so that the two numbers of a draw can be of two rows), steps.
const N: usize = 37;
const SEEN: usize = 5;
/// How far apart rows are on the card.
const PADDED: usize = 8;
const A: usize = 3;
const HORIZON: usize = 6;
/// Discount and lambda, the step that is answered, its noise, and parts that sums are made in.
const LAW: (f64, f64) = (0.97, 0.9);
const STEP: usize = 4;
const NOISE: (u64, u64) = (0x1234_5678_9abc_def0, (1 << 40) + 7);
const PARTS: usize = 7;

/// Every kernel in turn over a few more threads than it has work for.
const MAIN: &str = r"
#include <cmath>
#include <cstdio>
#include <vector>
using std::vector;
typedef unsigned long long u64;
#define __global__
#define __device__
#define FN static inline
static u64 INDEX;
#include KERNELS
template <class T> vector<T> take(size_t n) { vector<T> x(n); if (fread(x.data(), sizeof(T), n, stdin) != n) throw 1; return x; }
template <class T> void give(const vector<T>& x) { fwrite(x.data(), sizeof(T), x.size(), stdout); }
#define RUN(threads, call) for (INDEX = 0; INDEX < (u64)(threads) + 5; INDEX++) call
int main() {
    auto sizes = take<int>(6);
    const int n = sizes[0], seen = sizes[1], a = sizes[2], horizon = sizes[3], parts = sizes[4], padded = sizes[5], steps = n * horizon;
    auto key = take<u64>(5);
    const u64 later = 3, first_stream = key[4] - later;
    auto law = take<double>(10);
    auto rows = take<double>(steps * seen), mean_of = take<double>(seen), inverse = take<double>(seen);
    auto rewards = take<double>(steps), values = take<double>(steps + n), cut = take<double>(steps);
    auto said = take<float>(n * (a + 1)), parameter = take<float>(a);
    auto ends = take<unsigned char>(steps);
    vector<float> inputs(steps * padded), means(n * a), spreads(n * a), actions(n * a), surprise(n), kept(n * a);
    vector<float> advantages(steps), wanted(steps), known(steps);
    vector<double> worth(n), both(2 * steps), partial(parts * seen), first(seen), second(seen);
    RUN(steps * seen, normalize(rows.data(), mean_of.data(), inverse.data(), inputs.data(), steps * seen, seen, padded));
    RUN(n, act(said.data(), parameter.data(), key[0], key[1], key[2], key[3], &first_stream, later, law.data(), means.data(), spreads.data(),
               actions.data(), surprise.data(), worth.data(), kept.data(), n, a, a + 1, 0));
    RUN(n, gae(rewards.data(), ends.data(), values.data(), cut.data(), both.data(), n, horizon, law[2], law[3]));
    RUN(parts * seen, columns(rows.data(), nullptr, steps, seen, parts, partial.data()));
    RUN(seen, mean(partial.data(), steps, seen, parts, first.data()));
    RUN(parts * seen, columns(rows.data(), first.data(), steps, seen, parts, partial.data()));
    RUN(seen, mean(partial.data(), steps, seen, parts, second.data()));
    RUN(steps, goals(both.data(), values.data(), steps, law[4], law[5], law[6], law[7], law[8], law[9], advantages.data(), wanted.data(),
                     known.data()));
    // Twice at most time runs out in an environment.
    const int slots = 2;
    vector<double> all(values), shares(steps), earned(n);
    all.insert(all.end(), cut.begin(), cut.end());
    vector<unsigned> which((1 + slots) * n), without(n, 7);
    vector<int> asked(steps);
    vector<float> by((1 + slots) * n * (a + 1), 7), slow = means;
    RUN(n, reached(ends.data(), which.data(), n, horizon, slots));
    RUN(n, shac_ahead(rewards.data(), ends.data(), all.data(), law.data(), shares.data(), asked.data(), by.data(), earned.data(), without.data(), n,
                      horizon, slots, a, a + 1, law[2], law[3]));
    RUN(n * a, shac_follow(slow.data(), spreads.data(), 0.25f, n * a));
    for (auto* x : {&inputs, &means, &spreads, &actions, &surprise, &kept, &advantages, &wanted, &known}) give(*x);
    for (auto* x : {&worth, &both, &first, &second, &shares, &earned}) give(*x);
    give(which), give(asked), give(without), give(by), give(slow);
}
";

/// What the CPU's engine was told and asked: rewards and ends, values where time ran out and of the last answer, and actions of one step, as
/// environments get them.
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
    let mut draw = |n: usize, by: f64| -> Vec<f64> { (0..n).map(|k| 0.5 * k as f64 % 3.0 + by * normal(&mut rng)).collect() };
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
            .act(&draw(N * SEEN, 4.0), StreamKey { seed: NOISE.0, number: NOISE.1 - STEP as u64 + t as u64 }, &mut actions)
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
    let law = PpoConfig { gamma: LAW.0, lambda: LAW.1, ..PpoConfig::default() };
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
    println!("{what}: {apart:.1e} apart");
    assert!(apart <= most, "{what}: {apart:.1e} apart, at most {most:.1e}");
}

#[test]
fn kernels_answer_and_judge_as_the_cpu_does() {
    let Some(compiler) = cpp::Compiler::find() else { return };
    let text = MAIN.replace(
        "#include KERNELS",
        &(RANDOM.to_string() + include_str!("../../src/ppo/cuda/acting.cu") + include_str!("../../src/ppo/cuda/shac/kernels.cu")),
    );
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

    let mut input: Vec<u8> = [N, SEEN, A, HORIZON, PARTS, PADDED].iter().flat_map(|x| (*x as i32).to_le_bytes()).collect();
    input.extend(stream(NOISE.0, NOISE.1).get_seed());
    input.extend(NOISE.1.to_le_bytes());
    let numbers = [&laws, &r.observations, &columns.mean, &inverse, &rewards, &values, &cut];
    input.extend(numbers.into_iter().flatten().flat_map(|x| x.to_le_bytes()));
    input.extend(rows.chain(policy.spread()).flat_map(|x| x.to_le_bytes()));
    input.extend(&ends);
    let output = compiler.run(&text, input);

    let (singles, doubles) = output.split_at(4 * (steps * PADDED + 4 * N * A + N + 3 * steps));
    let mut singles = singles.as_chunks::<4>().0.iter().map(|b| f64::from(f32::from_le_bytes(*b)));
    let mut doubles = doubles.as_chunks::<8>().0.iter().map(|b| f64::from_le_bytes(*b));
    let mut single = |n: usize| singles.by_ref().take(n).collect::<Vec<_>>();
    let mut double = |n: usize| doubles.by_ref().take(n).collect::<Vec<_>>();
    let f64s = |x: &[f32]| x.iter().copied().map(f64::from).collect::<Vec<_>>();
    let at = |x: &[f32]| f64s(&x[STEP * N * A..][..N * A]);

    let mut seen = Vec::new();
    policy.seen.rows(&r.observations, &mut seen);
    let seen: Vec<f64> = seen.chunks(SEEN).flat_map(|row| f64s(&[row, &[0.0; PADDED - SEEN]].concat())).collect();
    near("inputs", &single(steps * PADDED), &seen, 1e-6);
    near("means", &single(N * A), &at(&r.mean), 0.0);
    near("spreads", &single(N * A), &at(&r.spread), 0.0);
    near("actions", &single(N * A), &at(&r.actions), 1e-6);
    near("surprise", &single(N), &f64s(&r.surprise[STEP * N..][..N]), 1e-5);
    near("actions kept within their bounds", &single(N * A), &kept, 1e-6);
    let by = |x: &[f64], mean: f64, scale: f64| x.iter().map(|x| (x - mean) / scale).collect::<Vec<_>>();
    near("advantages, normalised", &single(steps), &by(&r.advantages, mean, spread), 1e-6);
    let normalised = |x: &[f64], m: &RunningMoments| x.iter().map(|x| m.normalize(0, *x)).collect::<Vec<_>>();
    near("goals", &single(steps), &normalised(&returns, &moved), 1e-6);
    near("values, normalised", &single(steps), &normalised(&r.values, &policy.returns), 1e-6);
    near("values", &double(N), &r.values[STEP * N..][..N], 1e-12);
    let both: Vec<f64> = r.advantages.iter().zip(&returns).flat_map(|(a, r)| [*a, *r]).collect();
    near("advantages and returns", &double(2 * steps), &both, 1e-12);
    let of = |k: usize, about: f64, power: i32| average(&mut r.observations.iter().skip(k).step_by(SEEN).map(|x| (x - about).powi(power)));
    let means: Vec<f64> = (0..SEEN).map(|k| of(k, 0.0, 1)).collect();
    near("means of columns", &double(SEEN), &means, 1e-12);
    near("variances of columns", &double(SEEN), &(0..SEEN).map(|k| of(k, means[k], 2)).collect::<Vec<_>>(), 1e-12);
    let ahead = Ahead::of(&rewards, &ends, [&values, &cut], units(&policy.returns)[1]);
    near("what rewards count", &double(steps), &ahead.shares, 1e-12);
    near("J by environment", &double(N), &ahead.earned, 1e-12);
    let rest = &output[output.len() - 4 * (3 * N + steps + N + 3 * N * (A + 1) + N * A)..];
    let words = rest.as_chunks::<4>().0;
    let (whole, floats) = words.split_at(3 * N + steps + N);
    let whole: Vec<i32> = whole.iter().map(|b| i32::from_le_bytes(*b)).collect();
    assert_eq!(
        whole,
        [&ahead.which[..], &ahead.asked, &[0; N]].concat(),
        "where values go, rows that are asked for, environments without slopes"
    );
    let floats: Vec<f64> = floats.iter().map(|b| f64::from(f32::from_le_bytes(*b))).collect();
    near("gradients by values", &floats[..3 * N * (A + 1)], &ahead.by, 1e-6);
    let (mean, spread) = (at(&r.mean), at(&r.spread));
    let followed: Vec<f64> = mean.iter().zip(spread).map(|(slow, now)| 0.25 * slow + 0.75 * now).collect();
    near("the slower critic", &floats[3 * N * (A + 1)..], &followed, 1e-6);
}

/// What SHAC's way back begins with, of a rollout in which time ran out twice at most.
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
