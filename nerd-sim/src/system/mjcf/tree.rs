//! The bodies of an MJCF as the links and joints of a URDF. A body with several joints becomes a chain of links that weigh nothing.

use std::collections::{HashMap, HashSet};
use std::fmt::Write;

use mjcf_rs::body::{Geom, GeomType, JointType};
use mjcf_rs::{Model, body};

use super::drives::{Follower, Motor, followers, motors};
use super::inertia::{isometry, of, placed, shape};
use super::text::{Source, escape, numbers};
use crate::internal::*;

/// A link's name, and its origin in its body's frame.
struct Place {
    link: String,
    origin: Vector3<f64>,
}

/// The bodies of a model, and the URDF that is written of them.
pub(super) struct Tree<'a> {
    pub model: &'a Model,
    pub source: &'a Source,
    pub free: Option<usize>,
    pub motors: HashMap<String, Motor>,
    pub follow: HashMap<String, Follower>,
    pub urdf: String,
    pub notes: Vec<String>,
    places: Vec<Place>,
    names: Vec<Vec<String>>,
    /// Names of links.
    taken: HashSet<String>,
}

impl<'a> Tree<'a> {
    pub fn new(model: &'a Model, source: &'a Source) -> Result<Self, UrdfError> {
        let is_free = |joint: &body::Joint| joint.type_ == JointType::Free;
        let free = model.bodies.iter().position(|entry| entry.body.joints.iter().any(is_free));
        let mut places = vec![Place { link: "world".into(), origin: Vector3::zeros() }];
        let mut taken = HashSet::from(["world".to_string()]);
        for (id, entry) in model.bodies_iter() {
            let mut link = entry.body.name.clone().unwrap_or_else(|| format!("body{id}"));
            while !taken.insert(link.clone()) {
                link += "_";
            }
            places.push(Place { link, origin: entry.body.joints.last().map_or_else(Vector3::zeros, |joint| joint.pos.into()) });
        }
        let names = model.bodies.iter().zip(&places).map(|(entry, place)| {
            let joints = entry.body.joints.iter().enumerate();
            joints.map(|(k, joint)| joint.name.clone().unwrap_or_else(|| format!("{}.{k}", place.link))).collect()
        });
        let (names, mut notes) = (names.collect(), Vec::new());
        let motors = motors(model, source, &mut notes)?;
        let (follow, urdf) = (HashMap::new(), String::new());
        let mut tree = Self { model, source, free, motors, follow, urdf, notes, places, names, taken };
        let refs = tree.all_joints().map(|(name, joint)| (name.clone(), joint.ref_)).collect();
        tree.follow = followers(model, source, &refs)?;
        if let Some(unknown) = tree.motors.keys().find(|joint| !refs.contains_key(*joint)) {
            return Err(source.refused("joint", unknown, "an actuator acts on it, and it is no hinge or slide of the file"));
        }
        for (joint, most) in &source.efforts {
            let motor = tree.motors.entry(joint.clone()).or_insert(Motor { effort: f64::INFINITY, ..Motor::default() });
            motor.effort = motor.effort.min(*most);
        }
        free.map_or(Ok(()), |id| tree.check_free(id)).map(|()| tree)
    }

    fn check_free(&self, id: usize) -> Result<(), UrdfError> {
        let (entry, wrong) =
            (&self.model.bodies[id], |body: usize, reason: &str| self.source.refused("body", &self.places[body].link, reason));
        let [joint] = &entry.body.joints[..] else { return Err(wrong(id, "a free joint is the one joint of its body")) };
        if entry.parent != Some(0) {
            return Err(wrong(id, "only a body in the world may have a free joint"));
        }
        if [joint.armature, joint.damping, joint.frictionloss, joint.stiffness] != [0.0; 4] {
            return Err(wrong(
                id,
                "armature, damping, frictionloss and stiffness of its free joint, by a default class perhaps, are not 0: write `<freejoint/>`, which has none",
            ));
        }
        let beside = |k: usize| !self.model.bodies[k].body.joints.is_empty() && self.above(k).all(|above| above != id);
        match (1..self.places.len()).find(|k| beside(*k)) {
            Some(other) => Err(wrong(other, "it moves beside a body that is free; a file has one robot, leave out the others")),
            None => Ok(()),
        }
    }

    /// A body and all above it, up to the world.
    fn above(&self, id: usize) -> impl Iterator<Item = usize> {
        std::iter::successors(Some(id), |k| self.model.bodies[*k].parent)
    }

    /// Whether a body stands in the world.
    pub fn still(&self, id: usize) -> bool {
        self.above(id).all(|k| self.model.bodies[k].body.joints.is_empty())
    }

    /// Where a body is in the world, in the file's pose.
    pub fn in_world(&self, id: usize) -> Isometry3<f64> {
        self.above(id).fold(Isometry3::identity(), |pose, k| isometry(&self.model.bodies[k].body.pose) * pose)
    }

