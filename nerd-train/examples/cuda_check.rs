//! Checks the fused CUDA engine on the GPU at hand and times it.
//!
//! ```text
//! cargo run --release -p nerd-train --features cuda --example cuda_check            checks, then times
//! cargo run --release -p nerd-train --features cuda --example cuda_check -- dump DIR    raw f32 files of a short run
//! cargo run --release -p nerd-train --features cuda --example cuda_check -- step BATCH  one update for a profiler
//! ```
//!
//! Checks: every entry of the gradient against the CPU's, every tensor's against central differences along directions that do
//! not depend on it, validation against the CPU's, bitwise resume, a falling loss, inference against a rolled window, the stream
//! against the CPU's, numbers that are none, and what must be refused. The first that fails ends the program with an error.
//! `dump` writes what a comparison with another framework needs.

use std::error::Error;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use nerd_model::transformer::{Architecture, PackedStream, Positions, Stream, TransformerConfig, Weights};
use nerd_train::learner::cuda::{CudaForward, CudaLearner, CudaStream, Precision};
use nerd_train::learner::{CpuLearner, Learner, LearnerConfig, LearnerState};
use nerd_train::windows::{Windows, draw};

type Outcome = Result<(), Box<dyn Error>>;

fn main() -> Outcome {
    let args: Vec<String> = std::env::args().skip(1).collect();
    match args.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["dump", dir] => dump(Path::new(dir)),
        ["step", batch] => learner(batch.parse()?, Precision::Tf32, 1.0)?.update_eagerly(1e-4).map_err(Into::into),
        _ => {
            gradient()?;
            validation()?;
            refusals()?;
            resume()?;
            learning()?;
            inference()?;
            streaming()?;
            timing()
        }
    }
}

/// Uniform in +-1, a hash of `i`.
fn noise(stream: u64, i: usize) -> f32 {
    (draw(stream, 0, i as u64, 1 << 24) as f32 / (1 << 23) as f32) - 1.0
}

/// Largest difference; none of a number if there is one that is none.
fn largest(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, |most, x| if x > most || x.is_nan() { x } else { most })
}

/// Random inputs; the targets mix the present and the previous token, so that attention has something to find.
fn windows(stream: u64, config: TransformerConfig, trajectories: usize, frames: usize) -> Windows {
    let (i, o) = (config.inputs, config.outputs);
    let x: Vec<f32> = (0..trajectories * frames * i).map(|k| noise(stream, k)).collect();
    let y = (0..trajectories * frames * o).map(|k| {
        let (token, c) = (k / o, k % o);
        let before = if token % frames == 0 { 0.0 } else { x[(token - 1) * i + c % i] };
        x[token * i + c % i] + 0.5 * (2.0 * before).sin() - x[token * i] * x[token * i + i - 1]
    });
    Windows { inputs: i, outputs: o, frames, history: config.sequence(), y: y.collect(), x }
}

/// Weights with no entry at a special value (zero biases, unit norms).
fn weights(config: TransformerConfig, size: f32) -> Weights {
    let mut w = Weights::init(config, 1);
    w.flat.iter_mut().enumerate().for_each(|(i, x)| *x += size * noise(7, i));
    w
}

fn configuration(batch: usize) -> LearnerConfig {
    LearnerConfig { batch, clip: 1.0, average: 0.999, seed: 5, huber: None, optimizer: Default::default() }
}

fn learner(batch: usize, precision: Precision, scale: f32) -> Result<CudaLearner, Box<dyn Error>> {
    learner_of(TransformerConfig::paper(37, 4, 192), batch, precision, scale)
}

fn learner_of(config: TransformerConfig, batch: usize, precision: Precision, scale: f32) -> Result<CudaLearner, Box<dyn Error>> {
    let state = LearnerState::new(weights(config, 0.05 * scale));
    Ok(CudaLearner::new(configuration(batch), precision, state, &windows(2, config, 200, 100), &windows(3, config, 20, 100))?)
}

