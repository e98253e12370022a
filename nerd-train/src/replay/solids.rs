//! Shapes of a robot's links and of its scene, for replays.

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Quaternion, Translation3};
use nerd_core::robot::ShapeKind;
use nerd_sim::system::{Geometry, Source};

use crate::prelude::*;

/// Radius of a bone relative to its length. A bone is a capsule, drawn for a link without visual shapes.
const BONE_RADIUS: f64 = 0.08;
/// Hue of a cable (degrees).
const CABLE_HUE: f64 = 20.0;

/// Vertices (m), and triangles as indices of vertices.
pub type Surface = (Vec<[f32; 3]>, Vec<[u32; 3]>);

/// A shape on a link, or in the scene.
#[derive(Clone, Debug, Serialize)]
pub struct Solid {
    /// Index of the link that the shape is fixed to; `None` for a shape of the scene.
    pub link: Option<usize>,
    /// Hue of the shape (degrees).
    pub hue: f64,
    /// Pose in the link's axes, or in world axes for a scene's shape: position (m), then quaternion x y z w.
    pub pose: [f32; 7],
    /// `box`, `sphere`, `cylinder` or `capsule` (along z), or `hull`.
    pub kind: &'static str,
    /// Half edges (m) of a box or of a hull's bounding box. Otherwise radius and half length (m); a sphere's half
    /// length is 0.
    pub size: Vec<f64>,
    /// Surface of a hull about the centre of its bounding box; triangles are counter-clockwise from outside.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hull: Option<Surface>,
}

impl Solid {
    fn new(link: Option<usize>, pose: &Isometry3<f64>, kind: &'static str, size: Vec<f64>) -> Self {
        Self { link, hue: hue(link.unwrap_or_default()), pose: numbers(pose), kind, size, hull: None }
    }

    fn primitive(link: Option<usize>, pose: &Isometry3<f64>, kind: ShapeKind) -> Self {
        let (kind, size) = match kind {
            ShapeKind::Sphere { radius } => ("sphere", vec![radius, 0.0]),
            ShapeKind::Box { half } => ("box", half.as_slice().to_vec()),
            ShapeKind::Cylinder { radius, half_length } => ("cylinder", vec![radius, half_length]),
            ShapeKind::Capsule { radius, half_length } => ("capsule", vec![radius, half_length]),
        };
        Self::new(link, pose, kind, size)
    }
}

/// Visual shapes of the links. A link without any gets bones.
pub(super) fn solids(system: &System) -> Vec<Solid> {
    let mut all: Vec<_> = system
        .visuals()
        .into_iter()
        .map(|visual| match visual.geometry {
            Geometry::Shape(kind) => Solid::primitive(visual.link, &visual.pose, kind),
            Geometry::Hull(corners, triangles) => {
                let [low, high] = corners.iter().fold([corners[0]; 2], |[low, high], p| [low.inf(p), high.sup(p)]);
                let middle = 0.5 * (low + high);
                let half = 0.5 * (high - low);
                let pose = visual.pose * Translation3::from(middle);
                let corners = corners.iter().map(|p| (p - middle).data.0[0].map(rounded)).collect();
                let solid = Solid::new(visual.link, &pose, "hull", half.as_slice().to_vec());
                Solid { hull: Some((corners, triangles)), ..solid }
            }
        })
        .collect();
    let bones = bones(system, &all);
    all.extend(bones);
    all
}

/// Shape of a scene's collider; `None` unless it is a sphere, a box or a cylinder.
pub(super) fn scene_solid(collider: &Collider) -> Option<Solid> {
    let shape = &collider.shape;
    let (kind, pose) = if let Some(ball) = shape.as_ball() {
        (ShapeKind::Sphere { radius: ball.radius }, collider.pose)
    } else if let Some(cuboid) = shape.as_cuboid() {
        let half = cuboid.half_extents;
        (ShapeKind::Box { half: Vector3::new(half.x, half.y, half.z) }, collider.pose)
    } else {
        let cylinder = shape.as_cylinder()?;
        // Parry's cylinders lie along y, a solid's along z.
        let z_to_y = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), FRAC_PI_2);
        let kind = ShapeKind::Cylinder { radius: cylinder.radius, half_length: cylinder.half_height };
        (kind, collider.pose * z_to_y)
    };
    Some(Solid::primitive(None, &pose, kind))
}

