//! Small systems for single questions: a free body, pendulums, a slider. Built from URDF and TOML; z is up.

use nerd_sim::prelude::*;

/// The identity orientation (x y z w).
pub const UPRIGHT: [f64; 4] = [0.0, 0.0, 0.0, 1.0];

/// A free rigid body.
#[derive(Clone, Debug)]
pub struct Body {
    /// URDF geometry, such as `<sphere radius="0.1"/>`.
    pub shape: String,
    /// Four feet in place of `shape`: spheres of 0.02 m at half distances x and y, and a distance z below the body
    /// frame.
    pub feet: Option<[f64; 3]>,
    /// Mass (kg).
    pub mass: f64,
    /// Principal moments of inertia (kg m^2).
    pub inertia: [f64; 3],
    /// Centre of mass (m) in the body frame.
    pub com: [f64; 3],
    /// Roll, pitch and yaw (rad) of the principal axes.
    pub rpy: [f64; 3],
    /// Frame time (s), as in a specification, such as `1/60`.
    pub frame: &'static str,
    /// Gravity (m/s^2), pointing down.
    pub gravity: f64,
    /// Inclination of the ground (rad) about y.
    pub slope: f64,
    /// Contact stiffness (N/m), damping (N s/m), tangential damping (N s/m), friction coefficient.
    pub material: [f64; 4],
}