    /// Hinges and slides in the order of their coordinates, with their names.
    pub fn all_joints(&self) -> impl Iterator<Item = (&String, &'a body::Joint)> {
        let all = self.names.iter().zip(&self.model.bodies).flat_map(|(names, entry)| names.iter().zip(&entry.body.joints));
        all.filter(|(_, joint)| joint.type_ != JointType::Free)
    }

    pub fn range(&self, joint: &body::Joint) -> Option<[f64; 2]> {
        joint.range.filter(|_| joint.limited.resolve(self.model.compiler.autolimits, joint.range.is_some()))
    }

    /// The same with its URDF.
    pub fn write(mut self) -> Result<Self, UrdfError> {
        let model = self.model;
        let inertia = |(id, entry): (usize, &mjcf_rs::BodyEntry)| {
            // What stands counts where a total is set, but for the world itself.
            let counts = id > 0 && model.compiler.set_total_mass > 0.0;
            let found = if self.still(id) && !counts { Ok(BodyInertia::default()) } else { of(&entry.body, model) };
            found.map_err(|reason| self.source.refused("body", &self.places[id].link, reason))
        };
        let inertias = model.bodies.iter().enumerate().map(inertia).collect::<Result<Vec<_>, _>>()?;
        let (asked, total) = (model.compiler.set_total_mass, inertias.iter().map(|i| i.mass).sum::<f64>());
        let factor = if asked > 0.0 && total > 0.0 { asked / total } else { 1.0 };
        _ = write!(self.urdf, "<robot name=\"{}\">", escape(model.name.as_deref().unwrap_or("mjcf")));
        if self.free.is_none() {
            self.link(0, &BodyInertia::default());
        }
        for (id, entry) in model.bodies_iter() {
            // What stands beside a free robot is no part of it.
            if self.free.is_some() && self.still(id) {
                continue;
            }
            let (link, above) = (self.places[id].link.clone(), &self.places[entry.parent.unwrap_or(0)]);
            let (mut parent, mut from) = (above.link.clone(), shifted(&above.origin) * isometry(&entry.body.pose));
            let joints = &entry.body.joints;
            for (k, joint) in joints.iter().enumerate().filter(|(_, joint)| joint.type_ != JointType::Free) {
                let name = self.names[id][k].clone();
                let child = if k + 1 == joints.len() { link.clone() } else { format!("{link}.{name}") };
                let at = Vector3::from(joint.pos);
                self.joint(joint, &name, [&parent, &child], from * shifted(&-at))?;
                if child != link {
                    _ = write!(self.urdf, "<link name=\"{}\"/>", escape(&child));
                }
                (parent, from) = (child, shifted(&at));
            }
            if joints.is_empty() {
                self.fixed(&link, &parent, &from);
            }
            let (body, origin) = (inertias[id], self.places[id].origin);
            self.link(id, &BodyInertia { mass: body.mass * factor, com: body.com - origin, inertia: body.inertia * factor });
        }
        self.urdf += "</robot>";
        Ok(self)
    }

    fn fixed(&mut self, link: &str, parent: &str, pose: &Isometry3<f64>) {
        let (link, parent) = (escape(link), escape(parent));
        _ = write!(
            self.urdf,
            "<joint name=\"fixed {link}\" type=\"fixed\">{}<parent link=\"{parent}\"/><child link=\"{link}\"/></joint>",
            origin(pose)
        );
    }

    /// `pose` is the body's frame at the joint, in that of `parent`.
    fn joint(&mut self, joint: &body::Joint, name: &str, [parent, child]: [&String; 2], mut pose: Isometry3<f64>) -> Result<(), UrdfError> {
        let wrong = |reason: &str| self.source.refused("joint", name, reason);
        let axis = nalgebra::Unit::try_new(Vector3::from(joint.axis), 1e-9).ok_or_else(|| wrong("its axis has no direction"))?;
        if !(joint.damping >= 0.0 && joint.frictionloss >= 0.0 && joint.armature >= 0.0 && joint.stiffness >= 0.0) {
            return Err(wrong("damping, frictionloss, armature or stiffness is negative"));
        }
        let (slides, range) = (joint.type_ == JointType::Slide, self.range(joint));
        // MuJoCo's own coordinate is `ref` in the file's pose.
        let back = *axis * -joint.ref_;
        pose *= if slides { shifted(&-back) } else { Isometry3::rotation(back) };
        let kind = match (slides, range) {
            (true, _) => "prismatic",
            (false, Some(_)) => "revolute",
            (false, None) => "continuous",
        };
        let [lower, upper] = range.unwrap_or([f64::NEG_INFINITY, f64::INFINITY]);
        _ = write!(
            self.urdf,
            "<joint name=\"{}\" type=\"{kind}\">{}<parent link=\"{}\"/><child link=\"{}\"/><axis xyz=\"{}\"/>\
             <limit lower=\"{lower}\" upper=\"{upper}\" effort=\"{}\" velocity=\"inf\"/><dynamics damping=\"{}\" friction=\"{}\"/>",
            escape(name),
            origin(&pose),
            escape(parent),
            escape(child),
            numbers(axis.as_slice()),
            self.motors.get(name).map_or(f64::INFINITY, |motor| motor.effort),
            joint.damping,
            joint.frictionloss,
        );
        if let Some(Follower { leader, multiplier, offset }) = self.follow.get(name) {
            _ = write!(self.urdf, "<mimic joint=\"{}\" multiplier=\"{multiplier}\" offset=\"{offset}\"/>", escape(leader));
        }
        self.urdf += "</joint>";
        Ok(())
    }

