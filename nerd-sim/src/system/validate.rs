//! Validates a specification: ranges with their units, names, and consistency with the robot. A valid specification can
//! be simulated and sampled.
//!
//! Bounds lie far beyond the numbers of any robot. Products of a few numbers at their bounds are still finite.

use std::collections::HashSet;

use crate::robots::spec::{ContactSpec, ControlSpec, JointSpec, RootSpec, RootStart};
use crate::{internal::*, scene::WORLDS};

/// Maximum number of substeps per frame: for a robot with ten joints, such a frame takes 0.1 s to compute.
pub(crate) const MAX_SUBSTEPS: usize = 100_000;
/// Largest position (m).
const MAX_POSITION: f64 = 1e7;
/// Largest angle (rad), displacement of a sliding joint (m) or size of a shape (m).
const MAX_ANGLE_OR_LENGTH: f64 = 1e6;
/// Largest velocity (rad/s or m/s).
const MAX_VELOCITY: f64 = 1e6;
/// Largest force, stiffness or damping, in SI units.
const MAX_FORCE: f64 = 1e9;
const MAX_VERTICES: usize = 10_000;
/// Columns of trajectory tables that no coordinate may be named after.
pub(crate) const RESERVED: [&str; 2] = ["traj", "step"];

/// Checks a specification for `robot`; an error names key, value and requirement.
pub(crate) fn check(spec: &Spec, robot: &Robot) -> Result<(), String> {
    within(format!("frame_time = {:?}", spec.frame_time), spec.seconds(), 1e-6..=1.0, "s")?;
    within("substeps", spec.substeps as f64, 1.0..=MAX_SUBSTEPS as f64, "")?;
    within("mesh_points", spec.mesh_points as f64, 0.0..=MAX_VERTICES as f64, "")?;
    vector("gravity", &spec.gravity, 1e3, "m/s^2")?;
    let gravity = spec.gravity.iter().map(|g| g * g).sum::<f64>().sqrt();
    if spec.gravity != [0.0; 3] && gravity < 1e-6 {
        return Err(format!("gravity is {gravity} m/s^2; say 0, or at least 1e-6, which has a direction"));
    }
    spec.material.check().map_err(|e| format!("material: {e}"))?;
    if let Some(vary) = &spec.vary {
        vary.check(gravity > 0.0)?;
    }
    joints(spec, robot)?;
    if let Some(control) = &spec.control {
        self::control(control)?;
    }
    match &spec.root {
        Some(_) if !robot.floating() => return Err("[root] is for a floating robot; set floating = true".into()),
        Some(root) => self::root(root, spec.data_scene.is_some())?,
        None => {}
    }
    let known = |name: &str| robot.link(name).is_ok();
    if let Some(unknown) = spec.mass_matrix_of.iter().flat_map(|(a, b)| [a, b]).find(|n| !known(n)) {
        return Err(format!("mass_matrix_of names unknown link `{unknown}`"));
    }
    spec.contacts.iter().enumerate().try_for_each(|(i, contact)| self::contact(i, contact, robot))?;
    random(spec)?;
    if let Some(pace) = &spec.smooth {
        law("smooth", pace, 0.0..=1e6, "s")?;
        if spec.control.is_some_and(|control| control.data.is_some()) {
            return Err("smooth: torques come from random gains (control.data); leave one of the two out".into());
        }
    }
    scenes(spec)?;
    columns(spec, robot)
}

