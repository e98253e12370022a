//! Slopes against central differences on states that shipped policies visit in the truth: by state and torque, and of rollouts of 32 frames,
//! of the articulated solver.

use std::sync::Mutex;

use nerd_core::tangent::{difference, moved};
use nerd_sim::solver::Slopes;
use nerd_train::ppo::folder::load;
use nerd_train::shipped;

use crate::differences::*;
use crate::*;

/// Tasks, with the policies that were trained in the truth.
const TASKS: [&str; 6] = ["cartpole-swingup", "ant-run", "ant-spin-track", "anymal-forward", "franka-reach", "franka-reach-torque"];
/// Episodes that are played, and frames from one state that is taken to the next.
const EPISODES: usize = 2;
const EVERY: usize = 37;
/// States of a task at most, and frames of a rollout.
const STATES: usize = 20;
const ROLLOUT: usize = 32;
/// A frame: a state and the torques in it.
type Frame = (Vec<f64>, Vec<f64>);

/// A solver whose frames are noted, by environment.
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

    fn back(&mut self, batch: &Batch, torques: &[f64], rows: usize, by_next: &[f64]) -> Result<Slopes, StepError> {
        self.0.back(batch, torques, rows, by_next)
    }
}

/// Frames of a task's first episodes under its policy, one after the other, and a batch of one of its robots.
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

/// A limited number of played frames, spaced in time.
fn taken(frames: &[Vec<Frame>]) -> Vec<&Frame> {
    let all: Vec<&Frame> = frames.iter().flat_map(|own| own.iter().skip(EVERY / 2).step_by(EVERY)).collect();
    let each = all.len().div_ceil(STATES);
    all.into_iter().step_by(each).collect()
}

#[test]
fn slopes_where_policies_go_are_those_of_central_differences() {
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
fn slopes_of_rollouts_where_policies_go_are_those_of_central_differences() {
    for task in TASKS {
        let (batch, frames) = played(task);
        let (system, config) = (batch.system.clone(), ArticulatedConfig::accurate(&batch.system));
        let (robot, mut solver) = (&system.robot, settled(config));
        let (rows, joints) = (2 * robot.nv(), robot.joint_count());
        let some = |n: usize, phase: f64| (0..n).map(|k| (1.7 * k as f64 + phase).sin()).collect::<Vec<f64>>();
        let (by_last, along, along_torques) = (some(rows, 0.3), some(rows, 0.7), some(ROLLOUT * joints, 1.1));
        let (mut found, mut left_out) = (Vec::new(), 0);
        let begins = frames.iter().flat_map(|own| (0..own.len() - ROLLOUT).step_by(own.len() / 10).map(move |at| &own[at..at + ROLLOUT]));
        for frames in begins {
            // Under the torques of the policy, from a state of its on.
            let roll = |solver: &mut Articulated, by: f64| {
                let mut states = vec![vec![0.0; robot.state_dim()]];
                moved(robot, &frames[0].0, &along.iter().map(|x| x * by).collect::<Vec<_>>(), &mut states[0]);
                for (k, (_, torques)) in frames.iter().enumerate() {
                    let torques: Vec<f64> = torques.iter().zip(&along_torques[k * joints..]).map(|(t, a)| t + a * by).collect();
                    states.push(stepped(solver, &batch, &states[k], &torques));
                }
                states
            };
            let states = roll(&mut solver, 0.0);
            let (mut by_state, mut product) = (by_last.clone(), 0.0);
            let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
            for (k, (_, torques)) in frames.iter().enumerate().rev() {
                let slopes = solver.back(&only(&batch, &states[k]), torques, 1, &by_state).expect("slopes");
                product += dot(&slopes.torques, &along_torques[k * joints..][..joints]);
                by_state = slopes.states;
            }
            product += dot(&by_state, &along);
            let last = &states[ROLLOUT];
            let (expected, agrees) = central(3e-6, |by| difference(robot, last, &roll(&mut solver, by)[ROLLOUT]));
            match agrees > EXACT {
                true => left_out += 1,
                false => found.push(apart(&[product], &[dot(&expected, &by_last)])),
            }
        }
        // Over 32 frames contacts come and go, and an error of differences grows with what it meets: a product may be off by ten times as much.
        found.sort_by(f64::total_cmp);
        let (many, median) = (found.len(), found[found.len() / 2]);
        assert!(told(&format!("{task}, {ROLLOUT} frames"), found, left_out, 10.0 * EXACT), "{task}");
        assert!(median < EXACT && many > 10, "{task}");
    }
}
