//! Which motions of a joint are fast for a substep, so that the frame may gain energy.

use crate::prelude::*;

/// Turn (rad) of a joint in a substep above which the frame's energy is checked. The same for the travel (m) of a slide
/// on something that turns, and of other slides.
const FAST_TURN: f64 = 0.015;
const FAST_TRAVEL_ON_TURN: f64 = 0.0015;
const FAST_TRAVEL: f64 = 0.015;

/// By joint: turn (rad) or travel (m) in a substep above which the frame's energy is checked.
pub(super) fn fast_moves(robot: &Robot) -> Vec<f64> {
    let slides = |joint: &Joint| joint.kind == JointKind::Prismatic;
    let turns = |link: usize| robot.links[link].joint.as_ref().is_some_and(|joint| !slides(joint));
    let own = |link: usize| robot.links[link].joint.as_ref().filter(|joint| joint.mimic().is_none());
    let joints = (0..robot.links.len()).filter_map(|link| Some((link, own(link)?)));
    joints
        .map(|(link, joint)| {
            let on_turn = robot.floating() || robot.ancestors(link).skip(1).any(turns);
            match (slides(joint), on_turn) {
                (false, _) => FAST_TURN,
                (true, true) => FAST_TRAVEL_ON_TURN,
                (true, false) => FAST_TRAVEL,
            }
        })
        .collect()
}
