//! Elements and attributes of a URDF that determine how a robot moves: a misspelt one would silently change the robot, so it is refused.
//! Others (transmissions, sensors, simulators' own) are ignored.

/// Attributes of the elements that we read.
const ATTRIBUTES: [(&str, &[&str]); 15] = [
    ("origin", &["xyz", "rpy"]),
    ("axis", &["xyz"]),
    ("limit", &["lower", "upper", "effort", "velocity"]),
    ("dynamics", &["damping", "friction"]),
    ("mass", &["value"]),
    ("inertia", &["ixx", "ixy", "ixz", "iyy", "iyz", "izz"]),
    ("parent", &["link"]),
    ("child", &["link"]),
    ("mimic", &["joint", "multiplier", "offset"]),
    ("box", &["size"]),
    ("cylinder", &["radius", "length"]),
    ("capsule", &["radius", "length"]),
    ("sphere", &["radius"]),
    ("link", &["name", "type"]),
    ("joint", &["name", "type"]),
];

/// Child elements that matter.
const CHILDREN: [(&str, &[&str]); 5] = [
    ("robot", &["link", "joint", "material", "gazebo", "transmission", "sensor", "group"]),
    ("link", &["inertial", "collision", "visual", "contact", "sensor", "gazebo", "self_collision"]),
    ("joint", &["origin", "parent", "child", "axis", "limit", "dynamics", "mimic", "calibration", "safety_controller"]),
    ("inertial", &["origin", "mass", "inertia"]),
    ("collision", &["origin", "geometry", "material", "verbose", "contact_coefficients"]),
];

/// Letters by which a misspelt word differs.
const SLIPS: usize = 2;

fn of<'a>(table: &'a [(&str, &'a [&'a str])], element: &str) -> Option<&'a [&'a str]> {
    table.iter().find(|(name, _)| *name == element).map(|(_, words)| *words)
}

/// Refuses an element, whose path of names from the root ends with it, if it or an attribute of it looks like a slip.
pub(super) fn check(path: &[String], attributes: impl Iterator<Item = String>) -> Result<(), String> {
    let [root, rest @ ..] = path else { return Ok(()) };
    let Some(element) = rest.last() else { return Ok(()) };
    let [.., parent, _] = path else { return Ok(()) };
    // Only in links and joints of the robot itself.
    if root != "robot" || rest.len() > 1 && !matches!(rest[0].as_str(), "link" | "joint") || rest.iter().any(|e| e == "visual") {
        return Ok(());
    }
    if let Some(known) = of(&CHILDREN, parent).filter(|known| !known.contains(&element.as_str()))
        && let Some(meant) = meant(known, element)
    {
        return Err(format!("<{element}> in <{parent}> is not an element of a URDF; is <{meant}> meant?"));
    }
    let Some(known) = of(&ATTRIBUTES, element) else { return Ok(()) };
    for name in attributes.filter(|name| !known.contains(&name.as_str())) {
        if let Some(meant) = meant(known, &name) {
            return Err(format!("<{element}> in <{parent}> has an attribute `{name}`; is `{meant}` meant?"));
        }
    }
    Ok(())
}

/// The known word that this one misspells. Words that resemble none are extensions, of which real files are full.
fn meant<'a>(known: &[&'a str], word: &str) -> Option<&'a str> {
    known.iter().find(|k| strsim::osa_distance(k, word) <= SLIPS).copied()
}
