//! Gradients and updates on the GPU against the CPU, for windows and for rollouts.

use nerd_model::chain::{Chain, ChainSolver};
use nerd_sim::trajectories::Trajectories;
use nerd_train::unroll::chain::{Cable, Loss, scales};
use nerd_train::unroll::{Course, CudaUnrollLearner, UnrollLearner};

use crate::with::*;

/// Tolerance of a gradient entry, relative to the root mean square of its tensor. A missing entry exceeds it.
const ENTRY: f64 = 2e-3;

pub fn gradients(checks: &mut Checks) -> Outcome {
    for (config, huber) in shapes().into_iter().flat_map(|config| [(config, None), (config, Some(0.1))]) {
        let (data, centre) = (Arc::new(windows(2, config, 20, 80.max(config.sequence() + 16))), weights(config));
        let (settings, state) = (LearnerConfig { huber, ..settings(64) }, LearnerState::new(centre.clone()));
        let mut cuda = CudaLearner::new(settings, Precision::F32, state.clone(), [&data, &data])?;
        let mut cpu = CpuLearner::new(settings, state, [data.clone(), data.clone()])?;
        // The windows that the device draws for its first update.
        let rows: Vec<u64> =
            (0..settings.batch as u64).map(|row| draw(settings.seed, 0, row, data.len() as u64)).collect();
        let ((loss, found), (of_cpu, expected)) = (cuda.gradient()?, cpu.gradient(&rows)?);
        let (mut first, mut worst) = (0, 0.0f64);
        for tensor in config.tensors() {
            let range = first..first + tensor.len();
            first = range.end;
            let (a, b) = (&found[range.clone()], &expected[range]);
            let scale = (b.iter().map(|g| f64::from(*g).powi(2)).sum::<f64>() / b.len() as f64).sqrt();
            worst = worse(worst, a.iter().zip(b).map(|(a, b)| f64::from(a - b).abs() / scale));
        }
        let off = f64::from(loss / of_cpu - 1.0).abs();
        let name =
            format!("E {}, {:?}, {:?}, huber {huber:?}", config.embedding, config.architecture, config.positions);
        checks
            .demand(off < 1e-4 && worst < ENTRY, format!("{name}: loss {off:.1e}, entries {worst:.1e} from the CPU's"));
        for wanted in [1, 63, 10_000] {
            let (a, b) = (cuda.validate(wanted)?, cpu.validate(wanted)?);
            checks.demand(
                (a / b - 1.0).abs() < 1e-4,
                format!("{name}: validation over {wanted} windows {a:.6}, on the CPU {b:.6}"),
            );
        }
    }
    Ok(())
}

/// Ten updates by Adam and by Muon, against the CPU. A learner resumed from its state gives the same bits.
pub fn updates(checks: &mut Checks) -> Outcome {
    let small = TransformerConfig { layers: 2, heads: 4, ..TransformerConfig::paper(37, 4, 48) };
    for (config, optimizer) in
        others().into_iter().chain([small]).flat_map(|c| [(c, Optimizer::Adam), (c, Optimizer::Muon)])
    {
        let (data, state) = (Arc::new(windows(2, config, 20, 50)), LearnerState::new(weights(config)));
        let (first, settings) = (state.weights.flat.clone(), LearnerConfig { optimizer, ..settings(64) });
        let cuda = CudaLearner::new(settings, Precision::F32, state.clone(), [&data, &data]);
        if (config.architecture, optimizer) == (Architecture::Chain, Optimizer::Muon) {
            checks.demand(cuda.is_err(), "Muon has nothing to do in a chain".into());
            continue;
        }
        let (mut cuda, mut cpu) = (cuda?, CpuLearner::new(settings, state, [data.clone(), data.clone()])?);
        (0..10).try_for_each(|_| cuda.update(1e-3).and_then(|()| cpu.update(1e-3)))?;
        let (a, b) = (cuda.state()?, cpu.state()?);
        let off =
            [share_of_way(&a.weights.flat, &b.weights.flat, &first), share_of_way(&a.average, &b.average, &first)];
        let what =
            format!("{:?}, {optimizer:?}: weights, averages {off:?} of their way from the CPU's", config.architecture);
        checks.demand(off.iter().all(|off| *off < 0.02), what);
        let mut taken_up = CudaLearner::new(settings, Precision::F32, a, [&data, &data])?;
        (0..20).try_for_each(|_| cuda.update(5e-4).and_then(|()| taken_up.update(5e-4)))?;
        checks.demand(
            cuda.state()? == taken_up.state()?,
            format!("{:?}, {optimizer:?}: taken up again, the same bits", config.architecture),
        );
    }
    Ok(())
}

/// Losses of updates through eight frames of a cable, against the CPU.
pub fn chains(checks: &mut Checks) -> Outcome {
    let system = System::named("lead-pegs")?;
    let train = motions(&system)?;
    let (model, chain) = (Model::load(Path::new("models/lead-pegs"), &system, None)?, Chain::of(&system)?);
    let (scale, (_, velocity)) = (ChainSolver::scale(&model.normalizer)?, scales(&chain, &train));
    let body = Cable { chain, loss: Loss::new(&scale, velocity, 8), scale };
    unrolled(checks, &system, model.weights, Course { body, validation: train.clone(), train, frames: 8 })
}

fn record() -> GenerateConfig {
    GenerateConfig { transitions: 64 * 40, frames: 40, ..GenerateConfig::default() }
}

fn motions(system: &Arc<System>) -> Outcome<Arc<Trajectories>> {
    let solver =
        || -> Box<dyn Solver> { Box::new(Articulated::new(ArticulatedConfig::implicit(4, Friction::Coulomb))) };
    Ok(Arc::new(nerd_train::unroll::motions(system, &solver, &record(), &|_| ())?))
}

fn unrolled(checks: &mut Checks, system: &Arc<System>, weights: Weights, course: Course<Cable>) -> Outcome {
    let (config, state) = (LearnerConfig { average: 0.9, ..settings(24) }, LearnerState::new(weights));
    let mut here = UnrollLearner::new(config, state.clone(), course.clone())?;
    let mut there = CudaUnrollLearner::new(system, config, Precision::F32, state, course)?;
    for _ in 0..6 {
        here.update(1e-4)?;
        there.update(1e-4)?;
        let (a, b) = (here.progress()?, there.progress()?);
        let off = [b.loss / a.loss - 1.0, b.gradient_norm / a.gradient_norm - 1.0].map(f32::abs);
        let what = format!("{}: an update through 8 frames: loss {}, off by {off:?}", system.name, a.loss);
        checks.demand(off[0] < 1e-3 && off[1] < 1e-2, what);
    }
    Ok(())
}
