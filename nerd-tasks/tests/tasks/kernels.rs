//! GPU kernels of tasks against the tasks on the CPU. No GPU is needed: the kernels are compiled as C++ and run on the
//! CPU.

use nerd_sim::articulated::{along, device::Reach};
use nerd_sim::rig::LATEST;
use nerd_sim::vary::{self, VarySpec};
use nerd_sim::{prelude::*, solver::Fault};
use nerd_tasks::formula::{Sight, Traced};
use nerd_tasks::{About, Compiled, Episodes, StepResult, Task, Work, named};

use crate::cpp::{Compiler, bytes, doubles};
use crate::{every, recorded, some};

const N: usize = 64;
const SEED: u64 = 9;
/// Index of the first environment. Then environments where the solver fails, where a coordinate is too large, and at
/// the end of their time.
const FIRST: usize = 5;
const FAILS: usize = 3;
const FAR: usize = 4;
const LATE: [usize; 2] = [7, 8];

/// A solver without motion that fails in one environment.
struct Still;

impl Solver for Still {
    fn step(&mut self, batch: &mut Batch, _: &[f64]) -> Result<(), StepError> {
        let frame = batch.frames[FAILS];
        batch.frames.iter_mut().enumerate().filter(|(env, _)| *env != FAILS).for_each(|(_, f)| *f += 1);
        Err(StepError::Environments(vec![Fault { env: FAILS, frame, reason: "planted".into() }]))
    }
}

/// Episodes in progress, some at their ends, and the actions of a step.
fn under_way(task: &str, system: &Arc<System>) -> (Episodes, Vec<f64>) {
    let task = named(task).expect("a task");
    let batch = vary::batch(system, task.scene(), N, SEED).expect("robots");
    let (d, nq, length) = (system.robot.state_dim(), system.robot.nq(), task.episode_length() * task.frames());
    let mut episodes = Episodes::part(task, Simulation { batch, solver: Box::new(Still) }, SEED, FIRST);
    episodes.climb();
    if let Some((at, levels)) = episodes.task.levels() {
        // All levels, some with small and some with large errors so far.
        let mut kept = episodes.snapshot();
        for (env, goal) in kept.goals.chunks_exact_mut(episodes.task.goal_dim()).enumerate() {
            (goal[at], goal[at + 1]) =
                ((1 + env % levels) as f64 / levels as f64, if env % 2 == 0 { 1.0 } else { 1e6 });
        }
        episodes.restore(&kept).expect("its own");
        assert_eq!(episodes.simulation.batch.scenes[0].terrain().expect("terrain").1.scale(), 1.0 / levels as f64);
    }
    let batch = &mut episodes.simulation.batch;
    for (k, x) in batch.states.iter_mut().enumerate() {
        let (env, at) = (k / d, k % d);
        // Vary heights, so that some robots have fallen, and velocities.
        *x += if at < nq { 0.2 * (env as f64 * 0.37 + at as f64).sin() } else { (env as f64 * 0.73 + at as f64).cos() };
    }
    batch.states[FAR * d] = 1e6;
    batch.frames.iter_mut().enumerate().for_each(|(env, f)| *f = 1 + env as u64);
    LATE.iter().for_each(|env| batch.frames[*env] = length - 1);
    if system.sensed() {
        let (mut kept, frames) = (episodes.snapshot(), LATEST as usize);
        kept.past_states = (0..frames)
            .flat_map(|k| kept.states.iter().zip(some(N * d, k, 0.3)).map(|(x, off)| x + off).collect::<Vec<_>>())
            .collect();
        kept.past_torques = vec![0.0; frames * N * system.robot.joint_count()];
        episodes.restore(&kept).expect("its own");
    }
    let actions =
        (0..N * episodes.task.action_dim()).map(|k| f64::from((1.3 * (k as f32 * 0.9).sin()).clamp(-1.0, 1.0)));
    let actions = actions.collect();
    (episodes, actions)
}

