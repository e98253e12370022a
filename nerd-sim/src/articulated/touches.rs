//! What touches in a substep of the implicit step: points on colliders, joints beyond limits, dry friction, drives.

use nalgebra::{DMatrix, Vector3};
use nerd_core::dynamics::velocities;
use nerd_core::robot::Robot;

use super::along::Tree;
use super::frame::Workspace;
use crate::scene::{Material, Scene};

/// One point or limit that touches, or will within the substep: what it is, then what the substep makes of it.
#[derive(Default)]
pub(super) struct Touch {
    /// Its number among points and joints.
    pub(super) index: usize,
    /// The link of a point, and where it touches (m, from the root).
    pub(super) link: Option<usize>,
    pub(super) x: Vector3<f64>,
    /// Its columns among all, `J = [.. column ..]` by DoF; of a point only where the matrix is at hand.
    pub(super) columns: std::ops::Range<usize>,
    pub(super) material: Material,
    /// Whether it may pull and is damped both ways, as limits are.
    pub(super) sticky: bool,
    pub(super) normal: Vector3<f64>,
    pub(super) gap: f64,
    pub(super) velocity: Vector3<f64>,
    /// Shares a of the spring, the damper and the drag.
    pub(super) ahead: [f64; 3],
    /// Drag c (N s/m).
    pub(super) across: f64,
    /// Whether it would pull, and acts no more.
    pub(super) parted: bool,
    /// Of a drive: its least and largest force.
    pub(super) bounds: Option<[f64; 2]>,
    /// Its force (N) on the robot in the substep, of a contact.
    pub(super) force: Vector3<f64>,
    /// The bound that holds it.
    pub(super) held: Option<f64>,
}

/// Working memory.
pub(super) struct Touches {
    pub(super) touches: Vec<Touch>,
    pub(super) columns: Vec<(usize, Vector3<f64>)>,
    /// w of every point with every collider and of every joint, found once a frame.
    pub(super) weights: Vec<Option<f64>>,
    /// Damping of each joint: its own, or what its spring asks for where the substep is too long to follow it.
    pub(super) braked: Vec<f64>,
    /// Shares a of the joints' own dampers and springs, and the springs' torques in the middle of the substep.
    pub(super) dampers: Vec<f64>,
    /// The substep for which they were found (s); 0: for none.
    pub(super) shared: f64,
    pub(super) springs: Vec<f64>,
    pub(super) pull: Vec<f64>,
    pub(super) mass: DMatrix<f64>,
    /// Where the tree is too deep for the matrix.
    pub(super) tree: Option<Tree>,
    /// Velocity in the middle of the substep, as the bias sees it, and the rate of change of velocities in the last one.
    pub(super) middle: Vec<f64>,
    pub(super) rate: Vec<f64>,
    pub(super) right: Vec<f64>,
    /// Coordinates before the substep.
    pub(super) before: Vec<f64>,
}

impl Touches {
    pub(super) fn new(robot: &Robot) -> Self {
        let (points, joints, nv) = (robot.contact_points.len(), robot.joint_count(), robot.nv());
        Self {
            touches: Vec::with_capacity(points + 3 * joints),
            columns: Vec::with_capacity(points * nv + 3 * joints),
            weights: vec![None; points + 3 * joints],
            braked: vec![0.0; joints],
            dampers: vec![0.5; joints],
            shared: 0.0,
            springs: vec![0.0; joints],
            pull: vec![0.0; joints],
            mass: DMatrix::zeros(nv, nv),
            tree: Tree::new(robot),
            middle: vec![0.0; nv],
            rate: vec![0.0; nv],
            right: vec![0.0; nv],
            before: vec![0.0; robot.nq()],
        }
    }

    /// Adds this share of the contacts' forces to those of their points.
    pub(super) fn tell(&self, scene: &Scene, share: f64, forces: &mut [Vector3<f64>]) {
        let pairs = forces.len() * scene.colliders.len();
        for touch in self.touches.iter().filter(|t| t.index < pairs) {
            forces[touch.index / scene.colliders.len()] += touch.force * share;
        }
    }

    /// A frame begins; room for every point to touch every collider.
    pub(super) fn begin(&mut self, robot: &Robot, scene: &Scene) {
        let (pairs, joints) = (robot.contact_points.len() * scene.colliders.len(), robot.joint_count());
        self.shared = 0.0;
        self.weights.clear();
        self.weights.resize(pairs + 3 * joints, None);
        self.touches.clear();
        self.touches.reserve(pairs + 3 * joints);
        self.columns.clear();
        self.columns.reserve(pairs * robot.nv() + 3 * joints);
    }
}

