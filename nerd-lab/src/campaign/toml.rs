//! Specifications with their URDFs: read, then everything that is drawn from them: scenes, starts, data, motion.

use std::sync::Arc;

use nerd_sim::dataset::{GenerateConfig, Recording, record};
use nerd_sim::prelude::*;
use nerd_sim::sampling::{Start, start, stream};
use rand::{Rng, RngExt};

use crate::campaign::case::{Fault, Files, Judged, fault, text};
use crate::campaign::mutate::{ODD, anything, pick, pick_line, times};
use crate::campaign::robots::{finite, robot, roll};
use crate::campaign::urdf;

const FILE: &str = "robot.toml";
const URDF: &str = "robot.urdf";

/// What a key may be, and is not.
const VALUES: &str = r#"true
"text"
"U(1, 1)"
"U(-1e308, 1e308)"
"U(0, 1/0)"
[]
{}
[0.0, 0.0, 0.0]
"1e-300""#;

/// What may stand in a line more.
const MORE: &str = r#"damping = 1.0
substeps = 0
frame_time = "1"
gain = nan
limit = { stiffness = -1.0, damping = inf }
random_plane = { reach = nan, clearance = -1.0 }
control = { scale = 1.0, ahead = true, data = { kp = "U(0, 1e9)", kd = "U(-1, 0)" } }
data_scene = "hills"
material = { stiffness = 1e4, damping = -1.0, friction_damping = 1e3, friction = -0.5 }
clearance = 1e9
column = "tau1"
column = "step"
torque_columns = ["a", "a"]
like = "ant"
like = "robot"
truth = "paper""#;

/// A robot's specification, changed; sometimes its URDF, too.
pub fn make(rng: &mut impl Rng) -> Files {
    let (spec, xml) = robot(rng);
    let (mut spec, mut xml) = (spec.as_bytes().to_vec(), xml.as_bytes().to_vec());
    for _ in 0..times(rng) {
        change(rng, &mut spec);
    }
    if rng.random_range(0..8) == 0 {
        urdf::change(rng, &mut xml);
    }
    Files::from([(FILE.into(), spec), (URDF.into(), xml)])
}

/// Values and keys of `key = value` lines, or anything.
fn change(rng: &mut impl Rng, file: &mut Vec<u8>) {
    let Ok(spec) = std::str::from_utf8(file) else { return anything(rng, file) };
    let mut lines: Vec<String> = spec.lines().map(String::from).collect();
    let pairs: Vec<usize> = (0..lines.len()).filter(|i| lines[*i].contains(" = ")).collect();
    if pairs.is_empty() {
        return anything(rng, file);
    }
    let (a, b) = (pairs[rng.random_range(0..pairs.len())], pairs[rng.random_range(0..pairs.len())]);
    let split = |line: &str| line.split_once(" = ").map(|(k, v)| (k.to_string(), v.to_string())).unwrap_or_default();
    let ((key, _), (other, value)) = (split(&lines[a]), split(&lines[b]));
    match rng.random_range(0..8) {
        // Two keys with one's value, or a key of another place.
        0 => lines[a] = format!("{key} = {value}"),
        1 => lines[a] = format!("{other} = {value}"),
        2 => lines[a] = format!("{key} = {}", pick_line(rng, VALUES)),
        3 if rng.random_range(0..16) == 0 => lines[a] = format!("{key} = \"1{}\"", "/1".repeat(200_000)),
        3 => lines[a] = format!("{key} = {}", pick(rng, ODD)),
        4 => lines.insert(b, pick_line(rng, MORE).into()),
        _ => return anything(rng, file),
    }
    *file = lines.join("\n").into_bytes();
}

/// Reads them, and draws what training and evaluation would.
pub fn judge(files: &Files) -> Judged {
    let system = Arc::new(System::from_text("robot", text(files, URDF)?, Some(text(files, FILE)?))?);
    finite(&system)?;
    for name in system.scene_names() {
        let scene = system.scene(name)?;
        if let Some(plane) = scene.colliders.iter().filter_map(|c| c.plane).find(|p| !p.normal.iter().all(|x| x.is_finite())) {
            return fault(Fault::NotFinite, format!("scene `{name}`: {plane:?}"));
        }
    }
    let frames = 3;
    let config = GenerateConfig { transitions: 2 * frames, frames, seed: 1, ..Default::default() };
    for truth in [Truth::Articulated, Truth::Paper] {
        wrong(&record(&system, &mut *truth.solver(&system), &config, 0, 2)?)?;
    }
    let scene = system.scene(system.usual_scenes().last().copied().unwrap_or("free"))?;
    let state = start(&system, Start::Reset, &mut stream(1, 2));
    if state.iter().any(|x| !x.is_finite()) {
        return fault(Fault::NotFinite, format!("a start is {state:?}"));
    }
    roll(&system, &scene, &state, &system.torque_amplitudes())
}

/// Refuses recorded data that no learner should see. Distances in empty space are infinite.
fn wrong(recording: &Recording) -> Judged {
    recording.arrays().iter().try_for_each(|(name, _, x)| {
        match x.iter().find(|x| !(x.is_finite() || *name == "depths" && **x == f64::INFINITY)) {
            Some(bad) => fault(Fault::NotFinite, format!("`{name}` of the data holds {bad}")),
            None => Ok(()),
        }
    })
}