/// Results of a step of the kernels: rewards, rows of two observations, rows of truncated episodes, states and goals;
/// end of each episode, frames, and numbers of begun and failed episodes.
struct Made {
    rewards: Vec<f64>,
    rows: Vec<f64>,
    cut: Vec<f64>,
    states: Vec<f64>,
    goals: Vec<f64>,
    ends: Vec<u8>,
    frames: Vec<u64>,
    begun: Vec<u64>,
    failed: u32,
    reached: Vec<f64>,
}

/// A step without motion, with faults in every frame. Arguments: the world's memory, faults, actions, rows; results;
/// the key of the random draws.
const LAUNCHES: &str = "
    const unsigned long long* key = b[20];
    const World w = {b[0], b[1], b[2], b[3], b[4], b[5], nullptr, b[6], b[7], b[8], {key[0], key[1], key[2], key[3]}, key[4], b[9], N, LEVELS > 0,
                     b[10]};
    for (int frame = 0; frame < STEP_FRAMES; frame++)
        for (blockIdx.x = 0; blockIdx.x < N; blockIdx.x++) {
            task_act(&w, b[12], frame, nullptr, nullptr, nullptr);
            w.faults[blockIdx.x] = ((int*)b[11])[blockIdx.x];
        }
    for (blockIdx.x = 0; blockIdx.x < N; blockIdx.x++) task_judge(&w, b[13], b[14], b[15], b[16], 2, b[17], b[18], b[19]);
";

/// Runs the task's kernels on the present state of `episodes`.
fn run(compiler: &Compiler, text: &str, episodes: &Episodes, actions: &[f64], rows: &[f64]) -> Made {
    let (batch, kept) = (&episodes.simulation.batch, episodes.snapshot());
    let (d, joints, row) =
        (batch.system.robot.state_dim(), batch.system.robot.joint_count(), 2 * episodes.task.observation_dim());
    let (numbers, zeros) =
        (|values: &[f64]| bytes(values, f64::to_le_bytes), |size: usize, width: usize| vec![0; size * N * width]);
    let (whole, counts) =
        (|values: Vec<i32>| bytes(&values, i32::to_le_bytes), |values: &[u64]| bytes(values, u64::to_le_bytes));
    // Per environment, the newest first.
    let past = kept.past_states.chunks_exact(batch.states.len()).rev().collect::<Vec<_>>();
    let before =
        (0..N).flat_map(|env| past.iter().flat_map(move |all| all[env * d..][..d].to_vec())).collect::<Vec<f64>>();
    let world = [
        numbers(&batch.states),
        numbers(&kept.goals),
        zeros(8, joints),
        numbers(&recorded(batch)),
        whole((0..N as i32).collect()),
    ];
    let ends = [zeros(4, 1), zeros(4, 1), counts(&batch.frames), counts(&kept.begun), zeros(4, 2), numbers(&before)];
    let actions = bytes(&actions.iter().map(|x| *x as f32).collect::<Vec<_>>(), f32::to_le_bytes);
    let given = [whole((0..N).map(|env| i32::from(env == FAILS)).collect()), actions, numbers(rows)];
    let found = [zeros(8, row), zeros(8, row), zeros(4, 1), zeros(8, 1), zeros(1, 1), zeros(8, d)];
    let key = [&stream(SEED, 0).get_seed()[..], &(FIRST as u64).to_le_bytes()].concat();
    let buffers = [world.to_vec(), ends.to_vec(), given.to_vec(), found.to_vec(), vec![key]].concat();
    let made = compiler.launch(text, &format!("const int N = {N};{LAUNCHES}"), &buffers);
    let [states, goals, rows, cut, rewards, reached] = [0, 1, 14, 15, 17, 19].map(|k| doubles(&made[k]));
    let [frames, begun] = [7, 8].map(|k| made[k].as_chunks().0.iter().map(|b| u64::from_le_bytes(*b)).collect());
    // The second count is for a start state that cannot be stepped.
    let failed = u32::from_le_bytes(made[9][..4].try_into().expect("four bytes"));
    Made { rewards, rows, cut, states, goals, ends: made[18].clone(), frames, begun, failed, reached }
}

