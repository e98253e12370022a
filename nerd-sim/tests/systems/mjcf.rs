//! MJCF: a written file can be read again. A file that is read obeys MuJoCo's rules, or is refused by name and line.

use nerd_sim::mjcf::{mjcf, mjcf_of_our_contact};
use nerd_sim::prelude::*;

use super::common::crawler;

fn robot(inside: &str) -> System {
    read(&format!("<mujoco><worldbody>{inside}</worldbody></mujoco>"))
}

fn read(text: &str) -> System {
    System::from_text("r", text, None).unwrap_or_else(|e| panic!("{text}: {e}"))
}

fn refusal(text: &str) -> String {
    let error = System::from_text("r", text, None).err().unwrap_or_else(|| panic!("read: {text}")).to_string();
    assert!(!error.contains('\n'), "`{error}` is not one line");
    error
}

/// Accelerations qdd at a state, under the joints' damping and springs alone.
fn accelerations(system: &System, state: &[f64]) -> Vec<f64> {
    let (robot, (q, twist)) = (&system.robot, system.robot.split(state));
    let local = twist.to_local(robot, q);
    let mut tau = vec![0.0; robot.nv()];
    for (k, joint) in robot.joints().enumerate() {
        let dof = robot.root_dofs() + k;
        tau[dof] = -joint.damping * local.0[dof] - joint.stiffness * (q[robot.root_coords() + k] - joint.rest);
    }
    system.data().forward_dynamics(robot, q, &local, &tau, &system.gravity()).expect("inertia").as_slice().to_vec()
}

