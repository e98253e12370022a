//! Checks the names of the URDF elements and attributes that define the robot. A misspelt name is refused, since it
//! would silently change the robot. Other elements (transmissions, sensors, simulators' extensions) are ignored.

/// Known attributes of the elements that define the robot: `(element, attributes)`.
const ATTRIBUTES: [(&str, &[&str]); 15] = [
    ("origin", &["xyz", "rpy"]),
    ("axis", &["xyz"]),
    ("limit", &["lower", "upper", "effort", "velocity"]),
    ("dynamics", &["damping", "friction"]),
    ("mass", &["value"]),
    ("inertia", &["ixx", "ixy", "ixz", "iyy", "iyz", "izz", "iyx", "izx", "izy"]),
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

const CHILDREN: [(&str, &[&str]); 5] = [
    ("robot", &["link", "joint", "material", "gazebo", "transmission", "sensor", "group"]),
    ("link", &["inertial", "collision", "visual", "contact", "sensor", "gazebo", "self_collision"]),
    ("joint", &["origin", "parent", "child", "axis", "limit", "dynamics", "mimic", "calibration", "safety_controller"]),
    ("inertial", &["origin", "mass", "inertia"]),
    ("collision", &["origin", "geometry", "material", "verbose", "contact_coefficients"]),
];

/// How many numbers an attribute holds; `None` for text.
fn numbers(element: &str, attribute: &str) -> Option<usize> {
    match (element, attribute) {
        ("link" | "joint" | "parent" | "child", _) | ("mimic", "joint") => None,
        ("origin" | "axis", _) | ("box", "size") => Some(3),
        _ => Some(1),
    }
}

/// Root elements of formats that are mistaken for URDF: `(element, format)`.
const OTHERS: [(&str, &str); 3] = [("sdf", "an SDF file"), ("mujoco", "an MJCF file"), ("COLLADA", "a COLLADA mesh")];

/// Largest edit distance (in letters) at which a word counts as a misspelt known word.
const MAX_EDIT_DISTANCE: usize = 2;

fn of<'a>(table: &'a [(&str, &'a [&'a str])], element: &str) -> Option<&'a [&'a str]> {
    table.iter().find(|(name, _)| *name == element).map(|(_, words)| *words)
}

/// Refuses an element that is unknown, unsupported or misspelt; likewise its attributes `(name, value)`. `path` holds
/// the element names from the root and ends with the element.
pub(super) fn check(path: &[&str], attributes: &[(String, String)]) -> Result<(), String> {
    let [root, rest @ ..] = path else { return Ok(()) };
    if *root != "robot" {
        let known = OTHERS.iter().find(|(name, _)| name == root);
        return Err(known.map_or_else(
            || format!("<{root}> is not a URDF's <robot>"),
            |(_, kind)| format!("it is {kind}, not a URDF; convert it to one"),
        ));
    }
    if let Some(macros) = path.iter().find(|name| name.starts_with("xacro:")) {
        return Err(format!("<{macros}> is for xacro; expand the file first: xacro FILE > robot.urdf"));
    }
    let [.., parent, element] = path else { return Ok(()) };
    if rest == ["loop_joint"] {
        return Err("<loop_joint>: a closed loop is not supported; robots are trees".into());
    }
    // Deeper than the root's children, check only links and joints, and never visuals.
    if rest.len() > 1 && !matches!(rest[0], "link" | "joint") || rest.contains(&"visual") {
        return Ok(());
    }
    if let Some(known) = of(&CHILDREN, parent).filter(|known| !known.contains(element))
        && let Some(meant) = meant(known, element)
    {
        return Err(format!("<{element}> in <{parent}> is not an element of a URDF; is <{meant}> meant?"));
    }
    let Some(known) = of(&ATTRIBUTES, element) else { return Ok(()) };
    for (name, value) in attributes {
        if !known.contains(&name.as_str()) {
            if let Some(meant) = meant(known, name) {
                return Err(format!("<{element}> in <{parent}> has an attribute `{name}`; is `{meant}` meant?"));
            }
            continue;
        }
        let Some(count) = numbers(element, name) else { continue };
        let words: Vec<&str> = value.split_whitespace().collect();
        if let Some(word) = words.iter().find(|word| word.parse::<f64>().is_err()) {
            let hint = match word {
                _ if word.contains("${") => "; expand the file with xacro first",
                _ if word.contains(',') => "; decimals take a point, and spaces part numbers",
                _ => "",
            };
            return Err(format!("<{element} {name}=\"{value}\">: `{word}` is not a number{hint}"));
        }
        if words.len() != count {
            return Err(format!("<{element} {name}=\"{value}\">: {} numbers, {count} are needed", words.len()));
        }
    }
    // Entries of an inertia's lower triangle, if given, must equal those of the upper one.
    for (twin, key) in [("iyx", "ixy"), ("izx", "ixz"), ("izy", "iyz")].into_iter().filter(|_| *element == "inertia") {
        let of = |key: &str| {
            attributes.iter().find(|(name, _)| name == key).and_then(|(_, value)| value.trim().parse::<f64>().ok())
        };
        if let (Some(a), Some(b)) = (of(twin), of(key))
            && a != b
        {
            return Err(format!("<inertia>: {twin} is {a}, {key} is {b}; an inertia is symmetric"));
        }
    }
    Ok(())
}

/// The known word that `word` misspells, if any. A word far from all known ones is taken for an extension, as is common
/// in real files.
fn meant<'a>(known: &[&'a str], word: &str) -> Option<&'a str> {
    known.iter().find(|k| strsim::osa_distance(k, word) <= MAX_EDIT_DISTANCE).copied()
}
