//! The adjoint kernels through a policy's steps against the task's gradients on the CPU. No GPU is needed: the kernels
//! are compiled as C++ and run on the CPU.

use nerd_sim::{articulated::device::Reach, prelude::*};
use nerd_tasks::{Compiled, Trace, View, Work, named};

use crate::cpp::{Compiler, bytes, doubles, floats};
use crate::{actions, apart, episodes, every, recorded, some};

const N: usize = 8;
const HORIZON: usize = 3;
/// Value rows: after the last step, and of truncated episodes.
const ROWS: usize = 2 * N;
const SCALE: f64 = 0.25;
/// An environment without finite gradients, and one with a solver failure in the last step.
const BREAKS: usize = 3;
const LOST: usize = 4;

fn singles(n: usize, seed: usize, size: f64) -> Vec<f32> {
    some(n, seed, size).into_iter().map(|x| x as f32).collect()
}

/// Inputs of the adjoint besides the trace. The steps of some environments end episodes.
struct Given {
    seen: Vec<f64>,
    rows: Vec<f64>,
    mean: Vec<f64>,
    inverse: Vec<f64>,
    shares: Vec<f64>,
    pushed: Vec<f64>,
    drawn: Vec<f32>,
    means: Vec<f32>,
    by_seen: Vec<f32>,
    by_rows: Vec<f32>,
    asked: Vec<i32>,
    ends: Vec<u8>,
}

fn given(width: usize, a: usize, joints: usize, frames: usize) -> Given {
    let steps = HORIZON * N;
    let ends: Vec<u8> = (0..steps).map(|i| [0, u8::from(i / N == 1), 2 * u8::from(i / N == 0), 0][i % N % 4]).collect();
    let asked = |i: usize| {
        if ends[i] == 2 { (N + i % N) as i32 } else { if i / N + 1 == HORIZON { (i % N) as i32 } else { -1 } }
    };
    let mut pushed = some(steps * frames * joints, 4, 1.0);
    if let Some(x) = pushed.get_mut((frames * N + BREAKS) * joints) {
        *x = f64::INFINITY;
    }
    Given {
        seen: some((steps + N) * width, 1, 6.0),
        rows: some(ROWS * width, 2, 6.0),
        mean: some(width, 3, 0.5),
        inverse: (0..width).map(|k| 0.8 + 0.1 * (k % 3) as f64).collect(),
        shares: some(steps, 5, 1.0),
        pushed,
        drawn: singles(steps * a, 6, 1.3),
        means: singles(steps * a, 7, 1.0),
        by_seen: singles(steps * width, 8, 1.0),
        by_rows: singles(ROWS * width, 9, 1.0),
        asked: (0..steps).map(asked).collect(),
        ends,
    }
}

/// Gradients with respect to the first states, to action means and to log standard deviations.
type Found = (Vec<f64>, Vec<f64>, Vec<f64>);

