//! Robots and cables that come with the crate.

/// Name, specification and URDF of each built-in robot.
macro_rules! built_in {
    ($($name:literal, $urdf:literal;)*) => {
        [$(($name, include_str!(concat!("../../assets/", $name, ".toml")), include_str!(concat!("../../assets/", $urdf, ".urdf")))),*]
    };
}

pub(super) const BUILT_IN: [(&str, &str, &str); 12] = built_in! {
    "cartpole", "cartpole";
    "pendulum", "pendulum";
    "cube", "cube";
    "franka", "franka";
    "ant", "ant";
    "anymal", "anymal";
    "cartpole-paper", "cartpole";
    "pendulum-paper", "pendulum";
    "cube-paper", "cube";
    "franka-paper", "franka";
    "ant-paper", "ant";
    "anymal-paper", "anymal-paper";
};

/// Name, specification and URDF of each built-in robot with a `[vary]`: a family of robots.
pub(super) const FAMILIES: [(&str, &str, &str); 6] = built_in! {
    "pendulum-family", "pendulum";
    "franka-family", "franka";
    "ant-family", "ant";
    "anymal-family", "anymal";
    "cube-family", "cube-family";
    "elbow-family", "elbow-family";
};

/// Name and specification of each built-in cable.
pub(super) const CABLES: [(&str, &str); 2] = [
    ("lead", include_str!("../../assets/cables/lead.toml")),
    ("lead-pegs", include_str!("../../assets/cables/lead-pegs.toml")),
];

/// Keys of a robot's TOML that do not apply to a cable, and the reason or alternative.
pub(crate) const FOREIGN: [(&str, &str); 5] = [
    ("floating", "a cable's root is decided by [cable] support"),
    ("urdf", "a cable has none, [cable] says all of it"),
    ("mesh_points", "a cable has no meshes"),
    ("self_collision", "a cable's rods do not touch each other"),
    ("like", "a cable is like no other robot"),
];
