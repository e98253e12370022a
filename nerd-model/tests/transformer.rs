//! The burn Transformer against the published parameter counts and a plain f64 forward pass written out here.

use std::collections::HashMap;

use burn::tensor::{Device, Tensor, TensorData};
use nerd_model::program::Network;
use nerd_model::transformer::{
    Architecture, Forward, PackedForward, PackedStream, Positions, Storage, Stream, TransformerConfig, Weights, Windowed,
};

const SMALL: TransformerConfig = TransformerConfig {
    inputs: 5,
    outputs: 3,
    embedding: 24,
    layers: 3,
    heads: 4,
    block: 8,
    history: 6,
    head: 7,
    positions: Positions::Table,
    architecture: Architecture::Transformer,
};

/// The same without a position table; a token sees the last four.
const ROTARY: TransformerConfig = TransformerConfig { block: 20, history: 4, positions: Positions::Rotary, ..SMALL };

/// Parameters ten times the usual spread, so that attention is far from uniform and every term matters.
fn lively(seed: u64) -> Weights {
    lively_of(SMALL, seed)
}

fn lively_of(config: TransformerConfig, seed: u64) -> Weights {
    let mut w = Weights::init(config, seed);
    let noise = Weights::init(TransformerConfig { inputs: w.flat.len(), embedding: 1, layers: 0, heads: 1, ..SMALL }, seed + 1);
    w.flat.iter_mut().zip(&noise.flat).for_each(|(w, n)| *w = 4.0 * *w + 8.0 * n);
    w
}

fn inputs(windows: usize, tokens: usize) -> Vec<f32> {
    (0..windows * tokens * SMALL.inputs).map(|i| (1.7 * i as f32).sin() * 2.0).collect()
}

fn run(w: &Weights, x: &[f32], windows: usize, tokens: usize) -> Vec<f32> {
    let device = Device::flex();
    let x = Tensor::from_data(TensorData::new(x.to_vec(), [windows, tokens, w.config.inputs]), &device);
    Network::new(w, &device).forward(x).into_data().iter::<f32>().collect()
}

