//! Content of an MJCF besides its bodies, as keys of a specification: gravity, armature, springs, gains, control,
//! default pose.

use std::collections::HashMap;

use nerd_core::dynamics::{Factor, crba, kinematics};
use nerd_core::robot::Bodies;
use toml::{Table, Value};

use super::joint::Joint;
use super::tree::Tree;
use crate::internal::*;

/// Names of keyframes that give the default pose, in order of preference; without them, the first keyframe does.
const STANDING: [&str; 3] = ["home", "stand", "standing"];

/// Returns the keys of a specification, and the orientation (x y z w) of a free root in the default pose.
pub(super) fn keys(
    tree: &Tree,
    inertias: &HashMap<String, f64>,
    notes: &mut Vec<String>,
) -> Result<(Table, [f64; 4]), UrdfError> {
    let mut keys = Table::new();
    keys.insert("floating".into(), Value::Boolean(tree.free.is_some()));
    keys.insert("gravity".into(), Value::Array(tree.model.options.gravity.iter().map(|x| Value::Float(*x)).collect()));
    let led = || tree.all_joints().filter(|(name, ..)| !tree.follow.contains_key(*name));
    let mut joints: Vec<Table> =
        led().map(|(name, joint, body)| own(tree, name, joint, body, inertias.get(name))).collect();
    fold(tree, &mut joints, notes);
    // For a robot with a free base, a controller is always derived.
    if tree.free.is_none() && !joints.is_empty() {
        keys.extend(control(tree, notes).map(|control| ("control".into(), Value::Table(control))));
    }
    let root = pose(tree, &mut joints)?;
    if !joints.is_empty() {
        keys.insert("joint".into(), Value::Array(joints.into_iter().map(Value::Table).collect()));
    }
    Ok((keys, root))
}

/// Inertia (kg m^2 or kg) felt at each joint in the file's pose with all other joints free. Damping ratios and time
/// constants of the file refer to this inertia. Empty if no joint has such a number.
pub(super) fn inertias(tree: &Tree, bodies: &Bodies) -> Result<HashMap<String, f64>, UrdfError> {
    let asks = tree.all_joints().any(|(_, joint, _)| joint.spring_damper != [0.0; 2])
        || tree.motors.values().any(|m| !m.ratios.is_empty());
    if !asks {
        return Ok(HashMap::new());
    }
    let base = if tree.free.is_some() { Base::Floating } else { Base::fixed() };
    let mut robot = UrdfRobot::of_alone(bodies, base)?.robot;
    let all: HashMap<&str, &Joint> = tree.all_joints().map(|(name, joint, _)| (name.as_str(), joint)).collect();
    let mut q = robot.neutral();
    let coords = robot.root_coords();
    for (joint, q) in robot.joints_mut().zip(&mut q[coords..]) {
        let own = all.get(joint.name.as_str());
        joint.armature =
            own.map_or(0.0, |own| own.armature) + tree.motors.get(&joint.name).map_or(0.0, |motor| motor.armature);
        *q = own.map_or(0.0, |own| own.reference);
    }
    let mut data = Data::new(&robot);
    let mut factor = Factor::new(&robot);
    kinematics(&robot, &q, &mut data);
    crba(&robot, &mut data);
    if !factor.refill(&data.mass) {
        return Err(UrdfError::Refused(factor.fault(&robot)));
    }
    let first = robot.root_dofs();
    let inertia = |k: usize| {
        let mut x = vec![0.0; robot.nv()];
        x[first + k] = 1.0;
        factor.solve(&mut x);
        1.0 / x[first + k]
    };
    Ok(robot.joints().enumerate().map(|(k, joint)| (joint.name.clone(), inertia(k))).collect())
}

/// The `[[joint]]` entry of a joint: the numbers that its description as a joint between bodies lacks.
fn own(tree: &Tree, name: &str, joint: &Joint, body: usize, inertia: Option<&f64>) -> Table {
    let mut own = Table::from_iter([("name".to_string(), Value::String(name.into()))]);
    let mut set = |key: &str, x: f64| _ = own.insert(key.into(), Value::Float(x));
    let motor = tree.motors.get(name);
    set("armature", joint.armature + motor.map_or(0.0, |motor| motor.armature));
    set("default_q", within_range(tree, joint, body, joint.reference));
    let (stiffness, _) = joint.spring(inertia.copied(), &tree.model.options);
    if stiffness > 0.0 {
        set("stiffness", stiffness);
        set("rest", joint.spring_reference);
    }
    let Some(motor) = motor else { return own };
    let damping = |[kp, ratio]: &[f64; 2]| 2.0 * ratio * (kp * inertia.copied().unwrap_or(0.0)).sqrt();
    let kd = motor.kd + motor.ratios.iter().map(damping).sum::<f64>();
    if motor.kp > 0.0 || kd > 0.0 {
        set("kp", motor.kp);
        set("kd", kd);
    }
    if motor.effort.is_finite() {
        set("gain", motor.effort);
    }
    own
}

