//! Networks on the CPU against the published parameter counts and against the textbook's equations in plain f64 loops.
//! Tolerance: f32 rounding.

use std::collections::HashMap;

use nalgebra::DMatrix;
use nerd_model::program::cpu::{Loaded, Memory, Pass};
use nerd_model::transformer::{
    Architecture, BurnForward, Forward, PackedForward, PackedStream, Positions, Storage, Stream, TransformerConfig,
    Weights, Windowed,
};
use nerd_model::{BurnDevice, base::Base, features::Features};

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

/// As `SMALL` without a position table; a token attends to the last four.
const ROTARY: TransformerConfig = TransformerConfig { block: 20, history: 4, positions: Positions::Rotary, ..SMALL };

/// Small networks of all kinds with windows of several tokens.
fn all() -> [TransformerConfig; 3] {
    [SMALL, ROTARY, TransformerConfig { embedding: 8, layers: 2, architecture: Architecture::Residual, ..SMALL }]
}

/// Random weights; a Transformer's are ten times as large as usual, so that attention is far from uniform and every
/// term matters.
fn lively(config: TransformerConfig, seed: u64) -> Weights {
    let mut w = Weights::init(config, seed);
    if config.architecture == Architecture::Transformer {
        let noise = Weights::init(
            TransformerConfig { inputs: w.flat.len(), embedding: 1, layers: 0, heads: 1, ..SMALL },
            seed + 1,
        );
        w.flat.iter_mut().zip(&noise.flat).for_each(|(w, n)| *w = 4.0 * *w + 8.0 * n);
    }
    w
}

fn inputs(windows: usize, tokens: usize) -> Vec<f32> {
    (0..windows * tokens * SMALL.inputs).map(|i| (1.7 * i as f32).sin() * 2.0).collect()
}

/// Predictions of the training pass at every token.
fn run(w: &Weights, x: &[f32], tokens: usize) -> Vec<f32> {
    Loaded::new(w.config.program(), &w.flat).forward(x, &mut Memory::default(), Pass::Kept(tokens)).clone()
}

/// The largest difference, relative to the largest entry of `b` or to 1 if that is larger.
fn apart(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    let worst = a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    worst / b.iter().fold(1.0f32, |m, x| m.max(x.abs()))
}

/// `erf` by its Maclaurin series in f64: exact to 1e-12 for |x| < 5.
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

/// One window of a Transformer, straight from the equations, in f64.
fn reference(w: &Weights, x: &[f32], tokens: usize) -> Vec<f64> {
    let (c, e, d) = (w.config, w.config.embedding, w.config.embedding / w.config.heads);
    let matrix =
        |rows: usize, x: &[f32]| DMatrix::from_row_iterator(rows, x.len() / rows, x.iter().map(|x| f64::from(*x)));
    let rows = |shape: &[usize]| if shape.len() == 2 { shape[0] } else { 1 };
    let p: HashMap<String, DMatrix<f64>> = w.iter().map(|(t, x)| (t.name, matrix(rows(&t.shape), x))).collect();
    let linear = |x: &DMatrix<f64>, name: &str| {
        let (y, bias) = (x * &p[&format!("{name}.weight")], p.get(&format!("{name}.bias")));
        DMatrix::from_fn(y.nrows(), y.ncols(), |i, j| y[(i, j)] + bias.map_or(0.0, |b| b[j]))
    };
    let norm = |x: &DMatrix<f64>, name: &str| {
        let (g, mean, variance) = (&p[&format!("{name}.weight")], x.column_mean(), x.column_variance());
        DMatrix::from_fn(x.nrows(), x.ncols(), |i, j| g[j] * (x[(i, j)] - mean[i]) / (variance[i] + 1e-5).sqrt())
    };
    let mut h = linear(&matrix(tokens, x), "embed");
    if let Some(table) = p.get("position.weight") {
        h += table.rows(0, tokens);
    }
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
        let of = |name: &str| format!("blocks.{b}.{name}");
        let qkv = linear(&norm(&h, &of("norm_attn")), &of("attn.qkv"));
        let mut mixed = DMatrix::zeros(tokens, e);
        for (head, i) in (0..c.heads).flat_map(|head| (0..tokens).map(move |i| (head, i))) {
            let at = |t: usize, part: usize, k: usize| qkv[(t, part * e + head * d + k)];
            let product = |j: usize, k: usize| turned(&|k| at(i, 0, k), i, k) * turned(&|k| at(j, 1, k), j, k);
            let score: Vec<f64> =
                (0..=i).map(|j| ((0..d).map(|k| product(j, k)).sum::<f64>() / (d as f64).sqrt()).exp()).collect();
            let total: f64 = score[first(i)..].iter().sum();
            for k in 0..d {
                mixed[(i, head * d + k)] = (first(i)..=i).map(|j| score[j] / total * at(j, 2, k)).sum();
            }
        }
        h += linear(&mixed, &of("attn.proj"));
        let up = linear(&norm(&h, &of("norm_mlp")), &of("mlp.up"));
        h += linear(&up.map(|x| x * 0.5 * (1.0 + erf(x / 2f64.sqrt()))), &of("mlp.down"));
    }
    let hidden = linear(&linear(&norm(&h, "norm"), "out"), "head.hidden").map(|x| x.max(0.0));
    linear(&hidden, "head.out").transpose().as_slice().to_vec()
}

