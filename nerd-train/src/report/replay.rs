//! Motions as pages that any browser plays: poses of links by frame, the shapes that stand on them, and a small painter's
//! renderer (`assets/replay.js`) that turns them with the mouse. Several tracks of one robot lie over each other, the truth as a
//! ghost behind a learned one. A page loads nothing.

use std::f64::consts::PI;

use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use nerd_core::dynamics::{Data, kinematics, link_pose};
use nerd_core::robot::{Robot, ShapeKind};
use nerd_sim::batch::Batch;
use nerd_sim::scene::Scene;
use serde::Serialize;

/// Radius of a bone over its length.
const THICK: f64 = 0.08;
/// The renderer: a function `replay(element, data)`.
pub const SCRIPT: &str = include_str!("../../assets/replay.js");
const PAGE: &str = include_str!("../../assets/replay.html");

/// What is shown. Lengths in m; a pose is position, then quaternion x y z w, in world axes.
#[derive(Clone, Debug, Serialize)]
pub struct Replay {
    /// Over the picture.
    pub title: String,
    /// Seconds from frame to frame.
    pub dt: f64,
    /// Against gravity.
    pub up: [f64; 3],
    /// Normals and offsets of the scene's planes.
    pub planes: Vec<([f64; 3], f64)>,
    /// What stands on links.
    pub shapes: Vec<Solid>,
    /// Links whose origins a rod joins, since not every robot has a shape for each.
    pub rods: Vec<[usize; 2]>,
    /// Motions: the first is solid, the others are ghosts.
    pub tracks: Vec<Track>,
    /// Goal by frame, if there is one (m).
    pub goals: Vec<Vec<f32>>,
    /// Reward so far by frame, if there is one.
    pub rewards: Vec<f32>,
}

/// One motion.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Track {
    /// What moves so.
    pub name: String,
    /// Poses by frame and link.
    pub poses: Vec<Vec<[f32; 7]>>,
}

/// A shape on a link.
#[derive(Clone, Debug, Serialize)]
pub struct Solid {
    /// The link it is fixed on.
    pub link: usize,
    /// Where on it.
    pub pose: [f32; 7],
    /// `box`, `sphere`, `cylinder` or `capsule`, along z.
    pub kind: &'static str,
    /// Box: half edges; else radius and half length.
    pub size: Vec<f64>,
}

impl Replay {
    /// Of the first environment of a batch, without tracks yet; `dt` seconds from frame to frame.
    pub fn new(title: &str, batch: &Batch, dt: f64) -> Self {
        let (robot, scene) = (&batch.system.robot, &batch.scenes[0]);
        let up = if scene.gravity.norm() > 0.0 { -scene.gravity.normalize() } else { nalgebra::Vector3::z() };
        let links = robot.links.iter().enumerate();
        Self {
            title: title.into(),
            dt,
            up: up.into(),
            planes: planes(scene),
            shapes: solids(robot),
            rods: links.filter_map(|(i, link)| Some([link.parent?, i])).collect(),
            tracks: Vec::new(),
            goals: Vec::new(),
            rewards: Vec::new(),
        }
    }

    /// Begins another motion.
    pub fn begin(&mut self, name: &str) {
        self.tracks.push(Track { name: name.into(), poses: Vec::new() });
    }

    /// Adds the present state of the first environment to the motion begun last.
    pub fn add(&mut self, batch: &Batch) {
        let Some(track) = self.tracks.last_mut() else { return };
        let robot = &batch.system.robot;
        let mut data = Data::new(robot);
        kinematics(robot, batch.state(0), &mut data);
        track.poses.push((0..robot.links.len()).map(|link| numbers(&link_pose(&data, link))).collect());
    }

    /// Frames of the longest motion.
    pub fn frames(&self) -> usize {
        self.tracks.iter().map(|track| track.poses.len()).max().unwrap_or(0)
    }

    /// As JSON for a script within a page.
    pub fn json(&self) -> String {
        script(self)
    }

    /// As a page of its own.
    pub fn html(&self) -> String {
        let title = escape(&self.title);
        PAGE.replace("TITLE", &title).replace("SCRIPT", SCRIPT).replace("DATA", &self.json())
    }
}

/// JSON that may stand in a script: `<` may not.
pub fn script(data: &impl Serialize) -> String {
    serde_json::to_string(data).unwrap_or_else(|_| "null".into()).replace('<', "\\u003c")
}

/// Text that may stand in a page.
pub fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

fn planes(scene: &Scene) -> Vec<([f64; 3], f64)> {
    scene.colliders.iter().filter_map(|c| c.plane).map(|p| (p.normal.into(), p.offset)).collect()
}

fn solids(robot: &Robot) -> Vec<Solid> {
    let all = robot.links.iter().enumerate().flat_map(|(link, body)| body.shapes.iter().map(move |shape| (link, shape)));
    all.map(|(link, shape)| {
        let (kind, size) = match shape.kind {
            ShapeKind::Sphere { radius } => ("sphere", vec![radius, 0.0]),
            ShapeKind::Box { half } => ("box", half.iter().copied().collect()),
            ShapeKind::Cylinder { radius, half_length } => ("cylinder", vec![radius, half_length]),
            ShapeKind::Capsule { radius, half_length } => ("capsule", vec![radius, half_length]),
        };
        Solid { link, pose: numbers(&shape.pose), kind, size }
    })
    .chain(bones(robot))
    .collect()
}

/// Of links whose shapes are meshes or that have none: from their joint to the next ones, and to what they touch with.
fn bones(robot: &Robot) -> Vec<Solid> {
    let bare = robot.links.iter().enumerate().filter(|(_, body)| body.shapes.is_empty());
    let ends = |link: usize| {
        let next = robot.links.iter().filter(move |child| child.parent == Some(link));
        let next = next.filter_map(|child| Some(child.joint.as_ref()?.origin().translation.vector));
        let own: Vec<Vector3<f64>> = robot.contact_points.iter().filter(|p| p.link == link).map(|p| p.local).collect();
        let middle = own.iter().sum::<Vector3<f64>>() / own.len().max(1) as f64;
        next.chain((!own.is_empty()).then_some(middle)).filter(|end| end.norm() > 1e-3)
    };
    let bone = |link: usize, end: Vector3<f64>| {
        let turn = UnitQuaternion::rotation_between(&Vector3::z(), &end)
            .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI));
        let pose = Isometry3::from_parts((0.5 * end).into(), turn);
        Solid { link, pose: numbers(&pose), kind: "capsule", size: vec![THICK * end.norm(), 0.5 * end.norm()] }
    };
    bare.flat_map(|(link, _)| ends(link).map(move |end| bone(link, end)).collect::<Vec<_>>()).collect()
}

fn numbers(pose: &nalgebra::Isometry3<f64>) -> [f32; 7] {
    let (p, q) = (pose.translation.vector, pose.rotation.coords);
    // A tenth of a millimetre is more than a pixel shows.
    [p.x, p.y, p.z, q.x, q.y, q.z, q.w].map(|x| ((x * 1e4).round() / 1e4) as f32)
}
