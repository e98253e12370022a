//! Reads named poses from the SRDF beside a URDF.

use crate::internal::*;

/// Names of standing poses, in order of preference.
const STANDING: [&str; 2] = ["standing", "half_sitting"];

/// Description of the pose if there is no SRDF.
pub(super) const ZERO: &str = "zero, within the limits";

/// A state with zero velocities, and the description of its source. Joint positions are an SRDF's standing pose, else
/// the nearest to zero within the limits.
pub(super) fn pose_of(robot: &Robot, urdf: Option<&Path>) -> (Vec<f64>, String) {
    let mut state = robot.zero_state();
    let coords = robot.root_coords();
    for (q, joint) in state[coords..].iter_mut().zip(robot.joints()) {
        *q = joint.limit.map_or(0.0, |l| 0.0f64.clamp(l.lower, l.upper));
    }
    // The candidate pose with values for most of this robot's joints.
    let mut best: (usize, Vec<(usize, f64)>, String) = (0, Vec::new(), ZERO.into());
    for file in urdf.map(beside).unwrap_or_default() {
        let Ok(text) = crate::files::read_text(&file) else { continue };
        let Ok(document) = super::xml::document(&text) else { continue };
        for group in document.descendants().filter(|n| n.has_tag_name("group_state")) {
            let Some(name) = group.attribute("name").filter(|name| STANDING.contains(name)) else { continue };
            let given: Vec<(usize, f64)> = group
                .children()
                .filter_map(|joint| {
                    let place = robot.joint(joint.attribute("name")?).ok()?.joint;
                    Some((place, joint.attribute("value")?.trim().parse().ok()?))
                })
                .collect();
            if given.len() > best.0 {
                let file = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
                best = (given.len(), given, format!("`{name}` of {file}"));
            }
        }
    }
    for (place, q) in best.1.into_iter().filter(|(_, q)| q.is_finite()) {
        let limit = robot.joints().nth(place).and_then(|joint| joint.limit);
        state[coords + place] = limit.map_or(q, |l| q.clamp(l.lower, l.upper));
    }
    (state, best.2)
}

/// The .srdf files in the folder `srdf` of the robot's package.
fn beside(urdf: &Path) -> Vec<PathBuf> {
    let folder = urdf.parent().and_then(Path::parent).map(|package| package.join("srdf"));
    let mut files: Vec<PathBuf> =
        folder.and_then(|f| std::fs::read_dir(f).ok()).into_iter().flatten().flatten().map(|e| e.path()).collect();
    files.retain(|path| path.extension().is_some_and(|e| e == "srdf"));
    files.sort();
    files
}