/// Shapes with a table and without, wide heads and narrow ones, a band narrower than the sequence, more outputs than lanes.
fn shapes() -> [TransformerConfig; 7] {
    let paper = TransformerConfig::paper;
    let rotary = |c: TransformerConfig, block| TransformerConfig { positions: Positions::Rotary, block, ..c };
    let small = TransformerConfig { layers: 2, heads: 4, history: 7, ..paper(10, 33, 48) };
    let wide = paper(37, 4, 192);
    let narrow = rotary(TransformerConfig { heads: 3, ..small }, 20);
    let all = [wide, paper(6, 14, 384), small, rotary(wide, 32), rotary(wide, 55), rotary(paper(37, 4, 384), 64), narrow];
    all.map(|c| TransformerConfig { layers: c.layers.min(3), ..c })
}

/// Every entry within this share of the root mean square of its tensor's: an entry that is missing is off by all of itself.
const ENTRY: f64 = 2e-3;
/// Central differences along a tensor's random signs, within this share of the norm of its gradient.
const SLOPE: f64 = 0.05;

fn gradient() -> Outcome {
    for config in shapes() {
        let (data, centre) = (Arc::new(windows(2, config, 20, 80)), weights(config, 0.05));
        for huber in [None, Some(0.1)] {
            let settings = LearnerConfig { huber, ..configuration(64) };
            let state = LearnerState::new(centre.clone());
            let mut cuda = CudaLearner::new(settings, Precision::F32, state.clone(), &data, &data)?;
            let cpu = CpuLearner::new(settings, state, data.clone(), data.clone())?;
            // Those that the device draws for the first update.
            let rows: Vec<u64> = (0..settings.batch as u64).map(|row| draw(settings.seed, 0, row, data.len() as u64)).collect();
            let ((loss, found), (of_cpu, expected)) = (cuda.gradient()?, cpu.gradient(&rows)?);
            let off = f64::from(loss / of_cpu - 1.0).abs();
            println!("E {}, {:?}, huber {huber:?}: loss {loss:.5}, off the CPU's by {off:.1e}", config.embedding, config.positions);
            if off.is_nan() || off > 1e-4 {
                return Err("another loss than the CPU's".into());
            }
            let (mut first, mut worst) = (0, (0.0, String::new()));
            for tensor in config.tensors() {
                let range = first..first + tensor.len();
                first = range.end;
                let (a, b) = (&found[range.clone()], &expected[range.clone()]);
                let norm = b.iter().map(|g| f64::from(*g).powi(2)).sum::<f64>().sqrt();
                let scale = norm / (b.len() as f64).sqrt();
                let off = a.iter().zip(b).map(|(a, b)| f64::from(a - b).abs() / scale).fold(0.0, f64::max);
                if a.iter().any(|g| !g.is_finite()) || off.is_nan() || off > ENTRY {
                    return Err(format!("{}: an entry of its gradient is off by {off:.1e} of their root mean square", tensor.name).into());
                }
                if off > worst.0 {
                    worst = (off, tensor.name.clone());
                }
                // The loss is squares where it is not bent, and what is reported are squares.
                if huber.is_none() {
                    slope(&mut cuda, &centre.flat, range, a, (f64::from(loss), norm)).map_err(|e| format!("{}: {e}", tensor.name))?;
                }
            }
            println!("    largest error of an entry {:.1e} of its tensor's root mean square, in {}", worst.0, worst.1);
        }
    }
    Ok(())
}

/// The loss moves along random signs of one tensor as its gradient says, by steps that f32 can see.
fn slope(cuda: &mut CudaLearner, centre: &[f32], tensor: std::ops::Range<usize>, g: &[f32], (loss, norm): (f64, f64)) -> Outcome {
    let step = (1e-4 * loss / norm).min(5e-3);
    for direction in 0..2 {
        let sign = |i: usize| f64::from(noise(100 + direction, i)).signum();
        let mut at = |h: f64| -> Result<f64, Box<dyn Error>> {
            let mut flat = centre.to_vec();
            flat[tensor.clone()].iter_mut().enumerate().for_each(|(i, w)| *w += (h * sign(i)) as f32);
            cuda.set_weights(&flat)?;
            Ok(f64::from(cuda.gradient()?.0))
        };
        let (difference, expected) =
            ((at(step)? - at(-step)?) / (2.0 * step), g.iter().enumerate().map(|(i, g)| f64::from(*g) * sign(i)).sum::<f64>());
        cuda.set_weights(centre)?;
        let off = (difference - expected).abs() / norm;
        if off.is_nan() || off > SLOPE {
            return Err(
                format!("slope {expected:.3e} along random signs, the loss says {difference:.3e}: off by {off:.1e} of the norm").into()
            );
        }
    }
    Ok(())
}