impl Default for Body {
    /// A cube of 0.2 m and 1 kg.
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
    /// The system, with scenes `free` and `ground`.
    pub fn system(&self) -> Result<Arc<System>, SystemError> {
        let i = self.inertia;
        let c = self.com;
        let r = self.rpy;
        let m = self.material;
        let collision = |at: [f64; 3], shape: &str| {
            format!(
                r#"<collision><origin xyz="{} {} {}"/><geometry>{shape}</geometry></collision>"#,
                at[0], at[1], at[2]
            )
        };
        let collisions = match self.feet {
            None => collision([0.0; 3], &self.shape),
            Some([x, y, z]) => [[x, y], [x, -y], [-x, y], [-x, -y]]
                .map(|[x, y]| collision([x, y, -z], r#"<sphere radius="0.02"/>"#))
                .concat(),
        };
        let urdf = format!(
            r#"<robot name="body"><link name="body"><inertial><origin xyz="{} {} {}" rpy="{} {} {}"/><mass value="{}"/><inertia ixx="{}" ixy="0" ixz="0" iyy="{}" iyz="0" izz="{}"/></inertial>{}</link></robot>"#,
            c[0], c[1], c[2], r[0], r[1], r[2], self.mass, i[0], i[1], i[2], collisions
        );
        let toml = format!(
            "urdf = \"\"\nfloating = true\nframe_time = \"{}\"\ngravity = [0.0, 0.0, {:?}]\nsubsteps = 16\n\
             material = {{ stiffness = {:?}, damping = {:?}, friction_damping = {:?}, friction = {:?} }}\n\
             [[scene]]\nname = \"ground\"\nplane = {{ height = 0.0, angles = [0.0, {:?}, 0.0] }}\n",
            self.frame, -self.gravity, m[0], m[1], m[2], m[3], self.slope
        );
        System::from_text("body", &urdf, Some(&toml)).map(Arc::new)
    }

    /// A state from position p, orientation q (x y z w), angular velocity w and velocity v of the origin, world axes.
    pub fn state(p: [f64; 3], q: [f64; 4], w: [f64; 3], v: [f64; 3]) -> Vec<f64> {
        let [p_, w_, v_] = [p, w, v].map(nalgebra::Vector3::from);
        let twist = v_ - w_.cross(&p_);
        [&p[..], &q[..], &w[..], twist.as_slice()].concat()
    }

    /// The upright state with zero velocities at position p.
    pub fn at(p: [f64; 3]) -> Vec<f64> {
        Self::state(p, UPRIGHT, [0.0; 3], [0.0; 3])
    }
}

/// Hinges in a row with axes along y; each link is 1 m long along x with its mass (kg) at the end. `joint` is
/// additional TOML of every joint, `frame` the frame time (s), `gravity` (m/s^2) points down.
pub fn chain(masses: &[f64], joint: &str, frame: &str, gravity: f64) -> Result<Arc<System>, SystemError> {
    let mut urdf = String::from(r#"<robot name="chain"><link name="l0"/>"#);
    let mut toml = format!(
        "urdf = \"\"\nfloating = false\nframe_time = \"{frame}\"\ngravity = [0.0, 0.0, {:?}]\nsubsteps = 16\n",
        -gravity
    );
    for (k, m) in masses.iter().enumerate() {
        // A small inertia keeps the mass matrix regular.
        let i = 1e-4 * m;
        urdf += &format!(
            r#"<link name="l{n}"><inertial><origin xyz="1 0 0"/><mass value="{m}"/><inertia ixx="{i}" ixy="0" ixz="0" iyy="{i}" iyz="0" izz="{i}"/></inertial></link><joint name="j{n}" type="continuous"><parent link="l{k}"/><child link="l{n}"/><origin xyz="{x} 0 0"/><axis xyz="0 1 0"/></joint>"#,
            n = k + 1,
            x = if k == 0 { 0 } else { 1 }
        );
        toml += &format!(
            "[[joint]]\nname = \"j{}\"\n{joint}sample = {{ q = \"U(-1, 1)\", qd = \"U(-1, 1)\" }}\nreset = {{ q = \"U(0, 0)\", qd = \"U(0, 0)\" }}\n",
            k + 1
        );
    }
    System::from_text("chain", &(urdf + "</robot>"), Some(&toml)).map(Arc::new)
}

/// A 1 kg slider along x without gravity; its limit at 0.5 m is a spring of 1e4 N/m.
pub fn slider() -> Result<Arc<System>, SystemError> {
    let urdf = r#"<robot name="slider"><link name="rail"/><link name="box"><inertial><mass value="1"/><inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link><joint name="slide" type="prismatic"><parent link="rail"/><child link="box"/><axis xyz="1 0 0"/><limit lower="-0.5" upper="0.5" effort="1" velocity="1"/></joint></robot>"#;
    let toml = "urdf = \"\"\nfloating = false\nframe_time = \"1/60\"\ngravity = [0.0, 0.0, 0.0]\nsubsteps = 16\n[[joint]]\nname = \"slide\"\nlimit = { stiffness = 1e4, damping = 0.0 }\nsample = { q = \"U(0, 0)\", qd = \"U(0, 0)\" }\nreset = { q = \"U(0, 0)\", qd = \"U(0, 0)\" }\n";
    System::from_text("slider", urdf, Some(toml)).map(Arc::new)
}

/// A bob of 1 kg, 1 m below a universal joint that rotates about x, then about y.
pub fn universal() -> Result<Arc<System>, SystemError> {
    let link = |name: &str, at: &str, mass: f64| {
        format!(
            r#"<link name="{name}"><inertial><origin xyz="{at}"/><mass value="{mass}"/><inertia ixx="1e-6" ixy="0" ixz="0" iyy="1e-6" iyz="0" izz="1e-6"/></inertial></link>"#
        )
    };
    let joint = |name: &str, parent: &str, child: &str, axis: &str| {
        format!(
            r#"<joint name="{name}" type="continuous"><parent link="{parent}"/><child link="{child}"/><axis xyz="{axis}"/></joint>"#
        )
    };
    let urdf = [
        r#"<robot name="universal"><link name="base"/>"#.to_string(),
        link("cross", "0 0 0", 1e-3),
        link("bob", "0 0 -1", 1.0),
        joint("x", "base", "cross", "1 0 0"),
        joint("y", "cross", "bob", "0 1 0"),
        "</robot>".to_string(),
    ];
    System::from_text("universal", &urdf.concat(), None).map(Arc::new)
}