/// The adjoint on the CPU.
fn on_cpu(task: &Compiled, scene: &Scene, work: &mut Work, trace: &Trace, x: &Given) -> Found {
    let robot = work.system.robot.clone();
    let (d, joints, wide) = (robot.state_dim(), robot.joint_count(), 2 * robot.nv());
    let (a, width, goals, frames) =
        (task.action_dim(), task.observation_dim(), task.goal_dim(), task.frames() as usize);
    let (mut by_first, mut by_mean, mut by_spread) =
        (Vec::new(), vec![0.0; HORIZON * N * a], vec![0.0; HORIZON * N * a]);
    for env in 0..N {
        let at = |frame: usize| frame * N + env;
        let view = |state, frame: usize| View { state, goal: &trace.goals[at(frame) * goals..][..goals], scene };
        let seen = |frame: usize| view(&trace.states[at(frame) * d..][..d], frame);
        let by = |row: &[f64], by: &[f32]| -> Vec<f64> {
            let inside = |k: usize| ((row[k] - x.mean[k]) * x.inverse[k]).abs() < 5.0;
            (0..width).map(|k| if inside(k) { f64::from(by[k]) * x.inverse[k] } else { 0.0 }).collect()
        };
        let mut gradient = vec![0.0; wide];
        for t in (0..HORIZON).rev() {
            let (i, last) = (at(t), (t + 1) * frames - 1);
            let drawn: Vec<f64> = x.drawn[i * a..][..a].iter().map(|a| f64::from(*a)).collect();
            if t + 1 == HORIZON || x.ends[i] > 0 {
                gradient.fill(0.0);
            } else {
                task.observe_back(
                    seen(last + 1),
                    work,
                    &by(&x.seen[(i + N) * width..], &x.by_seen[i * width..]),
                    &mut gradient,
                );
            }
            let (mut tau, mut by_action, reached) = (vec![0.0; joints], vec![0.0; a], &trace.reached[i * d..][..d]);
            if !reached[0].is_nan() {
                let torques = &trace.torques[at(last) * joints..][..joints];
                let mut goal = view(reached, last).goal.to_vec();
                task.remember(&mut goal, &drawn);
                let now = View { goal: &goal, ..view(reached, last) };
                task.reward_back(now, torques, work, -SCALE * x.shares[i], &mut gradient, &mut tau);
                if let Ok(row) = usize::try_from(x.asked[i]) {
                    task.observe_back(now, work, &by(&x.rows[row * width..], &x.by_rows[row * width..]), &mut gradient);
                }
            }
            for frame in (t * frames..=last).rev() {
                let pushed = &x.pushed[at(frame) * joints..][..joints];
                if reached[0].is_nan() {
                    gradient.fill(0.0);
                } else {
                    tau.iter_mut().zip(pushed).for_each(|(sum, g)| *sum += g);
                }
                task.act_back(seen(frame), &drawn, work, &tau, &mut gradient, &mut by_action);
                tau.fill(0.0);
            }
            for k in (0..a).filter(|k| drawn[*k].abs() <= 1.0 || by_action[*k] * drawn[*k] >= 0.0) {
                by_mean[i * a + k] = by_action[k];
                by_spread[i * a + k] = by_action[k] * (drawn[k] - f64::from(x.means[i * a + k]));
            }
        }
        by_first.extend(gradient);
    }
    (by_first, by_mean, by_spread)
}

/// The adjoint through all steps, for a solver that passes gradients through unchanged.
const LAUNCHES: &str = "
#define EVERY for (blockIdx.x = 0; blockIdx.x < N; blockIdx.x++)
    World w = {};
    w.scenes = b[10], w.scene_of = b[11], w.n = N;
    Steps s = {b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7], b[8], b[9], b[12], b[13], b[14], nullptr, b[15], b[16], b[17], b[18], b[19], b[20],
               b[21], b[22], SCALE, ACTIONS + 1, HORIZON};
    for (int t = HORIZON - 1; t >= 0; t--) {
        s.by_seen = (float*)b[23] + t * N * SEEN;
        EVERY task_arrive_back(&w, &s, t);
        for (int frame = (t + 1) * STEP_FRAMES - 1; frame >= t * STEP_FRAMES; frame--) {
            for (int k = 0; k < N * NJ; k++) s.pushed[k] = ((double*)b[24])[frame * N * NJ + k];
            EVERY task_acted_back(&w, &s, frame);
        }
    }
    for (blockIdx.y = 0; blockIdx.y < HORIZON; blockIdx.y++) EVERY task_leave(&w, &s);
";