/// The same windows as on the CPU, whatever part of them is asked for.
fn validation() -> Outcome {
    let config = TransformerConfig { layers: 2, ..TransformerConfig::paper(37, 4, 192) };
    let (data, state) = (Arc::new(windows(2, config, 20, 50)), LearnerState::new(weights(config, 0.05)));
    let mut cuda = CudaLearner::new(configuration(64), Precision::F32, state.clone(), &data, &data)?;
    let mut cpu = CpuLearner::new(configuration(64), state, data.clone(), data.clone())?;
    for wanted in [1, 63, 500, 10_000] {
        let (a, b) = (cuda.validate(wanted)?, cpu.validate(wanted)?);
        println!("validation over {wanted} of {} windows: {a:.6}, on the CPU {b:.6}", data.len());
        if (a / b - 1.0).is_nan() || (a / b - 1.0).abs() > 1e-4 {
            return Err("another validation than the CPU's".into());
        }
    }
    Ok(())
}

/// What has no memory on the device is refused, what is no number stays none.
fn refusals() -> Outcome {
    let rotary = TransformerConfig { positions: Positions::Rotary, layers: 2, ..TransformerConfig::paper(37, 4, 192) };
    let mut stream = CudaStream::new(&weights(rotary, 0.05), Precision::F32, 40)?;
    let mut out = Vec::new();
    if stream.push(&windows(3, rotary, 41, 1).x, &[], &mut out).is_ok() {
        return Err("41 environments in a stream for 40".into());
    }
    for asked in [&[1, 0][..], &[2, 2], &[40]] {
        if stream.push(&windows(3, rotary, 40, 1).x, asked, &mut out).is_ok() {
            return Err(format!("environments {asked:?} of 40").into());
        }
    }
    for architecture in [Architecture::Mlp, Architecture::Gru, Architecture::Lstm] {
        let other = Weights::init(TransformerConfig { architecture, ..rotary }, 0);
        let made = CudaStream::new(&other, Precision::F32, 4).err().map(|e| e.to_string());
        if made.is_none_or(|e| !e.contains("Transformers")) {
            return Err(format!("{architecture:?} on the Transformer's engine").into());
        }
    }
    let table = TransformerConfig { positions: Positions::Table, ..rotary };
    let mut first = 0;
    for tensor in table.tensors() {
        let mut none = weights(table, 0.05);
        // An entry that all windows meet: of the position table the first row.
        none.flat[first] = f32::NAN;
        first += tensor.len();
        let y = CudaForward::new(&none, Precision::F32, 8)?.forward(&windows(3, table, 8, 10).x, 10, &[9; 8])?;
        if y.iter().all(|y| y.is_finite()) {
            return Err(format!("NaN in {} is swallowed", tensor.name).into());
        }
    }
    println!("rows without memory, unordered environments, other networks are refused; NaN in any tensor comes out");
    Ok(())
}

fn resume() -> Outcome {
    for precision in [Precision::F32, Precision::Tf32] {
        let config = TransformerConfig::paper(37, 4, 192);
        let (train, validation) = (windows(2, config, 200, 100), windows(3, config, 20, 100));
        let start = |state| CudaLearner::new(configuration(512), precision, state, &train, &validation);
        let mut whole = start(LearnerState::new(weights(config, 0.0)))?;
        let mut half = start(LearnerState::new(weights(config, 0.0)))?;
        (0..20).try_for_each(|_| whole.update(1e-3).and_then(|()| half.update(1e-3)))?;
        let mut taken_up = start(half.state()?)?;
        (0..20).try_for_each(|_| whole.update(5e-4).and_then(|()| taken_up.update(5e-4)))?;
        let equal = whole.state()? == taken_up.state()?;
        println!("{precision:?}: 20 + 20 updates from a state equal 40 unbroken ones bit for bit: {equal}");
        if !equal {
            return Err("resume is not exact".into());
        }
    }
    Ok(())
}

