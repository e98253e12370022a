//! A URDF that cannot be honoured is refused by name, in one line; no text at all makes the reader panic or overflow
//! its stack, which urdf-rs alone does from some ten thousand nested elements.

use nerd_core::robot::Robot;
use proptest::prelude::*;

const ARM: &str = r#"<robot name="arm"><link name="base"/>
<link name="upper"><inertial><origin xyz="0 0 1" rpy="0 0 0"/><mass value="2"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
<collision><origin xyz="0 0 1"/><geometry><sphere radius="0.5"/></geometry></collision></link><link name="tip"/>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 1"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="10" velocity="5"/><dynamics damping="0.5" friction="0"/></joint>
<joint name="weld" type="fixed"><parent link="upper"/><child link="tip"/></joint></robot>"#;

#[test]
fn what_a_joint_says_is_read() {
    let robot = Robot::from_urdf(ARM, false).expect("valid");
    let joint = robot.joints().next().expect("one joint");
    let limit = joint.limit.expect("limited");
    assert_eq!((limit.lower, limit.upper, limit.stiffness, limit.damping), (-1.0, 1.0, 0.0, 0.0));
    assert_eq!((joint.damping, joint.effort, joint.velocity, joint.armature), (0.5, 10.0, 5.0, 0.0));
    assert_eq!((robot.nq(), robot.nv(), robot.mass()), (1, 1, 2.0));
}

