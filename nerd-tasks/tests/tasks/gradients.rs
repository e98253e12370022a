//! Gradients of every task without plain code: on the CPU against central differences, in kernels against the CPU.

use nerd_core::tangent::moved;
use nerd_sim::{articulated::device::Reach, prelude::*};
use nerd_tasks::formula::{Number, Sight, Traced};
use nerd_tasks::{About, Compiled, Task, View, Work, named};

use crate::cpp::{Compiler, bytes, doubles};
use crate::{actions, apart, episodes, every, recorded, some};

const N: usize = 12;

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// State, goal, action, torques and upstream gradients of one evaluation.
struct Place {
    state: Vec<f64>,
    goal: Vec<f64>,
    action: Vec<f64>,
    torques: Vec<f64>,
    by: [Vec<f64>; 3],
}

/// Gradients with respect to the state of observation, act and reward, then with respect to action and torques.
fn gradients(task: &Compiled, scene: &Scene, work: &mut Work, at: &Place) -> [Vec<f64>; 5] {
    let robot = work.system.robot.clone();
    let [seen, tau, reward] = &at.by;
    let mut found =
        [2 * robot.nv(), 2 * robot.nv(), 2 * robot.nv(), at.action.len(), at.torques.len()].map(|n| vec![0.0; n]);
    let [of_seen, of_act, of_reward, by_action, by_torques] = &mut found;
    let view = View { state: &at.state, goal: &at.goal, scene };
    task.observe_back(view, work, seen, of_seen);
    task.act_back(view, &at.action, work, tau, of_act, by_action);
    task.reward_back(view, &at.torques, work, reward[0], of_reward, by_torques);
    found
}

/// The same products by central differences. ANYmal's position law holds mass matrix and bias forces constant in its
/// prediction. So its gradient with respect to the state is left out (`held`).
fn differences(task: &Compiled, scene: &Scene, work: &mut Work, at: &Place, held: bool) -> [Vec<f64>; 5] {
    let robot = work.system.robot.clone();
    let Place { state, goal, action, torques, by: [seen, tau, reward] } = at;
    let (d, joints, h) = (2 * robot.nv(), torques.len(), 1e-6);
    // Torques are tens of N m, and some rewards depend on them weakly: the step must exceed the reward's rounding.
    let beside = 1e-4;
    let mut said = |state: &[f64], action: &[f64], torques: &[f64]| {
        let (view, mut out, mut acts) = (View { state, goal, scene }, vec![0.0; seen.len()], vec![0.0; joints]);
        task.observe(view, work, &mut out);
        task.act(view, action, work, &mut acts);
        [dot(&out, seen), dot(&acts, tau), reward[0] * task.reward(view, torques, work)]
    };
    let mut gradient = |n: usize, which: usize, h: f64, change: &dyn Fn(usize, f64) -> [Vec<f64>; 3]| -> Vec<f64> {
        let mut at = |k, h| {
            let [state, action, torques] = change(k, h);
            said(&state, &action, &torques)[which]
        };
        (0..n).map(|k| (at(k, h) - at(k, -h)) / (2.0 * h)).collect()
    };
    let pushed = |of: &[f64], k: usize, by: f64| {
        of.iter().enumerate().map(|(i, x)| x + if i == k { by } else { 0.0 }).collect::<Vec<_>>()
    };
    let by_state = |k: usize, by: f64| {
        let (mut to, mut change) = (state.clone(), vec![0.0; d]);
        change[k] = by;
        moved(&robot, state, &change, &mut to);
        [to, action.clone(), torques.clone()]
    };
    let acts = if held { Vec::new() } else { gradient(d, 1, h, &by_state) };
    let by_action = gradient(action.len(), 1, h, &|k, by| [state.clone(), pushed(action, k, by), torques.clone()]);
    let by_torques = gradient(joints, 2, beside, &|k, by| [state.clone(), action.clone(), pushed(torques, k, by)]);
    [gradient(d, 0, h, &by_state), acts, gradient(d, 2, h, &by_state), by_action, by_torques]
}

/// A task that covers what other tasks do not: distances and positions at once, in roots, quotients and choices.
struct Near;

impl Task for Near {
    fn about(&self) -> About {
        About { name: "near", robot: "ant", scene: "ground", observation: 4, action: 8, steps: 10, frames: 1 }
    }

    fn observe<'a>(&self, sight: &Sight<'a>, out: &mut [Traced<'a>]) {
        let ([x, y, z], gap) = (sight.place(2, [0.1, 0.2, -0.3]), sight.distance(1));
        let (one, other) = (x.abs() * sight.qd(3), sight.q(4) / (one_and(y) + gap.squared()));
        out.copy_from_slice(&[
            one.max(other),
            one.min(other),
            (gap.squared() + z.squared()).sqrt(),
            gap.wrap() - sight.distance(0),
        ]);
    }

