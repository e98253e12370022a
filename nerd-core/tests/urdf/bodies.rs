//! Properties of a file's bodies besides motion reach the robot: visuals, surfaces, hulls, and body frames.

use super::{common::*, refusals::ARM};
use nerd_core::robot::{Bodies, Form, Hull, ShapeKind, Solid};

#[test]
fn looks_are_read_and_those_that_cannot_be_are_left_out() {
    let visual = |inner: &str| format!("<visual>{inner}</visual>");
    let looks = [
        visual(
            r#"<origin xyz="1 2 3" rpy="0 0 1.5707963267948966"/><geometry><box size="2 4 6"/></geometry><material name="x"><texture/></material>"#,
        ),
        visual(r#"<geometry><mesh filename="a&amp;b.stl" scale="1 2 -3"/></geometry>"#),
        visual(r#"<geometry><cylinder radius="0.1" length="2"/></geometry>"#),
        visual(r#"<origin xyz="1 two 3"/><geometry><sphere radius="1"/></geometry>"#),
        visual(r#"<geometry><sphere radius="-1"/></geometry>"#),
        visual(r#"<geometry/>"#),
        visual(""),
    ];
    let (bodies, notes) =
        Bodies::from_urdf(&changed(ARM, "<collision>", &format!("{}<collision>", looks.concat()))).expect("bodies");
    let [x, y, z] = [1.0, 2.0, 3.0];
    let solid = |pose: Isometry3<f64>, form: Form| Solid { pose, form, surface: None };
    let turned = Isometry3::from_parts(
        Vector3::new(x, y, z).into(),
        UnitQuaternion::from_euler_angles(0.0, 0.0, std::f64::consts::FRAC_PI_2),
    );
    let expected = [
        solid(turned, Form::Shape(ShapeKind::Box { half: Vector3::new(x, y, z) })),
        solid(Isometry3::identity(), Form::Mesh { file: "a&b.stl".into(), scale: Vector3::new(1.0, 2.0, -3.0) }),
        solid(Isometry3::identity(), Form::Shape(ShapeKind::Cylinder { radius: 0.1, half_length: 1.0 })),
    ];
    let of = |name: &str| bodies.bodies.iter().find(|body| body.name == name).expect("a body");
    assert_eq!(of("upper").visuals, expected);
    assert!(of("base").visuals.is_empty() && of("tip").visuals.is_empty() && notes.is_empty(), "{notes:?}");
}

/// With a tool welded to the arm: contact points inherit each solid's surface, and a hull lies where its body is.
#[test]
fn solids_keep_their_surfaces_where_they_are_lumped() {
    let (mut bodies, _) = Bodies::from_urdf(ARM).expect("bodies");
    bodies.bodies[1].collisions[0].surface = Some(7);
    bodies.joints[1].origin = Isometry3::translation(0.0, 0.0, 2.0);
    let at = |x: f64, form: Form, surface: usize| Solid {
        pose: Isometry3::translation(x, 0.0, 0.0),
        form,
        surface: Some(surface),
    };
    let corners: Vec<Vector3<f64>> = [Vector3::x(), Vector3::y(), Vector3::z(), Vector3::zeros()].into();
    bodies.bodies[2].collisions = vec![
        at(0.5, Form::Shape(ShapeKind::Capsule { radius: 0.1, half_length: 0.2 }), 3),
        at(0.5, Form::Hull(corners.clone()), 4),
        at(0.0, Form::Mesh { file: "m.stl".into(), scale: Vector3::repeat(1.0) }, 5),
    ];
    let UrdfRobot { robot, meshes, hulls, .. } = UrdfRobot::of(&bodies, Base::fixed()).expect("a robot");
    assert_eq!(robot.contact_points.iter().map(|p| p.surface).collect::<Vec<_>>(), [Some(7), Some(3), Some(3)]);
    assert_eq!(meshes.iter().map(|mesh| mesh.surface).collect::<Vec<_>>(), [Some(5)]);
    let vertices = corners.into_iter().map(|v| v + Vector3::new(0.5, 0.0, 2.0)).collect();
    assert_eq!(hulls, [Hull { link: 0, vertices, surface: Some(4) }]);
    // A fixed base has no link to carry a hull.
    bodies.bodies[0].collisions = vec![bodies.bodies[2].collisions[1].clone()];
    let read = UrdfRobot::of(&bodies, Base::fixed()).expect("a robot");
    assert!(
        read.hulls.len() == 1 && read.notes.iter().any(|n| n.contains("link `base`: a mesh is on the fixed base")),
        "{:?}",
        read.notes
    );
}

/// A joint 0.3 m up on its body: the body's frame lies below the joint's, `Robot::frame` returns it by name, and it
/// rotates with the joint. The same holds for a welded body.
#[test]
fn a_body_by_name_is_where_its_file_has_it() {
    let (mut bodies, _) = Bodies::from_urdf(ARM).expect("bodies");
    let below = Isometry3::translation(0.0, 0.0, -0.3);
    bodies.bodies[1].frame = below;
    bodies.joints[1].origin = Isometry3::translation(0.0, 0.0, 2.0);
    bodies.bodies[2].frame = Isometry3::translation(0.0, 0.0, 0.5);
    let mut robot = UrdfRobot::of(&bodies, Base::fixed()).expect("a robot").robot;
    assert_eq!(robot.links[0].frame, below);
    let reach = |robot: &Robot, name: &str, length: f64, size: f64| {
        // The shoulder is 1 m up and rotates about y.
        let (q, hand) = (0.4f64, Vector3::new(0.4f64.sin() * length, 0.0, 1.0 + 0.4f64.cos() * length) * size);
        let found = robot.pose(&[q], &robot.frame(name).expect("a frame")).translation.vector;
        let off = (found - hand).norm();
        assert!(off < 1e-12, "`{name}` is {off:.1e} m off, at {found:?}");
    };
    reach(&robot, "upper", -0.3, 1.0);
    reach(&robot, "tip", 2.5, 1.0);
    robot.scale(2.0);
    reach(&robot, "upper", -0.3, 2.0);
    reach(&robot, "tip", 2.5, 2.0);
}
