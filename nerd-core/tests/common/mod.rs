//! Random robots and states, and pieces of URDF, shared by the tests. Every seed is fixed.
#![allow(dead_code, unused_imports)]

pub use nalgebra::{DMatrix, DVector};
use nalgebra::{Rotation3, Translation3, Unit};
pub use nerd_core::prelude::*;
use nerd_core::robot::{FreeRoot, Mimic};
use rand::RngExt;
pub use rand::SeedableRng;
pub use rand_chacha::ChaCha8Rng as Rng;

/// Gravity of the tests (m/s^2), along no coordinate axis.
pub const GRAVITY: Vector3<f64> = Vector3::new(0.4, -1.1, -9.7);

pub fn vector3(rng: &mut Rng, scale: f64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| rng.random_range(-scale..scale))
}

pub fn values(rng: &mut Rng, n: usize, scale: f64) -> Vec<f64> {
    (0..n).map(|_| rng.random_range(-scale..scale)).collect()
}

pub fn rotation(rng: &mut Rng) -> UnitQuaternion<f64> {
    UnitQuaternion::from_scaled_axis(vector3(rng, 2.0))
}

pub fn pose(rng: &mut Rng, scale: f64) -> Isometry3<f64> {
    Isometry3::from_parts(Translation3::from(vector3(rng, scale)), rotation(rng))
}

/// A physically possible body: second moments of mass `a, b, c` along rotated axes.
pub fn body(rng: &mut Rng) -> BodyInertia {
    let [a, b, c] = [0; 3].map(|_| rng.random_range(0.005..0.05));
    let r = rotation(rng).to_rotation_matrix();
    let inertia = r.matrix() * Matrix3::from_diagonal(&Vector3::new(b + c, a + c, a + b)) * r.matrix().transpose();
    BodyInertia { mass: rng.random_range(0.5..2.0), com: vector3(rng, 0.2), inertia }
}

/// Compensates part of each link's weight, and gives a floating root armature and damping.
pub fn lifted(rng: &mut Rng, robot: &mut Robot) {
    for link in &mut robot.links {
        link.lifted = PointMass { mass: rng.random_range(0.0..1.0), at: vector3(rng, 0.2) };
    }
    if robot.floating() {
        robot.free = FreeRoot { armature: 0.3, damping: 0.7 };
        robot.links[0].arm(0.3);
    }
}

/// A random tree with `joints` moving joints of all types, with armature, on a fixed or a floating base.
pub fn robot(rng: &mut Rng, joints: usize, floating: bool) -> Robot {
    let mut robot = Robot::new("random", if floating { Base::Floating } else { Base::Fixed(pose(rng, 1.0)) });
    if floating {
        robot.links.push(Link::new("root", None, None, body(rng)));
    }
    for k in 0..joints {
        let parent = match robot.links.len() {
            0 => None,
            // Mostly chains, some branches, and on a fixed base some separate trees.
            n if rng.random_range(0.0..1.0) < 0.6 => Some(n - 1),
            _ if !floating && rng.random_range(0.0..1.0) < 0.1 => None,
            n => Some(rng.random_range(0..n)),
        };
        let kind = [JointKind::Revolute, JointKind::Continuous, JointKind::Prismatic][rng.random_range(0..3)];
        let axis = Unit::new_normalize(vector3(rng, 1.0) + Vector3::new(0.0, 0.0, 1.1));
        let mut joint = Joint::new(format!("joint{k}"), kind, pose(rng, 0.3), axis);
        joint.armature = rng.random_range(0.0..0.1);
        robot.links.push(Link::new(format!("link{k}"), parent, Some(joint), body(rng)));
    }
    robot
}

/// The robot with some joints made mimic joints. Their leaders may be on other branches, above or below them.
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

pub fn state(rng: &mut Rng, robot: &Robot) -> (Vec<f64>, LocalVelocity<Vec<f64>>) {
    let mut q = values(rng, robot.nq(), 2.0);
    if robot.floating() {
        write_quaternion(&mut q[3..7], &rotation(rng));
    }
    (q, LocalVelocity(values(rng, robot.nv(), 1.0)))
}

