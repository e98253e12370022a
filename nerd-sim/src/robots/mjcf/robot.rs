//! Converts the bodies of a model to links and joints; a body with several joints becomes a chain of massless links.

use nalgebra::Unit;
use nerd_core::robot::{Bodies, Body, BodyJoint, BodyJointKind, BodyMimic, FreeRoot};

use super::compiler::MIN_LENGTH;
use super::inertia::inertias;
use super::joint::{Joint, Kind};
use super::shapes::Shapes;
use super::tree::Tree;
use crate::internal::*;

/// Largest ratio (1/s) of damping to least inertia of a free root. It is the rate at which damping reduces the
/// velocity, relative to the velocity.
const MAX_ROOT_DAMPING_RATE: f64 = 50.0;

impl Tree<'_> {
    /// Bodies and joints of the robot.
    pub fn bodies(&self, shapes: &mut Shapes) -> Result<Bodies, UrdfError> {
        let model = self.model;
        let inertias = inertias(self)?;
        let free = self.free.and_then(|id| model.bodies[id].joints.first());
        let on = |flag: &str, x: f64| if model.options.is_off(flag) { 0.0 } else { x };
        let free = free.map(|joint| FreeRoot { armature: joint.armature, damping: on("damper", joint.damping[0]) });
        let mut made = Bodies { name: model.name.clone(), free: free.unwrap_or_default(), ..Bodies::default() };
        // For each body of the model: index of its body in `made`, and its frame in that body.
        let mut places: Vec<Option<(usize, Isometry3<f64>)>> = vec![None; model.bodies.len()];
        let mut soft: BTreeMap<&str, Vec<String>> = BTreeMap::new();
        for (id, body) in model.bodies.iter().enumerate().filter(|(id, _)| self.ours(*id)) {
            let above = if id == 0 { None } else { places[body.parent] };
            let on = above.map(|(host, frame)| (host, frame * body.pose));
            let frame = self.chain(id, on, &mut made, &mut soft)?;
            let own = made.bodies.len() - 1;
            places[id] = Some((own, frame));
            let new = &mut made.bodies[own];
            new.lifted = body.weightless;
            new.frame = frame;
            new.inertia = inertias[id].transformed(&frame.rotation.to_rotation_matrix(), &frame.translation.vector);
            (new.collisions, new.visuals) = shapes.of(self, id, &frame)?;
            if model.still(id) {
                // Static bodies collide as part of the world.
                let seen = std::mem::take(&mut new.collisions);
                new.visuals = if new.visuals.is_empty() { seen } else { std::mem::take(&mut new.visuals) };
            }
            self.sites(id, own, &frame, &mut made);
        }
        for (key, names) in soft {
            let others = if names.len() > 1 { format!(" and {} more", names.len() - 1) } else { String::new() };
            shapes.notes.push(format!(
                "joint `{}`{others}: `{key}` is passed over; limits and dry friction hold as those of a URDF's robot do",
                names[0]
            ));
        }
        self.damped(&inertias, made.free)?;
        Ok(made)
    }

    /// Adds the links and joints of a body; several joints become a chain of links. `on`: the link that carries the
    /// body, and the body's pose in it. Returns the body's frame in its last link.
    fn chain<'a>(
        &'a self,
        id: usize,
        mut on: Option<(usize, Isometry3<f64>)>,
        made: &mut Bodies,
        soft: &mut BTreeMap<&'a str, Vec<String>>,
    ) -> Result<Isometry3<f64>, UrdfError> {
        let body = &self.model.bodies[id];
        let hinges: Vec<_> =
            body.joints.iter().zip(&self.joints[id]).filter(|(joint, _)| joint.kind != Kind::Free).collect();
        for (k, (joint, name)) in hinges.iter().enumerate() {
            joint.soft.iter().for_each(|key| soft.entry(*key).or_default().push((*name).clone()));
            let Some((host, pose)) = on else { break };
            let last = k + 1 == hinges.len();
            let link = if last { self.links[id].clone() } else { format!("{}.{name}", self.links[id]) };
            let at = Vector3::from(joint.pos);
            made.joints.push(self.joint(joint, id, name, [host, made.bodies.len()], pose * Isometry3::from(at))?);
            made.bodies.push(bare(link));
            on = Some((made.bodies.len() - 1, Isometry3::from(-at)));
        }
        Ok(match (on, hinges.is_empty()) {
            (Some((_, frame)), false) => frame,
            (on, _) => {
                made.joints.extend(on.map(|(host, pose)| {
                    BodyJoint::fixed(format!("fixed {}", self.links[id]), [host, made.bodies.len()], pose)
                }));
                made.bodies.push(bare(self.links[id].clone()));
                Isometry3::identity()
            }
        })
    }

    /// Adds a link for each named site of a body. `frame`: frame of the body in the link `own`.
    fn sites(&self, id: usize, own: usize, frame: &Isometry3<f64>, made: &mut Bodies) {
        let body = &self.model.bodies[id];
        for (site, name) in body.sites.iter().filter_map(|site| Some((site, site.name.as_ref()?))) {
            let mut link = name.clone();
            while self.links.contains(&link) || made.bodies.iter().any(|body| body.name == link) {
                link += " site";
            }
            made.joints.push(BodyJoint::fixed(format!("fixed {link}"), [own, made.bodies.len()], frame * site.pose));
            made.bodies.push(bare(link));
        }
    }

    /// Refuses damping that stops a free root within a step.
    fn damped(&self, inertias: &[BodyInertia], free: FreeRoot) -> Result<(), UrdfError> {
        let stiff = |id: &usize| {
            let own = &inertias[*id];
            let least = (own.inertia.symmetric_eigenvalues().min().min(own.mass) + free.armature).max(0.0);
            free.damping > MAX_ROOT_DAMPING_RATE * least
        };
        match self.free.filter(stiff) {
            Some(id) => Err(self.model.bodies[id].element.refused(format!(
                "damping {} of its free joint stops it within a step, which is not supported; write a smaller one, or <freejoint/>",
                free.damping
            ))),
            None => Ok(()),
        }
    }

    /// Converts a joint; `pose`: frame of the joint in the parent body's frame, in the file's pose.
    fn joint(
        &self,
        joint: &Joint,
        id: usize,
        name: &str,
        [parent, child]: [usize; 2],
        mut pose: Isometry3<f64>,
    ) -> Result<BodyJoint, UrdfError> {
        let wrong =
            |reason: &str| self.model.bodies[id].element.refused(format!("joint `{}`: {reason}", name.escape_debug()));
        let axis =
            Unit::try_new(Vector3::from(joint.axis), MIN_LENGTH).ok_or_else(|| wrong("its axis has no direction"))?;
        let slides = joint.kind == Kind::Slide;
        let range = self.limits(joint, id);
        // The joint's coordinate equals `ref` in the file's pose, so the zero pose is turned or moved back by `ref`.
        let back = *axis * -joint.reference;
        pose *= if slides { Isometry3::from(back) } else { Isometry3::rotation(back) };
        let kind = match (slides, range) {
            (true, _) => BodyJointKind::Prismatic,
            (false, Some(_)) => BodyJointKind::Revolute,
            (false, None) => BodyJointKind::Continuous,
        };
        let options = &self.model.options;
        let on = |flag: &str, x: f64| if options.is_off(flag) { 0.0 } else { x };
        Ok(BodyJoint {
            name: name.into(),
            kind,
            parent,
            child,
            origin: pose,
            axis,
            range,
            effort: self.motors.get(name).map_or(f64::INFINITY, |motor| motor.effort),
            velocity: f64::INFINITY,
            damping: 0.0,
            friction: on("constraint", on("frictionloss", joint.friction)),
            mimic: self.follow.get(name).map(|f| BodyMimic {
                joint: f.leader.clone(),
                multiplier: f.multiplier,
                offset: f.offset,
            }),
        })
    }
}

fn bare(name: String) -> Body {
    Body {
        name,
        frame: Isometry3::identity(),
        inertia: BodyInertia::default(),
        lifted: 0.0,
        collisions: Vec::new(),
        visuals: Vec::new(),
    }
}
