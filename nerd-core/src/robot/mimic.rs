//! Resolves mimic joints (`<mimic>` of a URDF and the like) to the coordinates of independent joints.

use super::{BodyMimic, Joint, Limit, Mimic, Robot, UrdfError, UrdfRobot};

/// Joint position (rad or m) that stands for unlimited.
const UNLIMITED_POSITION: f64 = 1e9;
/// Least difference (rad or m) by which one limit counts as narrower than another.
const MIN_LIMIT_DIFFERENCE: f64 = 1e-6;

/// Makes the joints of `followers` (link index, law) follow their leaders, through chains of mimic joints. A leader
/// takes over its followers' damping, friction and limits.
pub(super) fn follow(read: &mut UrdfRobot, followers: Vec<(usize, &BodyMimic)>) -> Result<(), UrdfError> {
    let UrdfRobot { robot, notes, .. } = read;
    let found = followers.iter().map(|follower| led(robot, &followers, follower)).collect::<Result<Vec<_>, _>>()?;
    // Coordinate indices count only independent joints.
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
            // A wrapped angle loses full turns, which matter to a mimic joint with a fractional multiplier.
            leader.limit =
                Some(Limit { lower: -UNLIMITED_POSITION, upper: UNLIMITED_POSITION, stiffness: 0.0, damping: 0.0 });
        }
        narrow(leader, &own, [multiplier, offset], notes);
    }
    Ok(())
}

/// Index of a follower's link, index of its leader's link, and multiplier and offset of the chain of mimic joints
/// between the two.
type Led = (usize, usize, f64, f64);

/// Finds a follower's leader, the independent joint at the end of the follower's chain of mimic joints.
fn led(
    robot: &Robot,
    followers: &[(usize, &BodyMimic)],
    (link, mimic): &(usize, &BodyMimic),
) -> Result<Led, UrdfError> {
    let joint = |name: &str| robot.links.iter().position(|l| l.joint.as_ref().is_some_and(|j| j.name == name));
    let own = robot.links[*link].joint.as_ref().map(|j| j.name.clone()).unwrap_or_default();
    let wrong = |reason: String| UrdfError::joint(&own, reason);
    let mut at = *mimic;
    let mut multiplier = 1.0;
    let mut offset = 0.0;
    // A walk longer than the number of mimic joints means a cycle.
    for step in 0..=followers.len() {
        // Compose `m (m' q + o') + o` from the outside in.
        offset += multiplier * at.offset;
        multiplier *= at.multiplier;
        if !(multiplier.abs() < UNLIMITED_POSITION && offset.abs() < UNLIMITED_POSITION) {
            return Err(wrong("<mimic> has a multiplier or an offset that is not finite, or absurd".into()));
        }
        let Some(next) = joint(&at.joint) else {
            return Err(wrong(format!("<mimic> of `{}`, which is not a moving joint", at.joint)));
        };
        match followers.iter().find(|f| f.0 == next) {
            Some((_, mimic)) if step < followers.len() => at = mimic,
            Some(_) => break,
            None => return Ok((*link, next, multiplier, offset)),
        }
    }
    Err(wrong("<mimic> leads back to itself".into()))
}

/// Narrows a leader's limits to positions at which its follower `own` is within its own limits.
fn narrow(leader: &mut Joint, own: &Joint, [multiplier, offset]: [f64; 2], notes: &mut Vec<String>) {
    let Some(limit) = own.limit.filter(|_| multiplier != 0.0) else { return };
    let [a, b] = [limit.lower, limit.upper].map(|end| (end - offset) / multiplier);
    let [low, high] =
        leader.limit.map_or([-UNLIMITED_POSITION, UNLIMITED_POSITION], |limit| [limit.lower, limit.upper]);
    let [lower, upper] = [a.min(b).max(low), a.max(b).min(high)];
    if lower >= upper {
        notes.push(format!(
            "joint `{}`: its limits leave no way to `{}`, which it follows, and are passed over",
            own.name, leader.name
        ));
    } else if lower > low + MIN_LIMIT_DIFFERENCE || upper < high - MIN_LIMIT_DIFFERENCE {
        notes.push(format!(
            "joint `{}`: `{}`, which follows it, keeps it within {lower:.4}..{upper:.4}",
            leader.name, own.name
        ));
        leader.limit = Some(Limit { lower, upper, stiffness: 0.0, damping: 0.0 });
    }
}
