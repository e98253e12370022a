//! Shapes of a robot's links and of its scene, for replays.

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Quaternion, Translation3};
use nerd_core::robot::ShapeKind;
use nerd_sim::system::{Geometry, Source};

use crate::prelude::*;

/// Radius of a bone (a capsule in place of a bare link), relative to its length.
const THICK: f64 = 0.08;
/// Hue of a cable (degrees).
const CABLE: f64 = 20.0;

/// Vertices and triangles.
pub type Surface = (Vec<[f32; 3]>, Vec<[u32; 3]>);

/// A shape on a link, or in the scene.
#[derive(Clone, Debug, Serialize)]
pub struct Solid {
    /// The link that the shape is fixed on; none in the scene.
    pub link: Option<usize>,
    /// Hue (degrees).
    pub hue: f64,
    /// Pose on the link, or in the world.
    pub pose: [f32; 7],
    /// `box`, `sphere`, `cylinder` or `capsule` (along z), or `hull`.
    pub kind: &'static str,
    /// Half edges of a box or of a hull's bounding box; else radius and half length.
    pub size: Vec<f64>,
    /// Vertices (m) and triangles of a hull, counter-clockwise from outside.
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

/// Visual shapes of the links, or bones in their place.
pub(super) fn solids(system: &System) -> Vec<Solid> {
    let mut all: Vec<_> = system
        .visuals()
        .into_iter()
        .map(|own| match own.geometry {
            Geometry::Shape(kind) => Solid::primitive(own.link, &own.pose, kind),
            Geometry::Hull(corners, triangles) => {
                let [low, high] = corners.iter().fold([corners[0]; 2], |[low, high], p| [low.inf(p), high.sup(p)]);
                let middle = 0.5 * (low + high);
                let corners = corners.iter().map(|p| (p - middle).data.0[0].map(rounded)).collect();
                let around = Solid::new(
                    own.link,
                    &(own.pose * Translation3::from(middle)),
                    "hull",
                    (0.5 * (high - low)).as_slice().to_vec(),
                );
                Solid { hull: Some((corners, triangles)), ..around }
            }
        })
        .collect();
    let bones = bones(system, &all);
    all.extend(bones);
    all
}

/// The scene's shapes other than planes and meshes.
pub(super) fn standing(body: &Collider) -> Option<Solid> {
    // Parry's cylinders lie along y.
    let turned = body.pose * UnitQuaternion::from_axis_angle(&Vector3::x_axis(), FRAC_PI_2);
    let shape = &body.shape;
    let (kind, pose) = if let Some(ball) = shape.as_ball() {
        (ShapeKind::Sphere { radius: ball.radius }, body.pose)
    } else if let Some(cuboid) = shape.as_cuboid() {
        let half = cuboid.half_extents;
        (ShapeKind::Box { half: Vector3::new(half.x, half.y, half.z) }, body.pose)
    } else {
        let cylinder = shape.as_cylinder()?;
        (ShapeKind::Cylinder { radius: cylinder.radius, half_length: cylinder.half_height }, turned)
    };
    Some(Solid::primitive(None, &pose, kind))
}

/// Bones for links without visuals: from a link's joint to the joints of its children, and to the mean of its contact
/// points. Without either, a cube with the link's inertia.
fn bones(system: &System, seen: &[Solid]) -> Vec<Solid> {
    let (robot, cable) = (&system.robot, system.source == Source::Cable);
    let bare = (0..robot.links.len()).filter(|link| seen.iter().all(|solid| solid.link != Some(*link)));
    let ends = |link: usize| {
        let next = robot.links.iter().filter(move |child| child.parent == Some(link));
        let next = next.filter_map(|child| Some(child.joint.as_ref()?.origin().translation.vector));
        let own = robot.contact_points.iter().filter(|p| p.link == link).map(|p| p.local);
        let own = own.filter(|p| p.norm() > 1e-3).collect_vec();
        let middle = own.iter().sum::<Vector3<f64>>() / own.len().max(1) as f64;
        let mut ends = next.chain((!own.is_empty()).then_some(middle)).filter(|end| end.norm() > 1e-3).collect_vec();
        ends.dedup_by(|a, b| (*a - *b).norm() < 1e-6);
        ends
    };
    let bone = |link: usize, end: Vector3<f64>| {
        let pose = Isometry3::from_parts((0.5 * end).into(), rotation_from(&Vector3::z_axis(), &end));
        // A cable has the radius of its contact points, and one colour.
        let round = robot.contact_points.iter().find(|p| cable && p.link == link).map(|p| p.radius);
        let (radius, hue) = (round.unwrap_or(THICK * end.norm()), if cable { CABLE } else { hue(link) });
        Solid { hue, ..Solid::new(Some(link), &pose, "capsule", vec![radius, 0.5 * end.norm()]) }
    };
    let lump = |link: usize| {
        let inertia = &robot.links[link].inertia;
        let half = (0.5 * inertia.inertia.trace() / inertia.mass).sqrt();
        let pose = Isometry3::from_parts(inertia.com.into(), UnitQuaternion::identity());
        (inertia.mass > 0.0 && half > 1e-3).then(|| Solid::new(Some(link), &pose, "box", vec![half; 3]))
    };
    let of = |link: usize| match &ends(link)[..] {
        [] => lump(link).into_iter().collect(),
        ends => ends.iter().map(|end| bone(link, *end)).collect_vec(),
    };
    bare.flat_map(of).collect()
}

/// Hue of a link (degrees); neighbouring links get distant hues.
fn hue(link: usize) -> f64 {
    (210.0 + 137.5 * link as f64) % 360.0
}

/// Position, then quaternion x y z w.
pub(super) fn numbers(pose: &Isometry3<f64>) -> [f32; 7] {
    let (p, q) = (pose.translation.vector, pose.rotation.coords);
    [p.x, p.y, p.z, q.x, q.y, q.z, q.w].map(rounded)
}

/// Rounds to a tenth of a millimetre, less than a pixel.
pub(super) fn rounded(x: f64) -> f32 {
    ((x * 1e4).round() / 1e4) as f32
}

/// The pose from [`numbers`].
pub(super) fn isometry(pose: &[f32; 7]) -> Isometry3<f64> {
    let [x, y, z, i, j, k, w] = pose.map(f64::from);
    Isometry3::from_parts(Translation3::new(x, y, z), UnitQuaternion::from_quaternion(Quaternion::new(w, i, j, k)))
}
