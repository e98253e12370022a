//! SHA-256 hashes that identify a system by content, in place of names or files, for data, models and runs.
//!
//! The hash is taken over a canonical form: keys in order, numbers as f64 (little-endian, -0 as 0), text and lists with
//! their lengths. Comments, white space, order of keys and tables, and spelling of numbers have no effect.

use serde_json::{Value, json};
use sha2::{Digest, Sha256};

use crate::internal::*;
use crate::robots::motors::Motors;
use crate::scene::PairLaw;

/// Keys of a specification that [`System::sha256`] skips: they do not affect data, or [`System::robot_sha256`] covers
/// them.
const ELSEWHERE: [&str; 14] = [
    "urdf",
    "truth",
    "floating",
    "frame_time",
    "gravity",
    "substeps",
    "refresh",
    "state_columns",
    "torque_columns",
    "material",
    "mass_matrix_of",
    "contact",
    "mesh_points",
    "self_collision",
];

impl System {
    /// Hash of everything that determines the motion under given torques: links, joints, inertias, contact shapes and
    /// material, base, frame time, gravity, substeps. Lower-case hex.
    pub fn robot_sha256(&self) -> String {
        sha256(&self.motion())
    }

    /// Hash of [`System::robot_sha256`] and everything else that determines data: starts, drives, control and scenes.
    /// Lower-case hex.
    pub fn sha256(&self) -> String {
        let mut spec = json!(self.spec);
        if let Some(keys) = spec.as_object_mut() {
            // Keys that later versions added are omitted where they have no effect, so that earlier systems keep their
            // hash.
            let silent = |key: &str, value: &Value| value.is_null() && ["random_pegs", "smooth", "vary"].contains(&key);
            keys.retain(|key, value| !ELSEWHERE.contains(&key.as_str()) && !silent(key, value));
            keys.get_mut("vary")
                .and_then(Value::as_object_mut)
                .into_iter()
                .for_each(|vary| vary.retain(|_, range| !range.is_null()));
        }
        crate::files::renamed::hashed(&mut spec);
        for joint in spec["joint"].as_array_mut().into_iter().flatten().filter_map(Value::as_object_mut) {
            joint.retain(|key, _| !["column", "armature", "limit", "stiffness", "rest"].contains(&key.as_str()));
        }
        let base = self.base.iter().map(shape).collect::<Vec<_>>();
        sha256(&if base.is_empty() { json!([self.motion(), spec]) } else { json!([self.motion(), spec, base]) })
    }

    fn motion(&self) -> Value {
        let robot = &self.robot;
        let spec = &self.spec;
        let touching = |i: usize| robot.contact_points.iter().any(|p| p.link == i);
        let point = |p: &ContactPoint| match &p.locus {
            Locus::Fixed => json!([p.link, p.local.as_slice(), p.radius, p.thickness]),
            Locus::Rim { axis, radius, turn } => {
                json!([p.link, p.local.as_slice(), p.radius, p.thickness, axis.as_slice(), radius, turn])
            }
            Locus::Hull { vertices, .. } => {
                json!([p.link, vertices.iter().map(|v| v.as_slice()).collect::<Vec<_>>(), p.radius, p.thickness])
            }
        };
        let points = robot.contact_points.iter().map(|p| on(point(p), p.surface));
        let mut value = json!({
            "base": match &robot.base {
                Base::Fixed(at) => json!(pose(at)),
                Base::Floating => Value::Null,
            },
            "links": robot.links.iter().enumerate().map(|(i, l)| link(l, touching(i))).collect::<Vec<_>>(),
            "points": points.collect::<Vec<_>>(),
            "mass_matrix_of": self.stand_ins,
            "frame_time": self.frame_time,
            "gravity": spec.gravity,
            // Without contact the material has no effect.
            "material": (!robot.contact_points.is_empty() || !self.folds.is_empty()).then_some(spec.material),
            "substeps": spec.substeps,
            "refresh": spec.refresh,
        });
        if !self.folds.is_empty() {
            let capsules =
                self.folds.capsules.iter().map(|c| json!([c.middle.as_slice(), c.half.as_slice(), c.radius]));
            let mut folds = vec![json!(capsules.collect::<Vec<_>>()), json!(self.folds.own), json!(self.folds.pairs)];
            if !self.surfaces.is_empty() {
                let laws = self.folds.laws.iter().map(|law| law.as_ref().map(PairLaw::numbers));
                folds.push(json!([self.folds.links, laws.collect::<Vec<_>>()]));
            }
            value["self_collision"] = json!(folds);
        }
        if !self.surfaces.is_empty() {
            let laws = self.robot.contact_points.iter().map(|p| p.surface.map(|own| self.surfaces.row(own)));
            value["surfaces"] = json!([laws.collect::<Vec<_>>(), self.one_friction]);
        }
        if robot.free.damping != 0.0 {
            value["damping"] = json!(robot.free.damping);
        }
        if !self.motors.ideal() {
            let Motors { delay, strength, zeros, ripple, lines, .. } = &self.motors;
            value["motors"] = json!([delay, strength, zeros, ripple]);
            if !lines.is_empty() {
                value["motors"][4] = json!(lines);
            }
        }
        value
    }
}

