//! PPO on the GPU against the CPU: rollouts with tasks on the GPU, and updates from the same rollout.

use nerd_tasks::{Compiled, names};
use nerd_train::ppo::{Activation, OnCpu, Rollout, RolloutStats, Shape, Updated};

use crate::with::*;

/// Environments and steps of a rollout.
const N: usize = 512;
const HORIZON: usize = 16;
/// Relative difference above which two numbers count as apart, and the allowed share of such numbers. A few differ,
/// since contacts begin a frame early or late.
const APART: f64 = 1e-4;
const SHARE: f64 = 0.02;

/// The last minibatch of a pass is smaller. The learning rate is fixed (`target_kl` 0): rounding may carry the KL
/// divergence across its threshold.
fn config(stack: usize, activation: Activation) -> PpoConfig {
    let hidden = vec![64, 32];
    PpoConfig {
        environments: N,
        horizon: HORIZON,
        minibatch: 1000,
        epochs: 2,
        target_kl: 0.0,
        stack,
        hidden,
        activation,
        ..PpoConfig::default()
    }
}

/// Episodes with their engine on the GPU.
struct Side {
    episodes: Episodes,
    engine: CudaEngine,
    running: Running,
}

impl Side {
    /// Tasks and episodes run on the GPU if `on_card`, else on the CPU around the solver.
    fn new(episodes: Episodes, on_card: bool, shape: &Shape, config: &PpoConfig) -> Outcome<Self> {
        let (running, mut engine) = (Running::new(&episodes, shape.stack), CudaEngine::new(shape, config)?);
        engine.steps_episodes = on_card;
        Ok(Self { episodes, engine, running })
    }

    fn roll(&mut self, policy: &Policy, config: &PpoConfig, number: usize) -> Outcome<(Rollout, RolloutStats)> {
        let noise = StreamKey { seed: 7, number: (number * HORIZON) as u64 };
        let taken = self.engine.roll(RolloutInput {
            episodes: &mut self.episodes,
            running: &mut self.running,
            policy,
            config,
            noise,
            stop: Default::default(),
        })?;
        Ok((self.engine.rollout()?, taken))
    }

    /// Learns from the last rollout on the GPU and on the CPU. Returns the distance between both weights relative to
    /// the update, and the largest relative difference of loss terms and moments.
    fn learn(&mut self, first: &Policy, config: &PpoConfig) -> Outcome<[f64; 2]> {
        let adam = Adam::new(first.flat.len(), 1e-3);
        let [mut one, mut other] = [(first.clone(), adam.clone()), (first.clone(), adam)];
        let (mut cpu, orders) = (OnCpu::default(), StreamKey { seed: 5, number: 0 });
        cpu.rollout = self.engine.rollout()?;
        let here = cpu.update(&mut one.0, &mut one.1, config, orders)?;
        let there = self.engine.update(&mut other.0, &mut other.1, config, orders)?;
        let moments = |p: &Policy| {
            [&p.seen, &p.returns].map(|m| [&m.mean[..], &m.variance[..], &[m.count][..]].concat()).concat()
        };
        let terms = |u: &Updated| [u.terms.actor, u.terms.critic, u.gradient_norm];
        let found = [largest(&terms(&there), &terms(&here)), largest(&moments(&other.0), &moments(&one.0))];
        Ok([share_of_way(&one.0.flat, &other.0.flat, &first.flat), worse(0.0, found)])
    }
}

/// Episodes in progress: in every fifth environment at most 40 frames are left.
pub fn under_way(task: &str, arena: &Arena, n: usize) -> Outcome<Episodes> {
    let mut episodes = arena.episodes(task, n, 3)?;
    episodes.climb();
    let length = episodes.task.episode_length() * episodes.task.frames();
    let mut kept = episodes.snapshot();
    kept.frames
        .iter_mut()
        .enumerate()
        .filter(|(env, _)| env % 5 == 0)
        .for_each(|(env, f)| *f = length - 1 - (env as u64 % 40));
    episodes.restore(&kept)?;
    Ok(episodes)
}

