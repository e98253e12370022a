//! What an MJCF says beyond a URDF, as keys of a specification: gravity, armature, springs, gains and their law, a pose to stand in, the ground.

use mjcf_rs::body::{self, Geom, GeomType};
use toml::{Table, Value};

use super::description::Description;
use super::tree::{Tree, angles, touches};
use super::{drives::Motor, inertia::isometry};
use crate::{internal::*, scene::up};

/// Keyframes that are taken for a pose to stand in, the best first; else the first.
const STANDING: [&str; 3] = ["home", "stand", "standing"];

/// The robot that was written as a URDF, with the rest of what its file says.
pub(super) fn described(mut tree: Tree) -> Result<Description<'static>, UrdfError> {
    let urdf = std::mem::take(&mut tree.urdf).into();
    let (tree, model) = (&tree, tree.model);
    let (mut keys, gravity) = (Table::new(), Vector3::from(model.option.gravity));
    keys.insert("floating".into(), Value::Boolean(tree.free.is_some()));
    keys.insert("gravity".into(), floats(gravity.as_slice()));
    let mut notes = tree.notes.clone();
    let mut joints: Vec<Table> =
        tree.all_joints().filter(|(name, _)| !tree.follow.contains_key(*name)).map(|(n, j)| own(tree, n, j)).collect();
    fold(tree, &mut joints, &mut notes);
    // Of a robot on legs a controller is derived in any case.
    if tree.free.is_none() && !joints.is_empty() {
        keys.extend(control(tree, &mut notes).map(|control| ("control".into(), Value::Table(control))));
    }
    let root = pose(tree, &mut joints)?;
    if !joints.is_empty() {
        keys.insert("joint".into(), Value::Array(joints.into_iter().map(Value::Table).collect()));
    }
    let touching = |still: bool| {
        let bodies = model.bodies.iter().enumerate().filter(move |(id, _)| tree.still(*id) == still);
        bodies.flat_map(|(id, entry)| entry.body.geoms.iter().map(move |geom| (id, geom))).filter(|(_, geom)| touches(geom, model))
    };
    let plane = |geom: &Geom| geom.type_ == GeomType::Plane;
    let (up, mut floor) = (up(&gravity), 0.0);
    let grounds = touching(true).filter(|(_, geom)| plane(geom)).map(|(id, geom)| {
        let place = tree.in_world(id) * isometry(&geom.pose);
        (place.rotation * Vector3::z(), place.translation.vector, geom.friction[0])
    });
    // What is steeper is a wall.
    let ground = grounds.into_iter().find(|(normal, ..)| normal.dot(&up) > 0.5);
    // MuJoCo takes the larger friction of a pair.
    let mut frictions: Vec<f64> = touching(false).map(|(_, geom)| geom.friction[0].max(ground.map_or(0.0, |g| g.2))).collect();
    frictions.sort_by(f64::total_cmp);
    let friction = frictions.get(frictions.len().saturating_sub(1) / 2).copied();
    if let ([least, .., most], Some(friction)) = (&frictions[..], friction)
        && least < most
    {
        notes.push(format!("friction of its contacts is from {least} to {most}; {friction} is taken for all"));
    }
    if let (Some((normal, at, _)), Some(_)) = (ground, friction) {
        floor = normal.dot(&at) / normal.dot(&up);
        let turn = UnitQuaternion::rotation_between(&up, &normal).unwrap_or_default();
        let plane = Table::from_iter([("height".into(), Value::Float(floor)), ("angles".into(), floats(&angles(&turn)))]);
        let scene = Table::from_iter([("name".into(), Value::String("ground".into())), ("plane".into(), Value::Table(plane))]);
        keys.insert("scene".into(), Value::Array(vec![Value::Table(scene)]));
        keys.insert("data_scene".into(), Value::String("ground".into()));
    }
    let left = touching(true).filter(|(_, geom)| tree.free.is_some() && !plane(geom)).count();
    if left > 0 {
        notes.push(format!("{left} geoms of the world beside it are passed over; a .toml's [[scene]] may have them"));
    }
    Ok(Description { urdf, keys, notes, quaternion: root, floor, friction })
}

