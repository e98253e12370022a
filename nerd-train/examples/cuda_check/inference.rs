//! Predictions of windows and of streams, and what is refused.

use std::time::Instant;

use nerd_model::program::cpu::{Loaded, Memory, Pass};
use nerd_model::transformer::{Architecture, Forward, PackedForward, PackedStream, Positions, Stream, TransformerConfig, Weights};
use nerd_train::learner::cuda::{CudaForward, CudaStream, Precision};

use crate::Outcome;
use crate::training::rivals;
use crate::with::{largest, numbers, weights, windows as drawn};

/// What has no memory on the device is refused, what is no number stays none.
pub fn refusals() -> Outcome {
    let rotary = TransformerConfig { positions: Positions::Rotary, layers: 2, ..TransformerConfig::paper(37, 4, 192) };
    let mut stream = CudaStream::new(&weights(rotary, 0.05), Precision::F32, 40)?;
    let mut out = Vec::new();
    if stream.push(&drawn(3, rotary, 41, 1).x, &[], &mut out).is_ok() {
        return Err("41 environments in a stream for 40".into());
    }
    for asked in [&[1, 0][..], &[2, 2], &[40]] {
        if stream.push(&drawn(3, rotary, 40, 1).x, asked, &mut out).is_ok() {
            return Err(format!("environments {asked:?} of 40").into());
        }
    }
    let table = TransformerConfig { positions: Positions::Table, ..rotary };
    for other in [table, TransformerConfig { architecture: Architecture::Gru, ..table }] {
        let made = CudaStream::new(&Weights::init(other, 0), Precision::F32, 4).err().map(|e| e.to_string());
        if made.is_none_or(|e| !e.contains("sees no windows")) {
            return Err(format!("{:?} with {:?} frame by frame", other.architecture, other.positions).into());
        }
    }
    if CudaForward::new(&weights(rotary, 0.05), Precision::F32, 4).is_ok() {
        return Err("windows of rotary positions".into());
    }
    let mut first = 0;
    for tensor in table.tensors() {
        let mut none = weights(table, 0.05);
        // An entry that all windows meet: of the position table the first row.
        none.flat[first] = f32::NAN;
        first += tensor.len();
        let y = CudaForward::new(&none, Precision::F32, 8)?.forward(&drawn(3, table, 8, 10).x, 10, &[9; 8])?;
        if y.iter().all(|y| y.is_finite()) {
            return Err(format!("NaN in {} is swallowed", tensor.name).into());
        }
    }
    println!("rows without memory, unordered environments, networks of the other kind are refused; NaN in any tensor comes out");
    Ok(())
}

/// Predictions of windows and of their parts are those of the CPU; of a chain, those of all its rods.
pub fn windows() -> Outcome {
    let table = TransformerConfig { layers: 2, ..TransformerConfig::paper(37, 4, 192) };
    // A chain's products have kernels of their own on tensor cores, which round operands to 11 bits: 2^13 times as coarse as f32.
    let chain = |config: &TransformerConfig| config.architecture == Architecture::Chain;
    let coarse: Vec<_> = rivals().into_iter().filter(chain).map(|config| (config, Precision::Tf32, 1e-2)).collect();
    let fine = rivals().into_iter().chain([table]).map(|config| (config, Precision::F32, 1e-4));
    for (config, precision, bound) in fine.chain(coarse) {
        let (w, mut there) = (weights(config, 0.05), Vec::new());
        let mut cuda = CudaForward::new(&w, precision, 40)?;
        let chain = chain(&config);
        // Sizes that are captured apart, and one for the second time.
        for (count, tokens) in [(40, 10), (33, 10), (9, 6), (9, 10)] {
            let inputs = numbers(2, count * tokens * 37);
            let last: Vec<u32> = (0..count).map(|w| (w * 7 % tokens) as u32).collect();
            let (here, what) = if chain && tokens < 10 {
                continue;
            } else if chain {
                let rows: Vec<usize> = (0..count * tokens).collect();
                let (loaded, mut memory) = (Loaded::new(config.program(), &w.flat), Memory::default());
                there.clone_from(loaded.forward(&inputs, &mut memory, Pass::Windows(tokens, &rows)));
                (cuda.all(&inputs)?, "all tokens")
            } else {
                PackedForward::new(&w).forward(&inputs, tokens, &last, &mut there)?;
                (cuda.forward(&inputs, tokens, &last)?, "tokens asked for")
            };
            let off = largest(&here, &there) / there.iter().fold(0.0, |m: f32, x| m.max(x.abs()));
            println!("{:?}, {precision:?}, {count} windows of {tokens}, {what}: {off:.1e} from the CPU", config.architecture);
            if here.len() != there.len() || off.is_nan() || off > bound {
                return Err("other predictions than the CPU's".into());
            }
        }
    }
    Ok(())
}

/// A full window and its first tokens alone must give the same prediction for a token both hold.
pub fn inference() -> Outcome {
    let config = TransformerConfig::paper(37, 4, 192);
    let data = drawn(2, config, 300, config.history);
    let mut forward = CudaForward::new(&weights(config, 0.05), Precision::F32, 512)?;
    let whole = forward.forward(&data.x, 10, &[6; 300])?;
    let part: Vec<f32> = data.x.chunks_exact(370).flat_map(|w| w[..7 * 37].to_vec()).collect();
    let part = forward.forward(&part, 7, &[6; 300])?;
    let worst = largest(&whole, &part);
    println!("causality: largest difference {worst:e}");
    if worst.is_nan() || worst > 1e-4 {
        return Err("a token sees younger ones".into());
    }
    let inputs = drawn(2, config, 2048, config.history).x;
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
pub fn streaming() -> Outcome {
    let config = TransformerConfig { positions: Positions::Rotary, ..TransformerConfig::paper(247, 29, 192) };
    let (w, envs) = (weights(config, 0.05), 100);
    let (mut cuda, mut cpu) = (CudaStream::new(&w, Precision::F32, envs)?, PackedStream::new(&w));
    let (mut a, mut b, mut worst) = (Vec::new(), Vec::new(), 0.0f32);
    for frame in 0..80 {
        let tokens = drawn(20 + frame as u64, config, envs, 1).x;
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
            let (tokens, asked): (_, Vec<usize>) = (drawn(3, config, envs, 1).x, (0..envs).collect());
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
