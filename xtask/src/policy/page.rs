//! An episode as one HTML file: poses of links by step, their collision shapes, and a small painter's renderer that turns them
//! with the mouse (`xtask/assets/episode.html`). It loads nothing.

use anyhow::Result;
use nerd_core::dynamics::{Data, kinematics, link_pose};
use nerd_core::robot::{Robot, ShapeKind};
use nerd_sim::scene::Scene;
use nerd_tasks::Episodes;
use serde::Serialize;

const TEMPLATE: &str = include_str!("../../assets/episode.html");

/// What the page draws. Lengths in m; a pose is position, then quaternion x y z w.
#[derive(Serialize)]
pub struct Page {
    title: String,
    /// Seconds of a step.
    dt: f64,
    up: [f64; 3],
    /// Height of the floor along `up`, if there is one.
    floor: Option<f64>,
    shapes: Vec<Shape>,
    /// Links whose origins a rod joins, since not every robot has a collision shape for each.
    rods: Vec<[usize; 2]>,
    /// Poses of the links, by step.
    poses: Vec<Vec<[f32; 7]>>,
    goals: Vec<Vec<f32>>,
    rewards: Vec<f32>,
}

#[derive(Serialize)]
struct Shape {
    /// The link it is fixed on.
    link: usize,
    pose: [f32; 7],
    kind: &'static str,
    /// Box: half edges; else radius and half length.
    size: Vec<f64>,
}

impl Page {
    /// A page without steps yet.
    pub fn new(title: &str, episodes: &Episodes) -> Self {
        let (batch, view) = (&episodes.simulation.batch, episodes.view(0));
        let (system, gravity) = (&batch.system, view.scene.gravity);
        let up = if gravity.norm() > 0.0 { -gravity.normalize() } else { nalgebra::Vector3::z() };
        let links = system.robot.links.iter().enumerate();
        Self {
            title: title.into(),
            dt: system.frame_time * episodes.task.frames() as f64,
            up: up.into(),
            floor: floor(view.scene, &up),
            shapes: shapes(&system.robot),
            rods: links.filter_map(|(i, link)| Some([link.parent?, i])).collect(),
            poses: Vec::new(),
            goals: Vec::new(),
            rewards: Vec::new(),
        }
    }

    /// Adds the present state of the first environment.
    pub fn add(&mut self, episodes: &Episodes, reward: f64) {
        let (view, robot) = (episodes.view(0), &episodes.simulation.batch.system.robot);
        let mut data = Data::new(robot);
        kinematics(robot, view.state, &mut data);
        self.poses.push((0..robot.links.len()).map(|link| numbers(&link_pose(&data, link))).collect());
        self.goals.push(view.goal.iter().map(|x| *x as f32).collect());
        self.rewards.push(reward as f32);
    }

    /// Steps so far.
    pub fn frames(&self) -> usize {
        self.poses.len()
    }

    /// The file.
    pub fn html(&self) -> Result<String> {
        // `<` may not stand in a script's text.
        let json = serde_json::to_string(self)?.replace('<', "\\u003c");
        Ok(TEMPLATE.replace("EPISODE", &json))
    }
}

/// Height of a horizontal plane.
fn floor(scene: &Scene, up: &nalgebra::Vector3<f64>) -> Option<f64> {
    scene.colliders.iter().filter_map(|c| c.plane).find(|p| p.normal.dot(up) > 0.99).map(|p| p.offset)
}

fn shapes(robot: &Robot) -> Vec<Shape> {
    let all = robot.links.iter().enumerate().flat_map(|(link, body)| body.shapes.iter().map(move |shape| (link, shape)));
    all.map(|(link, shape)| {
        let (kind, size) = match shape.kind {
            ShapeKind::Sphere { radius } => ("sphere", vec![radius, 0.0]),
            ShapeKind::Box { half } => ("box", half.iter().copied().collect()),
            ShapeKind::Cylinder { radius, half_length } => ("cylinder", vec![radius, half_length]),
            ShapeKind::Capsule { radius, half_length } => ("capsule", vec![radius, half_length]),
        };
        Shape { link, pose: numbers(&shape.pose), kind, size }
    })
    .collect()
}

fn numbers(pose: &nalgebra::Isometry3<f64>) -> [f32; 7] {
    let (p, q) = (pose.translation.vector, pose.rotation.coords);
    // A tenth of a millimetre is more than a pixel shows.
    [p.x, p.y, p.z, q.x, q.y, q.z, q.w].map(|x| ((x * 1e4).round() / 1e4) as f32)
}