fn largest_difference(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

/// The largest difference, relative to the largest entry above 1.
fn apart(a: &[f32], b: &[f32]) -> f32 {
    largest_difference(a, b) / b.iter().fold(1.0f32, |m, x| m.max(x.abs()))
}

/// `erf` by its Maclaurin series, f64: exact to 1e-12 for the |x| < 5 seen here.
fn erf(x: f64) -> f64 {
    if x.abs() > 5.0 {
        return x.signum();
    }
    let (mut term, mut sum) = (x, x);
    for n in 1..120 {
        term *= -x * x / n as f64;
        sum += term / (2 * n + 1) as f64;
    }
    sum * std::f64::consts::FRAC_2_SQRT_PI
}

/// One window, straight from the equations, in f64.
fn reference(w: &Weights, x: &[f32], tokens: usize) -> Vec<f64> {
    let c = w.config;
    let p: HashMap<String, (Vec<usize>, Vec<f64>)> =
        w.iter().map(|(n, s, v)| (n, (s, v.iter().map(|&v| f64::from(v)).collect()))).collect();
    let linear = |rows: &[Vec<f64>], name: &str| -> Vec<Vec<f64>> {
        let (shape, m) = &p[&format!("{name}.weight")];
        let bias = p.get(&format!("{name}.bias"));
        let column = |row: &Vec<f64>, j: usize| {
            row.iter().enumerate().map(|(i, x)| x * m[i * shape[1] + j]).sum::<f64>() + bias.map_or(0.0, |b| b.1[j])
        };
        rows.iter().map(|row| (0..shape[1]).map(|j| column(row, j)).collect()).collect()
    };
    let norm = |rows: &[Vec<f64>], name: &str| -> Vec<Vec<f64>> {
        let g = &p[&format!("{name}.weight")].1;
        let one = |row: &Vec<f64>| {
            let mean = row.iter().sum::<f64>() / row.len() as f64;
            let var = row.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / row.len() as f64;
            row.iter().zip(g).map(|(x, g)| g * (x - mean) / (var + 1e-5).sqrt()).collect()
        };
        rows.iter().map(one).collect()
    };
    let add =
        |a: &mut Vec<Vec<f64>>, b: Vec<Vec<f64>>| a.iter_mut().zip(b).for_each(|(a, b)| a.iter_mut().zip(b).for_each(|(a, b)| *a += b));
    let rows: Vec<Vec<f64>> = x.chunks(c.inputs).map(|r| r.iter().map(|&v| f64::from(v)).collect()).collect();
    let mut h = linear(&rows, "embed");
    if let Some((_, table)) = p.get("position.weight") {
        add(&mut h, table.chunks(c.embedding).map(<[f64]>::to_vec).collect());
    }
    let d = c.embedding / c.heads;
    let rotary = c.positions == Positions::Rotary;
    let first = |i: usize| if rotary { (i + 1).saturating_sub(c.history) } else { 0 };
    // Su et al. 2021 as complex numbers: columns m and m + d/2 times e^(i place angle).
    let turned = |row: &dyn Fn(usize) -> f64, place: usize, k: usize| {
        let (m, half) = (k % (d / 2), d / 2);
        let (sin, cos) = (place as f64 * 100f64.powf(-2.0 * m as f64 / d as f64)).sin_cos();
        match (rotary, k < half) {
            (false, _) => row(k),
            (true, true) => row(m) * cos - row(m + half) * sin,
            (true, false) => row(m) * sin + row(m + half) * cos,
        }
    };
    for b in 0..c.layers {
        let qkv = linear(&norm(&h, &format!("blocks.{b}.norm_attn")), &format!("blocks.{b}.attn.qkv"));
        let mut mixed = vec![vec![0.0; c.embedding]; tokens];
        for (head, i) in (0..c.heads).flat_map(|head| (0..tokens).map(move |i| (head, i))) {
            let at = |t: usize, part: usize, k: usize| qkv[t][part * c.embedding + head * d + k];
            let product = |j: usize, k: usize| turned(&|k| at(i, 0, k), i, k) * turned(&|k| at(j, 1, k), j, k);
            let score: Vec<f64> = (0..=i).map(|j| ((0..d).map(|k| product(j, k)).sum::<f64>() / (d as f64).sqrt()).exp()).collect();
            let total: f64 = score[first(i)..].iter().sum();
            for k in 0..d {
                mixed[i][head * d + k] = (first(i)..=i).map(|j| score[j] / total * at(j, 2, k)).sum();
            }
        }
        add(&mut h, linear(&mixed, &format!("blocks.{b}.attn.proj")));
        let mut up = linear(&norm(&h, &format!("blocks.{b}.norm_mlp")), &format!("blocks.{b}.mlp.up"));
        up.iter_mut().flatten().for_each(|x| *x *= 0.5 * (1.0 + erf(*x / 2f64.sqrt())));
        add(&mut h, linear(&up, &format!("blocks.{b}.mlp.down")));
    }
    let mut hidden = linear(&linear(&norm(&h, "norm"), "out"), "head.hidden");
    hidden.iter_mut().flatten().for_each(|x| *x = x.max(0.0));
    linear(&hidden, "head.out").concat()
}

#[test]
fn parameter_counts_are_the_papers() {
    let counts = [(6, 4, 2_713_668, 10_809_156), (37, 4, 2_719_620, 10_821_060), (72, 13, 2_726_925, 10_835_085)];
    let more = [(21, 14, 2_717_198, 10_815_566), (215, 29, 2_755_421, 10_891_037), (150, 37, 2_743_461, 10_866_597)];
    for (inputs, outputs, narrow, wide) in counts.into_iter().chain(more) {
        assert_eq!(TransformerConfig::paper(inputs, outputs, 192).parameters(), narrow);
        assert_eq!(TransformerConfig::paper(inputs, outputs, 384).parameters(), wide);
    }
    let weights = Weights::init(TransformerConfig::paper(6, 4, 192), 0);
    assert_eq!(burn::module::Module::num_params(&Network::new(&weights, &Device::flex())), 2_713_668);
}

#[test]
fn inputs_and_outputs_are_as_wide_as_the_papers() {
    let widths = [("cartpole", 6, 4), ("pendulum", 37, 4), ("cube", 72, 13), ("franka", 21, 14), ("ant", 215, 29), ("anymal", 150, 37)];
    for (name, inputs, outputs) in widths {
        let system = nerd_sim::system::System::named(name).expect("built in");
        let features = nerd_model::features::Features::inputs(&system, nerd_model::base::Base::State);
        assert_eq!((features, nerd_model::features::Features::outputs(&system)), (inputs, outputs), "{name}");
    }
}

#[test]
fn forward_is_the_equations() {
    for (config, tokens) in [(SMALL, 6), (ROTARY, 9)] {
        let (w, x) = (lively_of(config, 1), inputs(2, tokens));
        let y = run(&w, &x, 2, tokens);
        let expected: Vec<f64> = x.chunks(tokens * config.inputs).flat_map(|x| reference(&w, x, tokens)).collect();
        let scale = expected.iter().fold(0.0f64, |m, e| m.max(e.abs()));
        let worst = y.iter().zip(&expected).map(|(&y, e)| (f64::from(y) - e).abs()).fold(0.0, f64::max);
        let positions = config.positions;
        assert!(scale > 0.1 && worst < 1e-5 * scale.max(1.0), "{positions:?}: largest difference {worst:.2e} at outputs up to {scale:.2}");
    }
}

/// One token a frame with kept keys and values, against the whole banded pass since the environment was cleared, however seldom
/// it was asked: never, for longer than its predictions reach back (10 frames), and through a clearing.
#[test]
fn the_stream_equals_the_banded_pass() {
    let (w, frames, envs) = (lively_of(ROTARY, 11), 36usize, 5usize);
    let (x, width, outputs) = (inputs(envs, frames), ROTARY.inputs, ROTARY.outputs);
    assert_eq!(ROTARY.reach(), 10, "three layers of four tokens");
    let cleared = |env: usize, frame: usize| if env == 4 && frame >= 12 { 12 } else { 3 * env.min(frame / 3) };
    let asks = |env: usize, frame: usize| match env {
        0 => true,
        1 => frame.is_multiple_of(3),
        2 => !(8..30).contains(&frame),
        3 => frame + 1 == frames,
        _ => !(9..=14).contains(&frame),
    };
    let mut stream = PackedStream::new(&w);
    let (mut out, mut worst, mut burns, mut compared) = (Vec::new(), 0.0f32, 0.0f32, 0);
    for frame in 0..frames {
        let tokens: Vec<f32> = (0..envs).flat_map(|env| x[(env * frames + frame) * width..][..width].to_vec()).collect();
        (0..envs).filter(|env| cleared(*env, frame) == frame).for_each(|env| stream.clear(env));
        let asked: Vec<usize> = (0..envs).filter(|env| asks(*env, frame)).collect();
        stream.push(&tokens, &asked, &mut out).unwrap();
        for (env, got) in asked.iter().zip(out.chunks_exact(outputs)) {
            let first = cleared(*env, frame);
            let seen = &x[(env * frames + first) * width..(env * frames + frame + 1) * width];
            let exact: Vec<f32> = reference(&w, seen, frame + 1 - first).iter().map(|y| *y as f32).collect();
            let exact = &exact[exact.len() - outputs..];
            let whole = run(&w, seen, 1, frame + 1 - first);
            worst = worst.max(apart(got, exact));
            burns = burns.max(apart(&whole[whole.len() - outputs..], exact));
            compared += 1;
        }
    }
    // These weights magnify rounding; the yardstick is burn's own distance from the pass in f64.
    println!("{compared} predictions: the stream is {worst:.1e} from the f64 pass, burn's banded pass {burns:.1e}");
    assert!(compared > 90 && worst < 1e-5 + burns, "{compared} predictions: {worst:.1e}, burn's banded pass {burns:.1e}");
}

/// Keys and values may be kept only if a token's prediction does not depend on where the sequence began.
#[test]
fn rotary_predictions_depend_on_what_the_band_reaches() {
    let (w, x) = (lively_of(ROTARY, 12), inputs(1, 16));
    let whole = run(&w, &x, 1, 16);
    let tail = |from: usize| run(&w, &x[from * ROTARY.inputs..], 1, 16 - from);
    let newest = |y: &[f32]| y[y.len() - ROTARY.outputs..].to_vec();
    // Three layers of four tokens reach nine tokens back.
    let (inside, outside) = (apart(&newest(&tail(7)), &newest(&whole)), apart(&newest(&tail(6)), &newest(&whole)));
    assert!(outside < 1e-5, "a token from beyond the band's reach changed a prediction by {outside:.1e}");
    assert!(inside > 1e-5, "the ninth token back does not matter ({inside:.1e})");
}

/// An engine for windows as a stream: every token is remembered, also those of frames in which nothing was asked.
#[test]
fn windows_remember_frames_that_were_not_asked_for() {
    let (w, frames) = (lively(13), 9usize);
    let x = inputs(1, frames);
    let mut stream = Windowed::new(PackedForward::new(&w), SMALL);
    let mut out = Vec::new();
    for frame in 0..frames {
        let asked: &[usize] = if frame + 1 == frames { &[0] } else { &[] };
        stream.push(&x[frame * SMALL.inputs..][..SMALL.inputs], asked, &mut out).unwrap();
    }
    let whole = run(&w, &x[(frames - 6) * SMALL.inputs..], 1, 6);
    let worst = apart(&out, &whole[whole.len() - SMALL.outputs..]);
    assert!(worst < 1e-5, "{worst:.1e}");
    let error = stream.push(&x[..SMALL.inputs], &[1], &mut out).unwrap_err().to_string();
    assert!(error.contains("below 1"), "{error}");
}

#[test]
fn a_token_never_sees_newer_ones() {
    let (w, x) = (lively(2), inputs(1, 6));
    let y = run(&w, &x, 1, 6);
    for k in 0..6 {
        let mut changed = x.clone();
        changed[k * SMALL.inputs..(k + 1) * SMALL.inputs].iter_mut().for_each(|x| *x += 1.0);
        let z = run(&w, &changed, 1, 6);
        let (before, after) = (k * SMALL.outputs, (k + 1) * SMALL.outputs);
        assert!(largest_difference(&y[..before], &z[..before]) < 1e-6, "token {k} changed an older prediction");
        assert!(largest_difference(&y[before..after], &z[before..after]) > 1e-4, "token {k} does not change its own prediction");
    }
}

#[test]
fn weights_survive_the_module_and_the_file() {
    let w = lively(3);
    assert_eq!(Network::new(&w, &Device::flex()).flat(), w.flat);
    let bytes = w.to_bytes(HashMap::new(), Storage::F32).unwrap();
    assert_eq!(Weights::from_bytes(SMALL, &bytes).unwrap(), w);
    let half = w.to_bytes(HashMap::new(), Storage::F16).unwrap();
    let rounded = Weights::from_bytes(SMALL, &half).unwrap();
    let worst = w.flat.iter().zip(&rounded.flat).map(|(a, b)| (a - b).abs() / a.abs().max(1e-3)).fold(0.0, f32::max);
    assert!(worst > 0.0 && worst <= 2f32.powi(-11), "f16 changes a weight by {worst:.1e} of itself");
    assert!(half.len() * 10 < bytes.len() * 7, "{} bytes in place of {}", half.len(), bytes.len());
    let mixed = w.to_bytes(HashMap::new(), Storage::Mixed).unwrap();
    let mixed = Weights::from_bytes(SMALL, &mixed).unwrap();
    for ((name, shape, exact), ((_, _, half), (_, _, mixed))) in w.iter().zip(rounded.iter().zip(mixed.iter())) {
        let hidden = name.starts_with("blocks.") && shape.len() == 2;
        assert!(mixed == if hidden { half } else { exact }, "{name} of a mixed file is neither its f16 nor its f32");
    }
    let other = TransformerConfig { embedding: 28, ..SMALL };
    let error = Weights::from_bytes(other, &bytes).unwrap_err().to_string();
    assert!(error.contains("embed.weight") && error.contains("[5, 28]"), "{error}");
}

#[cfg(feature = "autodiff")]
#[test]
fn weights_survive_an_autodiff_module() {
    let w = lively(3);
    assert_eq!(Network::new(&w, &Device::flex().autodiff()).flat(), w.flat);
}

/// Two engines, one network: burn's, and the one without a framework.
#[test]
fn the_packed_network_equals_burns() {
    let mut worst = 0.0f32;
    for (w, windows, tokens) in
        [(lively(7), 37usize, 6usize), (lively(8), 1, 1), (Weights::init(TransformerConfig::paper(37, 4, 192), 9), 50, 10)]
    {
        let width = w.config.inputs;
        let x: Vec<f32> = (0..windows * tokens * width).map(|i| (1.7 * i as f32).sin() * 2.0).collect();
        let last: Vec<u32> = (0..windows).map(|i| (i % tokens) as u32).collect();
        let all = run(&w, &x, windows, tokens);
        let newest = |(i, l): (usize, &u32)| all[(i * tokens + *l as usize) * w.config.outputs..][..w.config.outputs].to_vec();
        let (a, mut b) = (last.iter().enumerate().flat_map(newest).collect::<Vec<f32>>(), vec![7.0; 3]);
        let mut packed = PackedForward::new(&w);
        for _ in 0..2 {
            packed.forward(&x, tokens, &last, &mut b).unwrap();
            let scale = a.iter().fold(1.0f32, |m, x| m.max(x.abs()));
            worst = worst.max(largest_difference(&a, &b) / scale);
        }
    }
    assert!(worst < 1e-5, "the engines differ by {worst:.1e}");
}

#[test]
fn shorter_windows_use_the_first_positions() {
    let (w, x) = (lively(5), inputs(1, 6));
    let whole = run(&w, &x, 1, 6);
    let short = run(&w, &x[..3 * SMALL.inputs], 1, 3);
    assert!(largest_difference(&whole[..3 * SMALL.outputs], &short) < 1e-5);
}

#[test]
fn ill_formed_windows_are_errors_that_say_why() {
    let mut predictor = PackedForward::new(&lively(6));
    let mut ask = |n: usize, tokens, last: &[u32]| predictor.forward(&vec![0.0; n], tokens, last, &mut Vec::new()).unwrap_err().to_string();
    assert!(ask(30, 6, &[0, 0]).contains("30 input values"));
    assert!(ask(30, 6, &[6]).contains("newest token 6 of 6"));
    assert!(ask(45, 9, &[0]).contains("position table has 8"));
}