    /// A body's link with its shapes, and its sites as links on fixed joints.
    fn link(&mut self, id: usize, inertia: &BodyInertia) {
        let (body, model) = (&self.model.bodies[id].body, self.model);
        let (name, from) = (self.places[id].link.clone(), shifted(&self.places[id].origin));
        _ = write!(self.urdf, "<link name=\"{}\">", escape(&name));
        let BodyInertia { mass, com, inertia: i } = inertia;
        if *mass > 0.0 || i.amax() > 0.0 {
            let moments = ["ixx", "ixy", "ixz", "iyy", "iyz", "izz"].into_iter().zip([(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]);
            let moments: String = moments.map(|(key, k)| format!(" {key}=\"{}\"", i[k])).collect();
            let com = numbers(com.as_slice());
            _ = write!(self.urdf, "<inertial><origin xyz=\"{com}\"/><mass value=\"{mass}\"/><inertia{moments}/></inertial>");
        }
        for geom in body.geoms.iter().filter(|geom| geom.type_ != GeomType::Plane) {
            let kind = if touches(geom, model) { "collision" } else { "visual" };
            match geometry(geom, model) {
                Some((geometry, pose)) => {
                    _ = write!(self.urdf, "<{kind}>{}<geometry>{geometry}</geometry></{kind}>", origin(&(from * pose)));
                }
                None if kind == "visual" => {}
                None => self
                    .notes
                    .push(format!("link `{name}`: nothing touches its geom of type {}", format!("{:?}", geom.type_).to_lowercase())),
            }
        }
        self.urdf += "</link>";
        for (site, own) in body.sites.iter().filter_map(|site| Some((site, site.name.as_ref()?))) {
            let mut link = own.clone();
            while !self.taken.insert(link.clone()) {
                link += " site";
            }
            _ = write!(self.urdf, "<link name=\"{}\"/>", escape(&link));
            self.fixed(&link, &name, &(from * isometry(&site.pose)));
        }
    }
}

/// Into a frame with its origin there.
fn shifted(origin: &Vector3<f64>) -> Isometry3<f64> {
    Isometry3::translation(-origin.x, -origin.y, -origin.z)
}

pub(super) fn touches(geom: &Geom, model: &Model) -> bool {
    let paired = |name: &String| model.contact.pairs.iter().any(|pair| [&pair.geom1, &pair.geom2].contains(&name));
    geom.contype != 0 || geom.conaffinity != 0 || geom.name.as_ref().is_some_and(paired)
}

/// The geometry of a URDF's collision or visual, and where it is on its body.
fn geometry(geom: &Geom, model: &Model) -> Option<(String, Isometry3<f64>)> {
    let pose = placed(geom).0;
    if geom.type_ == GeomType::Mesh {
        let mesh = model.assets.mesh(geom.mesh.as_ref()?)?;
        let file = model.resolve_mesh_file(mesh, Path::new(""))?;
        let (file, scale) = (escape(&file.to_string_lossy()), numbers(&mesh.scale));
        return Some((format!("<mesh filename=\"{file}\" scale=\"{scale}\"/>"), pose * isometry(&mesh.refpose).inverse()));
    }
    let text = match shape(geom).filter(|_| geom.mesh.is_none())? {
        ShapeKind::Sphere { radius } => format!("<sphere radius=\"{radius}\"/>"),
        ShapeKind::Box { half } => format!("<box size=\"{}\"/>", numbers((half * 2.0).as_slice())),
        ShapeKind::Cylinder { radius, half_length } => format!("<cylinder radius=\"{radius}\" length=\"{}\"/>", 2.0 * half_length),
        ShapeKind::Capsule { radius, half_length } => format!("<capsule radius=\"{radius}\" length=\"{}\"/>", 2.0 * half_length),
    };
    Some((text, pose))
}

fn origin(pose: &Isometry3<f64>) -> String {
    format!("<origin xyz=\"{}\" rpy=\"{}\"/>", numbers(pose.translation.vector.as_slice()), numbers(&angles(&pose.rotation)))
}

/// Roll, pitch and yaw, as exact near a pitch of a quarter turn as elsewhere.
pub(super) fn angles(turn: &UnitQuaternion<f64>) -> [f64; 3] {
    let m = turn.to_rotation_matrix();
    let yaw = m[(1, 0)].atan2(m[(0, 0)]);
    let (s, c) = yaw.sin_cos();
    let pitch = (-m[(2, 0)]).atan2(c * m[(0, 0)] + s * m[(1, 0)]);
    [(s * m[(0, 2)] - c * m[(1, 2)]).atan2(c * m[(1, 1)] - s * m[(0, 1)]), pitch, yaw]
}