/// Velocity (rad/s or m/s) below which dry friction holds, as a drag: what it holds creeps.
pub(super) const CREEP: f64 = 1e-3;
impl Workspace {
    /// The points and limits that are beyond their surface in some part of the substep in whose middle they are now.
    pub(super) fn find(&mut self, robot: &Robot, scene: &Scene, q: &[f64], qd: &[f64], h: f64) {
        velocities(robot, qd, &mut self.data);
        let Touches { touches, columns, tree, pull, .. } = &mut self.touches;
        touches.clear();
        columns.clear();
        let (data, dofs) = (&self.data, robot.root_dofs());
        for ((pull, joint), x) in pull.iter_mut().zip(robot.joints()).zip(&q[robot.root_coords()..]) {
            *pull = joint.stiffness * (joint.rest - x);
        }
        for (owner, event) in self.owners.iter().zip(&self.events) {
            let (point, n) = (&robot.contact_points[*owner], event.normal);
            let x = data.position[point.link] + data.rotation[point.link] * point.local - n * point.radius;
            let velocity = data.velocity[point.link].at(&x);
            let Some((part, gap)) = inside(n.dot(&(x - (event.p1 - data.origin))), 0.5 * h * n.dot(&velocity)) else { continue };
            let start = columns.len();
            let mut link = tree.is_none().then_some(point.link);
            while let Some(i) = link {
                if robot.links[i].joint.is_some() {
                    columns.push((data.dof[i], data.axis[i].at(&x)));
                } else {
                    for k in 0..3 {
                        columns.push((k, Vector3::ith(k, 1.0).cross(&x)));
                        columns.push((3 + k, Vector3::ith(k, 1.0)));
                    }
                }
                link = robot.links[i].parent;
            }
            let material = part_of(&self.materials[event.collider], part);
            let (index, columns) = (owner * scene.colliders.len() + event.collider, start..columns.len());
            let link = Some(point.link);
            touches.push(Touch { index, link, x, columns, material, normal: n, gap, velocity, ..Default::default() });
        }
        let (points, joints) = (robot.contact_points.len() * scene.colliders.len(), robot.joint_count());
        for (i, joint) in robot.joints().enumerate().filter(|(_, j)| j.friction > 0.0) {
            // Pressed with its friction at a coefficient of 1.
            let material = Material { stiffness: 1.0, damping: 0.0, friction_damping: joint.friction / CREEP, friction: 1.0 };
            let velocity = Vector3::y() * qd[dofs + i];
            columns.push((dofs + i, Vector3::y()));
            let columns = columns.len() - 1..columns.len();
            let (index, normal, gap) = (points + joints + i, Vector3::x(), -joint.friction);
            touches.push(Touch { index, columns, material, normal, gap, velocity, ..Default::default() });
        }
        for ((i, joint), drive) in robot.joints().enumerate().zip(&self.drives) {
            let (x, v) = (q[robot.root_coords() + i], qd[dofs + i]);
            columns.push((dofs + i, Vector3::x()));
            touches.push(Touch {
                index: points + 2 * joints + i,
                columns: columns.len() - 1..columns.len(),
                material: Material { stiffness: drive.kp, damping: drive.kd, friction_damping: 0.0, friction: 0.0 },
                sticky: true,
                normal: Vector3::x(),
                gap: x - drive.target,
                velocity: Vector3::x() * (v - drive.speed),
                bounds: Some(drive.bounds(joint, v)),
                ..Default::default()
            });
        }
        for (i, joint) in robot.joints().enumerate() {
            let Some(limit) = joint.limit.filter(|l| l.stiffness > 0.0 || l.damping > 0.0) else { continue };
            let x = q[robot.root_coords() + i];
            for (end, side) in [(limit.lower, 1.0), (limit.upper, -1.0)] {
                let n = Vector3::x();
                let velocity = n * (side * qd[dofs + i]);
                let Some((part, gap)) = inside(side * (x - end), 0.5 * h * velocity.x) else { continue };
                columns.push((dofs + i, n * side));
                let material = Material { stiffness: limit.stiffness, damping: limit.damping, friction_damping: 0.0, friction: 0.0 };
                let (index, columns, material) = (points + i, columns.len() - 1..columns.len(), part_of(&material, part));
                touches.push(Touch { index, columns, material, sticky: true, normal: n, gap, velocity, ..Default::default() });
            }
        }
    }
}

/// Of a gap that is `middle` in the middle of a substep and `half` more at its end: the part of the substep in which it is
/// negative, and its mean there. None if it never is.
fn inside(middle: f64, half: f64) -> Option<(f64, f64)> {
    let (least, most) = (middle - half.abs(), middle + half.abs());
    match (least < 0.0, most <= 0.0) {
        (false, _) => None,
        (true, true) => Some((1.0, middle)),
        (true, false) => Some((least / (least - most), 0.5 * least)),
    }
}

/// A material that acts for a part of the time.
fn part_of(material: &Material, part: f64) -> Material {
    Material {
        stiffness: part * material.stiffness,
        damping: part * material.damping,
        friction_damping: part * material.friction_damping,
        friction: material.friction,
    }
}