    fn act<'a>(&self, sight: &Sight<'a>, action: &[Traced<'a>], torques: &mut [Traced<'a>]) {
        sight.controlled(action, torques);
        torques.iter_mut().zip(0..).for_each(|(tau, k)| *tau = *tau * sight.q(3) + sight.qd(k).exp());
    }

    fn reward<'a>(&self, sight: &Sight<'a>, torques: &[Traced<'a>]) -> Traced<'a> {
        sight.distance(0) * torques[1] + sight.place(3, [0.0; 3])[1]
    }
}

fn one_and(x: Traced) -> Traced {
    1.0 + x.squared()
}

/// Per environment, gradients of observation, act (also with respect to action) and reward (also to torques).
/// Arguments: states, goals, actions, torques, upstream gradients of observations, torques and rewards, and the scene.
const LAUNCHES: &str = "
    for (int i = 0; i < N; i++) {
        Work work;
        const Seen s = {(double*)b[0] + i * STATE, (double*)b[1] + i * GOALS, b[7], &work};
        settle(work, s.state, s.scene);
        double* out = (double*)b[8] + i * (6 * NV + ACTIONS + NJ);
        task_observe_back(s, (double*)b[4] + i * SEEN, out);
        task_act_back(s, (double*)b[2] + i * ACTIONS, (double*)b[5] + i * NJ, out + 2 * NV, out + 6 * NV);
        task_reward_back(s, (double*)b[3] + i * NJ, (double*)b[6] + i, out + 4 * NV, out + 6 * NV + ACTIONS);
    }
";

#[test]
fn gradients_of_every_task_are_those_of_differences_and_of_kernels() {
    let (compiler, mut count) = (Compiler::find(), 0);
    let built_in = every().into_iter().map(|name| (name, named(name).expect("registered")));
    for (name, task) in built_in.chain([("ant-run", Box::new(Near) as Box<dyn Task>)]) {
        let mut played = episodes(name, "articulated", N);
        let system = played.simulation.batch.system.clone();
        let task = Compiled::new(task, &system);
        if !task.has_gradients() {
            assert_eq!(name, "lead-tip", "without gradients");
            continue;
        }
        let name = task.name();
        (0..20).for_each(|step| _ = played.step(&actions(&played, step)).expect("finite"));
        let (scene, mut work) = (played.simulation.batch.scenes[0].clone(), Work::new(&system));
        let (joints, wide) = (system.robot.joint_count(), 2 * system.robot.nv());
        let place = |env: usize| Place {
            state: played.view(env).state.to_vec(),
            goal: played.view(env).goal.to_vec(),
            action: some(task.action_dim(), env, 0.9),
            torques: some(joints, 7 * env, 20.0),
            by: [task.observation_dim(), joints, 1].map(|n| some(n, 3 + env, 1.0)),
        };
        let places: Vec<Place> = (0..N).map(place).collect();
        let held = system.spec.control.is_some_and(|law| law.stable_pd);
        let (mut off, mut all) = ([0.0f64; 5], Vec::new());
        for at in &places {
            let found = gradients(&task, &scene, &mut work, at);
            let expected = differences(&task, &scene, &mut work, at, held);
            off.iter_mut()
                .zip(found.iter().zip(&expected))
                .for_each(|(off, (a, b))| *off = off.max(apart(&a[..b.len()], b)));
            all.extend(found.concat());
        }
        println!("{name}: observation, act, reward by the state, act by action, reward by torques: {off:?} off");
        assert!(off.iter().all(|off| *off < 1e-6), "{name}: {off:?}");
        count += 1;

        let Some(compiler) = &compiler else { continue };
        let reach = Reach { colliders: scene.colliders.len(), ..Reach::default() };
        let text = task.kernels(reach, true).expect("kernels");
        let column =
            |of: &dyn Fn(&Place) -> &Vec<f64>| places.iter().flat_map(|at| of(at).clone()).collect::<Vec<f64>>();
        let columns = [
            column(&|at| &at.state),
            column(&|at| &at.goal),
            column(&|at| &at.action),
            column(&|at| &at.torques),
            column(&|at| &at.by[0]),
            column(&|at| &at.by[1]),
            column(&|at| &at.by[2]),
            recorded(&played.simulation.batch),
        ];
        let found = vec![0.0; N * (3 * wide + task.action_dim() + joints)];
        let buffers = [&columns[..], &[found]]
            .concat()
            .iter()
            .map(|numbers| bytes(numbers, f64::to_le_bytes))
            .collect::<Vec<_>>();
        let kernels = doubles(&compiler.launch(&text, &format!("const int N = {N};{LAUNCHES}"), &buffers)[8]);
        assert_eq!(kernels.len(), N * (3 * wide + task.action_dim() + joints));
        let off = apart(&kernels, &all);
        println!("{name}: kernels {off:.1e} off");
        assert!(off < 1e-12, "{name}: kernels {off:.1e} off");
    }
    assert_eq!(count, 13, "tasks with gradients");
}