/// Checks the `i`-th `[[contact]]`.
fn contact(i: usize, contact: &ContactSpec, robot: &Robot) -> Result<(), String> {
    let at = |key: &str| format!("[[contact]] {} on link `{}`: {key}", i + 1, contact.link);
    if robot.link(&contact.link).is_err() {
        return Err(at("no such link moves"));
    }
    if contact.point.is_some() != contact.vertices.is_empty() {
        return Err(at("a `point` or `vertices` are needed, and not both"));
    }
    if contact.axis.is_some() != contact.rim.is_some() || contact.axis.is_some() && contact.point.is_none() {
        return Err(at("a disc needs `point`, `axis` and `rim`"));
    }
    if contact.vertices.len() > MAX_VERTICES {
        return Err(at(&format!("{} vertices, at most {MAX_VERTICES} are possible", contact.vertices.len())));
    }
    for place in contact.point.iter().chain(&contact.vertices) {
        vector(&at(if contact.point.is_some() { "point" } else { "vertices" }), place, MAX_ANGLE_OR_LENGTH, "m")?;
    }
    if let Some(axis) = &contact.axis {
        vector(&at("axis"), axis, MAX_ANGLE_OR_LENGTH, "1")?;
        within(at("length of axis"), Vector3::from(*axis).norm(), 1e-6..=2.0 * MAX_ANGLE_OR_LENGTH, "1")?;
    }
    within(at("rim"), contact.rim.unwrap_or(1.0), 0.0..=MAX_ANGLE_OR_LENGTH, "m")?;
    within(at("radius"), contact.radius, 0.0..=MAX_ANGLE_OR_LENGTH, "m")?;
    within(at("thickness"), contact.thickness.unwrap_or(0.0), 0.0..=MAX_ANGLE_OR_LENGTH, "m")
}

/// Checks the ranges of random planes and pegs.
fn random(spec: &Spec) -> Result<(), String> {
    if let Some(plane) = &spec.random_plane {
        within("random_plane.reach", plane.reach, 0.0..=MAX_POSITION, "m")?;
        within("random_plane.clearance", plane.clearance, 0.0..=MAX_POSITION, "m")?;
    }
    if let Some(pegs) = &spec.random_pegs {
        within("random_pegs.count", pegs.count as f64, 1.0..=100.0, "")?;
        law("random_pegs.radius", &pegs.radius, 1e-6..=MAX_ANGLE_OR_LENGTH, "m")?;
        within("random_pegs.height", pegs.height, 1e-6..=MAX_ANGLE_OR_LENGTH, "m")?;
        laws("random_pegs.position", &pegs.position, MAX_POSITION, "m")?;
    }
    Ok(())
}

fn vector(key: &str, values: &[f64], most: f64, unit: &str) -> Result<(), String> {
    values.iter().enumerate().try_for_each(|(i, x)| within(format!("{key}[{i}]"), *x, -most..=most, unit))
}

fn laws(key: &str, ranges: &[Range], most: f64, unit: &str) -> Result<(), String> {
    ranges.iter().enumerate().try_for_each(|(i, range)| law(&format!("{key}[{i}]"), range, -most..=most, unit))
}

/// Checks that every joint of the robot has one `[[joint]]` entry, in any order. Also checks each entry.
fn joints(spec: &Spec, robot: &Robot) -> Result<(), String> {
    let names = || robot.joints().map(|j| j.name.as_str()).collect::<Vec<_>>();
    let mut seen = HashSet::new();
    for joint in &spec.joints {
        let at = robot.joint(&joint.name).map_err(|e| format!("[[joint]] name = {:?}: {e}", joint.name))?.joint;
        if !seen.insert(joint.name.as_str()) {
            return Err(format!("[[joint]] name = {:?} appears twice", joint.name));
        }
        let modelled = robot.joints().nth(at);
        self::joint(joint, modelled.is_some_and(|j| j.kind == JointKind::Prismatic), &names()[..at])?;
        // A default position may exceed a limit by up to 1 (rad or m), since files round positions.
        let beyond = |limit: &Limit| joint.default_q < limit.lower - 1.0 || joint.default_q > limit.upper + 1.0;
        if let Some(limit) = modelled.and_then(|j| j.limit).filter(beyond) {
            let low = limit.lower;
            let high = limit.upper;
            let name = &joint.name;
            let default_q = joint.default_q;
            return Err(format!(
                "[[joint]] name = {name:?}: default_q is {default_q}, its limits are {low} to {high}; angles are in rad"
            ));
        }
        if joint.limit.is_some() && modelled.is_some_and(|j| j.limit.is_none()) {
            return Err(format!(
                "[[joint]] name = {:?}: limit, but the URDF has none to give stiffness to",
                joint.name
            ));
        }
    }
    match names().iter().find(|name| !seen.contains(**name)) {
        Some(missing) => Err(format!("no [[joint]] has name = {missing:?}")),
        None => Ok(()),
    }
}

