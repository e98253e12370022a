//! Words in expressions: quantities of a robot, from its files and its default pose.

use std::cell::RefCell;

use nerd_sim::{files::renamed::Renamed, prelude::*, scene::foot};

use crate::formula::{Leaf, Tape, Traced, rotation};

/// What the elements of a vector belong to: nothing, joints or contact points. The last two can be indexed by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Of {
    Numbers,
    Joints,
    Points,
}

/// Properties of robot and scene, measured in the robot's default pose.
pub(super) struct Facts {
    pub system: Arc<System>,
    pub up: Vector3<f64>,
    /// Whether the terrain is uneven; height of flat ground (m); height of the root's origin above the lowest contact
    /// point (m).
    terrain: bool,
    floor: f64,
    standing: f64,
    /// Longest side of the robot's bounding box (m).
    size: f64,
    /// Indices of the contact points of feet, and of all other contact points.
    pub feet: Vec<usize>,
    pub body: Vec<usize>,
    /// Duration of one step of the task (s).
    pub step: f64,
    /// End of the longest chain of links: link index, and position in the link's frame (m). Then the world positions of
    /// this end and of the chain's first link (m), and the length of the chain (m).
    tool: (usize, [f64; 3]),
    ends: [Vector3<f64>; 2],
    reach: f64,
    /// Renamed words that expressions use by their old name.
    pub old: RefCell<Vec<Renamed>>,
}

/// A link is a foot if its lowest point is less than this share of the standing height above the robot's lowest point.
const STANDS: f64 = 0.1;

impl Facts {
    pub fn new(system: &Arc<System>, scene: &Scene, step: f64) -> Self {
        let robot = &system.robot;
        let state = system.default_state();
        let gravity = system.gravity();
        let up = gravity.try_normalize(1e-9).map_or(Vector3::z(), |down| -down);
        let mut data = system.data();
        kinematics(robot, &state, &mut data);
        let lows: Vec<f64> = robot.contact_points.iter().map(|point| foot(point, &data, &up)).collect();
        let low = lows.iter().copied().fold(f64::INFINITY, f64::min);
        let root = data.origin + data.position.first().copied().unwrap_or_default();
        let standing = if low.is_finite() { up.dot(&root) - low } else { 0.0 };
        let stands = |link: usize| {
            robot.floating()
                && robot.contact_points.iter().zip(&lows).any(|(p, at)| p.link == link && at - low < STANDS * standing)
        };
        let (feet, body) = (0..lows.len()).partition(|k| stands(robot.contact_points[*k].link));
        let places = robot.contact_points.iter().map(|p| point_position(&data, p.link, &p.local));
        let all: Vec<_> = places.chain((0..robot.links.len()).map(|link| data.origin + data.position[link])).collect();
        let side = |k: usize| all.iter().fold([f64::MAX, f64::MIN], |[a, b], p| [a.min(p[k]), b.max(p[k])]);
        let size = (0..3).map(side).map(|[a, b]| b - a).fold(0.0, f64::max);
        let plane = scene.colliders.iter().filter_map(|c| c.plane.as_ref()).find(|plane| plane.normal.dot(&up) > 0.99);
        let floor = plane.map_or(0.0, |plane| plane.offset);
        let origin = |link: usize| data.origin + data.position[link];
        let mut lengths = vec![0.0; robot.links.len()];
        let mut first = (0..robot.links.len()).collect::<Vec<_>>();
        for (link, parent) in robot.links.iter().enumerate().filter_map(|(k, link)| Some((k, link.parent?))) {
            lengths[link] = lengths[parent] + (origin(link) - origin(parent)).norm();
            first[link] = first[parent];
        }
        let last = (0..robot.links.len()).max_by(|a, b| lengths[*a].total_cmp(&lengths[*b])).unwrap_or(0);
        let fixed =
            robot.frames.iter().filter(|frame| frame.link == Some(last)).map(|frame| frame.pose.translation.vector);
        let tip =
            fixed.max_by(|a, b| a.norm().total_cmp(&b.norm())).unwrap_or(robot.links[last].frame.translation.vector);
        let reach = lengths[last] + tip.norm();
        let ends = [point_position(&data, last, &tip), origin(first[last])];
        let tool = (last, tip.into());
        let terrain = scene.terrain().is_some();
        let old = RefCell::default();
        Self { system: system.clone(), up, terrain, floor, standing, size, feet, body, step, tool, ends, reach, old }
    }

