//! Joints that follow others: `<mimic>` of a URDF, folded into the coordinates.

use super::{Limit, Mimic, Robot, UrdfError, UrdfRobot};

/// Farther than any turn of a joint.
const ENDLESS: f64 = 1e9;
/// By how much (rad or m) a limit is narrower than another, beyond rounding.
const NARROWER: f64 = 1e-6;

/// Makes joints of links follow what the file says, through joints that follow in turn. One that is to follow what is not in the file at
/// all moves by itself, which is noted.
pub(super) fn follow(read: &mut UrdfRobot, file: &urdf_rs::Robot, mut followers: Vec<(usize, &urdf_rs::Mimic)>) -> Result<(), UrdfError> {
    let UrdfRobot { robot, notes, .. } = read;
    followers.retain(|(link, mimic)| {
        let there = file.joints.iter().any(|j| j.name == mimic.joint);
        if let (false, Some(joint)) = (there, &robot.links[*link].joint) {
            notes.push(format!("joint `{}`: <mimic> of `{}`, which is not there; it moves by itself", joint.name, mimic.joint));
        }
        there
    });
    let joint = |robot: &Robot, name: &str| robot.links.iter().position(|l| l.joint.as_ref().is_some_and(|j| j.name == name));
    let mut found = Vec::new();
    for (link, mimic) in &followers {
        let own = robot.links[*link].joint.as_ref().map(|j| j.name.clone()).unwrap_or_default();
        let wrong = |reason: String| UrdfError::joint(&own, reason);
        let (mut at, mut multiplier, mut offset) = (*mimic, 1.0, 0.0);
        // As many steps as there are followers, or they follow each other in a ring.
        for step in 0..=followers.len() {
            let (by, plus) = (at.multiplier.unwrap_or(1.0), at.offset.unwrap_or(0.0));
            // Of `m (m' q + o') + o`, from the outside in.
            offset += multiplier * plus;
            multiplier *= by;
            if !(multiplier.abs() < ENDLESS && offset.abs() < ENDLESS) {
                return Err(wrong("<mimic> has a multiplier or an offset that is not finite, or absurd".into()));
            }
            let Some(next) = joint(robot, &at.joint) else {
                return Err(wrong(format!("<mimic> of `{}`, which is not a moving joint", at.joint)));
            };
            match followers.iter().find(|f| f.0 == next) {
                Some((_, mimic)) if step < followers.len() => at = mimic,
                Some(_) => return Err(wrong("<mimic> leads back to itself".into())),
                None => {
                    found.push((*link, next, multiplier, offset));
                    break;
                }
            }
        }
    }
    // Indices are those of the joints that move by themselves.
    let own = |l: &usize| robot.links[*l].joint.is_some() && followers.iter().all(|f| f.0 != *l);
    let order: Vec<usize> = (0..robot.links.len()).filter(own).collect();
    for (link, leader, multiplier, offset) in found {
        let coordinate = order.iter().position(|l| *l == leader).unwrap_or_default();
        robot.follow(link, Some(Mimic { coordinate, multiplier, offset }));
        let Some(own) = robot.links[link].joint.clone() else { continue };
        let Some(leader) = robot.links[leader].joint.as_mut() else { continue };
        leader.damping += multiplier * multiplier * own.damping;
        leader.friction += multiplier.abs() * own.friction;
        if leader.wraps() && multiplier.fract() != 0.0 {
            // A joint that turns without end forgets its turns, which one that follows by half of them would miss.
            leader.limit = Some(Limit { lower: -ENDLESS, upper: ENDLESS, stiffness: 0.0, damping: 0.0 });
        }
        let Some(limit) = own.limit.filter(|_| multiplier != 0.0) else { continue };
        let [a, b] = [limit.lower, limit.upper].map(|end| (end - offset) / multiplier);
        let [low, high] = leader.limit.map_or([-ENDLESS, ENDLESS], |limit| [limit.lower, limit.upper]);
        let [lower, upper] = [a.min(b).max(low), a.max(b).min(high)];
        if lower >= upper {
            notes
                .push(format!("joint `{}`: its limits leave no way to `{}`, which it follows, and are passed over", own.name, leader.name));
        } else if lower > low + NARROWER || upper < high - NARROWER {
            notes.push(format!("joint `{}`: `{}`, which follows it, keeps it within {lower:.4}..{upper:.4}", leader.name, own.name));
            leader.limit = Some(Limit { lower, upper, stiffness: 0.0, damping: 0.0 });
        }
    }
    Ok(())
}
