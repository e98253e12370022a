//! Web pages that show motion: poses of links by frame, shapes on links, and a renderer (`replay.js`) with a camera.
//! Several tracks of one robot are drawn together, the first solid, the others as ghosts. A page loads no other file.

use nalgebra::Point3;
use nerd_core::dynamics::link_pose;

use super::solids::{Solid, isometry, numbers, rounded, scene_solid, solids};
use crate::prelude::*;

/// The renderer: a function `replay(element, data)`.
pub const SCRIPT: &str = include_str!("replay.js");
const PAGE: &str = include_str!("replay.html");

/// The data of a page. Lengths are in m. A pose is a position, then a quaternion x y z w, in world axes.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Replay {
    /// Title above the picture.
    pub title: String,
    /// Time between frames (s).
    pub dt: f64,
    /// Unit vector against gravity (world axes).
    pub up: [f64; 3],
    /// Normals and offsets of the scene's planes.
    pub planes: Vec<([f64; 3], f64)>,
    /// Terrain of the scene.
    pub grounds: Vec<Ground>,
    /// Shapes of links and scene.
    pub shapes: Vec<Solid>,
    /// Motions: the first is solid, the others are ghosts.
    pub tracks: Vec<Track>,
    /// Goal position (m) by frame, if the task's goal is a place.
    pub goals: Vec<Vec<f32>>,
    /// Sum of rewards so far, by frame; empty if the motion has no rewards.
    pub rewards: Vec<f32>,
    /// Mean distance (m) of the contact points in the first two motions, by frame; empty before [`Replay::compare`].
    pub apart: Vec<f32>,
}

/// One motion.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Track {
    /// Name of the motion.
    pub name: String,
    /// Poses `[frame][link]`, each a position (m) and a quaternion x y z w.
    pub poses: Vec<Vec<[f32; 7]>>,
}

/// A grid of heights, `[x][y]`, with origin and axes (x, y, up) in the world.
#[derive(Clone, Debug, Serialize)]
pub struct Ground {
    /// Node spacing along x and y (m).
    pub cell: [f64; 2],
    /// Whether the grid repeats beyond its last nodes.
    pub repeats: bool,
    /// Number of nodes along x and y.
    pub nodes: [usize; 2],
    /// Heights of the nodes (m).
    pub heights: Vec<f32>,
    /// Position of the first node at height 0 (m).
    pub origin: [f64; 3],
    /// Unit vectors of the grid's axes x, y, up, in world axes.
    pub axes: [[f64; 3]; 3],
}

impl Ground {
    fn of(body: &Collider) -> Option<Self> {
        let field = body.field.as_ref()?;
        let (nodes, cell) = field.grid();
        // A grid that does not repeat is centred, so its first node is at a corner.
        let first = [0, 1].map(|k| if field.repeats() { 0.0 } else { -0.5 * (nodes[k] - 1) as f64 * cell[k] });
        let node = |k: usize| {
            rounded(field.at(first[0] + (k / nodes[1]) as f64 * cell[0], first[1] + (k % nodes[1]) as f64 * cell[1]).0)
        };
        let axes = [0, 1, 2].map(|k| (body.pose.rotation * nalgebra::Vector3::ith(k, 1.0)).into());
        let heights = (0..nodes[0] * nodes[1]).map(node).collect();
        let origin = (body.pose * nalgebra::Point3::new(first[0], first[1], 0.0)).into();
        Some(Self { cell, repeats: field.repeats(), nodes, heights, origin, axes })
    }
}

impl Replay {
    /// A page for the first environment of a batch, without tracks; `dt` is the time between frames (s).
    pub fn new(title: &str, batch: &Batch, dt: f64) -> Self {
        let system = &batch.system;
        let scene = &batch.scenes[0];
        let up = if scene.gravity.norm() > 0.0 { -scene.gravity.normalize() } else { nalgebra::Vector3::z() };
        Self {
            title: title.into(),
            dt,
            up: up.into(),
            planes: scene.colliders.iter().filter_map(|c| c.plane).map(|p| (p.normal.into(), p.offset)).collect(),
            grounds: scene.colliders.iter().filter_map(Ground::of).collect(),
            shapes: solids(system).into_iter().chain(scene.colliders.iter().filter_map(scene_solid)).collect(),
            ..Self::default()
        }
    }

    /// Begins another motion.
    pub fn begin(&mut self, name: &str) {
        self.tracks.push(Track { name: name.into(), poses: Vec::new() });
    }

    /// Adds the present state of the first environment to the last motion.
    pub fn add(&mut self, batch: &Batch) {
        if let Some(track) = self.tracks.last_mut() {
            track.poses.push(poses(batch));
        }
    }

    /// Computes [`Replay::apart`] from the first two motions.
    pub fn compare(&mut self, robot: &Robot) {
        let ([one, two, ..], points @ [_, ..]) = (&self.tracks[..], &robot.contact_points[..]) else { return };
        let place = |poses: &[[f32; 7]], p: &ContactPoint| isometry(&poses[p.link]) * Point3::from(p.local);
        let apart =
            |a: &[[f32; 7]], b: &[[f32; 7]]| points.iter().map(|p| (place(a, p) - place(b, p)).norm()).sum::<f64>();
        self.apart =
            one.poses.iter().zip(&two.poses).map(|(a, b)| rounded(apart(a, b) / points.len() as f64)).collect();
    }

    /// Frames of the longest motion.
    pub fn frames(&self) -> usize {
        self.tracks.iter().map(|track| track.poses.len()).max().unwrap_or(0)
    }

    /// The page as HTML.
    pub fn html(&self) -> String {
        let title = escape(&self.title);
        fill(PAGE, &[("TITLE", &title), ("SCRIPT", SCRIPT), ("DATA", &script(self))])
    }
}

/// Present poses of the links of the first environment.
pub fn poses(batch: &Batch) -> Vec<[f32; 7]> {
    let robot = &batch.system.robot;
    let mut data = Data::new(robot);
    kinematics(robot, batch.state(0), &mut data);
    (0..robot.links.len()).map(|link| numbers(&link_pose(&data, link))).collect()
}

/// Fills in `@@NAME@@` in a template; inserted text is not searched again.
pub fn fill(template: &str, parts: &[(&str, &str)]) -> String {
    let part = |name: &str| parts.iter().find(|(own, _)| *own == name).map_or("", |(_, text)| text);
    template.split("@@").enumerate().map(|(k, piece)| if k % 2 == 1 { part(piece) } else { piece }).collect()
}

/// JSON for a script, without `<`.
pub fn script(data: &impl Serialize) -> String {
    serde_json::to_string(data).unwrap_or_else(|_| "null".into()).replace('<', "\\u003c")
}

/// Text escaped for HTML.
pub fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