/// Policies with each activation, value clip and spread by state learn the same on GPU and CPU.
pub fn policies(checks: &mut Checks) -> Outcome {
    for (activation, state_dependent_std, value_clip) in
        [(Activation::Relu, false, 0.0), (Activation::Elu, true, 0.2), (Activation::Tanh, false, 0.0)]
    {
        let host = under_way("cartpole-swingup", &Arena::Solver(SolverSpec::implicit(4)), N)?;
        let config = PpoConfig { value_clip, ent_coef: 0.01, state_dependent_std, ..config(2, activation) };
        let shape = Shape::of(&*host.task, &config);
        let (policy, mut side) =
            (Policy::new(shape.clone(), &mut stream(8, 0)), Side::new(host, false, &shape, &config)?);
        side.roll(&policy, &config, 0)?;
        let [apart, found] = side.learn(&policy, &config)?;
        let what = format!(
            "{activation:?}: weights {apart:.1e} of their way from those that the CPU learns, terms and moments {found:.1e}"
        );
        checks.demand(apart < 1e-2 && found < 1e-3, what);
    }
    Ok(())
}

/// Tasks on the GPU with a model, articulated dynamics and robots of a family; and continuation from a snapshot.
pub fn tasks(checks: &mut Checks) -> Outcome {
    for name in names() {
        let task = named(name)?;
        let system = task.system()?;
        let task = Compiled::new(task, &system);
        if task.kernels(Reach { colliders: 1, ..Reach::default() }, false).is_ok() {
            let folder = Path::new("models").join(task.robot());
            task_alike(checks, name, &Arena::Solver(SolverSpec::neural(folder).on(Device::Cuda)))?;
            task_alike(checks, name, &Arena::Solver(SolverSpec::implicit(4).on(Device::Cuda)))?;
        }
    }
    task_alike(checks, "rough@anymal", &Arena::Solver(SolverSpec::implicit(4).on(Device::Cuda)))?;
    for (task, robot) in [("ant-run", "ant"), ("anymal-forward", "anymal"), ("rough@anymal", "anymal")] {
        let mut family = (*System::named(&format!("{robot}-family"))?).clone();
        if let Some(vary) = &mut family.spec.vary {
            (vary.gain, vary.lag, vary.push) = (range(0.8, 1.2), range(0.0, 2.0), range(0.0, 0.5));
            (vary.noise, vary.root_noise, vary.orientation_noise) =
                (range(0.0, 0.01), range(0.0, 0.01), range(0.0, 0.01));
            vary.push_every = Some(0.1);
        }
        task_alike(checks, task, &Arena::Family(SolverSpec::default().on(Device::Cuda), family.into()))?;
    }
    Ok(())
}

fn range(low: f64, high: f64) -> Option<Range> {
    Some(Range { low, high })
}

fn task_alike(checks: &mut Checks, task: &str, arena: &Arena) -> Outcome {
    let (host, config) =
        (under_way(task, arena, N)?, config(if task == "franka-reach-torque" { 3 } else { 1 }, Activation::Elu));
    let shape = Shape::of(&*host.task, &config);
    let policy = Policy::new(shape.clone(), &mut stream(8, 0));
    let (mut cpu, mut gpu) =
        (Side::new(host, false, &shape, &config)?, Side::new(under_way(task, arena, N)?, true, &shape, &config)?);
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
        let what = format!(
            "{title}, rollout {number}: observations, actions, values, advantages, rows: {shares:?} of them apart"
        );
        checks.demand(gpu.engine.has_episodes() && near && shares.iter().all(|share| *share <= SHARE), what);
    }
    let [apart, _] = gpu.learn(&policy, &config)?;
    checks.demand(apart < 1e-2, format!("{title}: weights {apart:.1e} of their way from those that the CPU learns"));
    let kept = gpu.engine.snapshot(&gpu.episodes)?;
    let mut other = Side::new(under_way(task, arena, N)?, true, &shape, &config)?;
    other.engine.restore(&mut other.episodes, &kept)?;
    other.running = gpu.running.clone();
    let (gone_on, begun_again) = (gpu.roll(&policy, &config, 2)?.0, other.roll(&policy, &config, 2)?.0);
    let (share, exact) = (
        share(&gone_on.observations, &begun_again.observations),
        arena.spec().is_some_and(|spec| spec.folder().is_none()),
    );
    let same = gone_on.observations == begun_again.observations;
    checks.demand(share <= SHARE && (same || !exact), format!("{title}, gone on from a snapshot: {share:.1e} apart"));
    Ok(())
}

/// Share of the numbers that are apart ([`APART`]).
fn share(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    let off = a.iter().zip(b).map(|(a, b)| (a - b).abs() / (1.0 + b.abs()));
    off.filter(|x| x.is_nan() || *x > APART).count() as f64 / a.len().max(1) as f64
}
