//! What the numbers of an observation are, found by asking the task: at states drawn anywhere, each is compared with every quantity that a
//! robot's sensors and its estimate of the base give, up to a scale and an offset. So a contract is true of any task, and needs no word from it.

use std::f64::consts::{PI, TAU};

use nerd_core::state::{wrap, write_quaternion};
use nerd_tasks::{View, Work};

use super::terms::Seen;
use crate::prelude::*;

/// States that are compared.
const STATES: u64 = 24;
/// Largest difference, of the largest number.
const ALIKE: f64 = 1e-9;
const AXES: [&str; 3] = ["x", "y", "z"];

/// A state anywhere, with what is asked for there.
pub(super) struct Draw {
    pub state: Vec<f64>,
    pub goal: Vec<f64>,
}

/// The same states for everyone who asks.
pub(super) fn draws(task: &dyn Task, system: &System) -> Vec<Draw> {
    let draw = |k| {
        let mut rng = stream(17, k);
        let (state, mut goal) = (anywhere(&system.robot, &mut rng), vec![0.0; task.goal_dim()]);
        task.draw_goal(&mut rng, &mut goal);
        let first = goal.len() - task.memory();
        goal[first..].iter_mut().for_each(|a| *a = rng.random_range(-1.0..1.0));
        if let Some(steps) = goal.get_mut(first + 2 * task.action_dim()) {
            *steps = rng.random_range(0..task.episode_length()) as f64;
        }
        Draw { state, goal }
    };
    (0..STATES).map(draw).collect()
}

/// Joints anywhere within their limits, endless ones beyond a turn, a root turned at random, velocities up to 2 (rad/s or m/s).
fn anywhere(robot: &Robot, rng: &mut ChaCha8Rng) -> Vec<f64> {
    let (mut state, nq, coords) = (robot.zero_state(), robot.nq(), robot.root_coords());
    state.iter_mut().for_each(|x| *x = rng.random_range(-2.0..2.0));
    for (q, joint) in state[coords..nq].iter_mut().zip(robot.joints()) {
        let free = if joint.kind == JointKind::Prismatic { 1.0 } else { TAU };
        let [low, high] = joint.limit.map_or([-free, free], |limit| [limit.lower.max(-free), limit.upper.min(free)]);
        *q = low + (high - low) * rng.random_range(0.0..1.0);
    }
    if robot.floating() {
        let [roll, pitch, yaw] = [0, 1, 2].map(|_| rng.random_range(-PI..PI));
        write_quaternion(&mut state[3..7], &UnitQuaternion::from_euler_angles(roll, 0.5 * pitch, yaw));
    }
    state
}

/// One that may be observed, and its value.
struct Quantity {
    what: &'static str,
    of: String,
    unit: &'static str,
    value: f64,
}

