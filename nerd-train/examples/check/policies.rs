//! PPO on the card: rollouts whose tasks are there are those of tasks on the CPU, and what is learned from them there is what the CPU learns.

use nerd_tasks::names;
use nerd_train::ppo::{Activation, OnCpu, Rollout, Shape, Taken, Updated};

use crate::with::*;

/// Environments, and steps of a rollout.
const N: usize = 512;
const HORIZON: usize = 16;
/// Numbers that differ by more than this are apart; so many of all may be, since contact now and then falls otherwise.
const APART: f64 = 1e-4;
const SHARE: f64 = 0.02;

/// The last minibatch of a pass is smaller; the rate is left alone, since a rounding may carry a divergence across its threshold.
fn config(stack: usize, activation: Activation) -> PpoConfig {
    let hidden = vec![64, 32];
    PpoConfig { environments: N, horizon: HORIZON, minibatch: 1000, epochs: 2, kl: 0.0, stack, hidden, activation, ..PpoConfig::default() }
}

/// Episodes and what answers them on the card.
struct Side {
    episodes: Episodes,
    engine: CudaEngine,
    running: Running,
}

impl Side {
    /// Whose episodes are stepped on the card, or by their own solver.
    fn new(episodes: Episodes, on_card: bool, shape: &Shape, config: &PpoConfig) -> Outcome<Self> {
        let (running, mut engine) = (Running::new(&episodes, shape.stack), CudaEngine::new(shape, config)?);
        engine.steps_episodes = on_card;
        Ok(Self { episodes, engine, running })
    }

    fn roll(&mut self, policy: &Policy, config: &PpoConfig, number: usize) -> Outcome<(Rollout, Taken)> {
        let noise = StreamKey { seed: 7, number: (number * HORIZON) as u64 };
        let taken = self.engine.roll(Stage {
            episodes: &mut self.episodes,
            running: &mut self.running,
            policy,
            config,
            noise,
            stop: Default::default(),
        })?;
        Ok((self.engine.rollout()?, taken))
    }

    /// How far apart, as a share of their way, weights are that card and CPU learn from the last rollout; and how far apart what they find
    /// on the way and the moments are.
    fn learn(&mut self, first: &Policy, config: &PpoConfig) -> Outcome<[f64; 2]> {
        let adam = Adam::new(first.flat.len(), 1e-3);
        let [mut one, mut other] = [(first.clone(), adam.clone()), (first.clone(), adam)];
        let (mut cpu, orders) = (OnCpu::default(), StreamKey { seed: 5, number: 0 });
        cpu.rollout = self.engine.rollout()?;
        let here = cpu.update(&mut one.0, &mut one.1, config, orders)?;
        let there = self.engine.update(&mut other.0, &mut other.1, config, orders)?;
        let moments = |p: &Policy| [&p.seen, &p.returns].map(|m| [&m.mean[..], &m.variance[..], &[m.count][..]].concat()).concat();
        let terms = |u: &Updated| [u.terms.actor, u.terms.critic, u.gradient_norm];
        let found = [largest(&terms(&there), &terms(&here)), largest(&moments(&other.0), &moments(&one.0))];
        Ok([share_of_way(&one.0.flat, &other.0.flat, &first.flat), worse(0.0, found)])
    }
}

/// Episodes of which some will soon run out of time.
pub fn under_way(task: &str, arena: &Arena, n: usize) -> Outcome<Episodes> {
    let mut episodes = arena.episodes(task, n, 3)?;
    episodes.climb();
    let length = episodes.task.episode_length() * episodes.task.frames();
    let mut kept = episodes.snapshot();
    kept.frames.iter_mut().enumerate().filter(|(env, _)| env % 5 == 0).for_each(|(env, f)| *f = length - 1 - (env as u64 % 40));
    episodes.restore(&kept)?;
    Ok(episodes)
}

/// Every kind of policy learns the same on the card and on the CPU.
pub fn policies(checks: &mut Checks) -> Outcome {
    for (activation, spread_by_state, value_clip) in
        [(Activation::Relu, false, 0.0), (Activation::Elu, true, 0.2), (Activation::Tanh, false, 0.0)]
    {
        let host = under_way("cartpole-swingup", &Arena::Judge(Setting::Implicit(4)), N)?;
        let config = PpoConfig { value_clip, entropy: 0.01, spread_by_state, ..config(2, activation) };
        let shape = Shape::of(&*host.task, &config);
        let (policy, mut side) = (Policy::new(shape.clone(), &mut stream(8, 0)), Side::new(host, false, &shape, &config)?);
        side.roll(&policy, &config, 0)?;
        let [apart, found] = side.learn(&policy, &config)?;
        let what =
            format!("{activation:?}: weights {apart:.1e} of their way from those that the CPU learns, terms and moments {found:.1e}");
        checks.demand(apart < 1e-2 && found < 1e-3, what);
    }
    Ok(())
}