/// Bones for the links without a shape in `visuals`. A link's bones start at its joint; they end at its children's
/// joints and at the mean of its contact points. A link without such ends gets a cube of its mass and inertia.
fn bones(system: &System, visuals: &[Solid]) -> Vec<Solid> {
    let robot = &system.robot;
    let cable = system.source == Source::Cable;
    let bare = (0..robot.links.len()).filter(|link| visuals.iter().all(|solid| solid.link != Some(*link)));
    // Ends (m) of a link's bones in the link's axes, at least a millimetre from its joint.
    let ends = |link: usize| {
        let children = robot.links.iter().filter(move |child| child.parent == Some(link));
        let joints = children.filter_map(|child| Some(child.joint.as_ref()?.origin().translation.vector));
        let points = robot.contact_points.iter().filter(|p| p.link == link).map(|p| p.local);
        let points: Vec<Vector3<f64>> = points.filter(|p| p.norm() > 1e-3).collect();
        let middle = points.iter().sum::<Vector3<f64>>() / points.len().max(1) as f64;
        let mut ends: Vec<_> =
            joints.chain((!points.is_empty()).then_some(middle)).filter(|end| end.norm() > 1e-3).collect();
        ends.dedup_by(|a, b| (*a - *b).norm() < 1e-6);
        ends
    };
    let bone = |link: usize, end: Vector3<f64>| {
        let pose = Isometry3::from_parts((0.5 * end).into(), rotation_from(&Vector3::z_axis(), &end));
        // A cable has the radius of its contact points, and one hue.
        let cable_radius = robot.contact_points.iter().find(|p| cable && p.link == link).map(|p| p.radius);
        let radius = cable_radius.unwrap_or(BONE_RADIUS * end.norm());
        let hue = if cable { CABLE_HUE } else { hue(link) };
        Solid { hue, ..Solid::new(Some(link), &pose, "capsule", vec![radius, 0.5 * end.norm()]) }
    };
    let cube = |link: usize| {
        let inertia = &robot.links[link].inertia;
        let half = (0.5 * inertia.inertia.trace() / inertia.mass).sqrt();
        let pose = Isometry3::from_parts(inertia.com.into(), UnitQuaternion::identity());
        (inertia.mass > 0.0 && half > 1e-3).then(|| Solid::new(Some(link), &pose, "box", vec![half; 3]))
    };
    let bones_or_cube = |link: usize| match &ends(link)[..] {
        [] => cube(link).into_iter().collect(),
        ends => ends.iter().map(|end| bone(link, *end)).collect_vec(),
    };
    bare.flat_map(bones_or_cube).collect()
}

/// Hue of a link (degrees); neighbouring links get distant hues.
fn hue(link: usize) -> f64 {
    (210.0 + 137.5 * link as f64) % 360.0
}

/// A pose as rounded numbers: position (m), then quaternion x y z w.
pub(super) fn numbers(pose: &Isometry3<f64>) -> [f32; 7] {
    let p = pose.translation.vector;
    let q = pose.rotation.coords;
    [p.x, p.y, p.z, q.x, q.y, q.z, q.w].map(rounded)
}

/// Rounds to 1e-4: a position (m) changes by less than a pixel.
pub(super) fn rounded(x: f64) -> f32 {
    ((x * 1e4).round() / 1e4) as f32
}

/// Inverse of [`numbers`].
pub(super) fn isometry(pose: &[f32; 7]) -> Isometry3<f64> {
    let [x, y, z, i, j, k, w] = pose.map(f64::from);
    Isometry3::from_parts(Translation3::new(x, y, z), UnitQuaternion::from_quaternion(Quaternion::new(w, i, j, k)))
}
