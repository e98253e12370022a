//! Random robots and states, energies, and a small step along a velocity, shared by the tests. Every seed is fixed.
#![allow(dead_code)]

use nalgebra::{DMatrix, Isometry3, Matrix3, Rotation3, Translation3, Unit, UnitQuaternion, Vector3};
use nerd_core::dynamics::{Data, inertias, kinematics, point_position, velocities};
use nerd_core::robot::{Base, Joint, JointKind, Link, Mimic, Robot};
use nerd_core::spatial::{BodyInertia, Wrench};
use nerd_core::state::{quaternion, vector, write_quaternion};
use rand::RngExt;
pub use rand::SeedableRng;
pub use rand_chacha::ChaCha8Rng as Rng;

/// Gravity of the tests (m/s^2), along no axis.
pub const GRAVITY: [f64; 3] = [0.4, -1.1, -9.7];

pub fn uniform(rng: &mut Rng, scale: f64) -> f64 {
    rng.random_range(-scale..scale)
}

pub fn vector3(rng: &mut Rng, scale: f64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| uniform(rng, scale))
}

pub fn values(rng: &mut Rng, n: usize, scale: f64) -> Vec<f64> {
    (0..n).map(|_| uniform(rng, scale)).collect()
}

pub fn rotation(rng: &mut Rng) -> UnitQuaternion<f64> {
    UnitQuaternion::from_scaled_axis(vector3(rng, 2.0))
}

pub fn pose(rng: &mut Rng, scale: f64) -> Isometry3<f64> {
    Isometry3::from_parts(Translation3::from(vector3(rng, scale)), rotation(rng))
}

/// A body that matter can have: second moments `a, b, c` of mass along turned axes.
pub fn body(rng: &mut Rng) -> BodyInertia {
    let [a, b, c] = [0; 3].map(|_| rng.random_range(0.005..0.05));
    let r = rotation(rng).to_rotation_matrix();
    let inertia = r.matrix() * Matrix3::from_diagonal(&Vector3::new(b + c, a + c, a + b)) * r.matrix().transpose();
    BodyInertia { mass: rng.random_range(0.5..2.0), com: vector3(rng, 0.2), inertia }
}

/// A random tree with `joints` moving joints of all kinds, with armature, on a fixed or a floating base.
pub fn robot(rng: &mut Rng, joints: usize, floating: bool) -> Robot {
    let base = if floating { Base::Floating } else { Base::Fixed(pose(rng, 1.0)) };
    let mut links = Vec::new();
    if floating {
        links.push(Link { name: "root".into(), parent: None, joint: None, inertia: body(rng), shapes: Vec::new() });
    }
    for k in 0..joints {
        let parent = match links.len() {
            0 => None,
            // Mostly chains, some branches, and on a fixed base some trees of their own.
            n if rng.random_range(0.0..1.0) < 0.6 => Some(n - 1),
            _ if !floating && rng.random_range(0.0..1.0) < 0.1 => None,
            n => Some(rng.random_range(0..n)),
        };
        let kind = [JointKind::Revolute, JointKind::Continuous, JointKind::Prismatic][rng.random_range(0..3)];
        let axis = Unit::new_normalize(vector3(rng, 1.0) + Vector3::new(0.0, 0.0, 1.1));
        let mut joint = Joint::new(format!("joint{k}"), kind, pose(rng, 0.3), axis);
        joint.armature = rng.random_range(0.0..0.1);
        links.push(Link { name: format!("link{k}"), parent, joint: Some(joint), inertia: body(rng), shapes: Vec::new() });
    }
    let mut robot = Robot::new("random", base);
    robot.links = links;
    robot
}

/// The same robot with some joints that follow others, which may stand on other branches, above or below them.
pub fn following(rng: &mut Rng, robot: &Robot) -> Robot {
    let mut robot = robot.clone();
    let joints: Vec<usize> = (0..robot.links.len()).filter(|i| robot.links[*i].joint.is_some()).collect();
    let free: Vec<usize> = joints.iter().copied().filter(|_| rng.random_range(0.0..1.0) < 0.6).collect();
    for link in joints.iter().filter(|l| !free.contains(l) && !free.is_empty()) {
        let coordinate = rng.random_range(0..free.len());
        let (multiplier, offset) = (rng.random_range(-1.5..1.5), rng.random_range(-0.5..0.5));
        robot.follow(*link, Some(Mimic { coordinate, multiplier, offset }));
    }
    robot
}

