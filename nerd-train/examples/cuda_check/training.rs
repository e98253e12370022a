//! Gradients, updates and what they lead to.

use std::error::Error;
use std::sync::Arc;

use nerd_model::transformer::{Architecture, Positions, TransformerConfig};
use nerd_train::learner::cuda::{CudaLearner, Precision};
use nerd_train::learner::{CpuLearner, Learner, LearnerConfig, LearnerState, Optimizer};
use nerd_train::windows::draw;

use crate::Outcome;
use crate::with::{configuration, learner, noise, weights, windows};

/// Shapes with a table and without, wide heads and narrow ones, a band narrower than the sequence, more outputs than lanes; rivals, one
/// with more outputs than its head has room for; a chain.
fn shapes() -> Vec<TransformerConfig> {
    let paper = TransformerConfig::paper;
    let rotary = |c: TransformerConfig, block| TransformerConfig { positions: Positions::Rotary, block, ..c };
    let small = TransformerConfig { layers: 2, heads: 4, history: 7, ..paper(10, 33, 48) };
    let wide = paper(37, 4, 192);
    let narrow = rotary(TransformerConfig { heads: 3, ..small }, 20);
    let all = [wide, paper(6, 14, 384), small, rotary(wide, 32), rotary(wide, 55), rotary(paper(37, 4, 384), 64), narrow];
    let transformers = all.map(|c| TransformerConfig { layers: c.layers.min(3), ..c });
    transformers.into_iter().chain(rivals()).chain([TransformerConfig { history: 3, ..rival(Architecture::Mlp, 30, 600) }]).collect()
}

fn rival(architecture: Architecture, embedding: usize, outputs: usize) -> TransformerConfig {
    TransformerConfig { architecture, layers: 2, heads: 1, ..TransformerConfig::paper(37, outputs, embedding) }
}

/// One of each, of odd widths where they can be.
pub fn rivals() -> [TransformerConfig; 4] {
    let [mlp, gru, lstm] =
        [(Architecture::Mlp, 51), (Architecture::Gru, 45), (Architecture::Lstm, 40)].map(|(rival_of, e)| rival(rival_of, e, 4));
    [mlp, gru, lstm, TransformerConfig { layers: 8, block: 10, ..rival(Architecture::Chain, 48, 6) }]
}

/// Every entry within this share of the root mean square of its tensor's: an entry that is missing is off by all of itself.
const ENTRY: f64 = 2e-3;
/// Central differences along a tensor's random signs, within this share of the norm of its gradient.
const SLOPE: f64 = 0.05;

pub fn gradient() -> Outcome {
    let mut wrong = Vec::new();
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
            let name = format!("E {}, {:?}, {:?}, huber {huber:?}", config.embedding, config.architecture, config.positions);
            println!("{name}: loss {loss:.5}, off the CPU's by {off:.1e}");
            if off.is_nan() || off > 1e-4 {
                wrong.push(format!("the loss of {name}"));
            }
            let (mut first, mut worst) = (0, (0.0, String::new()));
            for tensor in config.tensors() {
                let range = first..first + tensor.len();
                first = range.end;
                let (a, b) = (&found[range.clone()], &expected[range.clone()]);
                let norm = b.iter().map(|g| f64::from(*g).powi(2)).sum::<f64>().sqrt();
                let scale = norm / (b.len() as f64).sqrt();
                let off = a.iter().zip(b).map(|(a, b)| f64::from(a - b).abs() / scale).fold(0.0, f64::max);
                if off > worst.0 || off.is_nan() {
                    worst = (off, tensor.name.clone());
                }
                if a.iter().any(|g| !g.is_finite()) || off.is_nan() || off > ENTRY {
                    println!("    {}: an entry of its gradient is off by {off:.1e} of their root mean square", tensor.name);
                    wrong.push(format!("{} of {name}", tensor.name));
                }
                // The loss is squares where it is not bent, and what is reported are squares. A perceptron is all kinks.
                if huber.is_none()
                    && config.architecture != Architecture::Mlp
                    && let Err(e) = slope(&mut cuda, &centre.flat, range, a, (f64::from(loss), norm))
                {
                    println!("    {}: {e}", tensor.name);
                    wrong.push(format!("the slope of {} of {name}", tensor.name));
                }
            }
            println!("    largest error of an entry {:.1e} of its tensor's root mean square, in {}", worst.0, worst.1);
        }
    }
    if wrong.is_empty() { Ok(()) } else { Err(format!("other gradients than the CPU's: {}", wrong.join(", ")).into()) }
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
pub fn validation() -> Outcome {
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

/// Ten updates from one state come to the CPU's weights, by Adam and by Muon.
pub fn updates() -> Outcome {
    let small = TransformerConfig { layers: 2, heads: 4, ..TransformerConfig::paper(37, 4, 48) };
    for (config, optimizer) in rivals().into_iter().chain([small]).flat_map(|c| [(c, Optimizer::Adam), (c, Optimizer::Muon)]) {
        let (data, state) = (Arc::new(windows(2, config, 20, 50)), LearnerState::new(weights(config, 0.05)));
        let (first, settings) = (state.weights.flat.clone(), LearnerConfig { optimizer, ..configuration(64) });
        let cuda = CudaLearner::new(settings, Precision::F32, state.clone(), &data, &data);
        let (Architecture::Chain, Optimizer::Muon) = (config.architecture, optimizer) else {
            let (mut cuda, mut cpu) = (cuda?, CpuLearner::new(settings, state, data.clone(), data.clone())?);
            (0..10).try_for_each(|_| cuda.update(1e-3).and_then(|()| cpu.update(1e-3)))?;
            let (a, b) = (cuda.state()?, cpu.state()?);
            let norm = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>().sqrt();
            let apart = |a: &[f32], b: &[f32]| norm(a, b) / norm(b, &first);
            let off = [apart(&a.weights.flat, &b.weights.flat), apart(&a.average, &b.average)];
            println!(
                "{:?}, {optimizer:?}: weights {:.1e} of their way from the CPU's, averages {:.1e}",
                config.architecture, off[0], off[1]
            );
            if off.iter().any(|off| off.is_nan() || *off > 0.02) {
                return Err("other updates than the CPU's".into());
            }
            continue;
        };
        if cuda.is_ok() {
            return Err("Muon has nothing to do in a chain".into());
        }
    }
    Ok(())
}

pub fn resume() -> Outcome {
    let [_, gru, ..] = rivals();
    for (config, precision) in
        [TransformerConfig::paper(37, 4, 192), gru].into_iter().flat_map(|c| [(c, Precision::F32), (c, Precision::Tf32)])
    {
        let (train, validation) = (windows(2, config, 200, 100), windows(3, config, 20, 100));
        let start = |state| CudaLearner::new(configuration(512), precision, state, &train, &validation);
        let mut whole = start(LearnerState::new(weights(config, 0.0)))?;
        let mut half = start(LearnerState::new(weights(config, 0.0)))?;
        (0..20).try_for_each(|_| whole.update(1e-3).and_then(|()| half.update(1e-3)))?;
        let mut taken_up = start(half.state()?)?;
        (0..20).try_for_each(|_| whole.update(5e-4).and_then(|()| taken_up.update(5e-4)))?;
        let equal = whole.state()? == taken_up.state()?;
        println!("{:?}, {precision:?}: 20 + 20 updates from a state equal 40 unbroken ones bit for bit: {equal}", config.architecture);
        if !equal {
            return Err("resume is not exact".into());
        }
    }
    Ok(())
}

pub fn learning() -> Outcome {
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