/// Checks one joint's entry; `earlier`: names of the joints before this one.
fn joint(joint: &JointSpec, slides: bool, earlier: &[&str]) -> Result<(), String> {
    let at = |key: &str| format!("[[joint]] name = {:?}: {key}", joint.name);
    let unit = |turning, sliding| if slides { sliding } else { turning };
    let (place, speed, force) = (unit("rad", "m"), unit("rad/s", "m/s"), unit("N m", "N"));
    let (stiffness, damping) = (unit("N m/rad", "N/m"), unit("N m s/rad", "N s/m"));
    within(at("default_q"), joint.default_q, -MAX_ANGLE_OR_LENGTH..=MAX_ANGLE_OR_LENGTH, place)?;
    within(at("rest"), joint.rest, -MAX_ANGLE_OR_LENGTH..=MAX_ANGLE_OR_LENGTH, place)?;
    for (key, x, most, unit) in [
        ("armature", Some(joint.armature), 1e6, unit("kg m^2", "kg")),
        ("stiffness", Some(joint.stiffness), MAX_FORCE, stiffness),
        ("limit.stiffness", joint.limit.map(|l| l.stiffness), MAX_FORCE, stiffness),
        ("limit.damping", joint.limit.map(|l| l.damping), MAX_FORCE, damping),
        ("torque", Some(joint.torque), MAX_FORCE, force),
        ("gain", joint.gain, MAX_FORCE, force),
        ("kp", Some(joint.kp), MAX_FORCE, stiffness),
        ("kd", Some(joint.kd), MAX_FORCE, damping),
    ] {
        x.map_or(Ok(()), |x| within(at(key), x, 0.0..=most, unit))?;
    }
    for (box_, start) in [("sample", &joint.sample), ("reset", &joint.reset)] {
        law(&at(&format!("{box_}.q")), &start.q, -MAX_ANGLE_OR_LENGTH..=MAX_ANGLE_OR_LENGTH, place)?;
        law(&at(&format!("{box_}.qd")), &start.qd, -MAX_VELOCITY..=MAX_VELOCITY, speed)?;
        if let Some(other) = start.minus.as_ref().filter(|name| !earlier.contains(&name.as_str())) {
            let known = if earlier.is_empty() { "none".into() } else { earlier.join(", ") };
            return Err(at(&format!("{box_}.minus is {other:?}, which is not an earlier joint (earlier is {known})")));
        }
    }
    Ok(())
}

fn control(control: &ControlSpec) -> Result<(), String> {
    within("[control] scale", control.scale, -MAX_ANGLE_OR_LENGTH..=MAX_ANGLE_OR_LENGTH, "rad or m")?;
    let Some(gains) = &control.data else { return Ok(()) };
    law("[control] data.kp", &gains.kp, 0.0..=MAX_FORCE, "N m/rad or N/m")?;
    law("[control] data.kd", &gains.kd, 0.0..=MAX_FORCE, "N m s/rad or N s/m")
}

fn root(root: &RootSpec, has_scene: bool) -> Result<(), String> {
    vector("[root] position", &root.position, MAX_POSITION, "m")?;
    let size = root.quaternion.iter().map(|x| x * x).sum::<f64>().sqrt();
    within("[root] quaternion's size", size, 1e-3..=1e3, "")?;
    start("[root.sample]", &root.sample, has_scene)?;
    root.reset.as_ref().map_or(Ok(()), |reset| start("[root.reset]", reset, has_scene))
}