#[test]
fn widths_and_parameter_counts_are_the_papers() {
    for (name, inputs, outputs, narrow, wide) in [
        ("cartpole", 6, 4, 2_713_668, 10_809_156),
        ("pendulum", 37, 4, 2_719_620, 10_821_060),
        ("cube", 72, 13, 2_726_925, 10_835_085),
        ("franka", 21, 14, 2_717_198, 10_815_566),
        ("ant", 215, 29, 2_755_421, 10_891_037),
        ("anymal", 150, 37, 2_743_461, 10_866_597),
    ] {
        let system = nerd_sim::system::System::named(name).expect("built in");
        assert_eq!((Features::inputs(&system, Base::State), Features::outputs(&system)), (inputs, outputs), "{name}");
        assert_eq!(
            [192, 384].map(|e| TransformerConfig::paper(inputs, outputs, e).parameters()),
            [narrow, wide],
            "{name}"
        );
    }
}

#[test]
fn predictions_are_the_equations() {
    for (config, tokens) in [(SMALL, 6), (ROTARY, 9)] {
        let (w, x) = (lively(config, 1), inputs(2, tokens));
        let expected = x.chunks(tokens * config.inputs).flat_map(|x| reference(&w, x, tokens));
        let expected: Vec<f32> = expected.map(|e| e as f32).collect();
        let (size, worst) =
            (expected.iter().fold(0.0f32, |m, e| m.max(e.abs())), apart(&run(&w, &x, tokens), &expected));
        assert!(size > 0.05 && worst < 1e-5, "{config:?}: {worst:.1e} from the equations, outputs up to {size:.2}");
    }
}

/// One token per frame with cached keys and values against the full banded pass since the last clear. Windows of all
/// frames that a prediction depends on (10) give the same, on the CPU and by burn.
#[test]
fn the_stream_equals_the_banded_pass() {
    let (w, frames, envs) = (lively(ROTARY, 11), 36usize, 5usize);
    let (x, width, outputs) = (inputs(envs, frames), ROTARY.inputs, ROTARY.outputs);
    assert_eq!(ROTARY.reach(), 10, "three layers of four tokens");
    let cleared = |env: usize, frame: usize| if env == 4 && frame >= 12 { 12 } else { 3 * env.min(frame / 3) };
    let burn = || BurnForward::new(&w, &BurnDevice::flex());
    let mut streams: [Box<dyn Stream>; 3] = [
        Box::new(PackedStream::new(&w)),
        Box::new(Windowed::new(PackedForward::new(&w), ROTARY)),
        Box::new(Windowed::new(burn(), ROTARY)),
    ];
    let mut burn = burn();
    let (mut out, mut whole, mut worst, mut yardstick, mut compared) = (Vec::new(), Vec::new(), [0.0f32; 3], 0.0f32, 0);
    for frame in 0..frames {
        let tokens: Vec<f32> =
            (0..envs).flat_map(|env| x[(env * frames + frame) * width..][..width].to_vec()).collect();
        for (stream, worst) in streams.iter_mut().zip(&mut worst) {
            (0..envs).filter(|env| cleared(*env, frame) == frame).for_each(|env| stream.clear(env));
            stream.push(&tokens, &mut out).unwrap();
            for (env, got) in out.chunks_exact(outputs).enumerate() {
                let first = cleared(env, frame);
                let seen = &x[(env * frames + first) * width..(env * frames + frame + 1) * width];
                let exact: Vec<f32> = reference(&w, seen, frame + 1 - first).iter().map(|y| *y as f32).collect();
                let newest = exact.len() - outputs;
                *worst = worst.max(apart(got, &exact[newest..]));
                burn.forward(seen, frame + 1 - first, &[(frame - first) as u32], &mut whole).unwrap();
                yardstick = yardstick.max(apart(&whole, &exact[newest..]));
                compared += 1;
            }
        }
    }
    // These weights magnify rounding, so burn's error against the f64 pass sets the tolerance.
    assert!(
        compared == 540 && worst.iter().zip([1.0, 1.0, 2.0]).all(|(w, share)| *w < 1e-5 + share * yardstick),
        "{compared} predictions: {worst:?}, {yardstick:.1e}"
    );
}

