//! Rewards, observations, torques and ends against states computed by hand.

use nerd_sim::prelude::*;
use nerd_tasks::{Compiled, View, Work, named};

pub struct Bench {
    task: Compiled,
    scene: Arc<Scene>,
    pub work: Work,
}

impl Bench {
    pub fn new(name: &str) -> Self {
        let task = named(name).expect("registered");
        let system = System::named(task.robot()).expect("built in");
        Self {
            scene: system.scene(task.scene()).expect("known"),
            work: Work::new(&system),
            task: Compiled::new(task, &system),
        }
    }

    pub fn reward(&mut self, state: &[f64], goal: &[f64], torques: &[f64]) -> f64 {
        self.task.reward(View { state, goal, scene: &self.scene }, torques, &mut self.work)
    }

    pub fn observe(&mut self, state: &[f64], goal: &[f64]) -> Vec<f64> {
        let mut out = vec![f64::NAN; self.task.observation_dim()];
        self.task.observe(View { state, goal, scene: &self.scene }, &mut self.work, &mut out);
        out
    }

    pub fn error(&mut self, state: &[f64], goal: &[f64]) -> Option<f64> {
        self.task.error(View { state, goal, scene: &self.scene }, &mut self.work)
    }

    fn terminated(&mut self, state: &[f64]) -> bool {
        self.task.terminated(View { state, goal: &[], scene: &self.scene }, &mut self.work)
    }

    fn torques(&mut self, state: &[f64], action: &[f64]) -> Vec<f64> {
        let mut out = vec![f64::NAN; self.work.system.robot.joint_count()];
        self.task.act(View { state, goal: &[], scene: &self.scene }, action, &mut self.work, &mut out);
        out
    }

    fn rest(&self) -> Vec<f64> {
        self.work.system.default_state()
    }
}

fn near(found: f64, by_hand: f64, what: &str) {
    assert!((found - by_hand).abs() < 1e-9, "{what}: {found}, by hand {by_hand}");
}

#[test]
fn cartpole_swings_up() {
    let mut bench = Bench::new("cartpole-swingup");
    near(bench.reward(&[0.0; 4], &[], &[0.0; 2]), 5.0, "upright at rest");
    // 5 - 1 - 0.05 * 4 - 0.1 * 9 - 0.1 * 16 = 1.3; the same after a whole turn.
    near(bench.reward(&[2.0, 1.0, 4.0, 3.0], &[], &[0.0; 2]), 1.3, "on the move");
    near(bench.reward(&[2.0, 1.0 + std::f64::consts::TAU, 4.0, 3.0], &[], &[0.0; 2]), 1.3, "a turn further");
    assert!(
        bench.terminated(&[4.01, 0.0, 0.0, 0.0])
            && bench.terminated(&[0.0, 0.0, -10.1, 0.0])
            && bench.terminated(&[0.0, 0.0, 0.0, 10.1])
    );
    assert!(!bench.terminated(&[3.99, 3.0, 9.9, -9.9]));
    assert_eq!(bench.torques(&[0.0; 4], &[0.5]), [750.0, 0.0]);
    assert_eq!(bench.torques(&[0.0; 4], &[-7.0]), [-1500.0, 0.0]);
}

/// An Ant at (3, 0.8, -2), upright and facing forward, with velocity p_dot and angular velocity w.
fn ant(bench: &Bench, p_dot: [f64; 3], w: [f64; 3]) -> Vec<f64> {
    let mut state = bench.rest();
    let p = [3.0, 0.8, -2.0];
    state[..3].copy_from_slice(&p);
    state[15..18].copy_from_slice(&w);
    // The state's twist is about the world's origin: v = p_dot + p x w.
    let cross = [p[1] * w[2] - p[2] * w[1], p[2] * w[0] - p[0] * w[2], p[0] * w[1] - p[1] * w[0]];
    (0..3).for_each(|k| state[18 + k] = p_dot[k] + cross[k]);
    state
}

#[test]
fn the_ant_runs_spins_and_tracks() {
    let mut bench = Bench::new("ant-run");
    let moving = ant(&bench, [2.0, 0.1, -0.3], [0.5, 4.0, -1.0]);
    near(bench.reward(&moving, &[], &[0.0; 8]), 2.0 + 0.1 + 1.0, "v_x + 0.1 up + heading");
    // Turned by 90 degrees about world up, its x axis points to -z: no heading.
    let mut turned = ant(&bench, [0.0; 3], [0.0; 3]);
    let half = std::f64::consts::FRAC_1_SQRT_2;
    // (rotation about y by 90 deg) * (rotation about x by -90 deg), x y z w.
    turned[3..7].copy_from_slice(&[-0.5, 0.5, 0.5, 0.5]);
    let seen = bench.observe(&turned, &[]);
    near(seen[28], 0.0, "heading after a quarter turn");
    near(seen[27], 1.0, "up after a quarter turn");
    near(bench.reward(&turned, &[], &[0.0; 8]), 0.1, "at rest, facing sideways");

    let seen = bench.observe(&moving, &[]);
    assert_eq!(seen.len(), 29, "the appendix's observation");
    let head = [0.8, -half, 0.0, 0.0, half, 2.0, 0.1, -0.3, 0.5, 4.0, -1.0];
    let tail = [vec![0.0, 1.0, 0.0, -1.0, 0.0, -1.0, 0.0, 1.0], vec![0.0; 8], vec![1.0, 1.0]].concat();
    for (k, (found, by_hand)) in seen.iter().zip(head.iter().chain(&tail)).enumerate() {
        near(*found, *by_hand, &format!("number {k} of the observation"));
    }
    assert_eq!(
        bench.torques(&moving, &[0.25, -2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]),
        [100.0, -400.0, 0.0, 0.0, 0.0, 0.0, 0.0, 400.0]
    );
    let mut low = moving.clone();
    low[1] = 0.29;
    assert!(!bench.terminated(&moving) && bench.terminated(&low), "0.29 m is too low");

    let mut spin = Bench::new("ant-spin");
    near(spin.reward(&moving, &[], &[0.0; 8]), 4.0 + 1.0, "w_y + up");
    let mut track = Bench::new("ant-spin-track");
    // 5 exp(-1 - 0.1 * 0.25 - 0.1) + 0.1
    near(track.reward(&moving, &[], &[0.0; 8]), 5.0 * (-1.125f64).exp() + 0.1, "at 4 rad/s");
    let steady = ant(&bench, [0.0; 3], [0.0, 5.0, 0.0]);
    near(track.reward(&steady, &[], &[0.0; 8]), 5.1, "at 5 rad/s");
}

