//! Joints, links and frames by name.

use super::common::*;

/// A leg of two joints on a floating trunk. The foot is fixed to the shank; the toe's joint mimics the knee.
fn leg() -> Robot {
    let [hip, knee] = ["hip", "knee"].map(|n| {
        joint(
            n,
            "continuous",
            if n == "hip" { "trunk" } else { "thigh" },
            if n == "hip" { "thigh" } else { "shank" },
            "",
        )
    });
    let parts = ["trunk", "thigh", "shank", "foot", "toe"].map(link).into_iter().chain([
        hip,
        knee,
        joint("ankle", "fixed", "shank", "foot", r#"<origin xyz="0 0 -0.2"/>"#),
        joint("curl", "continuous", "shank", "toe", r#"<mimic joint="knee" multiplier="2"/>"#),
    ]);
    Robot::from_urdf(&urdf(&parts.collect::<Vec<_>>()), Base::Floating).expect("a leg")
}

#[test]
fn a_joint_is_set_by_name() {
    let robot = leg();
    let knee = robot.joint("knee").expect("a knee");
    assert_eq!(knee, JointIndex { joint: 1, q: 8, qd: 7, link: 2 });
    let mut q = robot.zero_state();
    q[knee.q] = std::f64::consts::PI;
    let foot = robot.pose(&q, &robot.frame("foot").expect("a foot")).translation.vector;
    // Half a turn about the x axis, URDF's default axis.
    assert!((foot - Vector3::new(0.0, 0.0, 0.2)).norm() < 1e-15, "the foot is at {foot}");
}

#[test]
fn an_unknown_name_is_refused_in_one_line_with_those_near() {
    let robot = leg();
    let text = |e: UnknownName| e.to_string();
    for (error, expected) in [
        (robot.joint("kne").map_err(text).err(), "robot `r` has no moving joint `kne`; near are `knee`"),
        (robot.joint("elbow").map_err(text).err(), "robot `r` has no moving joint `elbow`; it has `hip`, `knee`"),
        (robot.joint("curl").map_err(text).err(), "robot `r` has no joint of its own `curl`; it follows `knee`"),
        (robot.joint("an\nkle").map_err(text).err(), "robot `r` has no moving joint `an\\nkle`; it has `hip`, `knee`"),
        (
            robot.link("foot").map_err(text).err(),
            "robot `r` has no moving link `foot`; it is fixed on `shank` and a frame of it",
        ),
        (robot.link("shanks").map_err(text).err(), "robot `r` has no moving link `shanks`; near are `shank`"),
        (
            robot.frame("feet").map(|f| f.link).map_err(text).err(),
            "robot `r` has no link or frame `feet`; near are `foot`",
        ),
    ] {
        assert_eq!(error.as_deref(), Some(expected));
    }
}
