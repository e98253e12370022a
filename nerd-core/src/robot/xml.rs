//! Prepares a URDF's text for urdf-rs. Elements that define the robot are checked, and faults reported by line and
//! element. Elements that do not affect motion are dropped. Optional attributes that urdf-rs requires are filled in.

use std::borrow::Cow;

use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event, attributes::Attribute};

use super::{Solid, UrdfError, visual::Looks, words::check};

/// Greatest nesting depth of elements. urdf-rs recurses, and overflows the stack at depths far beyond this one.
const MAX_DEPTH: usize = 64;
/// Elements that are dropped, since they do not affect motion. Files often leave such elements incomplete, and urdf-rs
/// refuses incomplete ones.
const UNREAD: [&str; 5] = ["material", "visual", "safety_controller", "calibration", "transmission"];

/// An open element on the path from the root.
struct Open {
    name: String,
    own: String,
    children: Vec<String>,
}

/// The text for urdf-rs, and the visual solids `[link][visual]`.
pub(super) fn prepared(text: &str) -> Result<(String, Vec<Vec<Solid>>), UrdfError> {
    if text.starts_with("version https://git-lfs") {
        return Err(UrdfError::text("it is a pointer of Git LFS; run `git lfs pull` for the file"));
    }
    let mut reader = Reader::from_str(text);
    let mut out = String::with_capacity(text.len());
    let mut path = Vec::<Open>::new();
    // Depth, counted from the root, of the element that is being dropped, if any.
    let mut unread = None;
    let mut looks = Looks::default();
    loop {
        let start = reader.buffer_position() as usize;
        let read = reader.read_event();
        let end = reader.buffer_position() as usize;
        let at = |place: usize| text.as_bytes()[..place.min(text.len())].iter().filter(|b| **b == b'\n').count() + 1;
        let event =
            read.map_err(|e| UrdfError::text(&format!("line {}: {e}", at(reader.error_position() as usize))))?;
        let mut kept = unread.is_none().then(|| text.get(start..end).unwrap_or_default().to_owned());
        match &event {
            Event::Eof if !path.is_empty() => return Err(UrdfError::text("the text ends within an element")),
            Event::Eof => return Ok((out, looks.solids())),
            Event::Start(tag) | Event::Empty(tag) => {
                let empty = matches!(event, Event::Empty(_));
                if path.len() == MAX_DEPTH {
                    return Err(refused(&path, at(start), &format!("elements nested more than {MAX_DEPTH} deep")));
                }
                let name = name(tag);
                let attributes = attributes(tag);
                let own =
                    attributes.iter().find(|(key, _)| key == "name").map(|(_, own)| own.clone()).unwrap_or_default();
                if let Some(above) = path.last_mut() {
                    above.children.push(name.clone());
                }
                path.push(Open { name: name.clone(), own, children: Vec::new() });
                let names: Vec<&str> = path.iter().map(|open| open.name.as_str()).collect();
                check(&names, &attributes).map_err(|reason| refused(&path, at(start), &reason))?;
                looks.open(&names, &attributes);
                if UNREAD.contains(&name.as_str()) {
                    kept = None;
                    unread = unread.or((!empty).then_some(path.len()));
                } else if let (Some(kept), true) = (&mut kept, names.ends_with(&["joint", "limit"])) {
                    fill(kept, &attributes);
                }
                if empty {
                    whole(&path).map_err(|reason| refused(&path, at(start), &reason))?;
                    path.pop();
                }
            }
            Event::End(_) => {
                whole(&path).map_err(|reason| refused(&path, at(start), &reason))?;
                unread = unread.filter(|depth| *depth != path.len());
                path.pop();
            }
            _ => {}
        }
        out += &kept.unwrap_or_default();
    }
}

/// Error for a refused element, with its line and its link or joint.
fn refused(path: &[Open], line: usize, reason: &str) -> UrdfError {
    let owner = path.get(1).filter(|open| ["link", "joint"].contains(&open.name.as_str()));
    let owner = owner.map_or_else(String::new, |open| format!(", {} `{}`", open.name, open.own));
    UrdfError::text(&format!("line {line}{owner}: {reason}"))
}

/// Adds the attributes of `<limit>` that URDF makes optional and urdf-rs requires. If both bounds are missing, they
/// become infinite. A missing effort or velocity becomes zero, which means unknown.
fn fill(tag: &mut String, attributes: &[(String, String)]) {
    let has = |key: &str| attributes.iter().any(|(name, _)| name == key);
    let mut more = String::new();
    if !has("lower") && !has("upper") {
        more += r#" lower="-inf" upper="inf""#;
    }
    for key in ["effort", "velocity"].into_iter().filter(|key| !has(key)) {
        more += &format!(r#" {key}="0""#);
    }
    tag.insert_str("<limit".len(), &more);
}

/// Refuses the last element of the path if it lacks a required child.
fn whole(path: &[Open]) -> Result<(), String> {
    let [.., above, Open { name, children, .. }] = path else { return Ok(()) };
    let has = |child: &str| children.iter().any(|c| c == child);
    match (above.name.as_str(), name.as_str()) {
        ("link", "inertial") if !has("mass") => Err("<inertial> has no <mass>".into()),
        ("link", "inertial") if !has("inertia") => {
            Err("<inertial> has no <inertia>; a mass alone cannot turn; give its moments: ixx, iyy, izz (kg m^2)"
                .into())
        }
        ("collision", "geometry") if children.is_empty() => {
            Err("<geometry> is empty; give a box, cylinder, capsule, sphere or mesh".into())
        }
        ("link", "collision") if !has("geometry") => Err("<collision> has no <geometry>".into()),
        _ => Ok(()),
    }
}

fn name(tag: &BytesStart) -> String {
    String::from_utf8_lossy(tag.name().as_ref()).into_owned()
}

fn attributes(tag: &BytesStart) -> Vec<(String, String)> {
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let value = |a: &Attribute| a.unescape_value().map_or_else(|_| text(&a.value), Cow::into_owned);
    tag.attributes().flatten().map(|a| (text(a.key.as_ref()), value(&a))).collect()
}