fn learning() -> Outcome {
    for precision in [Precision::F32, Precision::Tf32] {
        let mut learner = learner(512, precision, 0.0)?;
        let before = learner.validate(1000)?;
        for k in 0..=5 {
            println!("{precision:?} update {:>4}: validation {:.5}", 100 * k, learner.validate(1000)?);
            for _ in 0..100 {
                learner.update(1e-3)?;
            }
            let p = learner.progress()?;
            println!("{precision:?} training loss {:.5}, gradient norm {:.4}", p.loss, p.gradient_norm);
        }
        let after = learner.validate(1000)?;
        if after.is_nan() || after > 0.5 * before {
            return Err(format!("the loss does not fall: {before:.5} to {after:.5}").into());
        }
    }
    Ok(())
}

/// A full window and its first tokens alone must give the same prediction for a token both hold.
fn inference() -> Outcome {
    let config = TransformerConfig::paper(37, 4, 192);
    let data = windows(2, config, 300, config.history);
    let mut forward = CudaForward::new(&weights(config, 0.05), Precision::F32, 512)?;
    let whole = forward.forward(&data.x, 10, &[6; 300])?;
    let part: Vec<f32> = data.x.chunks_exact(370).flat_map(|w| w[..7 * 37].to_vec()).collect();
    let part = forward.forward(&part, 7, &[6; 300])?;
    let worst = largest(&whole, &part);
    println!("causality: largest difference {worst:e}");
    if worst.is_nan() || worst > 1e-4 {
        return Err("a token sees younger ones".into());
    }
    let inputs = windows(2, config, 2048, config.history).x;
    for precision in [Precision::F32, Precision::Tf32] {
        let mut forward = CudaForward::new(&weights(config, 0.05), precision, 2048)?;
        forward.forward(&inputs, 10, &[9; 2048])?;
        let start = Instant::now();
        for _ in 0..20 {
            forward.forward(&inputs, 10, &[9; 2048])?;
        }
        println!("{precision:?}: 2048 windows forward in {:.3} ms, copies included", start.elapsed().as_secs_f64() * 50.0);
    }
    Ok(())
}

/// Eighty frames of many environments, some cleared and some left out, on the device and on the CPU; then the time of a frame.
fn streaming() -> Outcome {
    let config = TransformerConfig { positions: Positions::Rotary, ..TransformerConfig::paper(247, 29, 192) };
    let (w, envs) = (weights(config, 0.05), 100);
    let (mut cuda, mut cpu) = (CudaStream::new(&w, Precision::F32, envs)?, PackedStream::new(&w));
    let (mut a, mut b, mut worst) = (Vec::new(), Vec::new(), 0.0f32);
    for frame in 0..80 {
        let tokens = windows(20 + frame as u64, config, envs, 1).x;
        // Some now and then, some not for longer than a prediction reaches back.
        let asked: Vec<usize> = (0..envs).filter(|env| (env + frame) % 17 != 0 && (env % 2 == 0 || !(4..70).contains(&frame))).collect();
        if frame % 7 == 3 {
            cuda.clear(frame);
            cpu.clear(frame);
        }
        cuda.push(&tokens, &asked, &mut a)?;
        cpu.push(&tokens, &asked, &mut b)?;
        let off = largest(&a, &b);
        worst = if off > worst || off.is_nan() { off } else { worst };
    }
    println!(
        "stream on the device and on the CPU: largest difference {worst:e} at outputs up to {:.2}",
        b.iter().fold(0.0f32, |m, x| m.max(x.abs()))
    );
    if worst.is_nan() || worst > 1e-3 {
        return Err("the streams differ".into());
    }
    for (name, config) in
        [("E 192, 6 layers", config), ("E 64, 2 layers", TransformerConfig { embedding: 64, layers: 2, heads: 4, ..config })]
    {
        for (precision, envs) in [(Precision::F32, 2048), (Precision::Tf32, 2048), (Precision::Tf32, 8192)] {
            let mut stream = CudaStream::new(&weights(config, 0.05), precision, envs)?;
            let (tokens, asked): (_, Vec<usize>) = (windows(3, config, envs, 1).x, (0..envs).collect());
            (0..12).try_for_each(|_| stream.push(&tokens, &asked, &mut a))?;
            let start = Instant::now();
            (0..200).try_for_each(|_| stream.evaluate())?;
            stream.wait()?;
            let device = start.elapsed().as_secs_f64() * 5.0;
            let start = Instant::now();
            (0..20).try_for_each(|_| stream.push(&tokens, &asked, &mut a))?;
            let whole = start.elapsed().as_secs_f64() * 50.0;
            println!("{name}, {precision:?}, {envs} environments: {device:.3} ms of the device a frame, {whole:.3} ms with copies");
        }
    }
    Ok(())
}