    /// Rotation matrix of the root, body to world: `[i][j]` is the component of body axis j along world axis i.
    fn turn<'a>(&self, tape: &'a Tape) -> [[Traced<'a>; 3]; 3] {
        rotation([3, 4, 5, 6].map(|k| state(tape, k)))
    }

    /// Rotates a world vector into the root's axes.
    fn inside<'a>(&self, tape: &'a Tape, v: [Traced<'a>; 3]) -> Vec<Traced<'a>> {
        let turn = self.turn(tape);
        (0..3).map(|j| sum((0..3).filter(|i| !none(v[*i])).map(|i| turn[i][j] * v[i]))).collect()
    }

    /// Value of a built-in word; `None` for an unknown word. Words about a free root are refused on a fixed base. To
    /// add a word, extend [`Self::WORDS`] and `docs/tasks.md`. For a word about a free root, extend also the list that
    /// is refused here. If contracts should name the word's quantity, extend `nerd-train/src/onnx/quantity.rs`.
    pub fn word<'a>(&self, tape: &'a Tape, name: &str) -> Option<Result<(Vec<Traced<'a>>, Of), String>> {
        let system = &self.system;
        let robot = &self.system.robot;
        let coords = robot.root_coords();
        let nq = robot.nq();
        let dofs = robot.root_dofs();
        let known = |x: f64| (vec![Traced::from(x)], Of::Numbers);
        let list = |list: Vec<f64>, of: Of| (list.into_iter().map(Traced::from).collect(), of);
        let joints = |what: &dyn Fn(&nerd_sim::nerd_core::robot::Joint) -> f64| {
            list(robot.joints().map(what).collect(), Of::Joints)
        };
        let specs = |what: &dyn Fn(&nerd_sim::system::JointSpec) -> f64| {
            list(system.joint_specs().map(what).collect(), Of::Joints)
        };
        let numbers = |points: &[usize]| list(points.iter().map(|k| *k as f64).collect(), Of::Numbers);
        let root = |k: std::ops::Range<usize>| (k.map(|k| state(tape, k)).collect::<Vec<_>>(), Of::Numbers);
        let end = |upper: bool, [low, high]: [f64; 2]| if upper { high } else { low };
        let limit = |upper: bool| {
            move |joint: &nerd_sim::nerd_core::robot::Joint| {
                end(upper, joint.limit.map_or([-1e3, 1e3], |limit| [limit.lower, limit.upper]))
            }
        };
        let found = match name {
            "q" => ((coords..nq).map(|k| state(tape, k)).collect(), Of::Joints),
            "qd" => ((dofs..robot.nv()).map(|k| state(tape, nq + k)).collect(), Of::Joints),
            "default_q" => specs(&|joint| joint.default_q),
            "kp" => specs(&|joint| joint.kp),
            "kd" => specs(&|joint| joint.kd),
            "gain" => specs(&|joint| joint.gain.unwrap_or(joint.torque)),
            "torque_limit" => list(
                robot.joints().zip(system.joint_specs()).map(|(joint, spec)| spec.torque_limit(joint)).collect(),
                Of::Joints,
            ),
            "low" => joints(&limit(false)),
            "high" => joints(&limit(true)),
            "gap" | "feet" | "body" | "standing" if robot.contact_points.is_empty() => {
                let unread = if system.meshes.is_empty() {
                    String::new()
                } else {
                    format!(", {} meshes are not read", system.meshes.len())
                };
                let what =
                    format!("`{name}`: nothing of `{}` touches the ground{unread}; see `inspect --robot`", system.name);
                return Some(Err(what));
            }
            "gap" => {
                let gap = |k: usize| tape.leaf(Leaf::Distance(k)) - Traced::from(robot.contact_points[k].radius);
                ((0..robot.contact_points.len()).map(gap).collect(), Of::Points)
            }
            "radius" => list(robot.contact_points.iter().map(|p| p.radius).collect(), Of::Points),
            "feet" => numbers(&self.feet),
            "body" => numbers(&self.body),
            "mass" => known(robot.mass()),
            "weight" => known(robot.mass() * system.gravity().norm()),
            "size" => known(self.size),
            "standing" => known(self.standing),
            "step" => known(self.step),
            "reach" => known(self.reach),
            "default_tool" => list(self.ends[0].as_slice().to_vec(), Of::Numbers),
            "shoulder" => list(self.ends[1].as_slice().to_vec(), Of::Numbers),
            "tool" => {
                let (link, local) = self.tool;
                ((0..3).map(|axis| tape.leaf(Leaf::Place { link, local, axis })).collect(), Of::Numbers)
            }
            "pi" => known(std::f64::consts::PI),
            "deg" => known(std::f64::consts::PI / 180.0),
            "position" | "quaternion" | "twist" | "height" | "ground" | "up" | "forward" | "velocity" | "ang_vel"
            | "world_velocity" | "world_ang_vel"
                if !robot.floating() =>
            {
                let fixed = format!("`{name}` is of a free root, and the base of `{}` is fixed", system.name);
                return Some(Err(format!("{fixed} (`floating = true` in its .toml frees it)")));
            }
            "position" => root(0..3),
            "quaternion" => root(3..7),
            "twist" => root(nq..nq + 6),
            "world_ang_vel" => root(nq..nq + 3),
            "world_velocity" => (world_velocity(tape, nq).to_vec(), Of::Numbers),
            "velocity" => (self.inside(tape, world_velocity(tape, nq)), Of::Numbers),
            "ang_vel" => (self.inside(tape, [0, 1, 2].map(|k| state(tape, nq + k))), Of::Numbers),
            "up" => (self.inside(tape, [0, 1, 2].map(|k| Traced::from(self.up[k]))), Of::Numbers),
            "forward" => (self.turn(tape).map(|row| row[0]).to_vec(), Of::Numbers),
            "height" => {
                let along = (0..3).filter(|k| self.up[*k] != 0.0).map(|k| Traced::from(self.up[k]) * state(tape, k));
                let height = sum(along);
                let flat = self.floor == 0.0 && !self.terrain;
                (vec![if flat { height } else { height - self.ground(tape, [0.0; 2]) }], Of::Numbers)
            }
            "ground" => (vec![self.ground(tape, [0.0; 2])], Of::Numbers),
            _ => return None,
        };
        Some(Ok(found))
    }

    /// Height of the ground (m) at `at`: distances (m) ahead of a free root and to its left, relative to its heading.
    pub fn ground<'a>(&self, tape: &'a Tape, at: [f64; 2]) -> Traced<'a> {
        if self.terrain { tape.leaf(Leaf::Ground(at)) } else { Traced::from(self.floor) }
    }

    /// All words, except names of a robot's parts, for errors. `expression.rs` gives the values of the words about
    /// actions, time and torque.
    pub const WORDS: &str = "q, qd, default_q, low, high, kp, kd, gain, torque_limit, position, quaternion, twist, height, ground, up, forward, \
                             velocity, ang_vel, world_velocity, world_ang_vel, gap, radius, feet, body, mass, weight, size, standing, step, time, tool, default_tool, \
                             shoulder, reach, pi, deg, action, last_action, torque";

    /// The frame of a link or of a body fixed on it: link index, position (m) and rotation in the link's axes.
    pub fn frame(&self, name: &str) -> Option<(usize, Vector3<f64>, Matrix3<f64>)> {
        let frame = self.system.robot.frame(name).ok()?;
        Some((frame.link?, frame.pose.translation.vector, frame.pose.rotation.to_rotation_matrix().into_inner()))
    }

    /// Indices, in a vector of kind `of`, of the joint `name` or of the contact points of the link `name`.
    pub fn named(&self, name: &str, of: Of) -> Result<Vec<usize>, String> {
        let robot = &self.system.robot;
        let (found, what, known): (Vec<usize>, _, Vec<_>) = match of {
            Of::Joints => {
                let known = robot.joints().map(|joint| joint.name.as_str()).collect::<Vec<_>>();
                ((0..known.len()).filter(|k| known[*k] == name).collect(), "joint", known)
            }
            Of::Points => {
                let on = |k: &usize| robot.links[robot.contact_points[*k].link].name == name;
                let known = robot.links.iter().map(|link| link.name.as_str()).collect();
                ((0..robot.contact_points.len()).filter(on).collect(), "link with contact points", known)
            }
            Of::Numbers => {
                return Err(format!("\"{name}\": numbers of joints and of contact points have names, these have not"));
            }
        };
        let listed = || known.iter().take(40).copied().collect::<Vec<_>>().join(", ");
        let on = (of == Of::Points).then(|| self.frame(name)).flatten().map(|(link, ..)| &robot.links[link].name);
        match on.filter(|link| *link != name) {
            Some(link) if found.is_empty() => Err(format!("`{name}` is fixed to `{link}`: write that")),
            _ if found.is_empty() => Err(format!("no {what} `{name}`: choose from {}", listed())),
            _ => Ok(found),
        }
    }
}

/// Velocity of the root's origin (m/s, world axes), from the root's twist, whose linear part is at the world's origin.
fn world_velocity(tape: &Tape, nq: usize) -> [Traced<'_>; 3] {
    let p = [0, 1, 2].map(|k| state(tape, k));
    let [w, v] = [0, 3].map(|at| [0, 1, 2].map(|k| state(tape, nq + at + k)));
    let cross = |i: usize| w[(i + 1) % 3] * p[(i + 2) % 3] - w[(i + 2) % 3] * p[(i + 1) % 3];
    [0, 1, 2].map(|i| v[i] + cross(i))
}

fn state(tape: &Tape, k: usize) -> Traced<'_> {
    tape.leaf(Leaf::State(k))
}

fn none(x: Traced) -> bool {
    matches!(x, Traced::Number(0.0))
}

pub(super) fn sum<'a>(all: impl Iterator<Item = Traced<'a>>) -> Traced<'a> {
    all.reduce(|a, b| a + b).unwrap_or(Traced::from(0.0))
}