/// The 24 robots of most tests, with 1 to 30 joints, every second one floating, each with its random generator.
pub fn robots() -> impl Iterator<Item = (Robot, Rng)> {
    (0..24u64).map(|seed| {
        let mut rng = Rng::seed_from_u64(seed);
        let joints = [1, 2, 3, 5, 7, 9, 12, 14, 18, 22, 26, 30][seed as usize / 2];
        (robot(&mut rng, joints, seed % 2 == 1), rng)
    })
}

pub fn push(rng: &mut Rng, data: &mut Data) {
    data.external.iter_mut().for_each(|w| *w = Wrench::new(vector3(rng, 5.0), vector3(rng, 5.0)));
}

/// The state `[q, qd]` of coordinates and local velocities.
pub fn whole(robot: &Robot, q: &[f64], qd: &LocalVelocity<Vec<f64>>) -> Vec<f64> {
    [q, &qd.clone().into_twist(robot, q).0].concat()
}

/// Coordinates after moving for `h` s at the constant local velocity `qd`.
pub fn moved(robot: &Robot, q: &[f64], qd: &LocalVelocity<Vec<f64>>, h: f64) -> Vec<f64> {
    let mut state = whole(robot, q, qd);
    qd.advance(robot, &mut state, h);
    state.truncate(robot.nq());
    state
}

/// Rate of `f` at the state by a central difference over `2 h` s.
pub fn rate<T>(robot: &Robot, q: &[f64], qd: &LocalVelocity<Vec<f64>>, h: f64, mut f: impl FnMut(&[f64]) -> T) -> T
where
    T: std::ops::Sub<Output = T> + std::ops::Div<f64, Output = T>,
{
    let [ahead, behind] = [h, -h].map(|h| f(&moved(robot, q, qd, h)));
    (ahead - behind) / (2.0 * h)
}

/// Accelerations by dense Cholesky of the mass matrix, independent of ABA and of `Factor`.
pub fn dense(mass: &DMatrix<f64>, rhs: &[f64]) -> Vec<f64> {
    let factor = mass.clone().cholesky().expect("a mass matrix is positive definite");
    factor.solve(&DVector::from_column_slice(rhs)).as_slice().to_vec()
}

/// Largest absolute difference, divided by the largest entry of `b` or by 1 if that is larger.
pub fn gap(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    let scale = b.iter().fold(1.0f64, |m, x| m.max(x.abs()));
    a.iter().zip(b).fold(0.0f64, |m, (x, y)| if x.is_nan() || y.is_nan() { f64::NAN } else { m.max((x - y).abs()) })
        / scale
}

/// Rotation matrix `Rz Ry Rx`, written out.
pub fn rpy([roll, pitch, yaw]: [f64; 3]) -> Matrix3<f64> {
    let about = |axis, angle| Rotation3::from_axis_angle(&axis, angle);
    *(about(Vector3::z_axis(), yaw) * about(Vector3::y_axis(), pitch) * about(Vector3::x_axis(), roll)).matrix()
}

/// A `<link>` of 1 kg and 1 kg m^2 about each axis.
pub fn link(name: &str) -> String {
    let inertia = r#"<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>"#;
    format!(r#"<link name="{name}"><inertial><mass value="1"/>{inertia}</inertial></link>"#)
}

pub fn joint(name: &str, kind: &str, parent: &str, child: &str, inner: &str) -> String {
    format!(r#"<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{inner}</joint>"#)
}

pub fn urdf(parts: &[String]) -> String {
    format!(r#"<robot name="r">{}</robot>"#, parts.concat())
}

/// The error message for a refused URDF, checked to be one line.
pub fn refusal(text: &str, base: Base) -> String {
    let said = Robot::from_urdf(text, base).expect_err("a refusal").to_string();
    assert!(!said.contains('\n'), "more than one line: {said}");
    said
}

pub fn changed(text: &str, from: &str, to: &str) -> String {
    assert!(text.contains(from), "`{from}` is not in the text");
    text.replacen(from, to, 1)
}
