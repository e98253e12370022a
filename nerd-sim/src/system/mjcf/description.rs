//! What a robot's file says.

use std::borrow::Cow;

use toml::{Table, Value};

use crate::internal::*;

/// What a file says of a robot: all of it a URDF, but for what keys of a specification say.
pub(crate) struct Description<'a> {
    pub urdf: Cow<'a, str>,
    /// Keys that take precedence over what is derived.
    pub keys: Table,
    pub notes: Vec<String>,
    /// How a free root is turned in the file's pose, x y z w.
    pub quaternion: [f64; 4],
    /// Height of the file's ground along the up axis (m).
    pub floor: f64,
    pub friction: Option<f64>,
}

impl Description<'_> {
    /// Whether its base is free, where the file says so.
    pub fn floating(&self) -> Option<bool> {
        self.keys.get("floating").and_then(Value::as_bool)
    }

    /// Its keys without joints that the robot does not have: those that carry no mass are fixed.
    pub fn keys_of(&self, robot: &Robot) -> Table {
        let mut keys = self.keys.clone();
        let there = |joint: &Value| joint.get("name").and_then(Value::as_str).is_some_and(|name| robot.joint(name).is_ok());
        keys.get_mut("joint").and_then(Value::as_array_mut).into_iter().for_each(|joints| joints.retain(there));
        keys
    }

    /// Refuses a base that the file does not have.
    pub fn stands(&self, floating: bool) -> Result<(), UrdfError> {
        match self.floating() {
            Some(own) if own != floating => Err(UrdfError::Refused(format!("its MJCF has a {} base", if own { "free" } else { "fixed" }))),
            _ => Ok(()),
        }
    }
}
