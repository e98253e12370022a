//! Reads the sites of an MJCF.

use super::compiler::{Compiler, between};
use super::element::Element;
use super::geom::{TYPES, Type, sized};
use super::placement::Placement;
use crate::internal::*;

/// A site: a frame on a body.
#[derive(Clone, Debug)]
pub(super) struct Site {
    pub name: Option<String>,
    kind: Type,
    size: [f64; 3],
    fromto: Option<[f64; 6]>,
    pub pose: Isometry3<f64>,
}

impl Default for Site {
    fn default() -> Self {
        Self { name: None, kind: Type::Sphere, size: [0.005; 3], fromto: None, pose: Isometry3::identity() }
    }
}

impl Site {
    /// Refuses sizes and segments that MuJoCo refuses.
    pub fn check(&self, e: &Element) -> Result<(), UrdfError> {
        sized(e, self.kind, &self.size, false, self.fromto.as_ref().map(|ends| (ends, &self.pose)))
    }

    /// Applies the attributes of a site element.
    pub fn apply(&mut self, e: &Element, compiler: &Compiler) -> Result<(), UrdfError> {
        self.name = e.word("name").map(String::from);
        self.kind = e.one_of("type", &TYPES).unwrap_or(self.kind);
        e.fill("size", &mut self.size)?;
        self.fromto = e.array("fromto")?.or(self.fromto);
        compiler.pose(e, &mut self.pose)
    }

    /// Expresses the site in the frame of its body, and adds prefix and suffix to its name.
    pub fn hang(&mut self, at: &Placement) {
        self.name = self.name.take().map(|name| at.name(&name));
        self.pose = at.frame * self.fromto.take().map_or(self.pose, |ends| between(&ends).0);
    }
}