fn within_range(tree: &Tree, joint: &Joint, body: usize, q: f64) -> f64 {
    tree.limits(joint, body).filter(|[low, high]| low <= high).map_or(q, |[low, high]| q.clamp(low, high))
}

/// The `[control]` table of a robot with position actuators on all joints; `None` for other robots.
fn control(tree: &Tree, notes: &mut Vec<String>) -> Option<Table> {
    let held = |name: &str| tree.motors.get(name).filter(|motor| motor.kp > 0.0);
    let led = tree.all_joints().map(|(name, ..)| name).filter(|name| !tree.follow.contains_key(*name));
    let (with, without): (Vec<_>, Vec<_>) = led.partition(|name| held(name).is_some());
    if let (false, Some(other)) = (with.is_empty(), without.first()) {
        notes.push(format!(
            "joint `{other}` has no position actuator, so actions are torques; [control] in a .toml makes them targets"
        ));
    }
    let clamp = with.iter().filter_map(|name| held(name)).all(|motor| motor.effort.is_finite());
    let law = [
        ("scale", Value::Float(1.0)),
        ("clamp", Value::Boolean(clamp)),
        ("stable_pd", Value::Boolean(true)),
        ("servo", Value::Boolean(true)),
    ];
    (!with.is_empty() && without.is_empty()).then(|| law.map(|(key, x)| (key.to_string(), x)).into_iter().collect())
}

/// Moves armature and springs of following joints to their leaders.
fn fold(tree: &Tree, joints: &mut [Table], notes: &mut Vec<String>) {
    for (name, joint, _) in tree.all_joints() {
        let Some(f) = tree.follow.get(name) else { continue };
        let Some(leader) = joints.iter_mut().find(|own| own["name"].as_str() == Some(&f.leader)) else { continue };
        let get = |key: &str| leader.get(key).and_then(Value::as_float).unwrap_or(0.0);
        let square = f.multiplier * f.multiplier;
        let [spring, ..] = joint.stiffness;
        let armature = get("armature") + square * joint.armature;
        let stiffness = get("stiffness") + square * spring;
        let pull = get("stiffness") * get("rest") + f.multiplier * spring * (joint.spring_reference - f.offset);
        let rest = if stiffness > 0.0 { pull / stiffness } else { 0.0 };
        leader.extend(
            [("armature", armature), ("stiffness", stiffness), ("rest", rest)]
                .map(|(key, x)| (key.into(), Value::Float(x))),
        );
        notes.push(format!("joint `{name}`: its equality with `{}` holds exactly, and is no spring", f.leader));
    }
}

/// Sets the default positions of the joints from a keyframe. Returns the orientation (x y z w) of a free root in the
/// keyframe, else in the file.
fn pose(tree: &Tree, joints: &mut [Table]) -> Result<[f64; 4], UrdfError> {
    let own = tree.free.map_or(UnitQuaternion::identity(), |id| tree.model.bodies[id].pose.rotation);
    let frames = || tree.model.keys.iter().filter_map(|key| Some((key, key.q.as_ref()?)));
    let named = |name: &&str| frames().find(|(key, _)| key.name == *name);
    let Some((_, q)) = STANDING.iter().find_map(named).or_else(|| frames().next()) else {
        return Ok(own.coords.into());
    };
    let root = if tree.free.is_some() { 7 } else { 0 };
    for ((name, joint, body), q) in tree.all_joints().zip(q.iter().skip(root)) {
        if let Some(own) = joints.iter_mut().find(|own| own["name"].as_str() == Some(name)) {
            own.insert("default_q".into(), Value::Float(within_range(tree, joint, body, *q)));
        }
    }
    let turned = || Some(nalgebra::Quaternion::new(*q.get(3)?, *q.get(4)?, *q.get(5)?, *q.get(6)?));
    let turned = || turned().and_then(|q| UnitQuaternion::try_new(q, 1e-9));
    Ok(if root > 0 { turned().unwrap_or(own) } else { own }.coords.into())
}
