//! Content of an MJCF: bodies with joints, geoms and sites, meshes, actuators, couplings, contacts, keyframes.

use std::collections::HashMap;
use std::sync::Arc;

use super::actuator::Actuator;
use super::classes::Pair;
use super::element::Element;
use super::field::Fields;
use super::geom::Geom;
use super::joint::{Joint, Kind};
use super::option::Options;
use super::site::Site;
use super::source::Source;
use crate::internal::*;
use crate::scene::Field;

/// A body; body 0 is the world.
pub(super) struct Body {
    pub name: Option<String>,
    pub parent: usize,
    /// Pose in the parent's frame.
    pub pose: Isometry3<f64>,
    pub joints: Vec<Joint>,
    pub geoms: Vec<Geom>,
    pub sites: Vec<Site>,
    /// Pose, mass and inertia from `<inertial>`.
    pub inertial: Option<(Isometry3<f64>, f64, Matrix3<f64>)>,
    pub mocap: bool,
    pub weightless: f64,
    /// The body's element without children, for errors.
    pub element: Element,
    pub source: Arc<Source>,
}

impl Body {
    /// An empty body.
    pub fn new(pose: Isometry3<f64>, parent: usize, element: Element, source: Arc<Source>) -> Self {
        let (name, joints, geoms, sites, inertial) = Default::default();
        Self { name, parent, pose, joints, geoms, sites, inertial, mocap: false, weightless: 0.0, element, source }
    }
}

/// A mesh asset.
pub(super) struct Mesh {
    pub name: String,
    /// Path of the file; `None` for a mesh with vertices in the MJCF.
    pub file: Option<PathBuf>,
    pub vertices: Vec<Vector3<f64>>,
    pub faces: Vec<[u32; 3]>,
    pub scale: Vector3<f64>,
    /// Reference frame of the mesh in the file's axes.
    pub reference: Isometry3<f64>,
    pub inertia: String,
}

/// Two geoms with the contact parameters of a `<pair>`.
pub(super) struct GeomPair {
    pub geoms: [String; 2],
    pub law: Pair,
    pub element: Element,
}

/// `joint = constant + multiplier leader + ..`, with the positions of joint and leader relative to their reference
/// positions.
pub(super) struct Coupling {
    pub joint: String,
    pub leader: Option<String>,
    pub polynomial: [f64; 5],
    pub element: Element,
}

/// A keyframe: a name and joint coordinates.
pub(super) struct Key {
    pub name: String,
    pub q: Option<Vec<f64>>,
    pub element: Element,
}

#[derive(Default)]
pub(super) struct Model {
    pub name: String,
    pub options: Options,
    pub bodies: Vec<Body>,
    pub meshes: Vec<Mesh>,
    pub fields: Fields,
    pub actuators: Vec<(Actuator, Element)>,
    pub couplings: Vec<Coupling>,
    /// Tendons of constant length, each with the difference of this length from the length in the file's pose.
    pub taut: Vec<(String, f64, Element)>,
    /// Fixed tendons by name: joints with their coefficients.
    pub tendons: HashMap<String, Vec<(String, f64)>>,
    pub pairs: Vec<GeomPair>,
    pub excluded: Vec<([String; 2], Element)>,
    pub keys: Vec<Key>,
    pub notes: Vec<String>,
}

impl Model {
    /// Converts a fixed tendon of two joints and constant length to a coupling of these joints.
    pub fn tie(&mut self) -> Result<(), UrdfError> {
        for (tendon, longer, element) in std::mem::take(&mut self.taut) {
            let Some([(leader, a), (joint, b)]) = self.tendons.get(&tendon).map(Vec::as_slice) else {
                return Err(element.refused(format!(
                    "`{}` is no fixed tendon of two joints, and others keep no length here; leave it out, or write active=\"false\"",
                    tendon.escape_debug()
                )));
            };
            let polynomial = [longer / b, -a / b, 0.0, 0.0, 0.0];
            self.couplings.push(Coupling { joint: joint.clone(), leader: Some(leader.clone()), polynomial, element });
        }
        Ok(())
    }

    pub fn field(&self, name: &str) -> Option<&Result<Field, String>> {
        self.fields.iter().find(|(own, _)| own == name).map(|(_, field)| field)
    }

    /// A body and its ancestors, up to the world.
    pub fn above(&self, id: usize) -> impl Iterator<Item = usize> {
        std::iter::successors(Some(id), |k| (*k > 0).then(|| self.bodies[*k].parent))
    }

    /// Whether a body is fixed in the world.
    pub fn still(&self, id: usize) -> bool {
        self.above(id).all(|k| self.bodies[k].joints.is_empty())
    }

    /// World pose of a body in the file's default pose.
    pub fn in_world(&self, id: usize) -> Isometry3<f64> {
        self.above(id).fold(Isometry3::identity(), |pose, k| self.bodies[k].pose * pose)
    }
}

impl Model {
    /// Refuses keyframes with more numbers than the model has coordinates, controls or mocap targets.
    pub fn sizes(&self) -> Result<(), UrdfError> {
        let joints = || self.bodies.iter().flat_map(|body| &body.joints);
        let sum = |of: fn(Kind) -> usize| joints().map(|joint| of(joint.kind)).sum::<usize>();
        let targets = self.bodies.iter().filter(|body| body.mocap).count();
        let acts =
            (!self.options.is_off("actuation") && self.options.groups.is_empty()).then_some(self.actuators.len());
        let most = [
            ("qpos", Some(sum(Kind::coordinates))),
            ("qvel", Some(sum(Kind::velocities))),
            ("ctrl", acts),
            ("act", acts.map(|_| 0)),
            ("plastic", Some(0)),
            ("mpos", Some(3 * targets)),
            ("mquat", Some(4 * targets)),
        ];
        for Key { element: e, .. } in &self.keys {
            for (key, most) in most {
                let given = e.text(key).map_or(0, |text| text.split_whitespace().count());
                if let Some(most) = most.filter(|most| given > *most) {
                    return Err(e.refused(format!("{key} has {given} numbers; the file has {most} of them")));
                }
            }
        }
        Ok(())
    }
}
