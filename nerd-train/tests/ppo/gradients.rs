//! Gradients of the articulated solver against central differences, on states that shipped policies visit in the truth.
//! Of single frames by state and torque, and of rollouts of 32 frames.

use std::sync::Mutex;

use nerd_core::tangent::{difference, moved};
use nerd_sim::solver::Gradients;
use nerd_train::ppo::folder::load;
use nerd_train::shipped;

use crate::differences::*;
use crate::*;

/// Tasks, with the policies that were trained in the truth.
const TASKS: [&str; 6] =
    ["cartpole-swingup", "ant-run", "ant-spin-track", "anymal-forward", "franka-reach", "franka-reach-torque"];
/// Episodes played, and frames between states taken from them.
const EPISODES: usize = 2;
const EVERY: usize = 37;
/// Most states of a task, and frames of a rollout.
const STATES: usize = 20;
const ROLLOUT: usize = 32;
/// How well differences of a rollout agree with those of four times their size, where they count.
const ROLLED: f64 = 10.0 * EXACT;
/// How far from a played state a rollout begins, in turn, along one direction.
const BESIDE: [f64; 7] = [0.0, 1e-3, -1e-3, 2e-3, -2e-3, 4e-3, -4e-3];
/// A frame: a state and the torques in it.
type Frame = (Vec<f64>, Vec<f64>);

/// A solver that records its frames by environment.
struct Noted(Articulated, Arc<Mutex<Vec<Vec<Frame>>>>);

impl Solver for Noted {
    fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
        let joints = batch.system.robot.joint_count();
        let mut all = self.1.lock().expect("one thread");
        all.resize(batch.len(), Vec::new());
        for (env, own) in all.iter_mut().enumerate() {
            own.push((batch.state(env).to_vec(), torques[env * joints..][..joints].to_vec()));
        }
        self.0.step(batch, torques)
    }

    fn vjp(&mut self, batch: &Batch, torques: &[f64], rows: usize, grad_next: &[f64]) -> Result<Gradients, StepError> {
        self.0.vjp(batch, torques, rows, grad_next)
    }
}

/// Frames of a task's first episodes under its policy, by environment, and a batch of one robot.
fn played(task: &str) -> (Batch, Vec<Vec<Frame>>) {
    let known = named(task).expect("a task");
    let system = System::named(known.robot()).expect("built in");
    let scene = system.scene(known.scene()).expect("built in");
    let noted = Arc::default();
    let truth = Noted(Articulated::new(ArticulatedConfig::accurate(&system)), Arc::clone(&noted));
    let mut episodes = Episodes::new(known, Simulation::new(Batch::new(&system, &scene, EPISODES), truth), 11);
    let folder = shipped::policies(&format!("{task}-accurate")).expect("shipped policies").remove(0);
    play(&load(&folder).expect("a policy").1, &mut episodes, &mut |_| {}).expect("episodes");
    let frames = noted.lock().expect("one thread").clone();
    (Batch::new(&system, &scene, 1), frames)
}

/// At most `STATES` of the played frames, spaced in time.
fn taken(frames: &[Vec<Frame>]) -> Vec<&Frame> {
    let all: Vec<&Frame> = frames.iter().flat_map(|own| own.iter().skip(EVERY / 2).step_by(EVERY)).collect();
    let each = all.len().div_ceil(STATES);
    all.into_iter().step_by(each).collect()
}

/// The central difference that agrees best with the one at four times the size, and how well; infinity if none does. If
/// a foot begins to slip within reach, one-sided differences do not approach each other. Such sizes do not count.
fn smooth(mut side: impl FnMut(f64) -> f64) -> (f64, f64) {
    let (mut best, mut last) = ((0.0, f64::INFINITY), (f64::NAN, f64::NAN));
    for finer in 0..6 {
        let size = 3e-6 * 0.25f64.powi(finer);
        let (right, left) = (side(size) / size, side(-size) / -size);
        let (now, gap) = (0.5 * (right + left), apart(&[right], &[left]));
        let agrees = apart(&[now], &[last.0]);
        if gap < 0.5 * last.1 && agrees < best.1 {
            best = (now, agrees);
        }
        last = (now, gap);
    }
    best
}

