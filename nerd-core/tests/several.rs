//! Joints of more than one DoF against what they are made of.

use std::f64::consts::FRAC_PI_2;

use nalgebra::Vector3;
use nerd_core::dynamics::{Data, crba, inverse_dynamics, kinematics, link_pose};
use nerd_core::robot::Robot;

/// A puck of 2 kg whose centre of mass stands 0.3 m off the point that the joint carries, on a plane whose normal is `axis`.
fn puck(axis: &str) -> String {
    format!(
        r#"<robot name="puck"><link name="table"/><link name="puck"><inertial><origin xyz="0.3 0 0"/><mass value="2"/>
        <inertia ixx="0.1" iyy="0.1" izz="0.2" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="slide" type="planar"><parent link="table"/><child link="puck"/><origin xyz="0 0 1"/><axis xyz="{axis}"/>
        <dynamics damping="0.5"/></joint></robot>"#
    )
}

#[test]
fn a_planar_joint_is_a_puck_on_a_table() {
    let robot = Robot::from_urdf(&puck("0 0 1"), false).expect("a robot");
    let names: Vec<_> = robot.joints().map(|j| j.name.as_str()).collect();
    assert_eq!(names, ["slide.x", "slide.y", "slide.turn"]);
    assert!(robot.joints().all(|j| j.damping == 0.5 && j.limit.is_none()));
    let (m, d, inertia) = (2.0, 0.3, 0.2);
    let (q, qd) = ([0.4, -0.7, 0.9f64], [1.0, -2.0, 3.0]);
    let mut data = Data::new(&robot);
    kinematics(&robot, &q, &mut data);
    crba(&robot, &mut data);
    let (sin, cos) = q[2].sin_cos();
    // Kinetic energy of a puck, by hand.
    let by_hand = [[m, 0.0, -m * d * sin], [0.0, m, m * d * cos], [-m * d * sin, m * d * cos, inertia + m * d * d]];
    for (i, row) in by_hand.iter().enumerate() {
        for (j, value) in row.iter().enumerate() {
            assert!((data.mass[(i, j)] - value).abs() < 1e-14, "M[{i}][{j}] is {}, {value} by hand", data.mass[(i, j)]);
        }
    }
    // What turns needs a force towards the middle, and nothing else.
    inverse_dynamics(&robot, &q, &qd, &[0.0; 3], &Vector3::zeros(), &mut data);
    let needed = [-m * d * cos * qd[2] * qd[2], -m * d * sin * qd[2] * qd[2], 0.0];
    for (k, value) in needed.iter().enumerate() {
        assert!((data.tau[k] - value).abs() < 1e-13, "tau[{k}] is {}, {value} by hand", data.tau[k]);
    }
}

#[test]
fn the_plane_stands_across_the_axis() {
    for axis in ["0 0 1", "1 0 0", "0 -2 0", "0 0 -1", "1 1 1"] {
        let robot = Robot::from_urdf(&puck(axis), false).expect("a robot");
        let normal = robot.links.last().and_then(|l| l.joint.as_ref()).map(|j| j.axis().into_inner()).expect("a turn");
        let mut data = Data::new(&robot);
        let place = |q: [f64; 3], data: &mut Data| {
            kinematics(&robot, &q, data);
            link_pose(data, robot.links.len() - 1)
        };
        let [home, x, y, turned] = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, FRAC_PI_2]].map(|q| place(q, &mut data));
        let [x, y] = [x, y].map(|p| p.translation.vector - home.translation.vector);
        assert!(x.dot(&normal).abs() < 1e-15 && y.dot(&normal).abs() < 1e-15 && x.dot(&y).abs() < 1e-15, "{axis}: {x} {y}");
        assert!((x.cross(&y) - normal).norm() < 1e-15, "{axis}: x, y and the normal are not right-handed");
        assert!(
            (turned.rotation.inverse() * (home.rotation * x) + home.rotation * y).norm() < 1e-12,
            "{axis}: a turn does not carry y to x"
        );
    }
}

#[test]
fn a_floating_joint_under_the_world_is_a_free_base() {
    let body = r#"<link name="trunk"><inertial><mass value="3"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <link name="leg"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="hip" type="continuous"><parent link="trunk"/><child link="leg"/><axis xyz="0 1 0"/></joint>"#;
    let under = |extra: &str| {
        format!(
            r#"<robot name="r"><link name="world"/>{extra}{body}<joint name="free" type="floating"><parent link="world"/>
            <child link="trunk"/></joint></robot>"#
        )
    };
    let robot = Robot::from_urdf(&under(""), true).expect("a robot");
    assert_eq!(robot, Robot::from_urdf(&format!(r#"<robot name="r">{body}</robot>"#), true).expect("a robot"));
    let refused = |text: &str, floating| Robot::from_urdf(text, floating).expect_err("a refusal").to_string();
    assert_eq!(refused(&under(""), false), "joint `free`: it is floating, and makes the base a free one: say `floating = true`");
    // Two free bodies are no tree of one robot.
    let more = r#"<link name="ball"/><joint name="weld" type="fixed"><parent link="world"/><child link="ball"/></joint>"#;
    assert!(refused(&under(more), true).starts_with("joint `free`: a floating joint is read only"), "{}", refused(&under(more), true));
    let mimic = puck("0 0 1").replace("<dynamics", r#"<mimic joint="slide"/><dynamics"#);
    assert!(refused(&mimic, false).contains("planar"), "{}", refused(&mimic, false));
    let shifted =
        under("").replace(r#"<child link="trunk"/></joint></robot>"#, r#"<child link="trunk"/><origin xyz="0 0 1"/></joint></robot>"#);
    let robot = Robot::from_urdf(&shifted, true).expect("a robot");
    assert!(robot.notes.iter().any(|n| n.contains("`free`") && n.contains("<origin>")), "{:?}", robot.notes);
}

#[test]
fn a_planar_joint_without_mass_is_fixed_and_its_names_are_its_own() {
    let cart = r#"<link name="cart"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="rail" type="prismatic"><parent link="table"/><child link="cart"/><axis xyz="1 0 0"/><limit lower="-1" upper="1"
        effort="1" velocity="1"/></joint></robot>"#;
    let text = puck("0 0 1").replace("</robot>", cart);
    let start = text.find("<inertial>").expect("the puck's");
    let end = text.find("</inertial>").expect("the puck's") + "</inertial>".len();
    let robot = Robot::from_urdf_alone(&(text[..start].to_string() + &text[end..]), false).expect("a robot");
    let notes: Vec<_> = robot.notes.iter().filter(|n| n.contains("carries no mass")).collect();
    assert_eq!((robot.joint_count(), notes.len()), (1, 1), "{notes:?}");
    for (from, to) in [("\"rail\"", "\"slide.x\""), ("\"cart\"", "\"puck.x\"")] {
        let error = Robot::from_urdf(&text.replace(from, to), false).expect_err(to).to_string();
        assert!(error.contains("`slide`") && error.contains(&to.replace('"', "`")), "{error}");
    }
}
