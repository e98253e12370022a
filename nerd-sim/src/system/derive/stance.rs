//! A pose to stand in, of a robot on legs whose joints cannot all be at zero: each foot below where its leg hangs, at a share of its reach.

use super::limits::pose;
use crate::internal::*;

/// Height of a hip over its foot, of the most that the leg reaches in some poses.
const REACH: f64 = 0.8;
/// How far from there a foot may be, as a share of that reach.
const OFF: f64 = 0.05;
/// Poses in which that is looked for, and turns of the search.
const POSES: usize = 256;
const TURNS: usize = 200;

/// Bends the legs of a robot on a free base, whose pose is `state`, if some joint cannot be at zero; whether it has. Nothing is bent where a leg
/// cannot put its foot there, with one hinge for instance.
pub(super) fn bend(robot: &Robot, pose: &mut [f64]) -> bool {
    let mut state = pose.to_vec();
    let bent = bent(robot, &mut state);
    if bent {
        pose.copy_from_slice(&state);
    }
    bent
}

fn bent(robot: &Robot, state: &mut [f64]) -> bool {
    let apart = |joint: &Joint| joint.limit.is_some_and(|limit| limit.lower > 0.0 || limit.upper < 0.0);
    if !robot.floating() || robot.mimics() || !robot.joints().any(apart) {
        return false;
    }
    let mut hips: Vec<Option<usize>> = vec![None; robot.links.len()];
    let mut data = Data::new(robot);
    kinematics(robot, state, &mut data);
    let origin = |data: &Data, link: usize| data.origin + data.position[link];
    let mut length = vec![0.0; robot.links.len()];
    for link in 1..robot.links.len() {
        let Some(parent) = robot.links[link].parent else { continue };
        hips[link] = hips[parent].or((parent == 0).then_some(link));
        length[link] = if parent == 0 { 0.0 } else { length[parent] + (origin(&data, link) - origin(&data, parent)).norm() };
    }
    let far = |p: &ContactPoint| length[p.link] + p.local.norm();
    // From a hip to its foot.
    let way = |state: &[f64], data: &mut Data, hip: usize, foot: &ContactPoint| {
        kinematics(robot, state, data);
        point_position(data, foot.link, &foot.local) - origin(data, hip)
    };
    let at = |link: usize| robot.root_coords() + link - 1;
    let mut legs = Vec::new();
    for hip in (1..robot.links.len()).filter(|link| hips[*link] == Some(*link)) {
        let own: Vec<usize> = (hip..robot.links.len()).filter(|link| hips[*link] == Some(hip)).collect();
        let points = robot.contact_points.iter().filter(|p| own.contains(&p.link));
        let Some(foot) = points.max_by(|a, b| far(a).total_cmp(&far(b))) else { continue };
        let reach = (0..POSES).map(|k| {
            let mut tried = state.to_vec();
            let drawn = pose(robot, k);
            own.iter().for_each(|link| tried[at(*link)] = drawn[at(*link)]);
            -way(&tried, &mut data, hip, foot).z
        });
        let reach = reach.fold(0.0, f64::max);
        if reach > 0.0 {
            let beside = way(state, &mut data, hip, foot).y;
            legs.push((hip, own, foot, [beside, reach, origin(&data, hip).z]));
        }
    }
    // All feet on one ground, the highest that a leg asks for.
    let ground = legs.iter().map(|(.., [_, reach, high])| high - REACH * reach).fold(f64::MIN, f64::max);
    let bent = !legs.is_empty();
    for (hip, own, foot, [beside, reach, high]) in legs {
        let asked = Vector3::new(0.0, beside, ground - high);
        for _ in 0..TURNS {
            let now = way(state, &mut data, hip, foot);
            let (mut square, mut slopes) = (Matrix3::identity() * 1e-6, Vec::new());
            for link in &own {
                let mut moved = state.to_vec();
                moved[at(*link)] += 1e-6;
                let slope = (way(&moved, &mut data, hip, foot) - now) / 1e-6;
                square += slope * slope.transpose();
                slopes.push(slope);
            }
            let Some(push) = square.try_inverse().map(|inverse| inverse * (asked - now)) else { break };
            for (link, slope) in own.iter().zip(slopes) {
                let (q, limit) = (&mut state[at(*link)], robot.links[*link].joint.as_ref().and_then(|joint| joint.limit));
                *q += slope.dot(&push).clamp(-0.1, 0.1);
                *q = limit.map_or(*q, |limit| q.clamp(limit.lower, limit.upper));
            }
        }
        // To a milliradian: it is a guess.
        for link in &own {
            let (q, limit) = (&mut state[at(*link)], robot.links[*link].joint.as_ref().and_then(|joint| joint.limit));
            *q = (*q * 1e3).round() / 1e3 + 0.0;
            *q = limit.map_or(*q, |limit| q.clamp(limit.lower, limit.upper));
        }
        if (way(state, &mut data, hip, foot) - asked).norm() > OFF * reach {
            return false;
        }
    }
    bent
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A trunk on two legs of a hip and a knee that cannot be straight: it stands on bent ones, its feet below its hips.
    #[test]
    fn legs_that_cannot_be_straight_are_bent_until_feet_are_below_hips() {
        let link = |name: &str, z: f64| {
            format!(
                "<link name=\"{name}\"><inertial><origin xyz=\"0 0 {z}\"/><mass value=\"1\"/><inertia ixx=\".01\" iyy=\".01\" izz=\".01\" ixy=\"0\" \
                 ixz=\"0\" iyz=\"0\"/></inertial><collision><origin xyz=\"0 0 {}\"/><geometry><sphere radius=\".02\"/></geometry></collision></link>",
                2.0 * z
            )
        };
        let joint = |name: &str, parent: &str, y: f64, z: f64, low: f64, high: f64| {
            format!(
                "<joint name=\"{name}_joint\" type=\"revolute\"><parent link=\"{parent}\"/><child link=\"{name}\"/><origin xyz=\"0 {y} {z}\"/><axis \
                 xyz=\"0 1 0\"/><limit lower=\"{low}\" upper=\"{high}\" effort=\"20\" velocity=\"10\"/></joint>"
            )
        };
        let leg = |side: &str, y: f64| {
            let (thigh, calf) = (format!("{side}_thigh"), format!("{side}_calf"));
            let links = link(&thigh, -0.1) + &link(&calf, -0.1);
            links + &joint(&thigh, "trunk", y, 0.0, -1.5, 3.0) + &joint(&calf, &thigh, 0.0, -0.2, -2.7, -0.8)
        };
        let text = format!("<robot name=\"biped\">{}{}{}</robot>", link("trunk", 0.1), leg("left", 0.1), leg("right", -0.1));
        let mut robot = UrdfRobot::read(&text, Base::Floating).expect("a robot").robot;
        let mut state = robot.zero_state();
        assert!(bend(&robot, &mut state));
        let (mut data, coords) = (Data::new(&robot), robot.root_coords());
        kinematics(&robot, &state, &mut data);
        for calf in [2, 4] {
            let hip = data.position[calf - 1];
            let foot = point_position(&data, calf, &Vector3::new(0.0, 0.0, -0.2)) - data.origin - hip;
            let knee = state[coords + calf - 1];
            // With the knee at its bound a leg is 0.4 m cos(0.4) long, to which the poses that are tried come near.
            let share = -foot.z / (0.4 * 0.4f64.cos());
            assert!(foot.x.abs() < 1e-3 && (0.7..0.8).contains(&share) && knee < -0.8, "foot at {foot:?}, knee at {knee}");
        }
        // Whose joints can all be at zero stands straight.
        robot.joints_mut().for_each(|joint| joint.limit.iter_mut().for_each(|limit| limit.upper = 1.0));
        assert!(!bend(&robot, &mut robot.zero_state()));
    }
}
