//! Reads a robot's file, URDF or MJCF, into bodies and keys of a specification.

use nerd_core::robot::Bodies;

use super::contacts::{Contacts, surfaces};
use super::description::Description;
use super::drives::{followers, motors};
use super::keys::{inertias, keys};
use super::model::Model;
use super::parse::is_mjcf;
use super::shapes::Shapes;
use super::statics::statics;
use super::tree::Tree;
use crate::internal::*;
use crate::scene::GROUND;

impl Description {
    /// Parses the text of a URDF or MJCF; `path`: the file that holds the text.
    pub fn of(text: &str, path: Option<&Path>) -> Result<Self, UrdfError> {
        if !is_mjcf(text) {
            let (bodies, notes) = Bodies::from_urdf(text)?;
            let (keys, world, surfaces) = Default::default();
            return Ok(Self { bodies, keys, notes, quaternion: [0.0, 0.0, 0.0, 1.0], world, surfaces });
        }
        let model = Model::read(text, path.and_then(Path::parent).unwrap_or(Path::new(".")))?;
        let contacts = Contacts::new(&model)?;
        let mut shapes = Shapes::new(&model, |id, k| contacts.touches(id, k), |id, two| contacts.alike(id, two));
        let mut notes = model.notes.clone();
        let mut tree = Tree::new(&model)?;
        tree.follow = followers(&tree)?;
        tree.motors = motors(&tree, &mut notes)?;
        let mut bodies = tree.bodies(&mut shapes)?;
        let inertias = inertias(&tree, &bodies)?;
        for (name, joint, _) in tree.all_joints() {
            let damping = joint.spring(inertias.get(name).copied(), &model.options).1
                + tree.motors.get(name).map_or(0.0, |m| m.damping);
            bodies.joints.iter_mut().filter(|own| own.name == *name).for_each(|own| own.damping = damping);
        }
        let (mut keys, quaternion) = keys(&tree, &inertias, &mut notes)?;
        let world = statics(&tree, &mut shapes);
        if !world.is_empty() {
            keys.insert("data_scene".into(), GROUND.into());
        }
        notes.append(&mut shapes.notes);
        let surfaces = surfaces(&tree, &contacts, &shapes);
        Ok(Self { bodies, keys, notes, quaternion, world, surfaces })
    }
}
