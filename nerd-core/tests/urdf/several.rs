//! Joints with several DoFs against their component joints.

use std::f64::consts::FRAC_PI_2;

use super::{common::*, reading::alone};

/// A puck of 2 kg on a plane with normal `axis`. Its centre of mass is 0.3 m off the joint's point.
fn puck(axis: &str) -> String {
    format!(
        r#"<robot name="puck"><link name="table"/><link name="puck"><inertial><origin xyz="0.3 0 0"/><mass value="2"/>
        <inertia ixx="0.1" iyy="0.1" izz="0.2" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="slide" type="planar"><parent link="table"/><child link="puck"/><origin xyz="0 0 1"/><axis xyz="{axis}"/>
        <dynamics damping="0.5"/></joint></robot>"#
    )
}

fn fixed(text: &str) -> Robot {
    Robot::from_urdf(text, Base::fixed()).expect("a robot")
}

#[test]
fn a_planar_joint_is_a_puck_on_a_table() {
    let robot = fixed(&puck("0 0 1"));
    assert_eq!(robot.joints().map(|j| j.name.as_str()).collect::<Vec<_>>(), ["slide.x", "slide.y", "slide.turn"]);
    assert!(robot.joints().all(|j| j.damping == 0.5 && j.limit.is_none()));
    let (m, d, inertia) = (2.0, 0.3, 0.2);
    let (q, qd, mut data) = ([0.4, -0.7, 0.9f64], [1.0, -2.0, 3.0], Data::new(&robot));
    let (sin, cos) = q[2].sin_cos();
    // Closed form: the puck's rotation needs only a centripetal force.
    let by_hand = [m, 0.0, -m * d * sin, 0.0, m, m * d * cos, -m * d * sin, m * d * cos, inertia + m * d * d];
    assert!(
        gap(data.mass_matrix(&robot, &q).as_slice(), &by_hand) < 1e-14,
        "{}, {by_hand:?} by hand",
        data.mass_matrix(&robot, &q)
    );
    let needed = [-m * d * cos * qd[2] * qd[2], -m * d * sin * qd[2] * qd[2], 0.0];
    let bias = data.bias(&robot, &q, &LocalVelocity(qd), &Vector3::zeros());
    assert!(gap(bias.as_slice(), &needed) < 1e-14, "{bias}, {needed:?} by hand");
}

#[test]
fn the_plane_is_across_the_axis() {
    for axis in ["0 0 1", "1 0 0", "0 -2 0", "0 0 -1", "1 1 1"] {
        let robot = fixed(&puck(axis));
        let normal = robot.links[2].joint.as_ref().expect("a turn").axis().into_inner();
        let puck = robot.frame("puck").expect("a puck");
        let places = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, FRAC_PI_2]].map(|q| robot.pose(&q, &puck));
        let [home, x, y, turned] = places;
        let [x, y] = [x, y].map(|p| p.translation.vector - home.translation.vector);
        assert!(
            (x.cross(&y) - normal).norm() < 1e-15 && x.dot(&y).abs() < 1e-15,
            "{axis}: x, y and the normal are not right-handed"
        );
        let carried = turned.rotation.inverse() * (home.rotation * x) + home.rotation * y;
        assert!(carried.norm() < 1e-12, "{axis}: a turn does not carry y to x");
    }
}

#[test]
fn a_floating_joint_under_the_world_is_a_free_base() {
    let body = [link("trunk"), link("leg"), joint("hip", "continuous", "trunk", "leg", "")];
    let under = |extra: &str, origin: &str| {
        let world = [format!(r#"<link name="world"/>{extra}"#), joint("free", "floating", "world", "trunk", origin)];
        urdf(&[&body[..], &world].concat())
    };
    let read = UrdfRobot::read(&under("", ""), Base::Floating).expect("a robot");
    assert_eq!(read, UrdfRobot::read(&urdf(&body), Base::Floating).expect("a robot"));
    let text = refusal(&under("", ""), Base::fixed());
    assert!(text.starts_with("joint `free`: it is floating, and makes the base free"), "{text}");
    // Two free bodies are not one tree.
    let more = format!("{}{}", r#"<link name="ball"/>"#, joint("weld", "fixed", "world", "ball", ""));
    let text = refusal(&under(&more, ""), Base::Floating);
    assert!(text.starts_with("joint `free`: a floating joint is read only"), "{text}");
    let read = UrdfRobot::read(&under("", r#"<origin xyz="0 0 1"/>"#), Base::Floating).expect("a robot");
    assert!(read.notes.iter().any(|n| n.contains("`free`") && n.contains("<origin>")), "{:?}", read.notes);
}

#[test]
fn a_planar_joint_without_mass_is_fixed_and_its_names_are_its_own() {
    let cart = link("cart")
        + &joint("rail", "prismatic", "table", "cart", r#"<limit lower="-1" upper="1" effort="1" velocity="1"/>"#);
    let text = puck("0 0 1").replace("</robot>", &(cart + "</robot>"));
    let light = text.replace("\"2\"", "\"0\"").replace("\"0.1\"", "\"0\"").replace("\"0.2\"", "\"0\"");
    let read = alone(&light);
    let notes = read.notes.iter().filter(|n| n.contains("carries no mass")).count();
    assert_eq!((read.robot.joint_count(), notes), (1, 1), "{:?}", read.notes);
    for (from, to) in [("\"rail\"", "\"slide.x\""), ("\"cart\"", "\"puck.x\"")] {
        let error = refusal(&text.replace(from, to), Base::fixed());
        assert!(error.contains("`slide`") && error.contains(&to.replace('"', "`")), "{error}");
    }
    let mimic = refusal(&changed(&puck("0 0 1"), "<dynamics", r#"<mimic joint="slide"/><dynamics"#), Base::fixed());
    assert!(mimic.contains("planar"), "{mimic}");
}
