//! Small systems that the rows step: a free body, pendulums, a slider. They are built from URDF and TOML; z is up.

use nerd_sim::prelude::*;

/// The identity orientation as a quaternion (x y z w).
pub const UPRIGHT: [f64; 4] = [0.0, 0.0, 0.0, 1.0];

/// Description of a free rigid body and of the ground below it.
#[derive(Clone, Debug)]
pub struct Body {
    /// URDF geometry, such as `<sphere radius="0.1"/>`.
    pub shape: String,
    /// `[x, y, z]` (m) of four feet at (+-x, +-y, -z) in the body frame, which replace `shape`. Feet are spheres with a
    /// radius of 0.02 m.
    pub feet: Option<[f64; 3]>,
    /// Mass (kg).
    pub mass: f64,
    /// Principal moments of inertia about the centre of mass (kg m^2).
    pub inertia: [f64; 3],
    /// Centre of mass (m) in the body frame.
    pub com: [f64; 3],
    /// Roll, pitch and yaw (rad) of the principal axes in the body frame.
    pub rpy: [f64; 3],
    /// Frame time (s) as text of a robot's TOML, such as `1/60`.
    pub frame: &'static str,
    /// Gravitational acceleration (m/s^2), downwards.
    pub gravity: f64,
    /// Inclination of the ground: its rotation about y (rad).
    pub slope: f64,
    /// Contact stiffness (N/m), damping (N s/m), tangential damping (N s/m), friction coefficient.
    pub material: [f64; 4],
}

impl Default for Body {
    /// Makes a cube of 1 kg with edges of 0.2 m.
    fn default() -> Self {
        Self {
            shape: r#"<box size="0.2 0.2 0.2"/>"#.into(),
            feet: None,
            mass: 1.0,
            inertia: [1.0 / 150.0; 3],
            com: [0.0; 3],
            rpy: [0.0; 3],
            frame: "1/60",
            gravity: GRAVITY,
            slope: 0.0,
            material: [1e4, 100.0, 1e3, 0.5],
        }
    }
}