#[test]
fn refusals_name_the_culprit_and_the_reason_in_one_line() {
    let table = [
        (r#"type="revolute""#, r#"type="spherical""#, "`shoulder`", "Spherical"),
        (r#"type="revolute""#, r#"type="floating""#, "`shoulder`", "floating"),
        (r#"<dynamics damping="0.5" friction="0"/>"#, r#"<mimic joint="weld"/>"#, "`shoulder`", "mimic"),
        (r#"friction="0""#, r#"friction="-0.1""#, "`shoulder`", "friction"),
        (r#"friction="0""#, r#"friction="nan""#, "`shoulder`", "friction"),
        (r#"damping="0.5""#, r#"damping="-1""#, "`shoulder`", "damping"),
        (r#"damping="0.5""#, r#"damping="inf""#, "`shoulder`", "damping"),
        (r#"damping="0.5""#, r#"damping="1e300""#, "`shoulder`", "damping is 1e300"),
        (r#"upper="1""#, r#"upper="1e300""#, "`shoulder`", "limit"),
        (r#"<origin xyz="0 0 1"/><axis"#, r#"<origin xyz="0 1e300 1"/><axis"#, "`shoulder`", "origin"),
        (r#"<sphere radius="0.5"/>"#, r#"<sphere radius="1e300"/>"#, "`upper`", "size"),
        ("</robot>", "", "not a URDF", "ends within"),
        ("</link>", "</lnk>", "not a URDF", "lnk"),
        (r#"axis xyz="0 1 0""#, r#"axis xyz="0 0 0""#, "`shoulder`", "axis"),
        (r#"axis xyz="0 1 0""#, r#"axis xyz="nan 1 0""#, "`shoulder`", "axis"),
        (r#"axis xyz="0 1 0""#, r#"axis xyz="1e300 1e300 0""#, "`shoulder`", "axis"),
        (r#"lower="-1""#, r#"lower="2""#, "`shoulder`", "limit"),
        (r#"lower="-1""#, r#"lower="-inf""#, "`shoulder`", "limit"),
        (r#"lower="-1""#, r#"lower="nan""#, "`shoulder`", "limit"),
        (r#"<origin xyz="0 0 1"/><axis"#, r#"<origin xyz="0 inf 1"/><axis"#, "`shoulder`", "origin"),
        (r#"mass value="2""#, r#"mass value="-2""#, "`upper`", "mass"),
        (r#"mass value="2""#, r#"mass value="nan""#, "`upper`", "mass"),
        (r#"mass value="2""#, r#"mass value="1e308""#, "`upper`", "large"),
        (r#"ixx="1""#, r#"ixx="-1""#, "`upper`", "positive semi-definite"),
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
        (r#"mass value="2""#, r#"mass value="two""#, "float", "not a URDF"),
    ];
    for (from, to, culprit, reason) in table {
        let text = ARM.replacen(from, to, 1);
        assert_ne!(text, ARM, "{from} is not in the text");
        let error = Robot::from_urdf(&text, false).expect_err(to).to_string();
        assert!(error.contains(culprit) && error.contains(reason), "{to}: `{error}` does not name {culprit} and {reason}");
        assert!(!error.contains('\n'), "{to}: more than one line: {error}");
    }
}

#[test]
fn what_a_file_leaves_out_is_taken_for_granted_and_said() {
    // A joint without limits that cannot move would be a fixed one.
    let robot =
        Robot::from_urdf(&ARM.replacen(r#"<limit lower="-1" upper="1" effort="10" velocity="5"/>"#, "", 1), false).expect("a robot");
    assert!(robot.joints().next().is_some_and(|j| j.limit.is_none() && j.wraps()));
    assert!(robot.notes.len() == 1 && robot.notes[0].contains("joint `shoulder`: <limit> is missing"), "{:?}", robot.notes);
    // Links on fixed joints are frames.
    let frames: Vec<_> = robot.frames.iter().map(|f| (f.name.as_str(), f.link)).collect();
    assert_eq!(frames, [("base", None), ("tip", Some(0))]);
    // A fixed link that no body can be is said, and harms nothing where the whole is sound.
    let odd =
        r#"<link name="tip"><inertial><mass value="0"/><inertia ixx="-1e-3" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial></link>"#;
    let robot = Robot::from_urdf(&ARM.replacen(r#"<link name="tip"/>"#, odd, 1), false).expect("a robot");
    assert!(robot.notes.iter().any(|n| n.contains("link `tip`: inertia is not positive")), "{:?}", robot.notes);
}

#[test]
fn a_joint_that_carries_no_mass_is_a_frame_where_nothing_will_be_added() {
    let massless = r#"<link name="tip"/>"#;
    let text = ARM.replacen(r#"name="weld" type="fixed""#, r#"name="weld" type="continuous""#, 1);
    assert!(text != ARM && text.contains(massless), "the arm has no such joint");
    let kept = Robot::from_urdf(&text, false).expect("a robot");
    assert_eq!(kept.joint_count(), 2, "armature may come later");
    let alone = Robot::from_urdf_alone(&text, false).expect("a robot");
    assert_eq!((alone.joint_count(), alone.frames.iter().filter(|f| f.name == "tip").count()), (1, 1));
    assert!(alone.notes.iter().any(|n| n.contains("joint `weld`: it carries no mass")), "{:?}", alone.notes);
    // All else is as it was.
    assert_eq!(Robot::from_urdf_alone(ARM, true).expect("a robot"), Robot::from_urdf(ARM, true).expect("a robot"));
}

#[test]
fn a_moving_link_may_lack_mass_and_a_triangle_inequality() {
    // Real files break both; armature comes later, and the moments are what the file says.
    for (from, to) in [(r#"mass value="2""#, r#"mass value="0""#), (r#"izz="1""#, r#"izz="9""#)] {
        assert!(Robot::from_urdf(&ARM.replacen(from, to, 1), false).is_ok(), "{to}");
    }
}

#[test]
fn nesting_cannot_overflow_the_stack() {
    for filler in ["", r#" b=">/>""#] {
        let deep =
            format!(r#"<robot name="r">{}{}<link name="a"/></robot>"#, format!("<a{filler}>").repeat(100_000), "</a>".repeat(100_000));
        let error = Robot::from_urdf(&deep, true).expect_err("too deep").to_string();
        assert!(error.contains("nested"), "{error}");
    }
    let commented = ARM.replacen("<link", &format!("<!-- {} --><link", "<a>".repeat(1000)), 1);
    assert!(Robot::from_urdf(&commented, false).is_ok(), "elements in a comment do not count");
    // A chain of 2000 links is long, not deep.
    let links: String = (0..2001).map(|i| format!(r#"<link name="l{i}"/>"#)).collect();
    let joints: String = (0..2000)
        .map(|i| format!(r#"<joint name="j{i}" type="continuous"><parent link="l{i}"/><child link="l{}"/></joint>"#, i + 1))
        .collect();
    let chain = Robot::from_urdf(&format!(r#"<robot name="r">{links}{joints}</robot>"#), false).expect("valid");
    assert_eq!(chain.nv(), 2000);
}

#[test]
fn dry_friction_is_read() {
    let robot = Robot::from_urdf(&ARM.replacen(r#"friction="0""#, r#"friction="0.3""#, 1), false).expect("valid");
    assert_eq!(robot.joints().next().map(|j| (j.damping, j.friction)), Some((0.5, 0.3)));
    assert!(robot.dry());
}

#[test]
fn what_things_look_like_is_not_looked_at() {
    // urdf-rs wants a file's name of every texture; comments stay whole, whatever is in them.
    for extra in [
        r#"<material name="a"><texture/></material>"#,
        r#"<material name="a"/><!-- <material> --><material name="b"><color rgba="1 1 1 1"/></material>"#,
        r#"<link name="l"><visual><geometry><sphere radius="1"/></geometry><material name=""><texture /></material></visual></link>
           <joint name="j" type="fixed"><parent link="tip"/><child link="l"/></joint>"#,
        // Quotes, comments and CDATA may hold what looks like the end of something.
        r#"<material name="a>b"/><link name="l"/><joint name="j" type="fixed"><parent link="tip"/><child link="l"/></joint>
           <material name="</material>"><texture filename='<material>'/></material><!-- "</material> --><material name='"'/>"#,
        r#"<material name="a"><color/><material name="b"/></material><link name="l"><![CDATA[<material>]]></link>
           <joint name="j" type="fixed"><parent link="tip"/><child link="l"/></joint>"#,
    ] {
        let robot = Robot::from_urdf(&ARM.replace("</robot>", &format!("{extra}</robot>")), false).expect(extra);
        assert_eq!((robot.mass(), robot.links[0].shapes.len()), (2.0, 1), "{extra}");
        // Before all else, too, where what a reader loses is the robot.
        let first = ARM.replacen("<link", "<material name=\"a>b\"/><link", 1);
        assert_eq!(Robot::from_urdf(&first, false).expect("valid").links, robot.links[..1]);
    }
    let open = ARM.replace("</robot>", r#"<material name="a"></robot>"#);
    assert!(Robot::from_urdf(&open, false).is_err(), "an element that does not end");
}

#[test]
fn a_rounding_error_is_no_negative_inertia() {
    let tiny =
        ARM.replacen(r#"ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1""#, r#"ixx="0" ixy="0" ixz="1e-20" iyy="0" iyz="0" izz="0""#, 1);
    assert_ne!(tiny, ARM);
    assert!(Robot::from_urdf(&tiny, false).is_ok());
}

/// Reads a text as both kinds of robot; a robot that comes out is finite.
fn read(text: &str) -> Result<(), TestCaseError> {
    for floating in [false, true] {
        match Robot::from_urdf(text, floating) {
            Ok(robot) => prop_assert!(robot.mass().is_finite() && robot.links.iter().all(|l| l.inertia.inertia.sum().is_finite())),
            Err(error) => prop_assert!(!error.to_string().contains('\n')),
        }
    }
    Ok(())
}

const NUMBERS: [&str; 12] = ["0", "-1", "nan", "inf", "-inf", "1e308", "-1e308", "1e-320", "", "1 2", "x", "&lt;"];

proptest! {
    #![proptest_config(ProptestConfig { cases: 500, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_text_at_all(text in "\\PC{0,200}") {
        read(&text)?;
    }

    #[test]
    fn pieces_of_xml(pieces in prop::collection::vec(prop::sample::select(ARM.split_inclusive(['<', '>', '"', ' ']).collect::<Vec<_>>()), 0..80)) {
        read(&format!("<robot name=\"r\">{}</robot>", pieces.concat()))?;
    }

    #[test]
    fn a_valid_file_with_bytes_changed(edits in prop::collection::vec((0..ARM.len(), " -~"), 1..6), cut in 0..ARM.len() * 4) {
        let mut text = ARM.to_owned();
        for (at, with) in edits {
            text.replace_range(at..at + 1, &with);
        }
        text.truncate(cut);
        read(&text)?;
    }

    #[test]
    fn a_valid_file_with_numbers_changed(edits in prop::collection::vec((0..60usize, 0..NUMBERS.len()), 1..6)) {
        // Every second piece between quotes is an attribute.
        let mut pieces: Vec<&str> = ARM.split('"').collect();
        for (at, with) in edits {
            let at = ((2 * at + 1) % (pieces.len() - 1)) | 1;
            pieces[at] = NUMBERS[with];
        }
        read(&pieces.join("\""))?;
    }
}

#[test]
fn a_misspelt_word_is_no_other_robot() {
    let good = r#"<robot name="r"><link name="a"/><link name="b"><inertial><origin xyz="0 0 1"/><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
        <joint name="j" type="continuous"><origin xyz="1 0 0"/><parent link="a"/><child link="b"/><axis xyz="0 1 0"/><dynamics damping="1"/></joint>
        <gazebo><orgin xzy="what a simulator makes of it"/></gazebo><transmission name="t"><axs/></transmission></robot>"#;
    assert!(Robot::from_urdf(&format!("\u{feff}{good}"), false).is_ok(), "others' elements are theirs, and so is an editor's mark");
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
        let bad = good.replace(from, to);
        assert_ne!(bad, good, "{from}");
        let error = Robot::from_urdf(&bad, false).expect_err(to).to_string();
        assert!(error.contains(word) && !error.contains('\n'), "{to}: {error}");
    }
    let inertial = good.replace("<inertial>", "<inertal>").replace("</inertial>", "</inertal>");
    let error = Robot::from_urdf(&inertial, false).expect_err("no inertia").to_string();
    assert!(error.contains("<inertial>"), "{error}");
}
