//! URDFs without a specification: read, put on a plane, stepped.

use std::sync::Arc;

use nerd_sim::prelude::*;
use rand::{Rng, RngExt};

use super::case::{Fault, Files, Verdict, text};
use super::mutate::{ODD, anything, one, times};
use super::robots::{not_finite, robot, roll};

const FILE: &str = "robot.urdf";

/// A robot's URDF, changed.
pub fn make(rng: &mut impl Rng) -> Files {
    let mut file = robot(rng).2.as_bytes().to_vec();
    for _ in 0..times(rng) {
        change(rng, &mut file);
    }
    Files::from([(FILE.into(), file)])
}

/// What only XML suffers from, or anything.
pub fn change(rng: &mut impl Rng, file: &mut Vec<u8>) {
    let Ok(xml) = std::str::from_utf8(file) else { return anything(rng, file) };
    let quoted: Vec<(usize, &str)> = {
        let mut at = 0;
        let pieces = xml.split('"').map(|piece| {
            at += piece.len() + 1;
            (at - piece.len() - 1, piece)
        });
        pieces.skip(1).step_by(2).collect()
    };
    match rng.random_range(0..8) {
        // The value of an attribute becomes another's, or odd.
        0..3 if !quoted.is_empty() => {
            let (at, old) = quoted[rng.random_range(0..quoted.len())];
            let span = at..at + old.len();
            let new = match rng.random_range(0..3) {
                0 => quoted[rng.random_range(0..quoted.len())].1.to_string(),
                1 => old.split(' ').map(|_| one(rng, &ODD)).collect::<Vec<_>>().join(" "),
                _ => one(rng, &["fixed", "floating", "planar", "prismatic", "revolute", "a>b", "ü", "nan nan nan", "1 2", "0 0 0"]).into(),
            };
            file.splice(span, new.into_bytes());
        }
        3 => {
            // Elements in elements.
            let depth = one(rng, &[1, 3, 63, 65, 20_000]);
            let at = xml.find("<link").unwrap_or(0);
            let tag = one(rng, &["a", "link", "joint", "material", "inertial", "collision", "mimic joint=\"x\""]);
            let close = tag.split(' ').next().unwrap_or(tag);
            let nested = format!("{}{}", format!("<{tag}>").repeat(depth), format!("</{close}>").repeat(depth));
            file.splice(at..at, nested.into_bytes());
        }
        4 => {
            let more = [
                "<material name=\"a>b\"/>",
                "<!-- > -->",
                "<limit lower=\"-10\" upper=\"10\" effort=\"1\" velocity=\"1\"/>",
                "<limit lower=\"1\" upper=\"-1\" effort=\"1\" velocity=\"1\"/>",
                "<dynamics damping=\"10\" friction=\"5\"/>",
                "<dynamics damping=\"-1\"/>",
                "<collision><geometry><cylinder radius=\"0.1\" length=\"0\"/></geometry></collision>",
                "<collision><geometry><sphere radius=\"-1\"/></geometry></collision>",
                "<collision><geometry><mesh filename=\"a.stl\"/></geometry></collision>",
                "<mimic joint=\"joint1\" multiplier=\"2\"/>",
                "<![CDATA[ > ]]>",
            ];
            let places: Vec<usize> = xml.match_indices('\n').map(|(at, _)| at + 1).collect();
            let at = if places.is_empty() { 0 } else { places[rng.random_range(0..places.len())] };
            file.splice(at..at, one(rng, &more).bytes());
        }
        _ => anything(rng, file),
    }
}

/// Reads it on a fixed and on a free base, and steps both. One that moves on either is accepted.
pub fn judge(files: &Files) -> Verdict {
    // As from a file that is not UTF-8.
    let Some(urdf) = text(files, FILE) else { return Verdict::Refused("not UTF-8".into()) };
    let [fixed, floating] = [false, true].map(|floating| match System::bare("robot", urdf, floating) {
        Ok(system) => moved(system),
        Err(e) => Verdict::Refused(e.to_string()),
    });
    match (&fixed, &floating) {
        (Verdict::Fault(..), _) | (Verdict::Accepted, Verdict::Refused(_)) => fixed,
        (_, Verdict::Fault(..) | Verdict::Accepted) => floating,
        _ => fixed,
    }
}

fn moved(system: System) -> Verdict {
    if let Some(number) = not_finite(&system) {
        return Verdict::Fault(Fault::NotFinite, number);
    }
    let system = Arc::new(system);
    let scene = system.scene("plane").or_else(|_| system.scene("free"));
    match scene {
        Ok(scene) => roll(&system, &scene, &system.default_state(), &vec![0.1; system.robot.joint_count()]),
        Err(e) => Verdict::Refused(e.to_string()),
    }
}
