//! Motions as pages that any browser plays: poses of links by frame, the shapes fixed on them, and the painter (`replay.js`) that
//! turns them with the mouse. Several tracks of one robot lie over each other, the truth as a ghost behind a learned one. A page
//! loads nothing.

use nalgebra::Point3;
use nerd_core::dynamics::link_pose;

use super::solids::{Solid, isometry, numbers, rounded, solids, standing};
use crate::prelude::*;

/// The renderer: a function `replay(element, data)`.
pub const SCRIPT: &str = include_str!("replay.js");
const PAGE: &str = include_str!("replay.html");

/// What is shown. Lengths in m; a pose is position, then quaternion x y z w, in world axes.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Replay {
    /// Over the picture.
    pub title: String,
    /// Seconds from frame to frame.
    pub dt: f64,
    /// Against gravity.
    pub up: [f64; 3],
    /// Normals and offsets of the scene's planes.
    pub planes: Vec<([f64; 3], f64)>,
    /// Ground that is not flat.
    pub grounds: Vec<Ground>,
    /// Shapes of links and scene.
    pub shapes: Vec<Solid>,
    /// Motions: the first is solid, the others are ghosts.
    pub tracks: Vec<Track>,
    /// Goal by frame, if there is one (m).
    pub goals: Vec<Vec<f32>>,
    /// Reward so far by frame, if there is one.
    pub rewards: Vec<f32>,
    /// Mean distance (m) by frame of contact points in the first two motions, where [`Replay::compare`] was asked.
    pub apart: Vec<f32>,
}

/// One motion.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Track {
    /// What moves so.
    pub name: String,
    /// Poses by frame and link.
    pub poses: Vec<Vec<[f32; 7]>>,
}

/// A grid of heights, `[x][y]`, over its origin along its axes (x, y, up), both in the world.
#[derive(Clone, Debug, Serialize)]
pub struct Ground {
    /// From node to node along x and y (m).
    pub cell: [f64; 2],
    /// Whether it goes on behind its last nodes with its first ones.
    pub repeats: bool,
    /// Along x and y.
    pub nodes: [usize; 2],
    /// Heights of nodes (m).
    pub heights: Vec<f32>,
    /// Where its first node has height 0 (m).
    pub origin: [f64; 3],
    /// Its axes.
    pub axes: [[f64; 3]; 3],
}

impl Ground {
    fn of(body: &Collider) -> Option<Self> {
        let field = body.field.as_ref()?;
        let (nodes, cell) = field.grid();
        // The first node of one that ends is at its corner.
        let first = [0, 1].map(|k| if field.repeats() { 0.0 } else { -0.5 * (nodes[k] - 1) as f64 * cell[k] });
        let node = |k: usize| rounded(field.at(first[0] + (k / nodes[1]) as f64 * cell[0], first[1] + (k % nodes[1]) as f64 * cell[1]).0);
        let axes = [0, 1, 2].map(|k| (body.pose.rotation * nalgebra::Vector3::ith(k, 1.0)).into());
        let heights = (0..nodes[0] * nodes[1]).map(node).collect();
        let origin = (body.pose * nalgebra::Point3::new(first[0], first[1], 0.0)).into();
        Some(Self { cell, repeats: field.repeats(), nodes, heights, origin, axes })
    }
}

impl Replay {
    /// Of the first environment of a batch, without tracks yet; `dt` seconds from frame to frame.
    pub fn new(title: &str, batch: &Batch, dt: f64) -> Self {
        let (system, scene) = (&batch.system, &batch.scenes[0]);
        let up = if scene.gravity.norm() > 0.0 { -scene.gravity.normalize() } else { nalgebra::Vector3::z() };
        Self {
            title: title.into(),
            dt,
            up: up.into(),
            planes: scene.colliders.iter().filter_map(|c| c.plane).map(|p| (p.normal.into(), p.offset)).collect(),
            grounds: scene.colliders.iter().filter_map(Ground::of).collect(),
            shapes: solids(system).into_iter().chain(scene.colliders.iter().filter_map(standing)).collect(),
            ..Self::default()
        }
    }

    /// Begins another motion.
    pub fn begin(&mut self, name: &str) {
        self.tracks.push(Track { name: name.into(), poses: Vec::new() });
    }

    /// Adds the present state of the first environment to the motion begun last.
    pub fn add(&mut self, batch: &Batch) {
        if let Some(track) = self.tracks.last_mut() {
            track.poses.push(poses(batch));
        }
    }

    /// Measures how far apart the first two motions are at the robot's contact points.
    pub fn compare(&mut self, robot: &Robot) {
        let ([one, two, ..], points @ [_, ..]) = (&self.tracks[..], &robot.contact_points[..]) else { return };
        let place = |poses: &[[f32; 7]], p: &ContactPoint| isometry(&poses[p.link]) * Point3::from(p.local);
        let apart = |a: &[[f32; 7]], b: &[[f32; 7]]| points.iter().map(|p| (place(a, p) - place(b, p)).norm()).sum::<f64>();
        self.apart = one.poses.iter().zip(&two.poses).map(|(a, b)| rounded(apart(a, b) / points.len() as f64)).collect();
    }

    /// Frames of the longest motion.
    pub fn frames(&self) -> usize {
        self.tracks.iter().map(|track| track.poses.len()).max().unwrap_or(0)
    }

    /// As a page of its own.
    pub fn html(&self) -> String {
        let title = escape(&self.title);
        fill(PAGE, &[("TITLE", &title), ("SCRIPT", SCRIPT), ("DATA", &script(self))])
    }
}

/// Poses of the links of the first environment, now.
pub fn poses(batch: &Batch) -> Vec<[f32; 7]> {
    let robot = &batch.system.robot;
    let mut data = Data::new(robot);
    kinematics(robot, batch.state(0), &mut data);
    (0..robot.links.len()).map(|link| numbers(&link_pose(&data, link))).collect()
}

/// A template with its `@@NAME@@` filled in, once through: what is filled in is not searched.
pub fn fill(template: &str, parts: &[(&str, &str)]) -> String {
    let part = |name: &str| parts.iter().find(|(own, _)| *own == name).map_or("", |(_, text)| text);
    template.split("@@").enumerate().map(|(k, piece)| if k % 2 == 1 { part(piece) } else { piece }).collect()
}

/// JSON for a script, without `<`.
pub fn script(data: &impl Serialize) -> String {
    serde_json::to_string(data).unwrap_or_else(|_| "null".into()).replace('<', "\\u003c")
}

/// Text for a page.
pub fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