/// Tasks on the card, in a model, in articulated dynamics and with robots of a family; and a run that goes on from a snapshot.
pub fn tasks(checks: &mut Checks) -> Outcome {
    for name in names() {
        let task = named(name)?;
        if task.kernels(&*System::named(task.robot())?, Reach { colliders: 1, ..Reach::default() }, false).is_ok() {
            let folder = Path::new("models").join(task.robot());
            task_alike(checks, name, &Arena::Model { folder, device: Device::Cuda })?;
            task_alike(checks, name, &Arena::Card(Setting::Implicit(4)))?;
        }
    }
    task_alike(checks, "rough@anymal", &Arena::Card(Setting::Implicit(4)))?;
    for (task, robot) in [("ant-run", "ant"), ("anymal-forward", "anymal"), ("rough@anymal", "anymal")] {
        let mut family = (*System::named(&format!("{robot}-family"))?).clone();
        if let Some(vary) = &mut family.spec.vary {
            (vary.gain, vary.lag, vary.push) = (range(0.8, 1.2), range(0.0, 2.0), range(0.0, 0.5));
            (vary.noise, vary.root_noise, vary.turn_noise) = (range(0.0, 0.01), range(0.0, 0.01), range(0.0, 0.01));
            vary.push_every = Some(0.1);
        }
        task_alike(checks, task, &Arena::Family(Truth::Articulated, family.into(), Device::Cuda))?;
    }
    Ok(())
}

fn range(low: f64, high: f64) -> Option<Range> {
    Some(Range { low, high })
}

fn task_alike(checks: &mut Checks, task: &str, arena: &Arena) -> Outcome {
    let (host, config) = (under_way(task, arena, N)?, config(if task == "franka-reach-torque" { 3 } else { 1 }, Activation::Elu));
    let shape = Shape::of(&*host.task, &config);
    let policy = Policy::new(shape.clone(), &mut stream(8, 0));
    let (mut cpu, mut gpu) = (Side::new(host, false, &shape, &config)?, Side::new(under_way(task, arena, N)?, true, &shape, &config)?);
    let title = format!("{task} on {}", arena.title()?);
    for number in 0..2 {
        let ((one, told), (other, said)) = (cpu.roll(&policy, &config, number)?, gpu.roll(&policy, &config, number)?);
        let wide = |numbers: &[f32]| numbers.iter().copied().map(f64::from).collect::<Vec<f64>>();
        let shares = [
            share(&one.observations, &other.observations),
            share(&wide(&one.actions), &wide(&other.actions)),
            share(&one.values, &other.values),
            share(&one.advantages, &other.advantages),
            share(&cpu.running.stack.rows, &gpu.running.stack.rows),
        ];
        let near = told.ended.len().abs_diff(said.ended.len()) as f64 <= 1.0 + SHARE * told.ended.len() as f64;
        let what = format!("{title}, rollout {number}: observations, actions, values, advantages, rows: {shares:?} of them apart");
        checks.demand(gpu.engine.has_episodes() && near && shares.iter().all(|share| *share <= SHARE), what);
    }
    let [apart, _] = gpu.learn(&policy, &config)?;
    checks.demand(apart < 1e-2, format!("{title}: weights {apart:.1e} of their way from those that the CPU learns"));
    let kept = gpu.engine.snapshot(&gpu.episodes)?;
    let mut other = Side::new(under_way(task, arena, N)?, true, &shape, &config)?;
    other.engine.restore(&mut other.episodes, &kept)?;
    other.running = gpu.running.clone();
    let (gone_on, begun_again) = (gpu.roll(&policy, &config, 2)?.0, other.roll(&policy, &config, 2)?.0);
    let (share, exact) = (share(&gone_on.observations, &begun_again.observations), matches!(arena, Arena::Card(_)));
    let same = gone_on.observations == begun_again.observations;
    checks.demand(share <= SHARE && (same || !exact), format!("{title}, gone on from a snapshot: {share:.1e} apart"));
    Ok(())
}

/// Share of the numbers that are apart.
fn share(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    let off = a.iter().zip(b).map(|(a, b)| (a - b).abs() / (1.0 + b.abs()));
    off.filter(|x| x.is_nan() || *x > APART).count() as f64 / a.len().max(1) as f64
}
