//! Shapes of a robot's links and of its scene, for replays.

use std::f64::consts::{FRAC_PI_2, PI};

use nalgebra::{Quaternion, Translation3};
use nerd_core::robot::ShapeKind;
use nerd_sim::system::Source;

use crate::prelude::*;

/// Radius of a bone over its length.
const THICK: f64 = 0.08;
/// Colour of a cable, all of it (degrees).
const CABLE: f64 = 20.0;

/// A shape on a link, or in the scene.
#[derive(Clone, Debug, Serialize)]
pub struct Solid {
    /// The link it is fixed on; none for the scene's.
    pub link: Option<usize>,
    /// Its colour (degrees).
    pub hue: f64,
    /// Where on the link, or in the world.
    pub pose: [f32; 7],
    /// `box`, `sphere`, `cylinder` or `capsule`, along z.
    pub kind: &'static str,
    /// Box: half edges; else radius and half length.
    pub size: Vec<f64>,
}

/// The links' shapes, or substitutes.
pub(super) fn solids(system: &System) -> impl Iterator<Item = Solid> {
    let all = system.robot.links.iter().enumerate().flat_map(|(link, body)| body.shapes.iter().map(move |shape| (link, shape)));
    all.map(|(link, shape)| {
        let (kind, size) = match shape.kind {
            ShapeKind::Sphere { radius } => ("sphere", vec![radius, 0.0]),
            ShapeKind::Box { half } => ("box", half.iter().copied().collect()),
            ShapeKind::Cylinder { radius, half_length } => ("cylinder", vec![radius, half_length]),
            ShapeKind::Capsule { radius, half_length } => ("capsule", vec![radius, half_length]),
        };
        Solid { link: Some(link), hue: hue(link), pose: numbers(&shape.pose), kind, size }
    })
    .chain(bones(system))
}

/// The scene's shapes other than planes and meshes.
pub(super) fn standing(body: &Collider) -> Option<Solid> {
    // Parry's round shapes lie along y.
    let turned = body.pose * UnitQuaternion::from_axis_angle(&Vector3::x_axis(), FRAC_PI_2);
    let shape = &body.shape;
    let (kind, pose, size) = if let Some(ball) = shape.as_ball() {
        ("sphere", body.pose, vec![ball.radius, 0.0])
    } else if let Some(cuboid) = shape.as_cuboid() {
        ("box", body.pose, vec![cuboid.half_extents.x, cuboid.half_extents.y, cuboid.half_extents.z])
    } else {
        let cylinder = shape.as_cylinder()?;
        ("cylinder", turned, vec![cylinder.radius, cylinder.half_height])
    };
    Some(Solid { link: None, hue: hue(0), pose: numbers(&pose), kind, size })
}

/// Of links whose shapes are meshes or that have none: from their joint to the next ones, and to what they touch with. Where there is
/// neither, a cube of the link's inertia.
fn bones(system: &System) -> Vec<Solid> {
    let (robot, cable) = (&system.robot, system.source == Source::Cable);
    let bare = robot.links.iter().enumerate().filter(|(_, body)| body.shapes.is_empty());
    let ends = |link: usize| {
        let next = robot.links.iter().filter(move |child| child.parent == Some(link));
        let next = next.filter_map(|child| Some(child.joint.as_ref()?.origin().translation.vector));
        let own = robot.contact_points.iter().filter(|p| p.link == link).map(|p| p.local);
        let own: Vec<Vector3<f64>> = own.filter(|p| p.norm() > 1e-3).collect();
        let middle = own.iter().sum::<Vector3<f64>>() / own.len().max(1) as f64;
        let mut ends: Vec<_> = next.chain((!own.is_empty()).then_some(middle)).filter(|end| end.norm() > 1e-3).collect();
        ends.dedup_by(|a, b| (*a - *b).norm() < 1e-6);
        ends
    };
    let bone = |link: usize, end: Vector3<f64>| {
        let turn = UnitQuaternion::rotation_between(&Vector3::z(), &end)
            .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI));
        let pose = Isometry3::from_parts((0.5 * end).into(), turn);
        // A cable is as thick as what it touches with, and of one colour.
        let round = robot.contact_points.iter().find(|p| cable && p.link == link).map(|p| p.radius);
        let (radius, hue) = (round.unwrap_or(THICK * end.norm()), if cable { CABLE } else { hue(link) });
        Solid { link: Some(link), hue, pose: numbers(&pose), kind: "capsule", size: vec![radius, 0.5 * end.norm()] }
    };
    let lump = |link: usize| {
        let inertia = &robot.links[link].inertia;
        let half = (0.5 * inertia.inertia.trace() / inertia.mass).sqrt();
        let pose = numbers(&Isometry3::from_parts(inertia.com.into(), UnitQuaternion::identity()));
        (inertia.mass > 0.0 && half > 1e-3).then(|| Solid { link: Some(link), hue: hue(link), pose, kind: "box", size: vec![half; 3] })
    };
    let of = |link: usize| match &ends(link)[..] {
        [] => lump(link).into_iter().collect(),
        ends => ends.iter().map(|end| bone(link, *end)).collect::<Vec<_>>(),
    };
    bare.flat_map(|(link, _)| of(link)).collect()
}

/// Colour of a link (degrees): those of neighbours are far apart.
fn hue(link: usize) -> f64 {
    (210.0 + 137.5 * link as f64) % 360.0
}

/// Position, then quaternion x y z w.
pub(super) fn numbers(pose: &Isometry3<f64>) -> [f32; 7] {
    let (p, q) = (pose.translation.vector, pose.rotation.coords);
    [p.x, p.y, p.z, q.x, q.y, q.z, q.w].map(rounded)
}

/// A tenth of a millimetre is more than a pixel shows.
pub(super) fn rounded(x: f64) -> f32 {
    ((x * 1e4).round() / 1e4) as f32
}

/// What [`numbers`] wrote.
pub(super) fn isometry(pose: &[f32; 7]) -> Isometry3<f64> {
    let [x, y, z, i, j, k, w] = pose.map(f64::from);
    Isometry3::from_parts(Translation3::new(x, y, z), UnitQuaternion::from_quaternion(Quaternion::new(w, i, j, k)))
}
