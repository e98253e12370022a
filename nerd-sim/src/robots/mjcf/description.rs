//! Content of a robot's file, URDF or MJCF.

use nerd_core::robot::Bodies;
use toml::{Table, Value};

use super::statics::Static;
use crate::internal::*;
use crate::scene::Surfaces;

/// A robot as described by its file: bodies, and keys of a specification.
#[derive(Clone, Debug)]
pub(crate) struct Description {
    pub bodies: Bodies,
    /// Keys of a specification that the file states; they take precedence over derived keys.
    pub keys: Table,
    pub notes: Vec<String>,
    /// Orientation of a free root in the file's default pose, x y z w.
    pub quaternion: [f64; 4],
    /// Static objects in the world; empty if the file has no world.
    pub world: Vec<Static>,
    /// Contact laws between the surfaces of geoms.
    pub surfaces: Surfaces,
}

impl Description {
    /// Whether the base is free; `None` if the file leaves the base open.
    pub fn floating(&self) -> Option<bool> {
        self.keys.get("floating").and_then(Value::as_bool)
    }

    /// The planes of the world, then planes through the highest points of its height fields.
    pub fn planes(&self) -> impl Iterator<Item = Plane> {
        let planes = self
            .world
            .iter()
            .filter_map(|solid| if let Static::Plane { plane, .. } = solid { Some(*plane) } else { None });
        let tops = self.world.iter().filter_map(|solid| {
            let Static::Field { field, pose, .. } = solid else { return None };
            let normal = pose.rotation * Vector3::z();
            Some(Plane { normal, offset: normal.dot(&pose.translation.vector) + field.highest() })
        });
        planes.chain(tops)
    }

    /// The keys, without joints that `robot` lacks since they carry no mass and became fixed.
    pub fn keys_of(&self, robot: &Robot) -> Table {
        let mut keys = self.keys.clone();
        let there =
            |joint: &Value| joint.get("name").and_then(Value::as_str).is_some_and(|name| robot.joint(name).is_ok());
        keys.get_mut("joint").and_then(Value::as_array_mut).into_iter().for_each(|joints| joints.retain(there));
        keys
    }

    /// Refuses a base, free or fixed, that differs from the base that the file states.
    pub fn stands(&self, floating: bool) -> Result<(), UrdfError> {
        match self.floating() {
            Some(own) if own != floating => {
                Err(UrdfError::Refused(format!("its MJCF has a {} base", if own { "free" } else { "fixed" })))
            }
            _ => Ok(()),
        }
    }
}
