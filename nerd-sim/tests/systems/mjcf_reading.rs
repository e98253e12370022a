//! Results of MuJoCo's compiler: defaults, ranges, frames, files. Values are from MuJoCo 4.0's compiled models.

use nerd_core::robot::ShapeKind;
use nerd_sim::prelude::*;
use nerd_sim::system::JointSpec;

use crate::common::line;

const ARM: &str = r#"<worldbody><body name="arm" pos="0 0 1"><joint name="a" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 0 0 -.4" size=".03"/></body></worldbody>"#;

fn read(text: &str) -> System {
    System::from_text("r", text, None).unwrap_or_else(|e| panic!("{text}: {e}"))
}

/// The arm's joint, as read with these defaults and this actuator.
fn driven(defaults: &str, actuator: &str) -> JointSpec {
    let text = format!(
        "<mujoco><compiler angle=\"radian\"/><default>{defaults}</default>{ARM}<actuator>{actuator}</actuator></mujoco>"
    );
    read(&text).spec.joints[0].clone()
}

#[test]
fn actuators_of_all_kinds_share_the_default_of_a_class() {
    let position = r#"<position joint="a" kp="100"/>"#;
    assert_eq!(driven(r#"<motor forcerange="-3 3"/>"#, position).gain, Some(3.0));
    let later = driven(r#"<general forcerange="-87 87"/><position forcerange="-100 100"/>"#, position);
    assert_eq!(later.gain, Some(100.0), "the later line wins");
    let general = driven(r#"<position kp="40" kv="2"/>"#, r#"<general joint="a"/>"#);
    assert_eq!([general.kp, general.kd], [40.0, 2.0]);
    let motor = driven(r#"<position kp="40" kv="2"/>"#, r#"<motor joint="a" gear="3" ctrlrange="-1 1"/>"#);
    assert_eq!(([motor.kp, motor.kd], motor.gain), ([0.0; 2], Some(3.0)), "a motor is no servo");
    let reset = driven(r#"<position kp="40"/><motor gear="2"/>"#, r#"<position joint="a"/>"#);
    assert_eq!(reset.kp, 4.0, "kp is 1 again, and the gear counts twice");
}

/// `kd = 2 ratio sqrt(kp m)`, where the joint's inertia m is the capsule's about its end plus the armature.
#[test]
fn a_damping_ratio_counts_from_the_joints_inertia() {
    let own = driven("<joint armature=\".02\"/>", r#"<position joint="a" kp="50" dampratio=".7"/>"#);
    let inertia = read(&format!("<mujoco>{ARM}</mujoco>")).robot.links[0].inertia;
    let m = inertia.inertia[(1, 1)] + inertia.mass * inertia.com.norm_squared() + 0.02;
    assert!((own.kd / (1.4 * (50.0 * m).sqrt()) - 1.0).abs() < 1e-9, "kd {} of an inertia of {m}", own.kd);
    let saved = driven("", r#"<general joint="a" input="pos" biastype="affine" gainprm="50" biasprm="0 -50 -2"/>"#);
    assert_eq!([saved.kp, saved.kd], [50.0, 2.0]);
}

/// A tendon over two fingers, one a follower of the other, acts on one coordinate.
#[test]
fn an_actuator_on_a_tendon_of_one_coordinate_is_read() {
    let finger = |k: usize| {
        format!(r#"<body pos="0 .{k} 0"><joint name="f{k}" type="slide" axis="0 1 0"/><geom size=".1"/></body>"#)
    };
    let text = format!(
        r#"<mujoco><worldbody>{}{}</worldbody><equality><joint joint1="f2" joint2="f1"/></equality><tendon><fixed name="t"><joint joint="f1" coef=".5"/>
        <joint joint="f2" coef=".5"/></fixed></tendon><actuator><position tendon="t" kp="100" kv="10" forcerange="-20 20"/></actuator></mujoco>"#,
        finger(1),
        finger(2)
    );
    let joint = &read(&text).spec.joints[0];
    assert_eq!(([joint.kp, joint.kd], joint.gain), ([100.0, 10.0], Some(20.0)));
}

/// A tendon of constant length makes one of its two joints follow the other. A joint with coefficient 0 takes no part.
#[test]
fn a_taut_tendon_of_two_joints_couples_them() {
    let finger = |k: usize| {
        format!(
            r#"<body pos="0 .{k} 0"><joint name="f{k}" type="slide" axis="0 1 0" ref=".{k}"/><geom size=".1"/></body>"#
        )
    };
    let text = format!(
        r#"<mujoco><worldbody>{}{}{}</worldbody><tendon><fixed name="t"><joint joint="f1" coef="-.5"/><joint joint="f2" coef=".25"/></fixed>
        <fixed name="one"><joint joint="f1" coef="0"/><joint joint="f3" coef="2"/></fixed></tendon><equality><tendon tendon1="t" polycoef=".1"/></equality>
        <actuator><motor tendon="one" ctrlrange="-3 3"/></actuator></mujoco>"#,
        finger(1),
        finger(2),
        finger(3)
    );
    let system = read(&text);
    let mimic = system.robot.links[1].joint.as_ref().and_then(|j| j.mimic()).expect("it follows");
    // -.5 (f1 - .1) + .25 (f2 - .2) = .1
    assert!((mimic.multiplier - 2.0).abs() < 1e-12 && (mimic.offset - 0.4).abs() < 1e-12, "{mimic:?}");
    assert_eq!(system.spec.joints[1].gain, Some(6.0));
    let three = text
        .replace("<fixed name=\"one\">", "<fixed name=\"one\"><joint joint=\"f2\" coef=\"1\"/>")
        .replace("tendon1=\"t\"", "tendon1=\"one\"");
    let three = three.replace("coef=\"0\"", "coef=\"1\"");
    let refused = System::from_text("r", &three, None).expect_err("three joints").to_string();
    assert!(refused.contains("`one` is no fixed tendon of two joints"), "{refused}");
}

/// Static objects under a bolted-down robot are in its scene, with meshes. Only pairs that the file allows meet, and a
/// start may be as deep as the file's own pose.
#[test]
fn what_an_arm_is_bolted_to_is_in_its_scene() {
    let corner =
        |k: usize| format!("{} {} {} ", 0.2 * (k & 1) as f64 - 0.1, 0.1 * (k & 2) as f64 - 0.1, 0.025 * (k & 4) as f64);
    let block: String = (0..8).map(corner).collect();
    let file = |more: &str| {
        format!(
            r#"<mujoco><compiler angle="radian"/><asset><mesh name="block" vertex="{block}"/></asset><worldbody><body name="stand" pos="0 0 -.1">
            <geom type="mesh" mesh="block"/><geom type="box" size=".05 .05 .05" pos=".5 0 .05"/><body name="arm" pos="0 0 .1"><joint name="a" axis="0 1 0"
            range="-1 1"/><geom type="sphere" size=".03" pos="0 0 -.01"/><geom type="capsule" fromto="0 0 .1 0 0 .4" size=".03"/></body></body></worldbody>{more}</mujoco>"#
        )
    };
    let depth = |system: &System| {
        let (mut data, mut events) = (system.data(), Vec::new());
        let scene = system.scene("ground").expect("the file's scene");
        nerd_sim::system::contacts(system, &scene, &system.default_state(), &mut data, &mut events);
        let depth = |(p, e): (&ContactPoint, &ContactEvent)| p.radius - e.distance;
        (scene.colliders.len(), system.robot.contact_points.iter().zip(&events).map(depth).fold(f64::MIN, f64::max))
    };
    let system = System::from_text("r", &file(""), Some("like = \"urdf\"")).expect("an arm");
    let (colliders, deep) = depth(&system);
    assert!(system.base.is_empty() && colliders == 2, "{colliders} colliders");
    assert!((deep - 0.04).abs() < 1e-7, "the ball is {deep} m inside of the block, not 0.04 m");
    assert!(system.notes.iter().any(|note| note.contains("`arm` is 40.0 mm inside")), "{:?}", system.notes);
    assert_eq!(system.spec.data_scene.as_deref(), Some("ground"));
    let apart = file(r#"<contact><exclude body1="stand" body2="arm"/></contact>"#);
    let (_, deep) = depth(&System::from_text("r", &apart, Some("like = \"urdf\"")).expect("an arm"));
    assert!(deep < -1e3, "what is excluded meets: {deep} m deep");
}

/// Sizes and positions as MuJoCo's compiler fits them to a brick with edges of .1, .2 and .4 m.
#[test]
fn primitives_are_fitted_to_meshes() {
    let corner = |k: usize| format!("{} {} {} ", 0.1 * (k & 1) as f64, 0.1 * (k & 2) as f64, 0.1 * (k & 4) as f64);
    let faces = "0 2 3  0 3 1  4 5 7  4 7 6  0 1 5  0 5 4  2 6 7  2 7 3  0 4 6  0 6 2  1 3 7  1 7 5";
    let fitted = |kind: &str, around: bool| {
        let text = format!(
            r#"<mujoco><compiler fitaabb="{around}"/><asset><mesh name="m" vertex="{}" face="{faces}" inertia="exact"/></asset><worldbody><body>
            <freejoint/><geom type="{kind}" mesh="m" fitscale="2"/></body></worldbody></mujoco>"#,
            (0..8).map(corner).collect::<String>()
        );
        let shape = read(&text).robot.links[0].shapes[0].clone();
        let off = (shape.pose.translation.vector - Vector3::new(0.05, 0.1, 0.2)).norm();
        assert!(off < 1e-7, "{kind}: its middle is {off} m off");
        shape
    };
    for around in [false, true] {
        let ShapeKind::Box { half } = fitted("box", around).kind else { panic!("no box") };
        assert!((half - Vector3::new(0.1, 0.2, 0.4)).norm() < 1e-7, "{half}");
        let capsule = fitted("capsule", around);
        let ShapeKind::Capsule { radius, half_length } = capsule.kind else { panic!("no capsule") };
        let expected = if around { [0.2, 0.2] } else { [0.15, 0.325] };
        assert!(
            (radius - expected[0]).abs() + (half_length - expected[1]).abs() < 1e-7,
            "radius {radius}, half length {half_length}"
        );
        assert!((capsule.pose.rotation * Vector3::z()).z.abs() > 1.0 - 1e-9, "it lies along another axis");
    }
}

/// `gravcomp` cancels weight. A free root's armature adds inertia without weight, and its damping slows the root down.
#[test]
fn gravity_compensation_and_a_damped_root_act_as_said() {
    let arm = |gravcomp: f64| ARM.replace("<body name=\"arm\"", &format!("<body name=\"arm\" gravcomp=\"{gravcomp}\""));
    let holds = |gravcomp: f64| {
        let system = read(&format!("<mujoco>{}</mujoco>", arm(gravcomp)));
        system.data().gravity_torque(&system.robot, &[0.7], &system.gravity())[0]
    };
    assert!(
        (holds(0.25) - 0.75 * holds(0.0)).abs() < 1e-12 && holds(1.0).abs() < 1e-12,
        "{} of {}",
        holds(0.25),
        holds(0.0)
    );
    let free = |joint: &str| {
        let system = read(&format!(
            r#"<mujoco><worldbody><body>{joint}<geom type="sphere" size=".1" mass="1.5"/></body></worldbody></mujoco>"#
        ));
        let mut state = system.default_state();
        state[10] = 2.0;
        let (q, qd) = system.robot.split(&state);
        system
            .data()
            .forward_dynamics(&system.robot, q, &qd.to_local(&system.robot, q), &[0.0; 6], &system.gravity())
            .expect("a mass")
            .clone()
    };
    let damped = free(r#"<joint type="free" armature=".5" damping=".3"/>"#);
    // (m + a) v' = m g - d v
    assert!((damped[3] + 0.3).abs() < 1e-12 && (damped[5] + 9.81 * 0.75).abs() < 1e-12, "{damped}");
    assert!((free("<freejoint/>")[5] + 9.81).abs() < 1e-12);
    let refused = |joint: &str| {
        let text = format!(r#"<mujoco><worldbody><body>{joint}<geom size=".1"/></body></worldbody></mujoco>"#);
        System::from_text("r", &text, None).expect_err("refused").to_string()
    };
    assert!(refused(r#"<joint type="free" frictionloss="1"/>"#).contains("frictionloss"));
    assert!(refused(r#"<joint type="free" damping="9e3"/>"#).contains("within a step"));
}

/// For an open mesh, a unit cube without its lid, MuJoCo counts all pyramids about the centre found first.
#[test]
fn an_open_mesh_has_the_inertia_of_the_compiler() {
    let corner = |k: usize| format!("{} {} {} ", k & 1, k >> 1 & 1, k >> 2);
    let faces = "0 2 3  0 3 1  0 1 5  0 5 4  2 6 7  2 7 3  0 4 6  0 6 2  1 3 7  1 7 5";
    let text = format!(
        r#"<mujoco><asset><mesh name="m" vertex="{}" face="{faces}"/></asset><worldbody><body><freejoint/><geom type="mesh" mesh="m"/></body></worldbody>
        </mujoco>"#,
        (0..8).map(corner).collect::<String>()
    );
    let own = read(&text).robot.links[0].inertia;
    let mut moments: Vec<f64> = own.inertia.symmetric_eigenvalues().iter().copied().collect();
    moments.sort_by(f64::total_cmp);
    let off = moments
        .iter()
        .zip([123.97539062, 123.97539062, 147.08333333])
        .map(|(a, b)| (a / b - 1.0).abs())
        .fold(0.0, f64::max);
    assert!((own.mass - 804.1666666666666).abs() < 1e-9 && (own.com.z - 0.4125).abs() < 1e-12, "{own:?}");
    assert!(off < 1e-9, "moments {moments:?}");
}

#[test]
fn a_range_without_width_is_none() {
    let limit = |joint: &str| {
        let body = ARM.replace("<joint ", &format!("<joint {joint} "));
        let class = r#"<default><joint range="0 1"/></default>"#;
        read(&format!("<mujoco><compiler angle=\"radian\"/>{class}{body}</mujoco>"))
            .robot
            .joints()
            .next()
            .and_then(|j| j.limit)
    };
    assert_eq!(limit("").map(|l| [l.lower, l.upper]), Some([0.0, 1.0]));
    assert!(limit(r#"range="0 0""#).is_none() && limit(r#"range="2 1""#).is_none());
    let bounded = |more: &str| {
        let body = ARM.replace("<joint ", &format!("<joint actuatorfrcrange=\"{more}\" "));
        read(&format!("<mujoco>{body}</mujoco>")).robot.joints().next().map(|j| j.effort)
    };
    assert_eq!([bounded("-4 4"), bounded("0 0")], [Some(4.0), Some(f64::INFINITY)]);
}

/// A site given by its ends is in their middle. A body's frame is the file's, wherever its joint is.
#[test]
fn sites_and_bodies_have_the_frames_of_the_file() {
    let text = r#"<mujoco><worldbody><body name="arm" pos=".2 0 1"><joint name="a" axis="0 1 0" pos="-.2 0 .3"/><geom size=".1"/>
        <site name="s" type="capsule" fromto="-.1 0 .1 .1 0 .1" size=".01"/></body></worldbody></mujoco>"#;
    let system = read(text);
    let at = |name: &str| system.robot.pose(&[0.0], &system.robot.frame(name).expect("a frame"));
    assert!((at("arm").translation.vector - Vector3::new(0.2, 0.0, 1.0)).norm() < 1e-12, "{}", at("arm"));
    assert!((at("s").translation.vector - Vector3::new(0.2, 0.0, 1.1)).norm() < 1e-12, "{}", at("s"));
    assert!(
        (at("s").rotation * Vector3::z() + Vector3::x()).norm() < 1e-12,
        "z points from its second end to its first"
    );
}

/// Files include others from their own folders, with meshes beside the included file. The brick's mass is its mesh's.
#[test]
fn included_files_find_what_lies_beside_them() {
    let folder = tempfile::tempdir().expect("a folder");
    let write = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().expect("a folder")).expect("made");
        std::fs::write(&path, text).expect("written");
        path.display().to_string()
    };
    let corner =
        |k: usize| format!("v {} {} {}\n", 0.1 * (k & 1) as f64, 0.1 * (k >> 1 & 1) as f64, 0.1 * (k >> 2) as f64);
    let faces = "f 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\nf 2 4 8 6\n";
    write("kit/brick.obj", &((0..8).map(corner).collect::<String>() + faces));
    write(
        "kit/inner.xml",
        r#"<mujocoinclude><asset><mesh file="brick.obj" smoothnormal="true"/></asset></mujocoinclude>"#,
    );
    let body = r#"<body name="brick" pos="0 0 .05"><freejoint/><geom type="mesh" mesh="brick" density="500"/></body>"#;
    write("kit/outer.xml", &format!(r#"<mujoco><include file="inner.xml"/><worldbody>{body}</worldbody></mujoco>"#));
    let main = write("main.xml", r#"<mujoco><compiler meshdir="away"/><include file="kit/outer.xml"/></mujoco>"#);
    let system = System::named(&main).unwrap_or_else(|e| panic!("{e}"));
    let own = system.robot.links[0].inertia;
    // Vertices are in f32.
    let edge = f64::from(0.1f32);
    assert!(
        (own.mass - 500.0 * edge.powi(3)).abs() < 1e-12 && (own.com - Vector3::repeat(0.5 * edge)).norm() < 1e-12,
        "{own:?}"
    );
    assert!((own.inertia - Matrix3::identity() * (own.mass * edge * edge / 6.0)).amax() < 1e-12, "{own:?}");
    assert!(!system.robot.contact_points.is_empty());
    // Named from the working directory, it is the same robot.
    let up = std::env::current_dir().expect("a folder").components().skip(1).map(|_| "../").collect::<String>();
    let near = System::named(&format!("{up}{}", &main[1..])).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(near.robot.contact_points.len(), system.robot.contact_points.len(), "by a path that begins with {up}");
}

/// Geoms of a mocap body and its children are static. A tilted floor and a world with y up become the scene.
#[test]
fn targets_and_tilted_worlds_are_scenes() {
    let text = |gravity: &str, euler: &str, target: &str| {
        format!(
            r#"<mujoco><option gravity="{gravity}"/><worldbody><geom type="plane" size="5 5 .1" euler="{euler}"/>
            <body mocap="true" pos="1 0 1"><geom size=".05" {target}/></body><body pos="0 0 .1"><freejoint/><geom type="box" size=".1 .1 .1"/></body>
            </worldbody></mujoco>"#
        )
    };
    let (drawn, folder) = (r#"contype="0" conaffinity="0""#, tempfile::tempdir().expect("a folder"));
    for (gravity, euler) in [("0 0 -9.81", "0 0 0"), ("0 0 -9.81", "0 20 0"), ("0 -9.81 0", "-90 0 0")] {
        let path = folder.path().join("tilted.xml");
        std::fs::write(&path, text(gravity, euler, drawn)).expect("written");
        let system = System::named(&path.display().to_string()).unwrap_or_else(|e| panic!("{e}"));
        let (state, scene) = (system.default_state(), system.scene("ground").expect("its own"));
        let mut events = Vec::new();
        contacts(&system, &scene, &state, &mut system.data(), &mut events);
        let low = events.iter().map(|e| e.distance).fold(f64::MAX, f64::min);
        assert!(low.abs() < 2e-5, "{gravity}, {euler}: its lowest corner is {low} m above the ground");
        assert_eq!(scene.colliders.len(), 1);
    }
    assert_eq!(
        read(&text("0 0 -9.81", "0 0 0", "")).scene("ground").expect("its own").colliders.len(),
        2,
        "a target that touches stands there"
    );
}

/// Copies are rotated and shifted from one to the next; attached models keep their own angle units and classes.
#[test]
fn copies_and_attached_models_are_written_out() {
    let spokes = r#"<mujoco><worldbody><replicate count="4" euler="0 0 90" sep="-"><body name="spoke" pos="1 0 0"><joint name="j" axis="0 1 0"/><geom size=".1"/></body>
        </replicate></worldbody><actuator><motor name="m" joint="j" gear="7" ctrlrange="-1 1"/></actuator></mujoco>"#;
    let system = read(spokes);
    let place =
        |name: &str| system.robot.pose(&[0.0; 4], &system.robot.frame(name).expect("a body")).translation.vector;
    assert!((place("spoke-3") - Vector3::new(0.0, -1.0, 0.0)).norm() < 1e-12, "{}", place("spoke-3"));
    assert!(system.spec.joints.iter().all(|joint| joint.gain == Some(7.0)));
    let folder = tempfile::tempdir().expect("a folder");
    let leg = r#"<mujoco><compiler angle="radian"/><default><joint damping="3"/></default><worldbody><body name="leg" euler="0 0 1.5707963267948966">
        <joint name="hip" axis="1 0 0"/><geom size=".1" pos="1 0 0"/></body></worldbody><actuator><position joint="hip" kp="9"/></actuator></mujoco>"#;
    std::fs::write(folder.path().join("leg.xml"), leg).expect("written");
    let main = folder.path().join("main.xml");
    let text = r#"<mujoco><asset><model name="leg" file="leg.xml"/></asset><worldbody><body name="hub" pos="0 0 2"><joint name="turn"/><geom size=".1"/>
        <frame euler="0 0 90"><attach model="leg" body="leg" prefix="left_"/></frame></body></worldbody></mujoco>"#;
    std::fs::write(&main, text).expect("written");
    let system = System::named(&main.display().to_string()).unwrap_or_else(|e| panic!("{e}"));
    let hip = system.robot.joints().find(|joint| joint.name == "left_hip").expect("attached");
    assert_eq!((hip.damping, system.spec.joints[1].kp), (3.0, 9.0));
    let turned = system.robot.pose(&[0.0; 2], &system.robot.frame("left_leg").expect("a body")).rotation * Vector3::x();
    assert!((turned + Vector3::x()).norm() < 1e-9, "two quarter turns: {turned}");
}

/// A copy's angles are multiplied, not its rotation; MuJoCo 4.0 puts the fourth at (1.75023804, 1.88740298,
/// -0.38340595) m.
#[test]
fn copies_turn_by_multiples_of_their_angles() {
    let text = r#"<mujoco><worldbody><body><freejoint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/><replicate count="4" offset="1 0 0"
        euler="0 30 40"><site name="s" pos=".3 0 0"/><geom size=".1" pos=".3 0 0"/></replicate></body></worldbody></mujoco>"#;
    let system = System::from_text("r", text, None).unwrap_or_else(|e| panic!("{e}"));
    let last = system.robot.contact_points.iter().map(|p| p.local).max_by(|a, b| a.y.total_cmp(&b.y)).expect("points");
    assert!((last - Vector3::new(1.75023804, 1.88740298, -0.38340595)).amax() < 1e-7, "{last:?}");
}

/// Actuators of a disabled group do nothing.
#[test]
fn groups_of_actuators_that_are_off_do_nothing() {
    let kp = |off: &str, own: &str, class: &str| {
        let text = format!(
            r#"<mujoco><option {off}/><default><position {class}/></default><worldbody><body pos="0 0 1"><joint name="a" range="-90 90"/><geom type="capsule" fromto="0 0 0 .3 0 0" size=".03"/>
            </body></worldbody><actuator><position joint="a" kp="10" kv="1" {own}/></actuator></mujoco>"#
        );
        System::from_text("r", &text, None).unwrap_or_else(|e| panic!("{e}")).spec.joints[0].kp
    };
    let group = r#"group="2""#;
    for (own, class) in [(group, ""), ("", group)] {
        let found = ["", r#"actuatorgroupdisable="2""#, r#"actuatorgroupdisable="1""#].map(|off| kp(off, own, class));
        assert_eq!(found, [10.0, 0.0, 10.0], "by itself `{own}`, by its class `{class}`");
    }
}

/// MuJoCo reads no further than an end tag behind its root.
#[test]
fn a_file_that_is_closed_twice_is_read() {
    let text = r#"<mujoco><worldbody><body><freejoint/><geom size=".1" mass="2"/></body></worldbody></mujoco>"#;
    let mass = |text: &str| System::from_text("r", text, None).map(|system| system.robot.mass());
    for more in ["\n</mujoco>\n", "</worldbody></mujoco>", "  </x>\nnothing of this is read"] {
        let found = mass(&format!("{text}{more}")).unwrap_or_else(|e| panic!("{more:?}: {e}"));
        assert!((found - 2.0).abs() < 1e-12, "{more:?}: {found} kg");
    }
    let said = line(mass(&text.replace("</body>", "")));
    assert!(said.contains("expected"), "{said}");
    assert!(line(mass(&format!("{text}<mujoco/>"))).contains("1:"), "two roots");
}