#[test]
fn windows_remember_frames_and_see_none_that_is_newer() {
    for config in all().into_iter().filter(|c| c.positions == Positions::Table) {
        let (w, frames) = (lively(config, 13), 9usize);
        let x = inputs(1, frames);
        let mut stream = Windowed::new(PackedForward::new(&w), config);
        let mut out = Vec::new();
        x.chunks(config.inputs).for_each(|token| stream.push(token, &mut out).unwrap());
        let last = &x[(frames - 6) * config.inputs..];
        let whole = run(&w, last, 6);
        let worst = apart(&out, &whole[whole.len() - config.outputs..]);
        assert!(worst < 1e-5, "{config:?}: {worst:.1e}");
        let error = stream.push(&x[..config.inputs + 1], &mut out).unwrap_err().to_string();
        assert!(error.contains("not rows of"), "{error}");

        let mut changed = last.to_vec();
        changed[2 * config.inputs] += 1.0;
        let moved: Vec<bool> =
            whole.chunks(3).zip(run(&w, &changed, 6).chunks(3)).map(|(a, b)| apart(a, b) > 1e-6).collect();
        let later = config.architecture == Architecture::Transformer;
        assert_eq!(moved, [false, false, true, later, later, later], "{config:?}: tokens changed by token 2");
    }
}

/// Padding after the newest token, and the split over threads, have no effect.
#[test]
fn the_evaluator_is_the_training_pass_at_the_newest_token() {
    for config in all() {
        let (w, windows, tokens) = (lively(config, 7), 37, 6);
        let mut x = inputs(windows, tokens);
        let last: Vec<u32> = (0..windows as u32).map(|w| w % 6).collect();
        let rows: Vec<usize> = last.iter().enumerate().map(|(w, l)| w * tokens + *l as usize).collect();
        let all = run(&w, &x, tokens);
        rows.iter()
            .enumerate()
            .for_each(|(w, row)| x[(row + 1) * config.inputs..(w + 1) * tokens * config.inputs].fill(9.0));
        let expected: Vec<f32> = rows.iter().flat_map(|row| all[row * 3..][..3].to_vec()).collect();
        let (mut found, mut evaluator) = (Vec::new(), PackedForward::new(&w));
        // Twice, since a pass reuses the memory of the previous one.
        for _ in 0..2 {
            evaluator.forward(&x, tokens, &last, &mut found).expect("fits");
            assert!(apart(&found, &expected) < 1e-5, "{config:?}: {:.1e}", apart(&found, &expected));
        }
    }
}

#[test]
fn weights_survive_a_file_and_are_no_other_networks() {
    for config in all() {
        let w = lively(config, 3);
        let bytes = w.to_bytes(HashMap::new(), Storage::F32).unwrap();
        assert_eq!(Weights::from_bytes(config, &bytes).unwrap(), w);
        for other in all().into_iter().filter(|other| *other != config) {
            assert!(Weights::from_bytes(other, &bytes).is_err(), "{config:?} read as {other:?}");
        }
        let text = serde_json::to_string(&config).expect("JSON");
        assert_eq!(serde_json::from_str::<TransformerConfig>(&text).expect("read back"), config);
    }
    let w = lively(SMALL, 3);
    let [exact, half] = [Storage::F32, Storage::F16].map(|storage| w.to_bytes(HashMap::new(), storage).unwrap());
    assert!(half.len() * 10 < exact.len() * 7, "{} bytes in place of {}", half.len(), exact.len());
    let half = Weights::from_bytes(SMALL, &half).unwrap();
    let worst = w.flat.iter().zip(&half.flat).map(|(a, b)| (a - b).abs() / a.abs().max(1e-3)).fold(0.0, f32::max);
    assert!(worst > 0.0 && worst <= 2f32.powi(-11), "f16 changes a weight by {worst:.1e} of itself");
    let error = Weights::from_bytes(TransformerConfig { embedding: 28, ..SMALL }, &exact).unwrap_err().to_string();
    assert!(error.contains("embed.weight") && error.contains("[5, 28]"), "{error}");
}

#[test]
fn ill_formed_windows_are_errors_that_say_why() {
    let mut predictor = PackedForward::new(&lively(SMALL, 6));
    let mut ask = |n: usize, tokens, last: &[u32]| {
        predictor.forward(&vec![0.0; n], tokens, last, &mut Vec::new()).unwrap_err().to_string()
    };
    assert!(ask(30, 6, &[0, 0]).contains("30 input values"));
    assert!(ask(30, 6, &[6]).contains("newest token 6 of 6"));
    assert!(ask(45, 9, &[0]).contains("position table has 8"));
}
