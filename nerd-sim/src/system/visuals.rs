//! What a robot looks like: of each link of its file the visual shapes, or those that it touches with; of a mesh a convex hull of few corners.
//! Nothing of it moves a robot, so what cannot be read is left out.

use nerd_core::robot::Shape;
use roxmltree::{Document, Node};

#[cfg(feature = "meshes")]
use super::derive::{faces, few, vertices};
use crate::internal::*;

/// How much less far a hull may reach than its mesh, over its size.
#[cfg(feature = "meshes")]
const COARSE: f64 = 0.02;

/// A shape that is seen.
#[derive(Clone, Debug)]
pub struct Visual {
    /// The moving link that carries it; none for the base's.
    pub link: Option<usize>,
    /// In its axes, or the world's.
    pub pose: Isometry3<f64>,
    /// What it is.
    pub geometry: Geometry,
}

/// Of what form it is.
#[derive(Clone, Debug)]
pub enum Geometry {
    /// A primitive.
    Shape(ShapeKind),
    /// Corners (m) and triangles, seen from outside against the clock.
    Hull(Vec<Vector3<f64>>, Vec<[u32; 3]>),
}

impl System {
    /// What it looks like; a file's meshes are read anew. Primitives of a fixed base are in its scenes.
    pub fn visuals(&self) -> Vec<Visual> {
        let (text, path) = &self.file;
        let Ok(document) = Document::parse(text) else { return self.touching().collect() };
        let path = path.as_deref().map(|path| std::fs::canonicalize(path).unwrap_or_else(|_| path.into()));
        let (mut visuals, mut known) = (Vec::new(), BTreeMap::new());
        for link in all(&document.root_element(), "link") {
            let Ok(frame) = self.robot.frame(link.attribute("name").unwrap_or_default()) else { continue };
            let place = if frame.link.is_none() { self.robot.pose(&self.robot.zero_state(), &frame) } else { frame.pose };
            let own = ["visual", "collision"].into_iter().map(|kind| {
                let shapes = all(&link, kind).filter_map(|n| Some((place * origin(&n)?, geometry(&n, path.as_deref(), &mut known)?)));
                shapes.map(|(pose, geometry)| Visual { link: frame.link, pose, geometry }).collect::<Vec<_>>()
            });
            visuals.extend(own.into_iter().find(|own| !own.is_empty()).unwrap_or_default());
        }
        visuals.retain(|visual| visual.link.is_some() || matches!(visual.geometry, Geometry::Hull(..)));
        visuals
    }

    fn touching(&self) -> impl Iterator<Item = Visual> {
        let all = self.robot.links.iter().enumerate().flat_map(|(link, body)| body.shapes.iter().map(move |shape| (link, shape)));
        all.map(|(link, Shape { pose, kind })| Visual { link: Some(link), pose: *pose, geometry: Geometry::Shape(*kind) })
    }
}

fn all<'a, 'b>(node: &Node<'a, 'a>, name: &'b str) -> impl Iterator<Item = Node<'a, 'a>> + use<'a, 'b> {
    node.children().filter(move |n| n.tag_name().name() == name)
}

fn numbers<const N: usize>(node: &Node, key: &str) -> Option<[f64; N]> {
    let all: Vec<f64> = node.attribute(key)?.split_whitespace().filter_map(|x| x.parse().ok()).collect();
    all.try_into().ok().filter(|all: &[f64; N]| all.iter().all(|x| x.abs() < 1e6))
}

fn origin(shape: &Node<'_, '_>) -> Option<Isometry3<f64>> {
    let Some(origin) = all(shape, "origin").next() else { return Some(Isometry3::identity()) };
    let three = |key: &str| if origin.has_attribute(key) { numbers::<3>(&origin, key) } else { Some([0.0; 3]) };
    let ([x, y, z], [roll, pitch, yaw]) = (three("xyz")?, three("rpy")?);
    Some(Isometry3::from_parts([x, y, z].into(), UnitQuaternion::from_euler_angles(roll, pitch, yaw)))
}

type Known = BTreeMap<String, Option<Geometry>>;

fn geometry(shape: &Node, path: Option<&Path>, known: &mut Known) -> Option<Geometry> {
    let own = all(shape, "geometry").next()?.children().find(Node::is_element)?;
    let number = |key: &str| numbers::<1>(&own, key).map(|[x]| x).filter(|x| *x > 0.0);
    let (radius, half_length) = (number("radius"), number("length").map(|length| 0.5 * length));
    Some(Geometry::Shape(match own.tag_name().name() {
        "box" => ShapeKind::Box { half: 0.5 * Vector3::from(numbers::<3>(&own, "size")?) },
        "sphere" => ShapeKind::Sphere { radius: radius? },
        "cylinder" => ShapeKind::Cylinder { radius: radius?, half_length: half_length? },
        "capsule" => ShapeKind::Capsule { radius: radius?, half_length: half_length? },
        _ => {
            let (file, scale) = (own.attribute("filename")?, own.attribute("scale").unwrap_or("1 1 1"));
            let read = || hulled(file, numbers(&own, "scale").unwrap_or([1.0; 3]).into(), path?);
            return known.entry(format!("{scale} {file}")).or_insert_with(read).clone();
        }
    }))
}

#[cfg(feature = "meshes")]
fn hulled(file: &str, scale: Vector3<f64>, urdf: &Path) -> Option<Geometry> {
    let all = vertices(file, &scale, urdf).ok()?;
    let [low, high] = all.iter().fold([all[0]; 2], |[low, high], p| [low.inf(p), high.sup(p)]);
    let (corners, triangles) = faces(&few(&all, |_| f64::NEG_INFINITY, COARSE * (high - low).amax()))?;
    Some(Geometry::Hull(corners, triangles))
}

#[cfg(not(feature = "meshes"))]
fn hulled(_: &str, _: Vector3<f64>, _: &Path) -> Option<Geometry> {
    None
}