/// Canonical form of a link: without its name, and with its shapes only if the link has contact points.
fn link(link: &Link, touching: bool) -> Value {
    let body = &link.inertia;
    let shapes = link.shapes.iter().filter(|_| touching).map(shape);
    let mut value = json!({
        "parent": link.parent,
        "joint": link.joint.as_ref().map(joint),
        "mass": body.mass,
        "com": body.com.as_slice(),
        "inertia": body.inertia.as_slice(),
        "shapes": shapes.collect::<Vec<_>>(),
    });
    if link.lifted.mass != 0.0 {
        value["lifted"] = json!([link.lifted.mass, link.lifted.at.as_slice()]);
    }
    value
}

fn joint(joint: &Joint) -> Value {
    let mut value = json!({
        "kind": format!("{:?}", joint.kind),
        "origin": pose(joint.origin()),
        "axis": joint.axis().as_slice(),
        "limit": joint.limit.map(|l| [l.lower, l.upper, l.stiffness, l.damping]),
        "damping": joint.damping,
        "friction": joint.friction,
        "armature": joint.armature,
    });
    // A joint without a spring omits the key, so that earlier robots keep their hash.
    if joint.stiffness > 0.0 {
        value["spring"] = json!([joint.stiffness, joint.rest]);
    }
    if let Some(m) = joint.mimic() {
        value["mimic"] = json!([m.coordinate, m.multiplier, m.offset]);
    }
    value
}

fn shape(shape: &Shape) -> Value {
    let (kind, sizes) = match shape.kind {
        ShapeKind::Sphere { radius } => ("sphere", vec![radius]),
        ShapeKind::Box { half } => ("box", half.as_slice().to_vec()),
        ShapeKind::Cylinder { radius, half_length } => ("cylinder", vec![radius, half_length]),
        ShapeKind::Capsule { radius, half_length } => ("capsule", vec![radius, half_length]),
    };
    on(json!([kind, sizes, pose(&shape.pose)]), shape.surface)
}

/// Appends the index of its surface to a contact shape's numbers, if the shape has a surface.
fn on(mut solid: Value, surface: Option<usize>) -> Value {
    if let (Value::Array(solid), Some(surface)) = (&mut solid, surface) {
        solid.push(json!(surface));
    }
    solid
}

fn pose(pose: &nalgebra::Isometry3<f64>) -> [Vec<f64>; 2] {
    [pose.translation.vector.as_slice().to_vec(), pose.rotation.coords.as_slice().to_vec()]
}

/// Hash of a value's canonical form, lower-case hex.
fn sha256(value: &Value) -> String {
    let mut hash = Sha256::new();
    feed(value, &mut hash);
    hash.finalize().iter().map(|b| format!("{b:02x}")).collect()
}

fn feed(value: &Value, hash: &mut Sha256) {
    let text = |hash: &mut Sha256, text: &str| {
        hash.update((text.len() as u64).to_le_bytes());
        hash.update(text);
    };
    match value {
        Value::Null => hash.update([0]),
        Value::Bool(is) => hash.update([1, u8::from(*is)]),
        Value::Number(x) => {
            hash.update([2]);
            // Adding 0 turns -0 into 0.
            hash.update((x.as_f64().unwrap_or(f64::NAN) + 0.0).to_le_bytes());
        }
        Value::String(x) => {
            hash.update([3]);
            text(hash, x);
        }
        Value::Array(items) => {
            hash.update([4]);
            hash.update((items.len() as u64).to_le_bytes());
            items.iter().for_each(|item| feed(item, hash));
        }
        Value::Object(map) => {
            hash.update([5]);
            hash.update((map.len() as u64).to_le_bytes());
            let mut keys: Vec<_> = map.iter().collect();
            keys.sort_by_key(|(key, _)| *key);
            for (key, item) in keys {
                text(hash, key);
                feed(item, hash);
            }
        }
    }
}