#[test]
fn steps_are_gone_back_over_in_kernels_as_on_the_cpu() {
    let Some(compiler) = Compiler::find() else { return };
    for name in every().into_iter().filter(|name| *name != "lead-tip") {
        let mut played = episodes(name, "articulated", N);
        let (system, task) = (
            played.simulation.batch.system.clone(),
            Compiled::new(named(name).expect("registered"), &played.simulation.batch.system),
        );
        let (d, joints, wide) = (system.robot.state_dim(), system.robot.joint_count(), 2 * system.robot.nv());
        let (a, width, frames) = (task.action_dim(), task.observation_dim(), task.frames() as usize);
        played.trace();
        (0..HORIZON).for_each(|step| _ = played.step(&actions(&played, step)).expect("finite"));
        let mut trace = played.trace();
        trace.reached[((HORIZON - 1) * N + LOST) * d..][..d].fill(f64::NAN);
        let (x, scene) = (given(width, a, joints, frames), played.simulation.batch.scenes[0].clone());
        let (mut by_first, mut by_mean, mut by_spread) = on_cpu(&task, &scene, &mut Work::new(&system), &trace, &x);

        let reach = Reach { colliders: scene.colliders.len(), ..Reach::default() };
        let text = task.kernels(reach, true).expect("kernels");
        let steps = HORIZON * N;
        let scenes = recorded(&played.simulation.batch);
        let read = [
            &trace.states,
            &trace.goals,
            &trace.torques,
            &trace.reached,
            &x.seen,
            &x.rows,
            &x.mean,
            &x.inverse,
            &x.shares,
        ];
        let numbers = |x: &Vec<f64>| bytes(x, f64::to_le_bytes);
        let mut buffers = read.map(numbers).to_vec();
        buffers.extend([x.ends.clone(), numbers(&scenes), vec![0; 4 * N], bytes(&x.asked, i32::to_le_bytes)]);
        buffers.extend([&x.drawn, &x.means, &x.by_rows].map(|x| bytes(x, f32::to_le_bytes)));
        buffers.extend([wide, joints, joints, a].map(|width| vec![0; 8 * N * width]));
        buffers.extend([N, steps * (a + 1), steps * a].map(|n| vec![0; 4 * n]));
        buffers.extend([bytes(&x.by_seen, f32::to_le_bytes), numbers(&x.pushed)]);
        let launches = format!("const int N = {N}, HORIZON = {HORIZON};\nconst double SCALE = {SCALE};{LAUNCHES}");
        let found = compiler.launch(&text, &launches, &buffers);
        let single = |k: usize| floats(&found[k]).into_iter().map(f64::from).collect::<Vec<f64>>();
        let (mut gradient, said, mut spread, without) =
            (doubles(&found[16]), single(21), single(22), found[20].as_chunks::<4>().0);
        let mut mean: Vec<f64> = said.chunks(a + 1).flat_map(|row| row[..a].to_vec()).collect();
        assert!(said.chunks(a + 1).all(|row| row[a] == 0.0), "{name}: gradients by values");
        let broken: Vec<usize> = (0..N).filter(|env| without[*env] != [0; 4]).collect();
        assert_eq!(broken, [BREAKS], "{name}: environments without gradients");
        // The environment without gradients contributes nothing, and is not compared.
        let steps = |x: &[f64]| {
            x.chunks(a)
                .enumerate()
                .filter(|(i, _)| i % N == BREAKS)
                .flat_map(|(_, row)| row.to_vec())
                .collect::<Vec<_>>()
        };
        assert!(steps(&mean).iter().chain(&steps(&spread)).all(|x| *x == 0.0), "{name}: it still teaches");
        for (numbers, width) in
            [(&mut mean, a), (&mut spread, a), (&mut by_mean, a), (&mut by_spread, a), (&mut by_first, wide)]
        {
            numbers.chunks_mut(width).enumerate().filter(|(i, _)| i % N == BREAKS).for_each(|(_, row)| row.fill(0.0));
        }
        gradient[BREAKS * wide..][..wide].fill(0.0);
        let off = [apart(&gradient, &by_first), apart(&mean, &by_mean), apart(&spread, &by_spread)];
        assert!(off[0] < 1e-11 && off[1] < 1e-6 && off[2] < 1e-6, "{name}: {off:?}");
    }
}
