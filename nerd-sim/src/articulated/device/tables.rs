//! Tables of one robot in the text: links, joints, contact points and the pairs of links that may touch each other.

use nerd_core::dynamics::Factor;

use super::super::fast::fast_moves;
use super::text::Text;
use crate::prelude::*;
use crate::system::capsules::Capsule;

/// Writes the tables that are the same for every robot of a family.
pub fn tables(text: &mut Text, system: &System) {
    links(text, system);
    joints(text, &system.robot);
    points(text, &system.robot);
    folds(text, system);
}

fn links(text: &mut Text, system: &System) {
    let robot = &system.robot;
    let dofs = robot.dofs();
    let first = robot.root_dofs();
    let count = robot.links.len();
    let joint = |i: usize| robot.links[i].joint.as_ref();
    let mut whole = |name: &str, f: &dyn Fn(usize) -> f64| text.table("int", name, (0..count).map(f));
    whole("PARENT", &|i| robot.links[i].parent.map_or(-1.0, |p| p as f64));
    whole("DOF", &|i| dofs[i] as f64);
    whole("JOINT", &|i| dofs[i].saturating_sub(first) as f64);
    whole("SLIDES", &|i| f64::from(joint(i).is_some_and(|j| j.kind == JointKind::Prismatic)));
    whole("MASS_OF", &|i| system.stand_ins.get(i).map_or(i, |o| *o) as f64);
    text.table("int", "ABOVE", Factor::new(robot).above().map(|p| p.map_or(-1.0, |p| p as f64)));
    let mut reals = |name: &str, f: &dyn Fn(usize) -> Vec<f64>| text.table("real", name, (0..count).flat_map(f));
    let rows = |m: &Matrix3<f64>| m.transpose().as_slice().to_vec();
    reals("RATIO", &|i| vec![joint(i).map_or(1.0, |j| j.ratio())]);
    reals("OFFSET", &|i| vec![joint(i).and_then(|j| j.mimic()).map_or(0.0, |m| m.offset)]);
    reals("PLACE", &|i| joint(i).map_or(vec![0.0; 3], |j| j.origin().translation.vector.as_slice().to_vec()));
    reals("AXIS", &|i| joint(i).map_or(vec![0.0; 3], |j| j.axis().as_slice().to_vec()));
    reals("TURN", &|i| joint(i).map_or(vec![0.0; 27], |j| j.turn().iter().flat_map(rows).collect()));
    let (turned, place) = match robot.base {
        Base::Fixed(pose) => (rows(&pose.rotation.to_rotation_matrix().into_inner()), pose.translation.vector),
        Base::Floating => (vec![0.0; 9], Vector3::zeros()),
    };
    text.table("real", "BASE", turned);
    text.table("double", "STAND", place.iter().copied());
}

fn joints(text: &mut Text, robot: &Robot) {
    let mut reals = |name: &str, f: fn(&Joint) -> f64| text.table("real", name, robot.joints().map(f));
    reals("SPRING", |j| j.stiffness);
    reals("SLACK", |j| j.rest);
    reals("TOP", |j| j.velocity);
    let limit = |j: &Joint| j.limit.map_or([0.0; 4], |l| [l.lower, l.upper, l.stiffness, l.damping]);
    text.table("real", "LIMIT", robot.joints().flat_map(limit));
    text.table("int", "LIMITED", robot.joints().map(|j| f64::from(j.limit.is_some())));
    text.table("real", "FAST_MOVE", fast_moves(robot));
    text.table("int", "WRAPS", robot.joints().map(|j| f64::from(j.wraps())));
}

fn points(text: &mut Text, robot: &Robot) {
    let points = &robot.contact_points;
    text.table("int", "POINT_LINK", points.iter().map(|p| p.link as f64));
    text.table("real", "POINT", points.iter().flat_map(|p| [p.local.x, p.local.y, p.local.z]));
    text.table("real", "RADIUS", points.iter().map(|p| p.radius));
    text.table("real", "REACH", points.iter().map(|p| p.reach()));
    let mut kinds = Vec::new();
    let mut rims = Vec::new();
    let mut hulls = Vec::new();
    let mut all = Vec::new();
    for point in points {
        let mut kind = 0.0;
        let mut rim = [0.0; 6];
        let first = all.len() / 3;
        match &point.locus {
            Locus::Fixed => {}
            Locus::Rim { axis, radius, turn } => {
                (kind, rim) = (1.0, [axis.x, axis.y, axis.z, *radius, turn.sin(), turn.cos()])
            }
            Locus::Hull { vertices, .. } => {
                kind = 2.0;
                all.extend(vertices.iter().flat_map(|v| [v.x, v.y, v.z]));
            }
        }
        kinds.push(kind);
        rims.extend(rim);
        hulls.extend([first as f64, (all.len() / 3) as f64]);
    }
    text.table("int", "LOCUS", kinds);
    text.table("real", "RIM", rims);
    text.table("int", "HULL", hulls);
    text.table("real", "VERTEX", all);
}

fn folds(text: &mut Text, system: &System) {
    let folds = &system.folds;
    text.table("int", "FOLD_PARTS", folds.pairs.iter().flatten().map(|part| *part as f64));
    text.table("int", "FOLD_LINK", folds.links.iter().map(|link| *link as f64));
    text.table("int", "FOLD_OWN", folds.own.iter().flat_map(|own| [own.start as f64, own.end as f64]));
    text.table("real", "FOLD_BALL", folds.balls.iter().flat_map(|(c, reach)| [c.x, c.y, c.z, *reach]));
    let numbers = |c: &Capsule| [c.middle.as_slice(), c.half.as_slice(), &[c.radius]].concat();
    text.table("real", "CAPSULE", folds.capsules.iter().flat_map(numbers));
}
