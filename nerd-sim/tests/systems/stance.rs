//! Default poses of legged robots that cannot be straight: feet below hips on one ground, legs alike, other joints
//! unchanged.

use super::common::{collision, joint, link, urdf};
use nerd_sim::prelude::*;

const FOOT: [f64; 3] = [0.0, 0.0, -0.2];
const BENT: [f64; 2] = [-2.7, -0.8];

/// A link of 1 kg with a ball at each of these positions.
fn part(name: &str, balls: &[[f64; 3]]) -> String {
    let balls: String = balls.iter().map(|at| collision(*at, "<sphere radius=\"0.02\"/>")).collect();
    link(name, 1.0, [0.0; 3], [0.01; 3], &balls)
}

/// A hinge named after its child link.
fn hinge(parent: &str, name: &str, [x, y, z]: [f64; 3], axis: &str, [low, high]: [f64; 2]) -> String {
    let limit = format!("<limit lower=\"{low}\" upper=\"{high}\" effort=\"20\" velocity=\"10\"/>");
    joint(name, "revolute", [parent, name], &format!("<origin xyz=\"{x} {y} {z}\"/><axis xyz=\"{axis}\"/>{limit}"))
}

/// A thigh and a calf of 0.2 m each, hanging from `parent`; axis and range of the knee.
fn leg(parent: &str, name: &str, at: [f64; 3], axis: &str, knee: [f64; 2]) -> [String; 4] {
    let [thigh, calf] = ["thigh", "calf"].map(|part| format!("{name}_{part}"));
    let [hip, knee] = [hinge(parent, &thigh, at, "0 1 0", [-1.5, 3.0]), hinge(&thigh, &calf, FOOT, axis, knee)];
    [part(&thigh, &[]), part(&calf, &[FOOT]), hip, knee]
}

/// A robot in its default pose.
struct Stance(Arc<System>, Vec<f64>);

impl Stance {
    fn of(parts: &[String]) -> Self {
        let parts = [vec![part("trunk", &[[0.0, 0.0, 0.1]])], parts.to_vec()].concat();
        let system = System::from_text("r", &urdf(&parts), Some("like = \"urdf\"")).unwrap_or_else(|e| panic!("{e}"));
        let state = system.default_state();
        Self(Arc::new(system), state)
    }

    fn joint(&self, name: &str) -> f64 {
        self.0.joint_specs().find(|joint| joint.name == name).expect("a joint").default_q
    }

    /// Position of a point of a link relative to the trunk (m).
    fn place(&self, link: &str, at: [f64; 3]) -> Vector3<f64> {
        let mut data = self.0.data();
        kinematics(&self.0.robot, &self.1, &mut data);
        point_position(&data, self.0.robot.link(link).expect("a link"), &at.into())
            - Vector3::from_column_slice(&self.1[..3])
    }
}

/// Legs that cannot be straight are bent, with feet below hips. A robot with all joints able to be zero stands
/// straight, as does a robot with knees that lack 2 degrees.
#[test]
fn legs_that_cannot_be_straight_are_bent_until_feet_are_below_hips() {
    let biped = |most| {
        let sides = [("left", 0.1), ("right", -0.1)];
        Stance::of(&sides.map(|(side, y)| leg("trunk", side, [0.0, y, 0.0], "0 1 0", [-2.7, most])).concat())
    };
    let stance = biped(-0.8);
    for side in ["left", "right"] {
        let calf = format!("{side}_calf");
        let (foot, knee) = (stance.place(&calf, FOOT), stance.joint(&calf));
        // With the knee at its bound a leg is 0.4 m cos(0.4) long; the search over poses comes near to that.
        let share = -foot.z / (0.4 * 0.4f64.cos());
        assert!(foot.x.abs() < 1e-3 && (0.7..0.8).contains(&share) && knee < -0.8, "foot at {foot:?}, knee at {knee}");
    }
    for most in [0.0, -2f64.to_radians()] {
        let straight = biped(most);
        let pose = ["left_thigh", "left_calf", "right_thigh", "right_calf"].map(|name| straight.joint(name));
        assert!(
            pose.iter().zip([0.0, most, 0.0, most]).all(|(q, asked)| (q - asked).abs() < 1e-12),
            "knees that reach {most}: {pose:?}"
        );
    }
}