impl Body {
    /// Makes a system of the body, with the scenes `free` (nothing) and `ground` (a plane through the origin).
    pub fn system(&self) -> Result<Arc<System>, SystemError> {
        let collision = |[x, y, z]: [f64; 3], shape: &str| {
            format!(r#"<collision><origin xyz="{x} {y} {z}"/><geometry>{shape}</geometry></collision>"#)
        };
        let collisions = match self.feet {
            None => collision([0.0; 3], &self.shape),
            Some([x, y, z]) => [[x, y], [x, -y], [-x, y], [-x, -y]]
                .map(|[x, y]| collision([x, y, -z], r#"<sphere radius="0.02"/>"#))
                .concat(),
        };
        let [x, y, z] = self.com;
        let [roll, pitch, yaw] = self.rpy;
        let [ixx, iyy, izz] = self.inertia;
        let origin = format!(r#"<origin xyz="{x} {y} {z}" rpy="{roll} {pitch} {yaw}"/>"#);
        let inertia = format!(r#"<inertia ixx="{ixx}" ixy="0" ixz="0" iyy="{iyy}" iyz="0" izz="{izz}"/>"#);
        let inertial = format!(r#"<inertial>{origin}<mass value="{}"/>{inertia}</inertial>"#, self.mass);
        let urdf = format!(r#"<robot name="body"><link name="body">{inertial}{collisions}</link></robot>"#);
        let [stiffness, damping, friction_damping, friction] = self.material;
        let toml = format!(
            "urdf = \"\"\nfloating = true\nframe_time = \"{}\"\ngravity = [0.0, 0.0, {:?}]\nsubsteps = 16\n\
             material = {{ stiffness = {stiffness:?}, damping = {damping:?}, \
             friction_damping = {friction_damping:?}, friction = {friction:?} }}\n\
             [[scene]]\nname = \"ground\"\nplane = {{ height = 0.0, angles = [0.0, {:?}, 0.0] }}\n",
            self.frame, -self.gravity, self.slope
        );
        System::from_text("body", &urdf, Some(&toml)).map(Arc::new)
    }

    /// Returns the body's state `[q, qd]`. `p` (m) and `v` (m/s) are the position and velocity of the body frame's
    /// origin. `q` (x y z w) and `w` (rad/s) are its orientation and angular velocity. All are in world axes.
    pub fn state(p: [f64; 3], q: [f64; 4], w: [f64; 3], v: [f64; 3]) -> Vec<f64> {
        let [place, spin, velocity] = [p, w, v].map(nalgebra::Vector3::from);
        let velocity_at_world_origin = velocity - spin.cross(&place);
        [&p[..], &q[..], &w[..], velocity_at_world_origin.as_slice()].concat()
    }

    /// Returns the state of the upright body at rest, with its origin at `p` (m).
    pub fn at(p: [f64; 3]) -> Vec<f64> {
        Self::state(p, UPRIGHT, [0.0; 3], [0.0; 3])
    }
}

/// Writes the URDF of a link with its `mass` (kg) at `place` (m, three numbers). The small moment of inertia (kg m^2),
/// the same about every axis, keeps the mass matrix regular.
fn link(name: &str, place: &str, mass: f64, moment: impl std::fmt::Display) -> String {
    let inertia = format!(r#"<inertia ixx="{moment}" ixy="0" ixz="0" iyy="{moment}" iyz="0" izz="{moment}"/>"#);
    let inertial = format!(r#"<inertial><origin xyz="{place}"/><mass value="{mass}"/>{inertia}</inertial>"#);
    format!(r#"<link name="{name}">{inertial}</link>"#)
}

/// Makes a chain of links on hinges with axes along y. Each link is 1 m long along x, with its mass (kg) at its end.
/// `joint`: TOML lines added to every joint. `frame`: frame time (s), such as `1/60`. `gravity`: acceleration (m/s^2),
/// downwards.
pub fn chain(masses: &[f64], joint: &str, frame: &str, gravity: f64) -> Result<Arc<System>, SystemError> {
    let mut urdf = String::from(r#"<robot name="chain"><link name="l0"/>"#);
    let mut toml = format!(
        "urdf = \"\"\nfloating = false\nframe_time = \"{frame}\"\ngravity = [0.0, 0.0, {:?}]\nsubsteps = 16\n",
        -gravity
    );
    for (k, mass) in masses.iter().enumerate() {
        let n = k + 1;
        let x = if k == 0 { 0 } else { 1 };
        let links = format!(r#"<parent link="l{k}"/><child link="l{n}"/>"#);
        let hinge = format!(r#"<origin xyz="{x} 0 0"/><axis xyz="0 1 0"/>"#);
        urdf += &link(&format!("l{n}"), "1 0 0", *mass, 1e-4 * mass);
        urdf += &format!(r#"<joint name="j{n}" type="continuous">{links}{hinge}</joint>"#);
        toml += &format!(
            "[[joint]]\nname = \"j{n}\"\n{joint}\
             sample = {{ q = \"U(-1, 1)\", qd = \"U(-1, 1)\" }}\nreset = {{ q = \"U(0, 0)\", qd = \"U(0, 0)\" }}\n"
        );
    }
    System::from_text("chain", &(urdf + "</robot>"), Some(&toml)).map(Arc::new)
}

/// Makes a slider of 1 kg along x, without gravity. Its limits, at -0.5 and 0.5 m, are springs of 1e4 N/m.
pub fn slider() -> Result<Arc<System>, SystemError> {
    let urdf = concat!(
        r#"<robot name="slider"><link name="rail"/><link name="box"><inertial><mass value="1"/>"#,
        r#"<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>"#,
        r#"<joint name="slide" type="prismatic"><parent link="rail"/><child link="box"/><axis xyz="1 0 0"/>"#,
        r#"<limit lower="-0.5" upper="0.5" effort="1" velocity="1"/></joint></robot>"#,
    );
    let toml = "urdf = \"\"\nfloating = false\nframe_time = \"1/60\"\ngravity = [0.0, 0.0, 0.0]\nsubsteps = 16\n\
                [[joint]]\nname = \"slide\"\nlimit = { stiffness = 1e4, damping = 0.0 }\n\
                sample = { q = \"U(0, 0)\", qd = \"U(0, 0)\" }\nreset = { q = \"U(0, 0)\", qd = \"U(0, 0)\" }\n";
    System::from_text("slider", urdf, Some(toml)).map(Arc::new)
}

/// Makes a pendulum: a bob of 1 kg, 1 m below a universal joint. The joint rotates about x, then about y.
pub fn universal() -> Result<Arc<System>, SystemError> {
    let joint = |name: &str, parent: &str, child: &str, axis: &str| {
        let links = format!(r#"<parent link="{parent}"/><child link="{child}"/>"#);
        format!(r#"<joint name="{name}" type="continuous">{links}<axis xyz="{axis}"/></joint>"#)
    };
    let urdf = [
        r#"<robot name="universal"><link name="base"/>"#.to_string(),
        link("cross", "0 0 0", 1e-3, "1e-6"),
        link("bob", "0 0 -1", 1.0, "1e-6"),
        joint("x", "base", "cross", "1 0 0"),
        joint("y", "cross", "bob", "0 1 0"),
        "</robot>".to_string(),
    ];
    System::from_text("universal", &urdf.concat(), None).map(Arc::new)
}
