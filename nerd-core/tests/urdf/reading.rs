//! The content of URDFs, and assumptions where a file is silent.

use nerd_core::robot::Bodies;

use super::{common::*, refusals::ARM};

/// A robot to which nothing, such as armature, is added later.
pub fn alone(text: &str) -> UrdfRobot {
    UrdfRobot::of_alone(&Bodies::from_urdf(text).expect("bodies").0, Base::fixed()).expect("a robot")
}

fn read(text: &str) -> UrdfRobot {
    UrdfRobot::read(text, Base::fixed()).expect("a robot")
}

#[test]
fn what_a_joint_says_is_read() {
    let robot = read(&changed(ARM, r#"friction="0""#, r#"friction="0.3""#)).robot;
    let joint = robot.joints().next().expect("one joint");
    let limit = joint.limit.expect("limited");
    assert_eq!((limit.lower, limit.upper, limit.stiffness, limit.damping), (-1.0, 1.0, 0.0, 0.0));
    assert_eq!(
        (joint.damping, joint.friction, joint.effort, joint.velocity, joint.armature),
        (0.5, 0.3, 10.0, 5.0, 0.0)
    );
    assert_eq!((robot.nq(), robot.nv(), robot.mass(), robot.dry()), (1, 1, 2.0, true));
}

#[test]
fn what_a_file_leaves_out_is_taken_for_granted_and_noted() {
    // A joint with limits of zero range would be a fixed one.
    let UrdfRobot { robot, notes, .. } =
        read(&changed(ARM, r#"<limit lower="-1" upper="1" effort="10" velocity="5"/>"#, ""));
    assert!(robot.joints().next().is_some_and(|j| j.limit.is_none() && j.wraps()));
    assert!(notes.len() == 1 && notes[0].contains("joint `shoulder`: <limit> is missing"), "{notes:?}");
    // Bodies on fixed joints become frames.
    let frames: Vec<_> = robot.frames.iter().map(|f| (f.name.as_str(), f.link)).collect();
    assert_eq!(frames, [("base", None), ("tip", Some(0))]);
    // A fixed link with an impossible inertia is noted, and accepted if the lumped inertia is valid.
    let odd = link("tip").replace(r#"mass value="1""#, r#"mass value="0""#).replace("\"1\"", "\"-1e-3\"");
    let notes = read(&changed(ARM, r#"<link name="tip"/>"#, &odd)).notes;
    assert!(notes.iter().any(|n| n.contains("link `tip`: inertia is not positive")), "{notes:?}");
    // Real files lack mass, break the triangle inequality and round; armature may come later.
    for (from, to) in
        [(r#"mass value="2""#, r#"mass value="0""#), (r#"izz="1""#, r#"izz="9""#), (r#"ixz="0""#, r#"ixz="1e-20""#)]
    {
        read(&changed(ARM, from, to));
    }
}

#[test]
fn a_joint_that_carries_no_mass_is_a_frame_where_nothing_will_be_added() {
    let text = changed(ARM, r#"name="weld" type="fixed""#, r#"name="weld" type="continuous""#);
    assert_eq!(read(&text).robot.joint_count(), 2, "armature may come later");
    let UrdfRobot { robot, notes, .. } = alone(&text);
    assert_eq!((robot.joint_count(), robot.frames.iter().filter(|f| f.name == "tip").count()), (1, 1));
    assert!(notes.iter().any(|n| n.contains("joint `weld`: it carries no mass")), "{notes:?}");
    assert_eq!(alone(ARM), read(ARM));
}

/// A mimic joint's limits narrow its leader's, through `q_b = -2 q_a + 0.1`. If no common range is left, the leader's
/// limits stay. An impossible inertia is noted.
#[test]
fn a_follower_narrows_its_leader() {
    let limited = |ends: [f64; 2], more: &str| {
        format!("<limit lower=\"{}\" upper=\"{}\" effort=\"9\" velocity=\"9\"/>{more}", ends[0], ends[1])
    };
    for (own, ends) in [([-0.5, 0.7], [-0.3, 0.3]), ([-4.0, 4.0], [-1.0, 1.0]), ([5.0, 6.0], [-1.0, 1.0])] {
        let follows = limited(own, r#"<mimic joint="ja" multiplier="-2" offset="0.1"/>"#);
        let joints = [
            joint("ja", "revolute", "base", "a", &limited([-1.0, 1.0], "")),
            joint("jb", "revolute", "base", "b", &follows),
        ];
        let UrdfRobot { robot, notes, .. } = read(&urdf(&[&["base", "a", "b"].map(link)[..], &joints].concat()));
        let limit = robot.joints().next().and_then(|j| j.limit).expect("it has limits");
        assert!((limit.lower - ends[0]).abs() + (limit.upper - ends[1]).abs() < 1e-12, "{own:?}: {limit:?}");
        assert_eq!(notes.iter().any(|n| n.contains("follows")), own != [-4.0, 4.0], "{notes:?}");
    }
    let thin = changed(ARM, r#"ixx=""#, r#"ixx="9"#);
    assert!(read(&thin).notes.iter().any(|n| n.contains("no body has the inertia")), "{:?}", read(&thin).notes);
}

#[test]
fn a_urdf_says_what_follows_what() {
    let text = |[b, c]: [&str; 2]| {
        let damped = |name: &str, parent: &str, child: &str, inner: &str| {
            joint(name, "continuous", parent, child, &format!(r#"<dynamics damping="0.5" friction="0.1"/>{inner}"#))
        };
        let joints = [damped("ja", "base", "a", ""), damped("jb", "a", "b", b), damped("jc", "base", "c", c)];
        urdf(&[&["base", "a", "b", "c"].map(link)[..], &joints].concat())
    };
    // c follows b, which follows a: 3 (2 q + 0.1) - 0.2.
    let [b, c] =
        [r#"<mimic joint="ja" multiplier="2" offset="0.1"/>"#, r#"<mimic joint="jb" multiplier="3" offset="-0.2"/>"#];
    let robot = read(&text([b, c])).robot;
    assert_eq!((robot.nq(), robot.joint_count(), robot.links.len()), (1, 1, 3));
    let c = robot.links[2].joint.as_ref().and_then(|j| j.mimic().copied()).expect("it follows");
    assert!((c.multiplier - 6.0).abs() < 1e-12 && (c.offset - 0.1).abs() < 1e-12 && c.coordinate == 0, "{c:?}");
    // Damping at the leader: 0.5 (1 + 2^2 + 6^2); dry friction: 0.1 (1 + 2 + 6).
    let a = robot.joints().next().expect("a joint");
    assert!((a.damping - 20.5).abs() < 1e-12 && (a.friction - 0.9).abs() < 1e-12, "{} and {}", a.damping, a.friction);
    // Integer multipliers allow a wrapped angle; others do not.
    assert!(a.wraps());
    let half = read(&text([r#"<mimic joint="ja" multiplier="0.5"/>"#, ""])).robot;
    assert!(!half.joints().next().expect("a joint").wraps());
    // An unknown leader leaves the joint independent.
    let alone = read(&text([r#"<mimic joint="nobody"/>"#, ""]));
    assert_eq!(alone.robot.joint_count(), 3);
    assert!(alone.notes[0].contains("joint `jb`: <mimic> of `nobody`, which is not there"), "{:?}", alone.notes);
    for (mimics, reason) in [
        ([r#"<mimic joint="jc"/>"#, r#"<mimic joint="jb"/>"#], "leads back to itself"),
        ([r#"<mimic joint="jb"/>"#, ""], "leads back to itself"),
        ([r#"<mimic joint="ja" multiplier="NaN"/>"#, ""], "not finite"),
        ([r#"<mimic joint="ja" multiplier="1e99"/>"#, ""], "absurd"),
    ] {
        let error = refusal(&text(mimics), Base::fixed());
        assert!(error.contains(reason), "`{error}` does not name `{reason}`");
    }
}

#[test]
fn what_things_look_like_is_not_looked_at() {
    // urdf-rs requires a file name for every texture. Comments are kept as they are.
    let weld = joint("j", "fixed", "tip", "l", "");
    for extra in [
        r#"<material name="a"><texture/></material>"#.into(),
        r#"<material name="a"/><!-- <material> --><material name="b"><color rgba="1 1 1 1"/></material>"#.into(),
        format!(
            r#"<link name="l"><visual><geometry><sphere radius="1"/></geometry><material name=""><texture /></material></visual></link>{weld}"#
        ),
        // Quotes, comments and CDATA may hold text that looks like the end of an element.
        format!(
            r#"<material name="a>b"/><link name="l"/>{weld}<material name="</material>"><texture filename='<material>'/></material>
            <!-- "</material> --><material name='"'/>"#
        ),
        format!(
            r#"<material name="a"><color/><material name="b"/></material><link name="l"><![CDATA[<material>]]></link>{weld}"#
        ),
    ] {
        let robot = read(&ARM.replace("</robot>", &format!("{extra}</robot>"))).robot;
        assert_eq!((robot.mass(), robot.links[0].shapes.len()), (2.0, 1), "{extra}");
        // Also before the first link, where dropping too much would drop the robot.
        assert_eq!(read(&changed(ARM, "<link", "<material name=\"a>b\"/><link")).robot.links, robot.links[..1]);
    }
    let open = ARM.replace("</robot>", r#"<material name="a"></robot>"#);
    assert!(Robot::from_urdf(&open, Base::fixed()).is_err(), "an element that does not end");
}