/// Legs below a waist of three hinges. One leg lists its parts in another order and bends its knee in the opposite
/// sense. Arms beside the legs have elbows that cannot be straight.
#[test]
fn below_a_waist_legs_bend_alike_and_the_waist_stays() {
    let mut parts = Vec::new();
    for (parent, name, axis) in [("trunk", "turn", "0 0 1"), ("turn", "bow", "0 1 0"), ("bow", "sway", "1 0 0")] {
        parts.extend([link(name, 0.0, [0.0; 3], [0.0; 3], ""), hinge(parent, name, [0.0; 3], axis, [-0.8, 0.8])]);
    }
    parts.push(part("pelvis", &[]) + &joint("fixed", "fixed", ["sway", "pelvis"], ""));
    parts.extend(leg("pelvis", "left", [0.0, 0.1, -0.1], "0 1 0", BENT));
    let mut other = leg("pelvis", "right", [0.0, -0.1, -0.1], "0 -1 0", [0.8, 2.7]);
    other.reverse();
    parts.extend(other);
    for (side, y) in [("left", 0.2), ("right", -0.2)] {
        let [arm, hand] = ["arm", "hand"].map(|part| format!("{side}_{part}"));
        parts.extend([part(&arm, &[]), hinge("trunk", &arm, [0.0, y, 0.1], "0 1 0", [-2.0, 2.0])]);
        parts.extend([part(&hand, &[[0.0, 0.0, -0.15]]), hinge(&arm, &hand, [0.0, 0.0, -0.15], "0 1 0", [-2.0, -0.5])]);
    }
    let stance = Stance::of(&parts);
    for still in ["turn", "bow", "sway", "left_arm", "right_arm"] {
        assert_eq!(stance.joint(still), 0.0, "{still}");
    }
    let [hands, knees, thighs] =
        ["hand", "calf", "thigh"].map(|part| ["left", "right"].map(|s| stance.joint(&format!("{s}_{part}"))));
    assert_eq!(hands, [-0.5; 2], "arms stay where they are nearest to zero");
    assert!(
        (knees[0] + knees[1]).abs() < 1.5e-3 && knees[0] < -0.8 && (thighs[0] - thighs[1]).abs() < 1.5e-3,
        "{knees:?}, {thighs:?}"
    );
    let feet = ["left_calf", "right_calf"].map(|calf| stance.place(calf, FOOT));
    assert!((feet[0].z - feet[1].z).abs() < 1e-3 && feet.iter().all(|foot| foot.x.abs() < 1e-3), "feet at {feet:?}");
}

/// Front legs on the trunk and hind legs behind a spine; the hind hips are 5 cm lower.
#[test]
fn four_legs_on_two_ends_of_a_spine_stand_on_one_ground() {
    let mut parts = vec![part("spine", &[]), hinge("trunk", "spine", [-0.2, 0.0, 0.0], "0 1 0", [-0.5, 0.5])];
    for (parent, name, x, z) in [("trunk", "front", 0.2, 0.0), ("spine", "hind", -0.2, -0.05)] {
        for (side, y) in [("left", 0.1), ("right", -0.1)] {
            parts.extend(leg(parent, &format!("{name}_{side}"), [x, y, z], "0 1 0", BENT));
        }
    }
    let stance = Stance::of(&parts);
    assert_eq!(stance.joint("spine"), 0.0);
    let feet =
        ["front_left", "front_right", "hind_left", "hind_right"].map(|leg| stance.place(&format!("{leg}_calf"), FOOT));
    let ahead = [0.2, 0.2, -0.4, -0.4];
    let off =
        feet.iter().zip(ahead).map(|(foot, x)| (foot.z - feet[0].z).abs().max((foot.x - x).abs())).fold(0.0, f64::max);
    assert!(off < 1e-3, "feet at {feet:?}");
}

/// With an ankle the foot is level, and the middle of its sole, not a toe, is below the hip. A wheel in place of the
/// foot is below the hip and not turned.
#[test]
fn a_foot_on_an_ankle_stays_level_and_a_wheel_unturned() {
    let sole = [[-0.05, 0.0, -0.03], [0.1, 0.0, -0.03]];
    let biped = |range: [f64; 2]| {
        let mut parts = Vec::new();
        for (side, y) in [("left", 0.1), ("right", -0.1)] {
            let foot = format!("{side}_foot");
            parts.extend(leg("trunk", side, [0.0, y, 0.0], "0 1 0", BENT));
            parts.extend([part(&foot, &sole), hinge(&format!("{side}_calf"), &foot, FOOT, "0 1 0", range)]);
        }
        Stance::of(&parts)
    };
    let [feet, wheels] = [biped([-1.5, 1.5]), biped([-50.0, 50.0])];
    for foot in ["left_foot", "right_foot"] {
        let [heel, toe] = sole.map(|at| feet.place(foot, at));
        let middle = 0.5 * (heel + toe);
        assert!((heel.z - toe.z).abs() < 1e-3 && middle.x.abs() < 1e-3, "{foot}: heel {heel:?}, toe {toe:?}");
        let hub = wheels.place(foot, [0.0; 3]);
        assert!(
            wheels.joint(foot) == 0.0 && hub.x.abs() < 1e-3 && hub.z > -0.4,
            "{foot} turned by {}, at {hub:?}",
            wheels.joint(foot)
        );
    }
}
