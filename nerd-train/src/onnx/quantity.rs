//! Finds what each number of an observation is, from the task's recorded formulas. The quantities that a robot's
//! sensors and base estimate give are recorded on the same tape. A number is a quantity if the normal forms of both
//! agree up to scale and offset. So contracts are true for any task, without annotations.

use nerd_tasks::formula::{Forms, Number, Sight, Tape, Traced, rotation};

use super::terms::Seen;
use crate::prelude::*;

const AXES: [&str; 3] = ["x", "y", "z"];

/// A quantity that a policy may observe.
struct Quantity<'a> {
    what: &'static str,
    of: String,
    unit: &'static str,
    value: Traced<'a>,
}

/// All quantities that a policy may observe, the simplest first.
fn quantities<'a>(task: &dyn Task, sight: &Sight<'a>) -> Vec<Quantity<'a>> {
    let system = sight.system();
    let mut all = Vec::new();
    let robot = &system.robot;
    if robot.floating() {
        root(sight, &mut all);
    }
    let mut put = |what, of: &str, unit, value| all.push(Quantity { what, of: of.into(), unit, value });
    for (k, joint) in robot.joints().enumerate() {
        let slides = joint.kind == JointKind::Prismatic;
        let q = sight.q(robot.root_coords() + k);
        put("joint position", &joint.name, if slides { "m" } else { "rad" }, q);
        put("joint velocity", &joint.name, if slides { "m/s" } else { "rad/s" }, sight.qd(robot.root_dofs() + k));
        if !slides {
            put("joint position within [-pi, pi)", &joint.name, "rad", q.wrap());
            put("sine of joint position", &joint.name, "1", q.sin());
            put("cosine of joint position", &joint.name, "1", q.cos());
        }
    }
    let actions = task.action_dim();
    let memory = task.memory();
    let goals = task.goal_dim() - memory;
    for (k, past) in (0..memory.min(2 * actions)).map(|k| (k, sight.goal(goals + k))) {
        put(if k < actions { "last action" } else { "action before last" }, &(k % actions).to_string(), "1", past);
    }
    if memory > 2 * actions {
        let step = system.frame_time * task.frames() as f64;
        put("time since the episode began", "", "s", sight.goal(goals + 2 * actions) * step);
    }
    for (k, goal) in (0..goals).map(|k| (k, sight.goal(k))) {
        put("goal", &k.to_string(), "", goal);
        if robot.floating() {
            let axes = AXES.iter().enumerate();
            axes.for_each(|(i, axis)| put("goal from root position", &format!("{k} {axis}"), "m", goal - sight.q(i)));
        }
    }
    all
}

/// Quantities of a free root.
fn root<'a>(sight: &Sight<'a>, all: &mut Vec<Quantity<'a>>) {
    let mut put = |what, of: &str, unit, value| all.push(Quantity { what, of: of.into(), unit, value });
    let (position, spin) = ([0, 1, 2].map(|k| sight.q(k)), [0, 1, 2].map(|k| sight.qd(k)));
    let cross = |i: usize, k: usize| spin[i] * position[k] - spin[k] * position[i];
    let velocity = [0, 1, 2].map(|k| sight.qd(3 + k) + cross((k + 1) % 3, (k + 2) % 3));
    let quaternion = [3, 4, 5, 6].map(|k| sight.q(k));
    let turn = rotation(quaternion);
    let inside =
        |v: [Traced<'a>; 3]| [0, 1, 2].map(|own| turn[0][own] * v[0] + turn[1][own] * v[1] + turn[2][own] * v[2]);
    let vectors = [
        ("root position", "m", position),
        ("root velocity", "m/s", velocity),
        ("root angular velocity", "rad/s", spin),
        ("root velocity in its axes", "m/s", inside(velocity)),
        ("root angular velocity in its axes", "rad/s", inside(spin)),
    ];
    for (what, unit, vector) in vectors {
        AXES.iter().zip(vector).for_each(|(axis, x)| put(what, axis, unit, x));
    }
    ["x", "y", "z", "w"].iter().zip(quaternion).for_each(|(axis, x)| put("root quaternion", axis, "1", x));
    for (own, world) in (0..9).map(|k| (k / 3, k % 3)) {
        put("root axis along world axis", &format!("{} {}", AXES[own], AXES[world]), "1", turn[world][own]);
    }
}

/// Identifies the entries of a task's observation.
pub(super) fn observation(task: &dyn Task, system: &System) -> Vec<Seen> {
    let tape = Tape::default();
    let sight = task.sight(&tape, system);
    let mut row = vec![Traced::from(f64::NAN); task.observation_dim()];
    task.observe(&sight, &mut row);
    let all = quantities(task, &sight);
    let forms = Forms::of(&tape, system);
    row.into_iter().map(|number| seen(number, &forms, &all)).collect()
}

/// Finds the quantity that equals a number up to scale and offset.
fn seen(number: Traced, forms: &Forms, all: &[Quantity]) -> Seen {
    if let Some(offset) = forms.constant(number) {
        return Seen { quantity: Some("constant".into()), offset, ..Seen::default() };
    }
    let found = all.iter().find_map(|Quantity { what, of, unit, value }| {
        let (scale, offset) = forms.linear(number, &[*value])?;
        Some(Seen { quantity: Some((*what).into()), of: of.clone(), unit: (*unit).into(), scale: scale[0], offset })
    });
    found.unwrap_or_default()
}
