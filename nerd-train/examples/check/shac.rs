//! SHAC on the GPU: gradient, return and critic against the CPU.

use crate::policies::under_way;
use crate::with::*;

/// Environments and steps of a rollout. Few steps, since every contact amplifies rounding.
const N: usize = 64;
const HORIZON: usize = 8;
/// Tolerance of gradient and return, relative to their size.
const APART: f64 = 1e-3;
const TASKS: [&str; 3] = ["cartpole-swingup", "ant-run", "anymal-forward"];

fn model(task: &str, device: Device) -> Outcome<Arena> {
    Ok(Arena::Solver(SolverSpec::neural(Path::new("models").join(named(task)?.robot())).on(device)))
}

/// The articulated solver in f64, on the GPU or the CPU.
fn articulated(on_card: bool) -> Arena {
    let make = move |system: &Arc<System>, _: &Arc<Scene>| -> nerd_train::Result<Box<dyn Solver>> {
        let config = ArticulatedConfig::accurate(system);
        Ok(if on_card { Box::new(CudaArticulated::new(config, Real::F64)) } else { Box::new(Articulated::new(config)) })
    };
    Arena::Guest("articulated".into(), Arc::new(make))
}

/// Results of one iteration: gradient, return J, weights of policy and critics, timed parts.
struct Found {
    gradient: Vec<f32>,
    earned: f64,
    first: Vec<f32>,
    weights: Vec<f32>,
    critic: [Vec<f32>; 2],
    parts: usize,
}

fn iteration(task: &str, arena: &Arena, on_card: bool) -> Outcome<Found> {
    let shipped = PpoConfig::shac(task)?;
    let config = PpoConfig { environments: N, horizon: HORIZON, minibatch: 128, epochs: 2, ..shipped };
    let mut episodes = under_way(task, arena, N)?;
    let mut policy = Trainer::new(arena.episodes(task, N, 3)?, config.clone(), 2)?.state.policy;
    policy.seen.update(episodes.observations());
    let mut running = Running::new(&episodes, 1);
    let mut shac = Shac::new(&mut episodes, &mut policy, &config, 4)?;
    // An untrained critic has zero gradient, so perturb its weights.
    for (name, numbers) in shac.learned()?.into_iter().take(2) {
        let offset = if name == "critic" { 0 } else { 7 };
        numbers.iter_mut().enumerate().for_each(|(k, w)| *w += 0.05 * crate::with::noise(9, k + offset));
    }
    let (noise, orders, mut adam) =
        (StreamKey { seed: 5, number: 0 }, StreamKey { seed: 6, number: 0 }, Adam::new(policy.flat.len(), 1e-3));
    let first = policy.flat.clone();
    let stage = RolloutInput {
        episodes: &mut episodes,
        running: &mut running,
        policy: &policy,
        config: &config,
        noise,
        stop: Default::default(),
    };
    let (gradient, earned, parts, critic) = if on_card {
        let mut card = CudaShac::new(shac, &policy, &config)?;
        card.roll(stage)?;
        let found = (card.shac.gradient.clone(), card.shac.earned);
        card.update(&mut policy, &mut adam, &config, orders)?;
        let parts = card.spent().len();
        (found.0, found.1, parts, critics(&mut card)?)
    } else {
        shac.roll(stage)?;
        let found = (shac.gradient.clone(), shac.earned);
        shac.update(&mut policy, &mut adam, &config, orders)?;
        (found.0, found.1, 0, critics(&mut shac)?)
    };
    Ok(Found { gradient, earned, first, weights: policy.flat, critic, parts })
}

/// Weights of the critic and of its target network.
fn critics(engine: &mut dyn Engine) -> Outcome<[Vec<f32>; 2]> {
    let both: Vec<Vec<f32>> = engine.learned()?.into_iter().take(2).map(|(_, numbers)| numbers.clone()).collect();
    both.try_into().map_err(|_| "two critics are learned".into())
}

/// Gradients and updates on the GPU against the CPU, in models and in the articulated solver.
pub fn shac(checks: &mut Checks) -> Outcome {
    for (task, exact) in TASKS.into_iter().flat_map(|task| [(task, false), (task, true)]) {
        let name = if exact { "articulated" } else { "model" };
        let both = if exact {
            [articulated(true), articulated(false)]
        } else {
            [model(task, Device::CudaF32)?, model(task, Device::Cpu)?]
        };
        if let Err(error) = gradients(checks, task, name, &both) {
            checks.demand(false, format!("{task} in the {name}: {error}"));
        }
    }
    Ok(())
}

fn gradients(checks: &mut Checks, task: &str, name: &str, [card, cpu]: &[Arena; 2]) -> Outcome {
    let started = Instant::now();
    let (there, here) = (iteration(task, card, true)?, iteration(task, cpu, false)?);
    let size = |x: &[f32]| x.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>().sqrt();
    let off: Vec<f32> = there.gradient.iter().zip(&here.gradient).map(|(a, b)| a - b).collect();
    let apart = size(&off) / size(&here.gradient);
    let earned = largest(&[there.earned], &[here.earned]);
    let way = share_of_way(&there.weights, &here.weights, &here.first);
    let critic = [0, 1].map(|k| share_of_way(&there.critic[k], &here.critic[k], &vec![0.0; here.critic[k].len()]));
    let what = format!(
        "{task} in the {name}: gradient {apart:.1e} of {:.1e} apart, J {earned:.1e} of {:.3}, weights {way:.1e} of their way, critics {critic:.1?}",
        size(&here.gradient),
        here.earned,
    );
    let seconds = started.elapsed().as_secs_f64();
    checks.demand(
        there.parts > 0 && apart < APART && earned < APART && critic.iter().all(|x| *x < 1e-2),
        format!("{what}; {seconds:.1} s"),
    );
    Ok(())
}