/// Windows of ten tokens at several batches, and sequences of 32 tokens of as many tokens a batch.
fn timing() -> Outcome {
    let window = TransformerConfig::paper(37, 4, 192);
    let rotary = TransformerConfig { positions: Positions::Rotary, ..window };
    let small = TransformerConfig { embedding: 64, layers: 2, heads: 4, ..rotary };
    let cases = [
        (window, [512, 2048, 8192]),
        (TransformerConfig { embedding: 384, ..window }, [512, 2048, 4096]),
        (rotary, [160, 640, 2560]),
        (small, [160, 640, 2560]),
    ];
    for (c, batches) in cases {
        let (e, seen) = (c.embedding, c.history);
        let matrices = c.layers * 12 * e * e + e * (c.inputs + e + c.head) + c.head * c.outputs;
        for batch in batches {
            let mut learner = learner_of(c, batch, Precision::Tf32, 0.0)?;
            (0..20).try_for_each(|_| learner.update(1e-4))?;
            learner.progress()?;
            let (start, count) = (Instant::now(), 100_000 / batch + 20);
            (0..count).try_for_each(|_| learner.update(1e-4))?;
            learner.progress()?;
            let seconds = start.elapsed().as_secs_f64() / count as f64;
            let flops = 6.0 * (batch * c.sequence() * (matrices + c.layers * 2 * e * seen)) as f64;
            println!(
                "E {e}, {} layers, {:?}, batch {batch}: {:.3} ms an update, {:.0} windows/s, {:.1} TFLOP/s",
                c.layers,
                c.positions,
                seconds * 1e3,
                batch as f64 / seconds,
                flops / seconds / 1e12
            );
        }
    }
    Ok(())
}

/// Weights, drawn windows, gradients, and the state after five updates, as raw little-endian f32.
fn dump(dir: &Path) -> Outcome {
    let config = TransformerConfig::paper(37, 4, 192);
    let save = |name: &str, x: &[f32]| std::fs::write(dir.join(name), x.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>());
    let (train, validation) = (windows(2, config, 200, 100), windows(3, config, 20, 100));
    let start = weights(config, 0.05);
    save("weights", &start.flat)?;
    for step in 0..5 {
        let (mut x, mut y) = (Vec::new(), Vec::new());
        for row in 0..512 {
            let t = train.first_token(draw(5, step, row, train.len() as u64) as usize);
            x.extend(&train.x[t * 37..(t + 10) * 37]);
            y.extend(&train.y[t * 4..(t + 10) * 4]);
        }
        save(&format!("x{step}"), &x)?;
        save(&format!("y{step}"), &y)?;
    }
    for precision in [Precision::F32, Precision::Tf32] {
        let mut learner = CudaLearner::new(configuration(512), precision, LearnerState::new(start.clone()), &train, &validation)?;
        let (loss, g) = learner.gradient()?;
        save(&format!("gradient_{precision:?}"), &g)?;
        (0..5).try_for_each(|_| learner.update(1e-3))?;
        let p = learner.progress()?;
        let state = learner.state()?;
        save(&format!("trained_{precision:?}"), &state.weights.flat)?;
        save(&format!("average_{precision:?}"), &state.average)?;
        save(&format!("scalars_{precision:?}"), &[loss, p.loss, p.gradient_norm, learner.validate(700)?])?;
        let inputs = windows(9, config, 33, 8).x;
        save("forward_x", &inputs)?;
        save("forward_y", &CudaForward::new(&start, Precision::F32, 40)?.forward(&inputs, 8, &[5; 33])?)?;
    }
    save("validation_x", &validation.x)?;
    save("validation_y", &validation.y)?;
    Ok(())
}
