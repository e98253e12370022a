//! Names of bodies and joints, and the selection of bodies that belong to the robot.

use std::collections::{HashMap, HashSet};

use super::geom::Type;
use super::joint::{Joint, Kind};
use super::model::{Body, Model};
use crate::internal::*;

/// Combined parameters of a joint's actuators.
#[derive(Clone, Debug)]
pub(super) struct Motor {
    /// Stiffness kp (N m/rad or N/m) and damping kd (N m s/rad or N s/m) of the position or velocity laws.
    pub kp: f64,
    pub kd: f64,
    /// For each actuator whose damping is given as a ratio: stiffness (N m/rad or N/m) and damping ratio.
    pub ratios: Vec<[f64; 2]>,
    /// Torque limit (N m) or force limit (N); infinite without bounds.
    pub effort: f64,
    /// Inertia (kg m^2 or kg) and damping (N m s/rad or N s/m) that the actuators add to the joint.
    pub armature: f64,
    pub damping: f64,
}

impl Default for Motor {
    fn default() -> Self {
        Self { kp: 0.0, kd: 0.0, ratios: Vec::new(), effort: f64::INFINITY, armature: 0.0, damping: 0.0 }
    }
}

/// A joint that follows another joint with position q: its position is `multiplier q + offset`.
#[derive(Clone, Debug)]
pub(super) struct Follower {
    pub leader: String,
    pub multiplier: f64,
    pub offset: f64,
}

/// A model with names for all bodies and joints.
pub(super) struct Tree<'a> {
    pub model: &'a Model,
    /// The body with a free joint.
    pub free: Option<usize>,
    pub motors: HashMap<String, Motor>,
    pub follow: HashMap<String, Follower>,
    /// Link name of each body.
    pub links: Vec<String>,
    /// Names of each body's joints.
    pub joints: Vec<Vec<String>>,
}

impl<'a> Tree<'a> {
    pub fn new(model: &'a Model) -> Result<Self, UrdfError> {
        let free = model.bodies.iter().position(|body| body.joints.iter().any(|joint| joint.kind == Kind::Free));
        let mut taken = HashSet::new();
        let mut named = |own: Option<&String>, id: usize| {
            let mut name = own.cloned().unwrap_or_else(|| if id == 0 { "world".into() } else { format!("body{id}") });
            while !taken.insert(name.clone()) {
                name += "_";
            }
            name
        };
        let links: Vec<String> =
            model.bodies.iter().enumerate().map(|(id, body)| named(body.name.as_ref(), id)).collect();
        let own = |(body, link): (&Body, &String)| {
            let joints = body.joints.iter().enumerate();
            joints.map(|(k, joint)| joint.name.clone().unwrap_or_else(|| format!("{link}.{k}"))).collect()
        };
        let joints = model.bodies.iter().zip(&links).map(own).collect();
        let tree = Self { model, free, motors: HashMap::new(), follow: HashMap::new(), links, joints };
        tree.one_robot().map(|()| tree)
    }

    /// Refuses unsupported joints, and a second robot in addition to a free one.
    fn one_robot(&self) -> Result<(), UrdfError> {
        for (id, body) in self.model.bodies.iter().enumerate() {
            let wrong = |reason: &str| Err(body.element.refused(reason));
            if body.geoms.iter().any(|geom| matches!(geom.kind, Type::Plane | Type::HeightField))
                && !self.model.still(id)
            {
                return wrong("planes and height fields stand in the world; this body moves");
            }
            for joint in &body.joints {
                if joint.lifts
                    && joint.torque_limit(&body.source.compiler).is_finite()
                    && self.model.bodies.iter().any(|b| b.weightless != 0.0)
                {
                    return wrong("actuatorgravcomp under actuatorfrcrange is not supported; leave one of the two out");
                }
                match joint.kind {
                    Kind::Free if body.joints.len() > 1 => return wrong("a free joint is the one joint of its body"),
                    Kind::Free if joint.align && self.model.bodies.iter().skip(1).all(|other| other.parent != id) => {
                        return wrong(
                            "align moves its frame to its centre of mass, which is not supported; write align=\"false\"",
                        );
                    }
                    Kind::Free if body.parent != 0 => return wrong("only a body in the world may have a free joint"),
                    Kind::Free if joint.friction != 0.0 || joint.stiffness != [0.0; 3] => {
                        return wrong(
                            "frictionloss or stiffness of its free joint, by a default class perhaps, is not 0: write <freejoint/>, which has none",
                        );
                    }
                    _ => {}
                }
            }
            let beside = self
                .free
                .is_some_and(|free| !body.joints.is_empty() && self.model.above(id).all(|above| above != free));
            if beside {
                return wrong("it moves beside a body that is free; a file has one robot here, leave out the others");
            }
        }
        Ok(())
    }

    /// Whether a body belongs to the robot. Static bodies do if the base is fixed.
    pub fn ours(&self, id: usize) -> bool {
        self.free.is_none() || !self.model.still(id)
    }

    /// Hinges and slides in the order of their coordinates: name, joint, body.
    pub fn all_joints(&self) -> impl Iterator<Item = (&String, &'a Joint, usize)> {
        let model = self.model;
        let all = self.joints.iter().zip(&model.bodies).enumerate();
        let all = all
            .flat_map(|(id, (names, body))| names.iter().zip(&body.joints).map(move |(name, joint)| (name, joint, id)));
        all.filter(|(_, joint, _)| matches!(joint.kind, Kind::Hinge | Kind::Slide))
    }

    /// The limits of a joint (rad or m); `None` if it has none, or if the file disables limits.
    pub fn limits(&self, joint: &Joint, body: usize) -> Option<[f64; 2]> {
        let off = self.model.options.is_off("limit") || self.model.options.is_off("constraint");
        joint.limits(&self.model.bodies[body].source.compiler).filter(|_| !off)
    }
}