fn start(table: &str, start: &RootStart, has_scene: bool) -> Result<(), String> {
    let at = |key: &str| format!("{table} {key}");
    laws(&at("position"), &start.position, MAX_POSITION, "m")?;
    laws(&at("ang_vel"), &start.ang_vel, MAX_VELOCITY, "rad/s")?;
    laws(&at("velocity"), &start.velocity, MAX_VELOCITY, "m/s")?;
    law(&at("tilt"), &start.tilt, -MAX_ANGLE_OR_LENGTH..=MAX_ANGLE_OR_LENGTH, "rad")?;
    let Some(clearance) = start.clearance else { return Ok(()) };
    within(at("clearance"), clearance, 0.0..=MAX_POSITION, "m")?;
    if has_scene { Ok(()) } else { Err(at("has a clearance, but there is no data_scene")) }
}

/// Whether a name may be part of a file name and of a comma-separated list.
fn plain(name: &str) -> bool {
    name.starts_with(char::is_alphanumeric) && name.chars().all(|c| c.is_alphanumeric() || "-_.".contains(c))
}

fn scenes(spec: &Spec) -> Result<(), String> {
    let mut seen: HashSet<&str> = WORLDS.into_iter().chain(["free"]).collect();
    for scene in &spec.scenes {
        let at = |key: &str| format!("[[scene]] name = {:?}: {key}", scene.name);
        if scene.name.trim().is_empty() || !seen.insert(&scene.name) {
            return Err(at(&format!(
                "a name of its own is needed (taken are free, {} and those of other scenes)",
                WORLDS.join(", ")
            )));
        }
        if !plain(&scene.name) {
            return Err(at(
                "files are called by it; letters, digits, `-`, `_` and `.` are allowed, a letter or digit first",
            ));
        }
        within(at("plane.height"), scene.plane.height, -MAX_POSITION..=MAX_POSITION, "m")?;
        vector(&at("plane.angles"), &scene.plane.angles, MAX_ANGLE_OR_LENGTH, "rad")?;
        if let Some(terrain) = &scene.terrain {
            terrain.check().map_err(|e| at(&format!("terrain: {e}")))?;
            if scene.plane.angles != [0.0; 3] {
                return Err(at("plane.angles: terrain lies level; for a slope take its kind `slopes`"));
            }
        }
        for b in &scene.boxes {
            b.size
                .iter()
                .enumerate()
                .try_for_each(|(i, x)| within(at(&format!("box.size[{i}]")), *x, 1e-6..=MAX_ANGLE_OR_LENGTH, "m"))?;
            vector(&at("box.position"), &b.position, MAX_POSITION, "m")?;
            within(at("box.yaw"), b.yaw, -MAX_ANGLE_OR_LENGTH..=MAX_ANGLE_OR_LENGTH, "rad")?;
        }
        for peg in &scene.pegs {
            within(at("peg.radius"), peg.radius, 1e-6..=MAX_ANGLE_OR_LENGTH, "m")?;
            within(at("peg.height"), peg.height, 1e-6..=MAX_ANGLE_OR_LENGTH, "m")?;
            vector(&at("peg.position"), &peg.position, MAX_POSITION, "m")?;
        }
        if let Some(m) = &scene.material {
            m.check().map_err(|e| at(&format!("material: {e}")))?;
        }
    }
    Ok(())
}

/// Checks names of table columns. Names that begin with `tau` are reserved for torques, so that a wrong torque column
/// is detected.
fn columns(spec: &Spec, robot: &Robot) -> Result<(), String> {
    let mut seen = HashSet::new();
    for (key, names, wanted) in [
        ("state_columns", &spec.state_columns, robot.state_dim()),
        ("torque_columns", &spec.torque_columns, robot.joint_count()),
    ] {
        if names.len() != wanted {
            return Err(format!("{key}: {} entries, the robot needs {wanted}", names.len()));
        }
        for name in names {
            let wrong =
                |why: &str| Err(format!("{key}: {name:?} {why}; say `column` in [[joint]] or give other {key}"));
            if name.is_empty() || name.trim() != name {
                return wrong("is empty or has blanks at an end");
            }
            if RESERVED.contains(&name.as_str()) || key == "state_columns" && name.starts_with("tau") {
                return wrong("is the name of another column of tables");
            }
            if !seen.insert(name) {
                return wrong("appears twice");
            }
        }
    }
    Ok(())
}
