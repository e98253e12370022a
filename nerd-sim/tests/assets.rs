//! What the built-in pendulums come out as: names, contact points, and where their tips are. Bounds: rounding.

use nalgebra::Vector3;
use nerd_core::dynamics::{Data, kinematics, link_pose};
use nerd_core::robot::Robot;

#[test]
fn built_in_assets_stand_where_they_should() {
    let cartpole = Robot::from_urdf(include_str!("../assets/cartpole.urdf"), false).expect("valid");
    assert_eq!(cartpole.joints().map(|j| j.name.as_str()).collect::<Vec<_>>(), ["slider", "hinge"]);
    assert_eq!(cartpole.joints().map(|j| j.wraps()).collect::<Vec<_>>(), [false, true]);
    let (q, mut data) = ([0.7, 0.3f64], Data::new(&cartpole));
    kinematics(&cartpole, &q, &mut data);
    let tip = link_pose(&data, 1).transform_point(&Vector3::z().into()).coords;
    let expected = Vector3::new(0.7 + 0.3f64.sin(), 0.3f64.cos(), 0.0);
    assert!((tip - expected).norm() < 1e-15, "pole tip at {tip}, expected {expected}");

    let pendulum = Robot::from_urdf(include_str!("../assets/pendulum.urdf"), false).expect("valid");
    let ends: Vec<_> = pendulum.contact_points.iter().map(|p| (p.link, p.local)).collect();
    let (far, near) = (Vector3::x() * 1.5, Vector3::zeros());
    for ((link, at), (body, place)) in ends.iter().zip([(0, far), (0, near), (1, far), (1, near)]) {
        assert!(*link == body && (at - place).norm() < 1e-15, "contact point at {at} of link {link}, expected {place} of {body}");
    }
    let (q, mut data) = ([0.2, 0.3], Data::new(&pendulum));
    kinematics(&pendulum, &q, &mut data);
    let tip = link_pose(&data, 1).transform_point(&far.into()).coords;
    let expected = Vector3::new(1.5 * (0.2f64.cos() + 0.5f64.cos()), 2.0 + 1.5 * (0.2f64.sin() + 0.5f64.sin()), 1.0);
    assert!(ends.len() == 4 && (tip - expected).norm() < 1e-15, "tip at {tip}, expected {expected}");
}