/// The position law of an arm all of whose joints have position actuators.
fn control(tree: &Tree, notes: &mut Vec<String>) -> Option<Table> {
    let held = |name: &str| tree.motors.get(name).filter(|motor| motor.kp > 0.0);
    let led = tree.all_joints().map(|(name, _)| name).filter(|name| !tree.follow.contains_key(*name));
    let (with, without): (Vec<_>, Vec<_>) = led.partition(|name| held(name).is_some());
    if let (false, Some(other)) = (with.is_empty(), without.first()) {
        notes.push(format!("joint `{other}` has no position actuator, so actions are torques; [control] in a .toml makes them targets"));
    }
    let clamp = with.iter().filter_map(|name| held(name)).all(|motor| motor.effort.is_finite());
    let law = [("scale", Value::Float(1.0)), ("clamp", Value::Boolean(clamp)), ("ahead", Value::Boolean(true))];
    (!with.is_empty() && without.is_empty()).then(|| law.map(|(key, x)| (key.to_string(), x)).into_iter().collect())
}

/// What a URDF cannot say of a joint.
fn own(tree: &Tree, name: &str, joint: &body::Joint) -> Table {
    let mut own = Table::from_iter([("name".to_string(), Value::String(name.into()))]);
    let mut set = |key: &str, x: f64| _ = own.insert(key.into(), Value::Float(x));
    set("armature", joint.armature);
    set("default", within_range(tree, joint, joint.ref_));
    if joint.stiffness > 0.0 {
        set("stiffness", joint.stiffness);
        set("rest", joint.springref);
    }
    let Some(Motor { kp, kd, effort }) = tree.motors.get(name) else { return own };
    if *kp > 0.0 || *kd > 0.0 {
        set("kp", *kp);
        set("kd", *kd);
    }
    if effort.is_finite() {
        set("gain", *effort);
    }
    own
}

fn within_range(tree: &Tree, joint: &body::Joint, q: f64) -> f64 {
    tree.range(joint).filter(|[low, high]| low <= high).map_or(q, |[low, high]| q.clamp(low, high))
}

/// Armature and springs of joints that follow, as the joints that they follow feel them.
fn fold(tree: &Tree, joints: &mut [Table], notes: &mut Vec<String>) {
    for (name, joint) in tree.all_joints() {
        let Some(f) = tree.follow.get(name) else { continue };
        let Some(leader) = joints.iter_mut().find(|own| own["name"].as_str() == Some(&f.leader)) else { continue };
        let get = |key: &str| leader.get(key).and_then(Value::as_float).unwrap_or(0.0);
        let square = f.multiplier * f.multiplier;
        let (armature, stiffness) = (get("armature") + square * joint.armature, get("stiffness") + square * joint.stiffness);
        let pull = get("stiffness") * get("rest") + f.multiplier * joint.stiffness * (joint.springref - f.offset);
        let rest = if stiffness > 0.0 { pull / stiffness } else { 0.0 };
        leader.extend([("armature", armature), ("stiffness", stiffness), ("rest", rest)].map(|(key, x)| (key.into(), Value::Float(x))));
        notes.push(format!("joint `{name}`: its equality with `{}` holds exactly, and is no spring", f.leader));
    }
}

/// Gives joints the positions of a keyframe; how a free root is turned there or else in the file, x y z w.
fn pose(tree: &Tree, joints: &mut [Table]) -> Result<[f64; 4], UrdfError> {
    let own = tree.free.map_or(UnitQuaternion::identity(), |id| isometry(&tree.model.bodies[id].body.pose).rotation);
    let frames = &tree.model.keyframes;
    let named = |name: &&str| frames.iter().find(|key| key.name.as_deref() == Some(*name) && !key.qpos.is_empty());
    let Some(key) = STANDING.iter().find_map(named).or(frames.iter().find(|key| !key.qpos.is_empty())) else {
        return Ok(own.coords.into());
    };
    let root = if tree.free.is_some() { 7 } else { 0 };
    let (found, needed) = (key.qpos.len(), root + tree.all_joints().count());
    if found != needed {
        return Err(tree.source.refused(
            "key",
            key.name.as_deref().unwrap_or_default(),
            format!("qpos has {found} numbers, {needed} are needed"),
        ));
    }
    for ((name, joint), q) in tree.all_joints().zip(&key.qpos[root..]) {
        if let Some(own) = joints.iter_mut().find(|own| own["name"].as_str() == Some(name)) {
            own.insert("default".into(), Value::Float(within_range(tree, joint, *q)));
        }
    }
    let turned = || UnitQuaternion::try_new(nalgebra::Quaternion::new(key.qpos[3], key.qpos[4], key.qpos[5], key.qpos[6]), 1e-9);
    Ok(if root > 0 { turned().unwrap_or(own) } else { own }.coords.into())
}

fn floats(x: &[f64]) -> Value {
    Value::Array(x.iter().map(|x| Value::Float(*x)).collect())
}