#[test]
fn gradients_where_policies_go_are_those_of_central_differences() {
    for task in TASKS {
        let (batch, frames) = played(task);
        let config = ArticulatedConfig::accurate(&batch.system);
        let mut solver = settled(config);
        let (mut found, mut left_out) = ([Vec::new(), Vec::new()], 0);
        for (state, torques) in taken(&frames) {
            let next = stepped(&mut solver, &batch, state, torques);
            let none = endless(config, &batch, state, torques, &next);
            match errors(&mut solver, &batch, state, torques, [3e-5, 3e-2], (EXACT, true)).filter(|_| !none) {
                Some(own) => found.iter_mut().zip(own).for_each(|(all, own)| all.push(own)),
                None => left_out += 1,
            }
        }
        let [by_state, by_torque] = found;
        let sound = [
            told(&format!("{task}, by state"), by_state, left_out, EXACT),
            told(&format!("{task}, by torque"), by_torque, left_out, EXACT),
        ];
        assert_eq!(sound, [true; 2], "{task}");
    }
}

#[test]
fn gradients_of_rollouts_where_policies_go_are_those_of_central_differences() {
    for task in TASKS {
        let (batch, frames) = played(task);
        let (system, config) = (batch.system.clone(), ArticulatedConfig::accurate(&batch.system));
        let (robot, mut solver) = (&system.robot, settled(config));
        let (rows, joints) = (2 * robot.nv(), robot.joint_count());
        let some = |n: usize, phase: f64| (0..n).map(|k| (1.7 * k as f64 + phase).sin()).collect::<Vec<f64>>();
        let (by_last, along, along_torques) = (some(rows, 0.3), some(rows, 0.7), some(ROLLOUT * joints, 1.1));
        let (mut found, mut left_out) = (Vec::new(), 0);
        let begins = frames
            .iter()
            .flat_map(|own| (0..own.len() - ROLLOUT).step_by(own.len() / 10).map(move |at| &own[at..at + ROLLOUT]));
        for frames in begins {
            // From a state of an episode, under the policy's torques. Where a foot begins to slip within reach of the
            // differences, from a state beside it.
            let tried = BESIDE.into_iter().find_map(|beside| {
                let displaced = |from: &[f64], by: f64| {
                    let mut to = vec![0.0; robot.state_dim()];
                    moved(robot, from, &along.iter().map(|x| x * by).collect::<Vec<_>>(), &mut to);
                    to
                };
                let begun = displaced(&frames[0].0, beside);
                let roll = |solver: &mut Articulated, by: f64| {
                    let mut states = vec![displaced(&begun, by)];
                    for (k, (_, torques)) in frames.iter().enumerate() {
                        let torques: Vec<f64> =
                            torques.iter().zip(&along_torques[k * joints..]).map(|(t, a)| t + a * by).collect();
                        states.push(stepped(solver, &batch, &states[k], &torques));
                    }
                    states
                };
                let states = roll(&mut solver, 0.0);
                let (mut by_state, mut product) = (by_last.clone(), 0.0);
                let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
                for (k, (_, torques)) in frames.iter().enumerate().rev() {
                    let gradients = solver.vjp(&only(&batch, &states[k]), torques, 1, &by_state).expect("gradients");
                    product += dot(&gradients.torques, &along_torques[k * joints..][..joints]);
                    by_state = gradients.states;
                }
                product += dot(&by_state, &along);
                let last = &states[ROLLOUT];
                let (expected, agrees) =
                    smooth(|by| dot(&difference(robot, last, &roll(&mut solver, by)[ROLLOUT]), &by_last));
                (agrees < ROLLED).then(|| apart(&[product], &[expected]))
            });
            match tried {
                Some(error) => found.push(error),
                None => left_out += 1,
            }
        }
        found.sort_by(f64::total_cmp);
        let (many, median) = (found.len(), found[found.len() / 2]);
        assert!(told(&format!("{task}, {ROLLOUT} frames"), found, left_out, 10.0 * EXACT), "{task}");
        assert!(median < EXACT && many > 10, "{task}");
    }
}
