//! URDFs without a specification: read, put on a plane, stepped.

use std::sync::Arc;

use nerd_sim::prelude::*;
use rand::{Rng, RngExt};

use crate::campaign::case::{Files, Judged, Verdict, text};
use crate::campaign::mutate::{ODD, anything, one, pick, pick_line, times};
use crate::campaign::robots::{finite, robot, roll};

const FILE: &str = "robot.urdf";

/// What may stand in a line more.
const MORE: &str = r#"<material name="a>b"/>
<!-- > -->
<limit lower="-10" upper="10" effort="1" velocity="1"/>
<limit lower="1" upper="-1" effort="1" velocity="1"/>
<dynamics damping="10" friction="5"/>
<dynamics damping="-1"/>
<collision><geometry><cylinder radius="0.1" length="0"/></geometry></collision>
<collision><geometry><sphere radius="-1"/></geometry></collision>
<collision><geometry><mesh filename="a.stl"/></geometry></collision>
<mimic joint="joint1" multiplier="2"/>
<![CDATA[ > ]]>"#;

/// A robot's URDF, changed.
pub fn make(rng: &mut impl Rng) -> Files {
    let mut file = robot(rng).1.as_bytes().to_vec();
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
                1 => old.split(' ').map(|_| pick(rng, ODD)).collect::<Vec<_>>().join(" "),
                _ => pick(rng, "fixed floating planar prismatic revolute a>b ü nan,nan,nan 1,2 0,0,0").replace(',', " "),
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
            let places: Vec<usize> = xml.match_indices('\n').map(|(at, _)| at + 1).collect();
            let at = if places.is_empty() { 0 } else { places[rng.random_range(0..places.len())] };
            file.splice(at..at, pick_line(rng, MORE).bytes());
        }
        _ => anything(rng, file),
    }
}

/// Reads it on a fixed and on a free base, and steps both. One that moves on either is accepted.
pub fn judge(files: &Files) -> Judged {
    match [false, true].map(|floating| moved(files, floating)) {
        [Err(Verdict::Fault(fault, words)), _] | [_, Err(Verdict::Fault(fault, words))] => Err(Verdict::Fault(fault, words)),
        [_, Ok(())] => Ok(()),
        [fixed, _] => fixed,
    }
}

fn moved(files: &Files, floating: bool) -> Judged {
    let system = Arc::new(System::bare("robot", text(files, FILE)?, floating)?);
    finite(&system)?;
    let scene = system.scene("plane").or_else(|_| system.scene("free"))?;
    roll(&system, &scene, &system.default_state(), &vec![0.1; system.robot.joint_count()])
}
