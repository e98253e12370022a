//! Converts geoms to solids: collision solids if they may collide, else visual solids.

use nerd_core::robot::{Form, Solid};

use super::geom::{Geom, Type};
use super::model::Model;
use super::tree::Tree;
use crate::internal::*;

/// Number of vertices of an ellipsoid's hull.
const ELLIPSOID_VERTICES: usize = 400;

/// The geoms that may collide, by surface number. Geoms of a body with equal contact parameters share a number.
pub(super) struct Shapes {
    /// By surface number: a body, and the indices of its geoms with this number.
    pub touching: Vec<(usize, Vec<usize>)>,
    /// Surface numbers `[body][geom]`; `None` for geoms that never collide.
    numbers: Vec<Vec<Option<usize>>>,
    pub notes: Vec<String>,
}

impl Shapes {
    /// `touches`: whether a body's geom may collide; `alike`: whether two geoms of a body have the same contact laws.
    pub fn new(
        model: &Model,
        touches: impl Fn(usize, usize) -> bool,
        alike: impl Fn(usize, [usize; 2]) -> bool,
    ) -> Self {
        let mut own = Self { touching: Vec::new(), numbers: Vec::new(), notes: Vec::new() };
        for (id, body) in model.bodies.iter().enumerate() {
            let first = own.touching.len();
            let number = |k: usize| {
                touches(id, k).then(|| {
                    let known = (first..own.touching.len()).find(|number| alike(id, [own.touching[*number].1[0], k]));
                    let number = known.unwrap_or(own.touching.len());
                    own.touching.resize_with(own.touching.len().max(number + 1), || (id, Vec::new()));
                    own.touching[number].1.push(k);
                    number
                })
            };
            let numbers = (0..body.geoms.len()).map(number).collect();
            own.numbers.push(numbers);
        }
        own
    }

    /// Surface number of a body's geom.
    pub fn number(&self, [id, k]: [usize; 2]) -> Option<usize> {
        self.numbers[id][k]
    }

    /// Collision solids and visual solids of a body; `frame` is the body frame in its link.
    pub fn of(
        &mut self,
        tree: &Tree,
        id: usize,
        frame: &Isometry3<f64>,
    ) -> Result<(Vec<Solid>, Vec<Solid>), UrdfError> {
        let mut collisions = Vec::new();
        let mut visuals = Vec::new();
        for (k, geom) in tree.model.bodies[id].geoms.iter().enumerate() {
            let surface = self.numbers[id][k];
            match solid(geom, tree.model) {
                Some((form, pose)) => {
                    let solid = Solid { pose: frame * pose, form, surface };
                    if surface.is_some() { collisions.push(solid) } else { visuals.push(solid) }
                }
                None if surface.is_none() || [Type::Plane, Type::HeightField].contains(&geom.kind) => {}
                None => self
                    .notes
                    .push(format!("link `{}`: nothing touches its geom of type {:?}", tree.links[id], geom.kind)),
            }
        }
        Ok((collisions, visuals))
    }
}

/// Form of a geom and its pose on the body; `None` for planes and height fields.
pub(super) fn solid(geom: &Geom, model: &Model) -> Option<(Form, Isometry3<f64>)> {
    let [a, b, c] = geom.size;
    let shape = match geom.kind {
        Type::Mesh => {
            let mesh = model.mesh(geom.mesh.as_ref()?)?;
            return mesh.form(&geom.pose);
        }
        Type::Sphere => ShapeKind::Sphere { radius: a },
        Type::Capsule => ShapeKind::Capsule { radius: a, half_length: b },
        Type::Cylinder => ShapeKind::Cylinder { radius: a, half_length: b },
        Type::Box => ShapeKind::Box { half: geom.size.into() },
        Type::Ellipsoid => {
            let size = Vector3::new(a, b, c);
            let vertices = crate::robots::mesh::around(ELLIPSOID_VERTICES).map(|n| n.component_mul(&size)).collect();
            return Some((Form::Hull(vertices), geom.pose));
        }
        Type::Plane | Type::HeightField | Type::Sdf => return None,
    };
    Some((Form::Shape(shape), geom.pose))
}
