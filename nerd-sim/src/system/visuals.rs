//! Visual shapes of a robot: for each link of its file the visual shapes, else the collision shapes. A mesh becomes a
//! convex hull with few vertices. Visual shapes do not affect motion, so unreadable ones are left out.

use nerd_core::robot::{Form, Shape, Solid};

use crate::internal::*;
use crate::robots::derive::vertices;
use crate::robots::mesh::hull::{bounds, faces, few};

/// Largest loss of a hull's support function against its mesh, relative to the mesh's size.
const MAX_SUPPORT_LOSS: f64 = 0.02;

/// A visual shape.
#[derive(Clone, Debug)]
pub struct Visual {
    /// The moving link that carries the shape; `None` for the base.
    pub link: Option<usize>,
    /// Pose in the link frame, or in the world for the base.
    pub pose: Isometry3<f64>,
    /// Form and size.
    pub geometry: Geometry,
}

/// Form of a visual shape.
#[derive(Clone, Debug)]
pub enum Geometry {
    /// A primitive.
    Shape(ShapeKind),
    /// Vertices (m) and triangles, counter-clockwise seen from outside.
    Hull(Vec<Vector3<f64>>, Vec<[u32; 3]>),
}

impl System {
    /// Visual shapes of the robot; meshes are read from their files again. Primitives of a fixed base are left out,
    /// since the scenes contain them.
    pub fn visuals(&self) -> Vec<Visual> {
        let (file, path) = &self.file;
        if file.bodies.is_empty() {
            return self.touching().collect();
        }
        let path = path.as_deref().map(|path| std::fs::canonicalize(path).unwrap_or_else(|_| path.into()));
        let mut visuals = Vec::new();
        let mut known = BTreeMap::new();
        for body in &file.bodies {
            let Ok(frame) = self.robot.frame(&body.name) else { continue };
            let place =
                if frame.link.is_none() { self.robot.pose(&self.robot.zero_state(), &frame) } else { frame.pose };
            let place = place * body.frame.inverse();
            let own = [&body.visuals, &body.collisions].into_iter().map(|solids| {
                let seen = |solid: &Solid| {
                    let geometry = geometry(&solid.form, path.as_deref(), &mut known)?;
                    Some(Visual { link: frame.link, pose: place * solid.pose, geometry })
                };
                solids.iter().filter_map(seen).collect::<Vec<_>>()
            });
            visuals.extend(own.into_iter().find(|own| !own.is_empty()).unwrap_or_default());
        }
        visuals.retain(|visual| visual.link.is_some() || matches!(visual.geometry, Geometry::Hull(..)));
        visuals
    }

    fn touching(&self) -> impl Iterator<Item = Visual> {
        let all = self
            .robot
            .links
            .iter()
            .enumerate()
            .flat_map(|(link, body)| body.shapes.iter().map(move |shape| (link, shape)));
        all.map(|(link, Shape { pose, kind, .. })| Visual {
            link: Some(link),
            pose: *pose,
            geometry: Geometry::Shape(*kind),
        })
    }
}

type Known = BTreeMap<String, Option<Geometry>>;

fn geometry(form: &Form, path: Option<&Path>, known: &mut Known) -> Option<Geometry> {
    match form {
        Form::Shape(ShapeKind::Sphere { radius }) if *radius == 0.0 => None,
        Form::Shape(kind) => Some(Geometry::Shape(*kind)),
        Form::Mesh { file, scale } => {
            let read = || hulled(&vertices(file, scale, path?).ok()?);
            known.entry(format!("{scale:?} {file}")).or_insert_with(read).clone()
        }
        Form::Hull(vertices) => hulled(vertices),
    }
}

fn hulled(all: &[Vector3<f64>]) -> Option<Geometry> {
    let [low, high] = bounds(all)?;
    let (corners, triangles) = faces(&few(all, |_| f64::NEG_INFINITY, MAX_SUPPORT_LOSS * (high - low).amax()))?;
    Some(Geometry::Hull(corners, triangles))
}
