//! What of MJCF determines how a robot moves and is not understood here: refused with its line. What has no effect on motion is read over.

use roxmltree::Node;

/// Attributes that MJCF knows: another one is misspelt, or newer than this.
const ATTRIBUTES: [(&str, &str); 6] = [
    (
        "compiler",
        "angle eulerseq autolimits inertiafromgeom inertiagrouprange balanceinertia boundmass boundinertia settotalmass coordinate meshdir \
         texturedir assetdir strippath discardvisual usethread fusestatic convexhull exactmeshinertia fitaabb saveinertial alignfree",
    ),
    ("body", "name childclass pos quat axisangle xyaxes zaxis euler mocap gravcomp sleep user"),
    ("inertial", "pos quat axisangle xyaxes zaxis euler mass diaginertia fullinertia"),
    (
        "joint",
        "name class type group pos axis range limited margin ref springref springdamper stiffness damping armature frictionloss \
         actuatorfrcrange actuatorfrclimited actuatorgravcomp solreflimit solimplimit solreffriction solimpfriction user",
    ),
    (
        "geom",
        "name class type group pos quat axisangle xyaxes zaxis euler fromto size mesh hfield fitscale mass density shellinertia contype \
         conaffinity condim priority friction solmix solref solimp margin gap material rgba fluidshape fluidcoef user",
    ),
    (
        "actuator",
        "name class group joint tendon gear ctrllimited ctrlrange forcelimited forcerange gaintype gainprm biastype biasprm dyntype dynprm kp \
         kv dampratio timeconst inheritrange lengthrange user",
    ),
];

/// Attributes with the values, parted by `|`, that say nothing, and why others are refused.
const MATTER: [(&str, &str, &str, &str); 16] = [
    ("joint", "springdamper", "0 0", "write stiffness and damping"),
    ("joint", "actuatorfrclimited", "true|auto|false", "it is one of true, auto, false"),
    ("freejoint", "align", "false|auto", "its frame would be another; write inertial frames out"),
    ("compiler", "alignfree", "false", "its frame would be another; write inertial frames out"),
    ("compiler", "inertiagrouprange", "0 5", "give bodies an <inertial>"),
    ("compiler", "coordinate", "local", "MuJoCo itself no longer takes it"),
    ("geom", "shellinertia", "false", "give the body an <inertial>"),
    ("body", "mocap", "false", "it follows no law of motion"),
    ("body", "gravcomp", "0", "weights are not taken off; apply the torque instead"),
    ("option", "density", "0", "there is no medium; leave it out to move without"),
    ("option", "viscosity", "0", "there is no medium; leave it out to move without"),
    ("actuator", "timeconst", "0", "drives act at once"),
    ("actuator", "dampratio", "0", "write kv"),
    ("actuator", "dyntype", "none", "drives act at once"),
    ("actuator", "gaintype", "fixed", "only gains that are fixed are read"),
    ("actuator", "biastype", "none|affine", "only a position and velocity law is read"),
];

/// Parts of MuJoCo that a file may switch off.
const FLAGS: [&str; 9] = ["gravity", "contact", "limit", "frictionloss", "equality", "passive", "spring", "damper", "actuation"];
/// What makes a tendon act on the joints that it goes along.
const ACTS: [&str; 6] = ["stiffness", "damping", "frictionloss", "armature", "range", "limited"];
/// Attributes that are words.
const WORDS: &str = "name class childclass type mesh hfield material fluidshape joint tendon limited ctrllimited forcelimited \
                     actuatorfrclimited actuatorgravcomp shellinertia mocap sleep gaintype biastype dyntype user fitscale inheritrange";

/// Actuators that are read; MJCF's shortcuts for general ones share its attributes.
pub(super) const ACTUATORS: [&str; 4] = ["motor", "position", "velocity", "general"];

pub(super) fn check(node: &Node) -> Result<(), String> {
    let (tag, own) = (node.tag_name().name(), node.parent_element());
    let above = own.map_or("", |n| n.tag_name().name());
    let is = |key: &str, value: &str| node.attribute(key) == Some(value);
    let trees = "; robots are trees of hinges and slides";
    match (above, tag) {
        ("equality", "joint" | "include") => {}
        ("equality", _) if is("active", "false") => {}
        ("equality", _) => return Err(format!("<{tag}> is not supported{trees}")),
        (_, "flex" | "flexcomp" | "composite" | "skin" | "replicate" | "attach" | "plugin") => {
            return Err(format!("<{tag}> is not supported; write it out as bodies, or leave it out"));
        }
        ("actuator", "include") => {}
        ("actuator", _) if !ACTUATORS.contains(&tag) => {
            return Err(format!("<{tag}> is not supported; {} are", ACTUATORS.join(", ")));
        }
        ("frame", "joint" | "freejoint") => return Err(format!("<{tag}> in a <frame> is not read; put it into the body")),
        ("tendon" | "default", "fixed" | "spatial" | "tendon") => {
            let acts = |key: &&&str| node.attribute(**key).is_some_and(|value| value != "false" && value.trim() != "0");
            if let Some(key) = ACTS.iter().find(acts) {
                return Err(format!("a tendon with `{key}` acts on joints, which is not supported"));
            }
        }
        (_, "flag") => {
            if let Some(flag) = FLAGS.iter().find(|flag| is(flag, "disable")) {
                return Err(format!("<flag {flag}=\"disable\"> is not supported; leave it out, and what it switches off"));
            }
        }
        (_, "joint") if is("type", "ball") => return Err(format!("ball joints are not supported{trees}")),
        _ => {}
    }
    let kind = match (above, tag) {
        ("actuator" | "default", _) if ACTUATORS.contains(&tag) => "actuator",
        // Others of these names, in tendons, equalities and sensors.
        ("worldbody" | "body" | "frame" | "default" | "mujoco" | "mujocoinclude", _) | ("option", "flag") => tag,
        _ => return Ok(()),
    };
    if let Some((_, known)) = ATTRIBUTES.iter().find(|(of, _)| *of == kind)
        && let Some(other) = node.attributes().find(|a| known.split_whitespace().all(|k| k != a.name()))
    {
        return Err(format!("<{tag}> has an attribute `{}` that is not known", other.name()));
    }
    for (_, key, harmless, why) in MATTER.iter().filter(|(of, ..)| *of == kind) {
        let silent = |value: &str| harmless.split('|').any(|h| h == value || number(h).is_some() && number(h) == number(value));
        if let Some(value) = node.attribute(*key).filter(|value| !silent(value.trim())) {
            return Err(format!("{key}=\"{value}\" is not supported: {why}"));
        }
    }
    let numeric = ["body", "inertial", "joint", "geom", "actuator", "site", "frame"].contains(&kind);
    for a in node.attributes().filter(|a| numeric && WORDS.split_whitespace().all(|word| word != a.name())) {
        if let Some(word) = a.value().split_whitespace().find(|word| !number(word).is_some_and(|x| x.abs() <= 1e9)) {
            return Err(format!("{}=\"{}\": `{word}` is not a number up to 1e9", a.name(), a.value()));
        }
    }
    Ok(())
}

fn number(text: &str) -> Option<f64> {
    text.trim().parse::<f64>().ok().filter(|x| x.is_finite())
}
