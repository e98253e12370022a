//! Invalid URDFs are refused in one line that names the fault. No text overflows the reader's stack, which urdf-rs
//! alone does from some ten thousand nested elements. The campaign of `xtask` changes URDFs at random.

use super::common::*;

pub const ARM: &str = r#"<robot name="arm"><link name="base"/>
<link name="upper"><inertial><origin xyz="0 0 1" rpy="0 0 0"/><mass value="2"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
<collision><origin xyz="0 0 1"/><geometry><sphere radius="0.5"/></geometry></collision></link><link name="tip"/>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 1"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="10" velocity="5"/><dynamics damping="0.5" friction="0"/></joint>
<joint name="weld" type="fixed"><parent link="upper"/><child link="tip"/></joint></robot>"#;

#[test]
fn refusals_name_the_culprit_and_the_reason_in_one_line() {
    let table = [
        (r#"type="revolute""#, r#"type="spherical""#, "`shoulder`", "Spherical"),
        (r#"type="revolute""#, r#"type="floating""#, "`shoulder`", "floating"),
        (r#"<dynamics damping="0.5" friction="0"/>"#, r#"<mimic joint="weld"/>"#, "`shoulder`", "mimic"),
        (r#"friction="0""#, r#"friction="-0.1""#, "`shoulder`", "friction"),
        (r#"damping="0.5""#, r#"damping="1e300""#, "`shoulder`", "damping is 1e300"),
        (r#"upper="1""#, r#"upper="1e300""#, "`shoulder`", "limit"),
        (r#"<origin xyz="0 0 1"/><axis"#, r#"<origin xyz="0 1e300 1"/><axis"#, "`shoulder`", "origin"),
        ("</robot>", "", "not a URDF", "ends within"),
        ("</link>", "</lnk>", "not a URDF", "lnk"),
        (r#"axis xyz="0 1 0""#, r#"axis xyz="0 0 0""#, "`shoulder`", "axis"),
        (r#"axis xyz="0 1 0""#, r#"axis xyz="1e300 1e300 0""#, "`shoulder`", "axis"),
        (r#"lower="-1""#, r#"lower="2""#, "`shoulder`", "limit"),
        (r#"lower="-1""#, r#"lower="-inf""#, "`shoulder`", "limit"),
        (r#"mass value="2""#, r#"mass value="-2""#, "`upper`", "mass"),
        (r#"mass value="2""#, r#"mass value="1e308""#, "`upper`", "large"),
        (r#"ixy="0""#, r#"ixy="2""#, "`upper`", "positive semi-definite"),
        (r#"izz="1""#, r#"izz="inf""#, "`upper`", "not finite"),
        (r#"rpy="0 0 0""#, r#"rpy="0 nan 0""#, "`upper`", "origin"),
        (r#"<sphere radius="0.5"/>"#, r#"<sphere radius="-0.5"/>"#, "`upper`", "size"),
        (r#"<link name="tip"/>"#, r#"<link name="upper"/>"#, "`upper`", "twice"),
        (r#"name="weld""#, r#"name="shoulder""#, "`shoulder`", "twice"),
        (r#"child link="tip""#, r#"child link="nowhere""#, "`weld`", "`nowhere`"),
        (r#"parent link="base""#, r#"parent link="nowhere""#, "`shoulder`", "`nowhere`"),
        (r#"child link="tip""#, r#"child link="upper""#, "`weld`", "`upper`"),
        (r#"parent link="upper""#, r#"parent link="tip""#, "`tip`", "cycle"),
        (r#"<link name="tip"/>"#, r#"<link name="tip"/><link name="lost"/>"#, "`lost`", "roots"),
        (r#"child link="tip""#, r#"child link="base""#, "`base`", "cycle"),
        (r#"type="revolute""#, r#"type="fixed""#, "nothing moves", ""),
        (r#"type="revolute""#, r#"type="screw""#, "screw", "not a URDF"),
        (r#"mass value="2""#, r#"mass value="two""#, "line 2, link `upper`", "`two` is not a number"),
        (r#"mass value="2""#, r#"mass value="1,5""#, "<mass value=\"1,5\">", "`1,5` is not a number"),
        (r#"mass value="2""#, r#"mass value="${m}""#, "line 2, link `upper`", "xacro"),
        (
            r#"<origin xyz="0 0 1"/><axis"#,
            r#"<origin xyz="0 1"/><axis"#,
            "line 4, joint `shoulder`",
            "2 numbers, 3 are needed",
        ),
        (
            r#"<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>"#,
            "",
            "link `upper`",
            "<inertial> has no <inertia>",
        ),
        (r#"<sphere radius="0.5"/>"#, "", "line 3, link `upper`", "<geometry> is empty"),
        (r#"ixy="0""#, r#"ixy="0" iyx="0.1""#, "iyx is 0.1", "symmetric"),
        ("</robot>", "<xacro:wheel/></robot>", "<xacro:wheel>", "expand"),
        ("</robot>", r#"<loop_joint name="l" type="revolute"/></robot>"#, "<loop_joint>", "closed loop"),
        (r#"<robot name="arm">"#, r#"<sdf version="1"><robot name="arm">"#, "line 1", "an SDF file"),
    ];
    for (from, to, culprit, reason) in table {
        let error = refusal(&changed(ARM, from, to), Base::fixed());
        assert!(
            error.contains(culprit) && error.contains(reason),
            "{to}: `{error}` does not name {culprit} and {reason}"
        );
    }
}

#[test]
fn nesting_cannot_overflow_the_stack() {
    for filler in ["", r#" b=">/>""#] {
        let [open, close] = [format!("<a{filler}>"), "</a>".into()].map(|tag| tag.repeat(100_000));
        assert!(refusal(&urdf(&[open, close, link("a")]), Base::Floating).contains("nested"));
    }
    let commented = changed(ARM, "<link", &format!("<!-- {} --><link", "<a>".repeat(1000)));
    assert!(Robot::from_urdf(&commented, Base::fixed()).is_ok(), "elements in a comment do not count");
    // A chain of 2000 links is long, not deeply nested.
    let parts = (0..2001).map(|i| link(&format!("l{i}")));
    let joints = (0..2000).map(|i| joint(&format!("j{i}"), "continuous", &format!("l{i}"), &format!("l{}", i + 1), ""));
    let chain = Robot::from_urdf(&urdf(&parts.chain(joints).collect::<Vec<_>>()), Base::fixed()).expect("valid");
    assert_eq!(chain.nv(), 2000);
}

#[test]
fn a_misspelt_word_is_no_other_robot() {
    let good = r#"<robot name="r"><link name="a"/><link name="b"><inertial><origin xyz="0 0 1"/><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
        <joint name="j" type="continuous"><origin xyz="1 0 0"/><parent link="a"/><child link="b"/><axis xyz="0 1 0"/><dynamics damping="1"/></joint>
        <gazebo><orgin xzy="what a simulator makes of it"/></gazebo><transmission name="t"><axs/></transmission></robot>"#;
    assert!(
        Robot::from_urdf(&format!("\u{feff}{good}"), Base::fixed()).is_ok(),
        "others' elements are theirs, and so is an editor's mark"
    );
    for (from, to, word) in [
        ("origin xyz=\"1", "origin xzy=\"1", "`xzy`"),
        ("origin xyz=\"1", "orgin xyz=\"1", "<origin>"),
        ("<axis", "<axs", "<axis>"),
        ("damping=", "dampening=", "`dampening`"),
        ("<dynamics", "<dynamic", "<dynamics>"),
        ("<mass", "<mas", "<mass>"),
        ("type=\"continuous\"", "tpye=\"continuous\"", "`tpye`"),
        ("<joint name", "<jont name", "<joint>"),
    ] {
        let error = refusal(&changed(good, from, to), Base::fixed());
        assert!(error.contains(word), "{to}: {error}");
    }
    let inertial = good.replace("<inertial>", "<inertal>").replace("</inertial>", "</inertal>");
    assert!(refusal(&inertial, Base::fixed()).contains("<inertial>"));
}

/// Files may leave out optional elements, and repeat others.
#[test]
fn what_is_not_needed_may_be_missing_or_said_twice() {
    for (from, to) in [
        (r#" velocity="5""#, ""),
        (r#" effort="10""#, ""),
        (r#"ixy="0""#, r#"ixy="0" iyx="0" izx="0" izy="0""#),
        ("<dynamics", r#"<safety_controller soft_lower_limit="-0.9" k_position="100"/><calibration/><dynamics"#),
        ("</robot>", r#"<transmission name="t"><type/></transmission></robot>"#),
        ("<collision>", "<visual/><collision>"),
    ] {
        let robot = Robot::from_urdf(&changed(ARM, from, to), Base::fixed()).unwrap_or_else(|e| panic!("{to}: {e}"));
        let limits: Vec<_> = robot.joints().filter_map(|joint| joint.limit.map(|l| (l.lower, l.upper))).collect();
        assert_eq!(limits, [(-1.0, 1.0)], "{to}");
    }
    let endless =
        UrdfRobot::read(&changed(ARM, r#"lower="-1" upper="1" "#, ""), Base::fixed()).expect("a hinge without bounds");
    assert!(endless.robot.joints().all(|joint| joint.limit.is_none()), "it turns without end");
    assert!(endless.notes.iter().any(|n| n.contains("`shoulder`") && n.contains("no bounds")), "{:?}", endless.notes);
}