#[test]
fn the_franka_reaches() {
    for name in ["franka-reach", "franka-reach-torque"] {
        let mut bench = Bench::new(name);
        let zero = [0.0; 14];
        // At zero angles the arm stands up: 0.333 + 0.316 + 0.384 up, 0.088 out, then down by the tool's 0.21207.
        let seen = bench.observe(&zero, &[0.5, 0.1, 0.2]);
        for (k, by_hand) in [0.088, 0.0, 0.333 + 0.316 + 0.384 - 0.21207, 0.5, 0.1, 0.2].into_iter().enumerate() {
            assert!(
                (seen[7 + k] - by_hand).abs() < 1e-6,
                "{name}: number {}: {}, by hand {by_hand}",
                7 + k,
                seen[7 + k]
            );
        }
        // At the target both peaks are 1 / (2 + 1e-4).
        let tool: Vec<f64> = seen[7..10].to_vec();
        near(bench.reward(&zero, &tool, &[0.0; 7]), 2.0 / 2.0001, name);
        let beside = [tool[0] + 0.01, tool[1], tool[2]];
        let peak = |k: f64| 1.0 / (k.exp() + (-k).exp() + 1e-4);
        near(bench.reward(&zero, &beside, &[0.0; 7]), -0.01 + peak(0.5) + peak(3.0), name);
        near(bench.reward(&zero, &[tool[0], tool[1] + 4.0, tool[2]], &[0.0; 7]), -4.0, "far away, without overflow");
        assert!(!bench.terminated(&zero));
    }
    let mut position = Bench::new("franka-reach");
    let mut state = [0.0; 14];
    state[7] = 0.1;
    // kp 0.03125 a - kd qd: 600 * 0.03125 * 0.5 - 5 * 0.1. The fifth joint's torque limit of 12 does not bound 250 *
    // 0.03125.
    let tau = position.torques(&state, &[0.5, 9.0, 0.0, 0.0, 1.0, 0.0, 0.0]);
    near(tau[0], 600.0 * 0.03125 * 0.5 - 0.5, "joint 1");
    near(tau[1], 600.0 * 0.03125, "joint 2 by a clamped action");
    near(tau[4], 250.0 * 0.03125, "joint 5");
    let mut torque = Bench::new("franka-reach-torque");
    assert_eq!(
        torque.torques(&state, &[1.0, -2.0, 0.5, 0.0, 1.0, 0.0, -0.5]),
        [87.0, -87.0, 43.5, 0.0, 12.0, 0.0, -6.0]
    );
}

#[test]
fn anymal_walks_forward_and_sideways() {
    for (name, velocity) in [("anymal-forward", [1.0, 0.0]), ("anymal-side", [0.0, 1.0])] {
        let mut bench = Bench::new(name);
        let mut state = bench.rest();
        near(bench.reward(&state, &[], &[0.0; 12]), (-1.0f64).exp() + 0.5, "standing");
        let [x, z] = velocity;
        // At x = y = 0 the twist's linear part is p_dot + p x w; with w = (0, 0.3, 0) at height 0.7 it equals p_dot.
        (state[22], state[24], state[20]) = (x, z, 0.3);
        near(bench.reward(&state, &[], &[10.0; 12]), 1.0 + 0.5 * (-0.09f64).exp() - 2.5e-5 * 1200.0, name);
        near(bench.reward(&state, &[], &[1000.0; 12]), 0.0, "never below nothing");
        let seen = bench.observe(&state, &[]);
        assert_eq!(seen.len(), 37);
        for (k, by_hand) in
            [(0, 0.7), (5, x), (7, z), (9, 0.3), (11, 0.03), (12, 0.4), (13, -0.8), (35, 1.0), (36, 1.0)]
        {
            near(seen[k], by_hand, &format!("number {k} of the observation"));
        }
        assert!(!bench.terminated(&state), "standing");
        let low = |height: f64| [&[0.0, height, 0.0], &state[3..]].concat();
        assert!(bench.terminated(&low(0.39)), "the base below 0.4 m");
        // Nose down by an angle a about world z, the base at 0.45 m. The front knees, at (0.471, -0.268) from the base,
        // are 0.45 - 0.471 sin a - 0.268 cos a above ground: 0.094 m at 0.2 rad and 0.055 m at 0.3. They touch below
        // 0.07.
        let nosed = |a: f64| {
            let ((ts, tc), (s, c)) = ((-a / 2.0).sin_cos(), (-std::f64::consts::FRAC_PI_4).sin_cos());
            [&[0.0, 0.45, 0.0, tc * s, ts * s, ts * c, tc * c], &state[7..]].concat()
        };
        assert!(!bench.terminated(&nosed(0.2)) && bench.terminated(&nosed(0.3)), "the knees on the ground");
    }
}