/// All there are at a state, the plainest first.
fn quantities(task: &dyn Task, system: &System, Draw { state, goal }: &Draw) -> Vec<Quantity> {
    let (robot, mut all) = (&system.robot, Vec::new());
    let (q, qd) = state.split_at(robot.nq());
    let mut put = |what, of: &str, unit, value| all.push(Quantity { what, of: of.into(), unit, value });
    if robot.floating() {
        let (turn, spin) = (quaternion(&q[3..7]), vector(qd));
        let velocity = vector(&qd[3..]) + spin.cross(&vector(q));
        let vectors = [
            ("root position", "m", vector(q)),
            ("root velocity", "m/s", velocity),
            ("root angular velocity", "rad/s", spin),
            ("root velocity in its axes", "m/s", turn.inverse() * velocity),
            ("root angular velocity in its axes", "rad/s", turn.inverse() * spin),
        ];
        for (what, unit, vector) in vectors {
            AXES.iter().zip(vector.iter()).for_each(|(axis, x)| put(what, axis, unit, *x));
        }
        ["x", "y", "z", "w"].iter().zip(&q[3..7]).for_each(|(axis, x)| put("root quaternion", axis, "1", *x));
        let axes = turn.to_rotation_matrix();
        for (own, world) in (0..9).map(|k| (k / 3, k % 3)) {
            put("root axis along world axis", &format!("{} {}", AXES[own], AXES[world]), "1", axes[(world, own)]);
        }
    }
    let rates = &qd[robot.root_dofs()..];
    for ((joint, q), rate) in robot.joints().zip(&q[robot.root_coords()..]).zip(rates) {
        let slides = joint.kind == JointKind::Prismatic;
        put("joint position", &joint.name, if slides { "m" } else { "rad" }, *q);
        put("joint velocity", &joint.name, if slides { "m/s" } else { "rad/s" }, *rate);
        if !slides {
            put("joint position within [-pi, pi)", &joint.name, "rad", wrap(*q));
            put("sine of joint position", &joint.name, "1", q.sin());
            put("cosine of joint position", &joint.name, "1", q.cos());
        }
    }
    let (goal, past) = goal.split_at(goal.len() - task.memory());
    for (what, past) in ["last action", "action before last"].into_iter().zip(past.chunks(task.action_dim().max(1))) {
        past.iter().enumerate().for_each(|(k, x)| put(what, &k.to_string(), "1", *x));
    }
    if let Some(steps) = past.get(2 * task.action_dim()) {
        put("time since the episode began", "", "s", steps * system.frame_time * task.frames() as f64);
    }
    for (k, x) in goal.iter().enumerate() {
        put("goal", &k.to_string(), "", *x);
        if robot.floating() {
            AXES.iter().zip(q).for_each(|(axis, p)| put("goal from root position", &format!("{k} {axis}"), "m", x - p));
        }
    }
    all
}

/// What a task's observation holds, number by number.
pub(super) fn observation(task: &dyn Task, system: &Arc<System>) -> Result<Vec<Seen>> {
    let (scene, draws) = (system.scene(task.scene())?, draws(task, system));
    let mut work = Work::new(system);
    let rows = draws.iter().map(|Draw { state, goal }| {
        let mut row = vec![0.0; task.observation_dim()];
        task.observe(View { state, goal, scene: &scene }, &mut work, &mut row);
        row
    });
    let rows: Vec<Vec<f64>> = rows.collect();
    let all: Vec<Vec<Quantity>> = draws.iter().map(|draw| quantities(task, system, draw)).collect();
    let column = |k: usize| -> Vec<f64> { rows.iter().map(|row| row[k]).collect() };
    Ok((0..task.observation_dim()).map(|k| seen(&column(k), &all)).collect())
}

/// The quantity that these numbers are, `[state]`.
fn seen(numbers: &[f64], all: &[Vec<Quantity>]) -> Seen {
    let most = numbers.iter().fold(1.0, |most: f64, x| most.max(x.abs()));
    let alike = |x: f64, y: f64| (x - y).abs() <= ALIKE * most;
    if numbers.iter().all(|x| alike(*x, numbers[0])) {
        return Seen { quantity: Some("constant".into()), offset: numbers[0], ..Seen::default() };
    }
    for (k, Quantity { what, of, unit, .. }) in all[0].iter().enumerate() {
        let value = |state: usize| all[state][k].value;
        let run = value(1) - value(0);
        if run == 0.0 {
            continue;
        }
        // Of a line through two states the decimal that was meant.
        let scale = decimal((numbers[1] - numbers[0]) / run);
        let offset = decimal(numbers[0] - scale * value(0));
        if scale != 0.0 && numbers.iter().enumerate().all(|(state, x)| alike(*x, scale * value(state) + offset)) {
            return Seen { quantity: Some((*what).into()), of: of.clone(), unit: (*unit).into(), scale, offset };
        }
    }
    Seen::default()
}

fn decimal(x: f64) -> f64 {
    let rounded = (x * 1e9).round() / 1e9;
    if (rounded - x).abs() <= 1e-12 * x.abs().max(1.0) { rounded } else { x }
}
