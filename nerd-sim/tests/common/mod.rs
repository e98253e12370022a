//! Systems, batches and motions shared by the tests.
#![allow(dead_code, unused_imports)]

pub mod differences;

pub use nerd_sim::dataset::{GenerateConfig, record};
pub use nerd_sim::prelude::*;
pub use nerd_sim::scene::{Field, TerrainKind, TerrainSpec};

pub fn built_in(name: &str) -> Arc<System> {
    System::named(name).expect("built in")
}

/// A built-in robot that has the scene `terrain`: rubble of 10 cm.
pub fn on_rubble(name: &str) -> Arc<System> {
    let rubble = TerrainSpec { kind: TerrainKind::Rubble, height: 0.1, cell: 0.2, length: None, seed: Some(4) };
    Arc::new((*built_in(name)).clone().with_terrain(rubble).expect("in range"))
}

/// The articulated solver with this number of implicit substeps.
pub fn implicit(substeps: usize) -> Articulated {
    Articulated::new(ArticulatedConfig::implicit(substeps, Friction::Coulomb))
}

/// Settings that must agree without contact.
pub fn presets(system: &System) -> [(&'static str, ArticulatedConfig); 4] {
    let law = Friction::Coulomb;
    [
        ("paper", ArticulatedConfig::paper(system, law)),
        ("explicit", ArticulatedConfig::explicit(8, law)),
        ("implicit", ArticulatedConfig::implicit(4, law)),
        ("converged", ArticulatedConfig::converged(law)),
    ]
}

/// Environments at zero coordinates in a scene of their system.
pub fn batch(system: &Arc<System>, scene: &str, n: usize) -> Batch {
    Batch::new(system, &system.scene(scene).expect("a scene"), n)
}

pub fn at(system: &Arc<System>, scene: &str, state: &[f64]) -> Batch {
    within(system, &system.scene(scene).expect("a scene"), state)
}

/// One environment at a state in the given scene.
pub fn within(system: &Arc<System>, scene: &Arc<Scene>, state: &[f64]) -> Batch {
    let mut batch = Batch::new(system, scene, 1);
    batch.reset(0, state);
    batch
}

/// Steps a batch with the same torque (N m or N) at every joint.
pub fn run(solver: &mut (impl Solver + ?Sized), batch: &mut Batch, torque: f64, frames: usize) {
    let torques = vec![torque; batch.len() * batch.system.robot.joint_count()];
    (0..frames).for_each(|frame| solver.step(batch, &torques).unwrap_or_else(|e| panic!("frame {frame}: {e}")));
}

/// States of a batch after each frame of `run`.
pub fn motion(solver: &mut (impl Solver + ?Sized), mut batch: Batch, torque: f64, frames: usize) -> Vec<Vec<f64>> {
    let step = |_| {
        run(solver, &mut batch, torque, 1);
        batch.states.clone()
    };
    (0..frames).map(step).collect()
}

/// States of a batch after the last frame of `run`.
pub fn end(solver: &mut (impl Solver + ?Sized), mut batch: Batch, torque: f64, frames: usize) -> Vec<f64> {
    run(solver, &mut batch, torque, frames);
    batch.states
}

/// The error message, which must be one line.
pub fn line<T>(refused: Result<T, impl std::fmt::Display>) -> String {
    let Err(error) = refused.map(|_| ()) else { panic!("it is not refused") };
    let said = error.to_string();
    assert!(!said.contains('\n'), "more than one line: {said}");
    said
}

pub fn changed(text: &str, from: &str, to: &str) -> String {
    assert!(text.contains(from), "`{from}` is not in the text");
    text.replacen(from, to, 1)
}

/// `<link>` with a mass (kg) at a position (m), its principal inertia (kg m^2) about that position, and further
/// elements.
pub fn link(name: &str, mass: f64, [x, y, z]: [f64; 3], [xx, yy, zz]: [f64; 3], more: &str) -> String {
    format!(
        r#"<link name="{name}"><inertial><origin xyz="{x} {y} {z}"/><mass value="{mass}"/>
        <inertia ixx="{xx}" ixy="0" ixz="0" iyy="{yy}" iyz="0" izz="{zz}"/></inertial>{more}</link>"#
    )
}

/// `<collision>` of a shape at a position (m).
pub fn collision([x, y, z]: [f64; 3], shape: &str) -> String {
    format!(r#"<collision><origin xyz="{x} {y} {z}"/><geometry>{shape}</geometry></collision>"#)
}

pub fn joint(name: &str, kind: &str, [parent, child]: [&str; 2], inner: &str) -> String {
    format!(r#"<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{inner}</joint>"#)
}

pub fn urdf(parts: &[String]) -> String {
    format!(r#"<robot name="r">{}</robot>"#, parts.concat())
}

/// A fixed base without mass, `base`.
pub fn base() -> String {
    r#"<link name="base"/>"#.into()
}

/// Keys that every specification needs, with gravity (m/s^2) along -z.
pub fn keys(floating: bool, gravity: f64) -> String {
    format!("floating = {floating}\nframe_time = \"1/60\"\ngravity = [0.0, 0.0, {:?}]\nsubsteps = 16\n", -gravity)
}

/// `[[joint]]` of a name with more keys; it starts at zero.
pub fn joint_table(name: &str, more: &str) -> String {
    format!(
        "[[joint]]\nname = \"{name}\"\n{more}\nsample = {{ q = \"U(0, 0)\", qd = \"U(0, 0)\" }}\nreset = {{ q = \"U(0, 0)\", qd = \"U(0, 0)\" }}\n"
    )
}

/// `[[scene]]` with level ground.
pub const GROUND: &str = "[[scene]]\nname = \"ground\"\nplane = { height = 0.0, angles = [0.0, 0.0, 0.0] }\n";

/// A trunk on four legs of condim 6, 4, 1 and 3 with margins. One leg has a `<pair>`, and the trunk's geom meets
/// nothing.
pub fn crawler() -> Arc<System> {
    let leg = |k: usize, x: f64, y: f64, condim: usize| {
        format!(
            r#"<body name="l{k}" pos="{x} {y} 0"><joint name="j{k}" axis="0 1 0" armature=".01" damping=".1"/><geom name="f{k}" type="sphere"
            size=".04" pos=".05 0 -.1" mass=".2" condim="{condim}" margin=".002" friction=".8 .01 .005"/></body>"#
        )
    };
    let legs = [leg(0, 0.15, 0.1, 6), leg(1, 0.15, -0.1, 4), leg(2, -0.15, 0.1, 1), leg(3, -0.15, -0.1, 3)].concat();
    let text = format!(
        r#"<mujoco><worldbody><geom name="floor" type="plane" size="5 5 .1" friction=".5 .02 .01"/><body name="trunk" pos="0 0 .15"><freejoint/>
        <geom name="trunk" type="box" size=".2 .1 .03" mass="2" contype="2" conaffinity="2"/>{legs}</body></worldbody>
        <contact><pair geom1="floor" geom2="f3" condim="6" friction=".4 .4 .02 .01 .01" margin=".004"/></contact></mujoco>"#
    );
    Arc::new(System::from_text("crawler", &text, None).expect("a robot"))
}

/// A trunk with armature and damping on its free joint. Gravity compensation acts on the trunk in part, on its legs,
/// and on a box on one leg.
pub const LIFTED: &str = r#"<mujoco><worldbody><geom name="floor" type="plane" size="5 5 .1"/><body name="trunk" pos="0 0 .2" gravcomp=".4">
    <joint type="free" armature=".3" damping=".7"/><geom type="box" size=".2 .1 .03" pos=".03 0 .01" mass="2"/>
    <body name="left" pos=".1 .12 0" gravcomp="1"><joint name="a" axis="0 1 0" armature=".01" damping=".1"/>
    <geom type="sphere" size=".04" pos=".05 0 -.1" mass=".5"/><body name="box" pos="0 0 -.1"><geom type="box" size=".02 .03 .02" mass=".3"/></body></body>
    <body name="right" pos=".1 -.12 0" gravcomp="1.3"><joint name="b" axis="1 .2 0" armature=".01" damping=".1"/>
    <geom type="sphere" size=".04" pos=".05 0 -.1" mass=".5"/></body></body></worldbody>
    <actuator><motor joint="a" ctrlrange="-1 1"/><motor joint="b" ctrlrange="-1 1"/></actuator></mujoco>"#;

/// Puts crawlers near the ground, each with another angular velocity about y.
pub fn drop_low(batch: &mut Batch) {
    let d = batch.system.robot.state_dim();
    batch.states.chunks_exact_mut(d).enumerate().for_each(|(env, state)| (state[2], state[12]) = (0.15, env as f64));
}

/// A table of the reference simulator: its columns by name, and the numeric cells of each row.
pub struct Reference {
    pub columns: Vec<String>,
    pub rows: Vec<Vec<Option<f64>>>,
}

impl Reference {
    pub fn path(file: &str) -> std::path::PathBuf {
        std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/reference").join(file)
    }

    /// Read from `../shared/reference` beside the checkout when it is there.
    pub fn read(file: &str) -> Option<Self> {
        let path = Self::path(file);
        if !path.exists() {
            // Bypasses the test harness, which captures the output of tests that pass.
            use std::io::Write;
            let _ = writeln!(std::io::stderr(), "skipped: no reference data ({file})");
            return None;
        }
        let mut reader = csv::Reader::from_path(&path).expect("a table");
        let columns = reader.headers().expect("a header").iter().map(String::from).collect();
        let rows = reader.records().map(|row| row.expect("a row").iter().map(|cell| cell.parse().ok()).collect());
        Some(Self { columns, rows: rows.collect() })
    }

    pub fn places<S: AsRef<str>>(&self, names: &[S]) -> Vec<usize> {
        let place = |name: &S| self.columns.iter().position(|c| c == name.as_ref());
        names.iter().map(|name| place(name).unwrap_or_else(|| panic!("no column {}", name.as_ref()))).collect()
    }
}