fn apart(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter()
        .zip(b)
        .map(|(a, b)| (a - b).abs() / (1.0 + b.abs()))
        .fold(0.0, |most, x| if x > most || x.is_nan() { x } else { most })
}

/// Compares a step of a task's episodes in kernels and on the CPU; false if the task has no kernels.
fn is_the_same(compiler: &Compiler, name: &str, system: &Arc<System>) -> bool {
    let (mut episodes, actions) = under_way(name, system);
    let task = Compiled::new(named(name).expect("a task"), system);
    let text = match task.kernels(Reach::of(&episodes.simulation.batch), true) {
        Ok(text) => text,
        Err(why) => {
            assert_eq!(name, "lead-tip", "{why}");
            return false;
        }
    };
    let before: Vec<f64> = (0..N * 2 * task.observation_dim()).map(|k| (k as f64 * 0.31).sin()).collect();
    let made = run(compiler, &text, &episodes, &actions, &before);
    episodes.trace();
    let begun = episodes.snapshot();
    let StepResult { rewards, terminated, truncated, reached, failed, .. } =
        episodes.step(&actions).expect("it can be stepped");
    let failed = failed.iter().filter(|failed| **failed).count();
    let (after, trace) = (episodes.snapshot(), episodes.trace());
    let numbers = |x: &[f64]| x.iter().filter(|x| !x.is_nan()).copied().collect::<Vec<f64>>();
    let ends: Vec<u8> =
        terminated.iter().zip(&truncated).map(|(end, cut)| if *end { 1 } else { 2 * u8::from(*cut) }).collect();
    assert_eq!((&made.ends, made.failed as usize), (&ends, failed), "{name}: how episodes ended");
    assert!(failed == 2 && LATE.iter().any(|env| ends[*env] == 2) && ends.contains(&0), "{name}: {ends:?}");
    assert_eq!(made.frames, episodes.simulation.batch.frames, "{name}: frames");
    assert_eq!(made.begun, after.begun, "{name}: episodes begun");
    let width = task.observation_dim();
    if system.sensed() {
        let mut bare = vec![0.0; width];
        task.observe(episodes.view(0), &mut Work::new(system), &mut bare);
        assert!(apart(&bare, &episodes.observations()[..width]) > 1e-3, "{name}: its sensors show no noise");
    }
    let ended = |env: usize| ends[env] > 0;
    let expected = (0..N).flat_map(|env| {
        let now = &episodes.observations()[env * width..][..width];
        let difference = now.iter().zip(&before[env * 2 * width..]).map(|(a, b)| if ended(env) { 0.0 } else { a - b });
        now.iter().copied().chain(difference).collect::<Vec<_>>()
    });
    let expected = expected.collect::<Vec<_>>();
    let of_late = |rows: &[f64], all: usize| -> Vec<f64> {
        let rows = rows.chunks(all).zip(&ends).filter(|(_, end)| **end == 2);
        rows.flat_map(|(row, _)| row[..width].to_vec()).collect()
    };
    let (cut, seen) = (of_late(&made.cut, 2 * width), of_late(&reached, width));
    let off = [
        ("rewards", apart(&made.rewards, &rewards)),
        ("rows", apart(&made.rows, &expected)),
        ("cut rows", apart(&cut, &seen)),
        ("states", apart(&made.states, &after.states)),
        ("goals", apart(&made.goals, &after.goals)),
        ("states that were reached", apart(&numbers(&made.reached), &numbers(&trace.reached))),
    ];
    if let Some((at, levels)) = task.levels() {
        let level = |goals: &[f64], env: usize| (goals[env * task.goal_dim() + at] * levels as f64).round();
        for (env, end) in ends.iter().enumerate() {
            let [was, is] = [&begun.goals, &after.goals].map(|goals| level(goals, env));
            let up = if *end == 1 { -1.0 } else { f64::from(u8::from(*end == 2 && env % 2 == 0)) };
            assert_eq!(is, (was + up).clamp(1.0, levels as f64), "{name}: environment {env}, ended by {end}");
        }
        assert!(LATE.iter().all(|env| ends[*env] == 2), "{name}: {ends:?}");
    }
    assert!(off.iter().all(|(_, x)| *x < 1e-11), "{name}: {off:?}");
    true
}