/// Random coordinates and local velocities `(w, p_dot, joints)`.
pub fn state(rng: &mut Rng, robot: &Robot) -> (Vec<f64>, Vec<f64>) {
    let mut q = values(rng, robot.nq(), 2.0);
    if robot.floating() {
        write_quaternion(&mut q[3..7], &rotation(rng));
    }
    (q, values(rng, robot.nv(), 1.0))
}

/// The 24 robots most tests run on, 1 to 30 joints, every second one floating, each with a generator of its own.
pub fn robots() -> impl Iterator<Item = (Robot, Rng)> {
    (0..24u64).map(|seed| {
        let mut rng = Rng::seed_from_u64(seed);
        let joints = [1, 2, 3, 5, 7, 9, 12, 14, 18, 22, 26, 30][seed as usize / 2];
        (robot(&mut rng, joints, seed % 2 == 1), rng)
    })
}

/// Random wrenches on every link.
pub fn push(rng: &mut Rng, data: &mut Data) {
    for w in &mut data.external {
        *w = Wrench::new(vector3(rng, 5.0), vector3(rng, 5.0));
    }
}

/// Coordinates after moving for `h` s at the constant local velocity `qd`.
pub fn moved(robot: &Robot, q: &[f64], qd: &[f64], h: f64) -> Vec<f64> {
    let mut out = q.to_vec();
    if robot.floating() {
        for k in 0..3 {
            out[k] += h * qd[3 + k];
        }
        write_quaternion(&mut out[3..7], &(UnitQuaternion::from_scaled_axis(vector(qd) * h) * quaternion(&q[3..7])));
    }
    for (x, v) in out[robot.root_coords()..].iter_mut().zip(&qd[robot.root_dofs()..]) {
        *x += h * v;
    }
    out
}

/// Kinetic energy of the links and of the drives' armature (J).
pub fn kinetic(robot: &Robot, q: &[f64], qd: &[f64], data: &mut Data) -> f64 {
    kinematics(robot, q, data);
    inertias(robot, data);
    velocities(robot, qd, data);
    let links: f64 = data.velocity.iter().zip(&data.inertia).map(|(v, i)| 0.5 * v.dot(&i.apply(v))).sum();
    let drives: f64 = robot.joints().zip(&qd[robot.root_dofs()..]).map(|(j, v)| 0.5 * j.armature * v * v).sum();
    links + drives
}

/// Potential energy (J).
pub fn potential(robot: &Robot, q: &[f64], data: &mut Data) -> f64 {
    kinematics(robot, q, data);
    let g = Vector3::from(GRAVITY);
    robot.links.iter().enumerate().map(|(i, l)| -l.inertia.mass * g.dot(&point_position(data, i, &l.inertia.com))).sum()
}

/// Accelerations by dense Cholesky of the mass matrix, an algorithm apart from ABA and from `Factor`.
pub fn dense(mass: &DMatrix<f64>, rhs: impl Iterator<Item = f64>) -> Vec<f64> {
    let factor = mass.clone().cholesky().expect("a mass matrix is positive definite");
    factor.solve(&nalgebra::DVector::from_iterator(mass.nrows(), rhs)).as_slice().to_vec()
}

/// Largest difference, over the largest entry of `b` (or 1 if that is smaller).
pub fn gap(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    let scale = b.iter().fold(1.0f64, |m, x| m.max(x.abs()));
    a.iter().zip(b).fold(0.0f64, |m, (x, y)| if x.is_nan() || y.is_nan() { f64::NAN } else { m.max((x - y).abs()) }) / scale
}

/// `Rz Ry Rx`, written out.
pub fn rpy([roll, pitch, yaw]: [f64; 3]) -> Matrix3<f64> {
    let about = |axis, angle| Rotation3::from_axis_angle(&axis, angle);
    *(about(Vector3::z_axis(), yaw) * about(Vector3::y_axis(), pitch) * about(Vector3::x_axis(), roll)).matrix()
}