#[test]
fn what_is_written_is_read_again() {
    let cable = concat!(env!("CARGO_MANIFEST_DIR"), "/assets/cables/lead.toml");
    for name in ["cartpole", "pendulum", "cube", "franka", "ant", "anymal", cable] {
        let system = System::named(name).expect("built in");
        let text = mjcf(&system, &system.scene("free").expect("a scene"), &[]).expect("written");
        let again = read(&text);
        let joints = |system: &System| {
            system.robot.joints().map(|j| (j.name.clone(), j.limit.map(|l| [l.lower, l.upper]))).collect::<Vec<_>>()
        };
        assert_eq!(joints(&system), joints(&again), "{name}");
        for k in 0..20 {
            let state = start(&system, Start::Sample, &mut stream(5, k));
            let (a, b) = (accelerations(&system, &state), accelerations(&again, &state));
            let gap = a.iter().zip(&b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
                / a.iter().map(|a| a.abs()).fold(1e-9, f64::max);
            assert!(gap < 1e-9, "{name}: accelerations apart by {gap:.1e}");
        }
    }
}

/// MuJoCo scales a contact's spring and damper by the inertia at the body's centre of mass, here the mass.
#[test]
fn our_contact_is_written_as_mujoco_scales_it() {
    let system = System::named("cube").expect("built in");
    let scene = system.scene("ground").expect("ground");
    let (text, mass) = (mjcf_of_our_contact(&system, &scene).expect("written"), system.robot.mass());
    let material = scene.colliders[0].material.mean(&system.spec.material);
    let numbers = |key: &str| -> Vec<f64> {
        let value = text.split(key).nth(1).and_then(|rest| rest.split('"').next()).expect("a value");
        value.split(' ').map(|x| x.parse().expect("a number")).collect()
    };
    for (found, expected) in numbers(" solref=\"").into_iter().zip([material.stiffness, material.damping]) {
        assert!((-found * mass / expected - 1.0).abs() < 1e-9, "{found} of {mass} kg, not {expected}");
    }
    assert_eq!(numbers("impratio=\""), [material.friction_damping / material.damping]);
    assert!(!mjcf(&system, &scene, &[]).expect("written").contains(" solref="));
}

#[test]
fn a_ball_of_a_capsule_and_a_rod_have_their_moments() {
    let moments = |geom: &str, settings: &str| {
        let text = format!(
            "<mujoco><compiler {settings}/><worldbody><body><freejoint/><geom {geom}/></body></worldbody></mujoco>"
        );
        read(&text).robot.links[0].inertia
    };
    // A capsule without length is a ball of water. A thin capsule of a given mass is a rod about its middle.
    let (ball, point) = (moments(r#"type="sphere" size=".1""#, ""), moments(r#"type="capsule" size=".1 1e-15""#, ""));
    assert!(
        (ball.mass - 4188.790 * 1e-3).abs() < 1e-6
            && (ball.inertia[(0, 0)] / (0.4 * ball.mass * 0.01) - 1.0).abs() < 1e-12,
        "{ball:?}"
    );
    assert!((point.mass - ball.mass).abs() < 1e-12 && (point.inertia - ball.inertia).amax() < 1e-15, "{point:?}");
    let rod = moments(r#"type="capsule" size="1e-4" fromto="0 0 0 0 3 4" mass="2""#, "");
    let across = Vector3::new(0.0, 0.6, 0.8);
    let expected = (Matrix3::identity() - across * across.transpose()) * (2.0 * 25.0 / 12.0);
    assert!(
        (rod.inertia - expected).amax() < 1e-3 && (rod.com - Vector3::new(0.0, 1.5, 2.0)).norm() < 1e-12,
        "{rod:?}"
    );
    // `balanceinertia`, `boundmass` and `boundinertia` act, and `settotalmass` scales the total.
    let inertial = r#"type="box" size="1 1 1" mass="0"/><inertial mass="1" pos="0 0 0" diaginertia="1 1 7""#;
    assert!((moments(inertial, r#"balanceinertia="true""#).inertia - Matrix3::identity() * 3.0).amax() < 1e-12);
    let inertial = r#"type="box" size="1 1 1" mass="0"/><inertial mass="1" pos="0 0 0" diaginertia="1 1 1.5""#;
    assert_eq!(moments(inertial, r#"boundmass="5""#).mass, 5.0);
    let (set, geoms) = (
        moments(inertial, r#"settotalmass="2""#),
        moments(inertial, r#"inertiafromgeom="true" boundmass="1" boundinertia="2""#),
    );
    assert!(
        set.mass == 2.0 && (set.inertia[(2, 2)] - 3.0).abs() < 1e-12 && (geoms.inertia[(0, 0)] - 2.0).abs() < 1e-12,
        "{set:?} {geoms:?}"
    );
}

/// Two joints away from their body's origin, with `ref` 0.5 m and 30 degrees: a site moves as rotated about them.
#[test]
fn joints_of_one_body_are_a_chain_in_their_own_coordinates() {
    let system = robot(
        r#"<body pos="0 0 1"><joint name="lift" type="slide" axis="0 0 2" ref=".5"/><joint name="turn" axis="0 1 0" pos="1 0 0" ref="30" range="-90 90"/>
           <geom type="box" size=".1 .1 .1"/><site name="tip" pos="2 0 0" euler="0 90 0"/></body>"#,
    );
    let pose = |q: [f64; 2]| system.robot.pose(&q, &system.robot.frame("tip").expect("a site"));
    let (still, moved) = (pose([0.5, 30f64.to_radians()]), pose([0.75, 120f64.to_radians()]));
    assert!((still.translation.vector - Vector3::new(2.0, 0.0, 1.0)).norm() < 1e-12, "{still}");
    assert!((moved.translation.vector - Vector3::new(1.0, 0.0, 0.25)).norm() < 1e-12, "{moved}");
    assert!((still.rotation * Vector3::x() + Vector3::z()).norm() < 1e-12, "{still}");
    assert!(
        system.robot.joints().map(|j| j.name.as_str()).eq(["lift", "turn"])
            && system.robot.links[0].inertia.mass == 0.0
    );
    let limit = system.robot.joints().nth(1).and_then(|j| j.limit).expect("autolimits");
    assert!((limit.upper - 0.5 * std::f64::consts::PI).abs() < 1e-12);
}

#[test]
fn classes_give_what_elements_leave_out() {
    let text = r#"<mujoco><default><geom pos="0 0 1" density="0"/><default class="big"><geom size="2" quat="0 1 0 0"/><joint damping="3"/>
        <motor gear="4" ctrlrange="-2 2"/></default></default><worldbody><body childclass="big"><joint name="j" axis="1 0 0"/>
        <geom type="box" size="1 2 3" mass="2" pos="1 0 0"/><geom/></body></worldbody>
        <actuator><motor joint="j" class="big"/></actuator></mujoco>"#;
    let (system, half_turn) = (read(text), UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI));
    let (joint, shapes) = (system.robot.joints().next().expect("a joint"), &system.robot.links[0].shapes);
    assert_eq!([joint.damping, joint.effort, system.spec.joints[0].gain.unwrap_or(0.0)], [3.0, 8.0, 8.0]);
    assert!(shapes[0].pose.rotation.angle_to(&half_turn) < 1e-12 && shapes[0].pose.translation.x == 1.0, "{shapes:?}");
    assert!(
        shapes[1].pose.translation.z == 1.0
            && matches!(shapes[1].kind, nerd_sim::nerd_core::robot::ShapeKind::Sphere { radius: 2.0 })
    );
}

/// Position actuators of all of an arm's joints become its controller; with any other actuator, actions are torques.
#[test]
fn an_arm_with_position_actuators_is_held_by_them() {
    let body = |k: usize, inner: &str| {
        format!(r#"<body name="b{k}"><joint name="j{k}" axis="0 1 0"/><geom size=".1" pos=".2 0 0"/>{inner}</body>"#)
    };
    let arm = |actuators: &str| {
        let bodies = body(1, &body(2, ""));
        read(&format!("<mujoco><worldbody>{bodies}</worldbody><actuator>{actuators}</actuator></mujoco>")).spec
    };
    let [first, second] = [1, 2].map(|k| format!(r#"<position joint="j{k}" kp="40" kv="2" forcerange="-9 9"/>"#));
    let held = arm(&(first.clone() + &second));
    let control = held.control.expect("a controller");
    assert!(control.scale == 1.0 && control.clamp && control.stable_pd && !control.relative, "{control:?}");
    assert_eq!([held.joints[0].kp, held.joints[0].kd, held.joints[0].gain.unwrap_or(0.0)], [40.0, 2.0, 9.0]);
    let strong = arm(&(first.clone() + r#"<position joint="j2" kp="40"/>"#)).control.expect("a controller");
    assert!(!strong.clamp, "an actuator without a largest force is not kept within one");
    for other in ["", r#"<motor joint="j2" ctrlrange="-9 9"/>"#, r#"<velocity joint="j2" kv="5"/>"#] {
        assert!(arm(&(first.clone() + other)).control.is_none(), "{other}");
    }
}

/// Drives, springs, a coupling, a pose and the ground become keys. Elements without effect on motion are accepted.
#[test]
fn what_no_urdf_says_becomes_keys() {
    let folder = tempfile::tempdir().expect("a folder");
    let body = |k: usize, more: &str| {
        format!(
            r#"<body name="b{k}" pos="{k} 0 0"><joint name="j{k}" axis="0 1 0" armature=".{k}" {more}/><geom size=".1" friction="{k}"/><camera name="eye{k}"/></body>"#
        )
    };
    std::fs::write(folder.path().join("leg.xml"), format!("<mujocoinclude>{}</mujocoinclude>", body(3, "")))
        .expect("a file");
    let text = format!(
        r#"<!-- <robot> --><mujoco model="m"><option gravity="0 0 -5"/><visual/><statistic extent="1"/><asset><texture name="t" builtin="flat" width="4" height="4"/></asset>
        <worldbody><light/><geom type="plane" size="1 1 1" pos="0 0 2" friction=".2"/><body name="root"><freejoint/><geom size=".5"/><site name="s"/>{}{}<include file="leg.xml"/></body></worldbody>
        <equality><joint joint1="j2" joint2="j1" polycoef=".1 -2 0 0 0"/><weld body1="root" active="false"/></equality>
        <actuator><position joint="j1" kp="7" kv="2" forcerange="-3 3" gear="2"/><velocity joint="j3" kv="5"/></actuator>
        <sensor><gyro site="s"/></sensor><tendon><fixed><joint joint="j1" coef="1"/></fixed></tendon>
        <keyframe><key name="home" qpos="0 0 9 1 0 0 0 .3 -.5 .4"/></keyframe></mujoco>"#,
        body(1, r#"stiffness="3" springref="90" actuatorfrcrange="-1 1" actuatorfrclimited="false""#),
        body(2, "")
    );
    let path = folder.path().join("m.xml");
    std::fs::write(&path, text).expect("a file");
    let system = System::named(&path.display().to_string()).unwrap_or_else(|e| panic!("{e}"));
    let (robot, specs) = (&system.robot, &system.spec.joints);
    let mimic = robot.follower().and_then(Joint::mimic).expect("j2 follows");
    assert_eq!(
        [mimic.multiplier, mimic.offset, specs[0].armature, specs[1].armature],
        [-2.0, 0.1, 0.1 + 4.0 * 0.2, 0.3]
    );
    assert_eq!([specs[0].kp, specs[0].kd, specs[0].stiffness, specs[1].kp, specs[1].kd], [28.0, 8.0, 3.0, 0.0, 5.0]);
    assert_eq!([specs[0].default_q, specs[1].default_q, robot.joints().next().expect("j1").effort], [0.3, 0.4, 6.0]);
    assert_eq!(
        (system.gravity(), system.spec.data_scene.as_deref(), system.spec.material.friction),
        (Vector3::z() * -5.0, Some("ground"), 1.0)
    );
    // The default pose stands on the ground of the file.
    let (state, ground) = (system.default_state(), system.scene("ground").expect("its ground"));
    let mut events = Vec::new();
    contacts(&system, &ground, &state, &mut system.data(), &mut events);
    let low = events.iter().zip(&robot.contact_points).map(|(e, p)| e.distance - p.radius).fold(f64::MAX, f64::min);
    assert!(low.abs() < 1e-9 && state[2] > 2.0, "its lowest point is {low:.1e} m above the ground");
}

#[test]
fn what_matters_and_is_not_understood_is_refused_by_name_and_line() {
    let body = r#"<body name="b"><joint name="j"/><geom size=".1"/></body>"#;
    let world = |inside: &str| format!("<mujoco>\n<worldbody>\n{inside}</worldbody></mujoco>");
    let beside = |inside: &str| format!("<mujoco><worldbody>{body}</worldbody>\n{inside}</mujoco>");
    for (text, says) in [
        (world(r#"<body name="b"><joint type="ball" name="hip"/></body>"#), "line 3, <joint> `hip`: ball joints"),
        (
            world(r#"<body name="b"><joint name="hip" dampng="1"/></body>"#),
            "line 3, <joint> `hip`: an attribute `dampng` is not known; is `damping` meant?",
        ),
        (world(r#"<body name="b"><joint name="hip" damping="1,5"/></body>"#), "line 3, <joint> `hip`: damping=\"1,5\""),
        (world(r#"<body name="b"><composite type="rope"/></body>"#), "line 3, <composite>: it is not known in <body>"),
        (
            world(r#"<body name="b"><joint/><geom type="mesh" mesh="m"/></body>"#),
            "line 3, <geom>: mesh=\"m\": there is no such mesh",
        ),
        (
            world(&format!(r#"<body name="a"><freejoint/><geom size="1"/></body>{body}"#)),
            "line 3, <body> `b`: it moves beside",
        ),
        (
            world(r#"<body name="a"><joint type="free" frictionloss="1"/><geom size="1"/></body>"#),
            "is not 0: write <freejoint/>",
        ),
        (
            world(r#"<body name="a"><freejoint align="true"/><geom size="1"/></body>"#),
            "line 3, <body> `a`: align moves its frame",
        ),
        (world(r#"<body><geom class="no"/></body>"#), "there is no default class `no`"),
        (beside(r#"<equality><weld name="w" body1="b"/></equality>"#), "line 2, <weld> `w`: it is not supported"),
        (
            beside(r#"<equality><joint joint1="j" joint2="k"/></equality>"#),
            "line 2, <joint>: joint2=\"k\": there is no such hinge or slide",
        ),
        (beside(r#"<actuator><muscle name="m" joint="j"/></actuator>"#), "line 2, <muscle> `m`: only motor"),
        (
            beside(r#"<actuator><motor name="m" tendon="t"/></actuator>"#),
            "line 2, <motor> `m`: tendon=\"t\": there is no such tendon",
        ),
        (
            beside(r#"<tendon><fixed name="t" stiffness="2"/></tendon>"#),
            "line 2, <fixed> `t`: a tendon with `stiffness`",
        ),
        (beside(r#"<deformable><flex name="f"/></deformable>"#), "line 2, <flex> `f`"),
        (beside(r#"<option viscosity=".1"/>"#), "line 2, <option>: viscosity"),
        (beside(r#"<option><flag contact="off"/></option>"#), "line 2, <flag>: contact=\"off\": it is one of"),
        (beside(r#"<include file="nowhere.xml"/>"#), "line 2, <include> `nowhere.xml`"),
        (
            beside(r#"<keyframe><key name="k" qpos="1 2"/></keyframe>"#),
            "line 2, <key> `k`: qpos has 2 numbers; the file has 1",
        ),
        (format!("<mujoco>{}", "<body>".repeat(100_000)), "nested more than"),
        ("<mujoco><worldbody>".into(), "not an MJCF"),
    ] {
        let error = refusal(&text);
        assert!(error.contains(says), "`{error}` does not say `{says}`");
    }
}

/// Geoms with different contact properties are written as explicit pairs, each with its numbers.
#[test]
fn contacts_by_pair_are_written_as_pairs() {
    let system = crawler();
    let scene = system.scene("plane").expect("a world");
    let text = mjcf(&system, &scene, &[]).expect("written");
    let of = |line: &str, key: &str| {
        line.split(&format!(" {key}=\"")).nth(1).and_then(|rest| rest.split('"').next()).map(String::from)
    };
    let pairs: Vec<_> = text.lines().filter(|line| line.starts_with("<pair")).collect();
    let told: Vec<_> =
        pairs.iter().map(|line| ["condim", "friction", "margin"].map(|key| of(line, key).expect("a number"))).collect();
    let expected = [
        ["6", "0.8 0.8 0.02 0.01 0.01", "0.002"],
        ["4", "0.8 0.8 0.02 0 0", "0.002"],
        ["3", "0.8 0.8 0 0 0", "0.002"],
        ["6", "0.4 0.4 0.02 0.01 0.01", "0.004"],
    ];
    assert_eq!(told, expected);
    assert!(pairs.iter().all(|line| of(line, "solref").as_deref() == Some("0.02 1")), "{pairs:?}");
    // With our contact each pair is as soft as its own material.
    let ours = mjcf_of_our_contact(&system, &scene).expect("written");
    let soft: Vec<f64> = ours
        .lines()
        .filter(|line| line.starts_with("<pair"))
        .map(|line| {
            of(line, "solref")
                .and_then(|x| x.split(' ').next().map(|k| k.parse::<f64>()))
                .expect("a stiffness")
                .expect("a number")
        })
        .collect();
    let met = system
        .robot
        .contact_points
        .iter()
        .filter_map(|point| Some(system.meeting(point, &scene.colliders[0])?.stiffness));
    let met: Vec<f64> = met.collect();
    // Stiffnesses of two mirrored legs.
    assert!((soft[0] / soft[1] / (met[0] / met[1]) - 1.0).abs() < 1e-9, "{soft:?}");
}