#[test]
fn every_task_without_plain_code_is_the_same_in_kernels() {
    let Some(compiler) = Compiler::find() else { return };
    let robot = |name: &str| named(name).expect("a task").system().expect("a robot");
    let count =
        every().into_iter().chain(["rough@anymal"]).filter(|name| is_the_same(&compiler, name, &robot(name))).count();
    assert_eq!(count, 13, "tasks with kernels");
}

/// Also for a family of robots with different gains, delayed and noisy sensors, and pushes.
#[test]
fn robots_of_a_family_are_the_same_in_kernels() {
    let Some(compiler) = Compiler::find() else { return };
    let range = |low, high| Some(Range { low, high });
    for name in ["anymal-forward", "franka-reach"] {
        let mut system = (*named(name).expect("a task").system().expect("a robot")).clone();
        let (root, blur) = (system.robot.floating(), range(0.0, 0.1));
        let mut spec = VarySpec {
            mass: range(0.5, 1.5),
            gain: range(0.5, 1.5),
            noise: blur,
            lag: range(0.0, 2.0),
            ..VarySpec::default()
        };
        if root {
            spec = VarySpec { root_noise: blur, orientation_noise: blur, push: range(0.1, 0.5), ..spec };
            spec.push_every = Some(3.0 * system.frame_time);
        }
        system.spec.vary = Some(spec);
        assert!(is_the_same(&compiler, name, &Arc::new(system)));
    }
}

/// Also for a chain with springs, stepped along its tree, under a controller that predicts with the mass matrix.
#[test]
fn a_chain_whose_controller_looks_ahead_is_the_same_in_kernels() {
    let Some(compiler) = Compiler::find() else { return };
    let mut system = (*named("franka-reach").expect("a task").system().expect("a robot")).clone();
    system.robot.links.iter_mut().filter_map(|link| link.joint.as_mut()).for_each(|joint| joint.stiffness = 1.0);
    system.spec.control.as_mut().expect("a controller").stable_pd = true;
    assert!(along(&system.robot) && system.held());
    assert!(is_the_same(&compiler, "franka-reach", &Arc::new(system)));
}

struct Astray;

impl Task for Astray {
    fn about(&self) -> About {
        About { name: "astray", robot: "cartpole", scene: "free", observation: 1, action: 2, steps: 10, frames: 1 }
    }

    fn observe<'a>(&self, sight: &Sight<'a>, out: &mut [Traced<'a>]) {
        out[0] = sight.q(0) / f64::INFINITY;
    }

    fn act<'a>(&self, sight: &Sight<'a>, action: &[Traced<'a>], torques: &mut [Traced<'a>]) {
        sight.controlled(action, torques);
    }

    fn reward<'a>(&self, sight: &Sight<'a>, _: &[Traced<'a>]) -> Traced<'a> {
        sight.q(9)
    }
}

#[test]
fn a_formula_that_reaches_too_far_is_refused() {
    let system = System::named("cartpole").expect("a robot");
    let said = Compiled::new(Box::new(Astray) as Box<dyn Task>, &system)
        .kernels(Reach::default(), true)
        .expect_err("there are two coordinates");
    assert_eq!(said, "task `astray`, `reward`: number 9 of 2 coordinates is asked for");
}
