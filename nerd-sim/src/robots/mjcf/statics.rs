//! Static objects in the world of an MJCF that may collide with the robot.

use nerd_core::robot::Solid;

use super::geom::Type;
use super::shapes::{Shapes, solid};
use super::tree::Tree;
use crate::internal::*;
use crate::scene::Field;

/// A static object in the world.
#[derive(Clone, Debug)]
pub(crate) enum Static {
    /// A plane, with the surface number of its geom.
    Plane { plane: Plane, surface: Option<usize> },
    /// A height field, with the surface number of its geom.
    Field { field: Field, pose: Isometry3<f64>, surface: Option<usize> },
    /// A solid in world axes.
    Solid(Solid),
}

/// All static objects.
pub(super) fn statics(tree: &Tree, shapes: &mut Shapes) -> Vec<Static> {
    let mut all = Vec::new();
    for (id, body) in tree.model.bodies.iter().enumerate().filter(|(id, _)| tree.model.still(*id)) {
        let place = tree.model.in_world(id);
        for (k, geom) in body.geoms.iter().enumerate() {
            let Some(surface) = shapes.number([id, k]) else { continue };
            let pose = place * geom.pose;
            let name = geom.name.as_deref().unwrap_or(&tree.links[id]);
            match geom.kind {
                Type::Plane => {
                    let normal = pose.rotation * Vector3::z();
                    let plane = Plane { normal, offset: normal.dot(&pose.translation.vector) };
                    all.push(Static::Plane { plane, surface: Some(surface) });
                }
                Type::HeightField => match geom.field.as_ref().and_then(|field| tree.model.field(field)) {
                    Some(Ok(field)) => all.push(Static::Field { field: field.clone(), pose, surface: Some(surface) }),
                    Some(Err(reason)) => shapes
                        .notes
                        .push(format!("geom `{name}` of the world touches nothing: its height field, {reason}")),
                    None => {}
                },
                Type::Sdf => {
                    shapes.notes.push(format!("geom `{name}` of the world is an sdf and touches nothing here"))
                }
                _ => match solid(geom, tree.model) {
                    Some((form, own)) => {
                        let pose = place * own;
                        all.push(Static::Solid(Solid { pose, form, surface: Some(surface) }));
                    }
                    None => shapes
                        .notes
                        .push(format!("geom `{name}` of the world touches nothing, since its mesh cannot be read")),
                },
            }
        }
    }
    all
}
