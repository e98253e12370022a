//! A joint's frame and axis may be changed at any time, and what turns for ever is told from what has limits.

mod common;

use common::*;
use nalgebra::{Isometry3, Vector3};
use nerd_core::dynamics::{Data, kinematics, link_pose};
use nerd_core::robot::{Base, Joint, JointKind, Limit};
use nerd_core::state::wrap_state;

/// A changed joint moves as one made so does.
#[test]
fn a_joint_that_is_changed_is_the_joint_made_so() {
    for (robot, mut rng) in robots() {
        let (mut changed, mut made) = (robot.clone(), robot.clone());
        for (a, b) in changed.joints_mut().zip(made.joints_mut()) {
            let (origin, axis) = (pose(&mut rng, 0.3), nalgebra::Unit::new_normalize(vector3(&mut rng, 1.0)));
            a.set_axis(axis);
            a.set_origin(origin);
            let armature = b.armature;
            *b = Joint::new(b.name.clone(), b.kind, origin, axis);
            b.armature = armature;
        }
        assert_eq!(changed, made);
        let (q, _) = state(&mut rng, &robot);
        let (mut a, mut b) = (Data::new(&changed), Data::new(&made));
        kinematics(&changed, &q, &mut a);
        kinematics(&made, &q, &mut b);
        let moved = changed.links.iter().enumerate().any(|(i, _)| link_pose(&a, i) != link_pose(&b, i));
        assert!(!moved, "links stand elsewhere than those of a robot made so");
    }
}

/// A hinge about z whose frame is then turned by a quarter about x turns about -y.
#[test]
fn a_frame_turned_later_turns_the_motion() {
    let mut rng = Rng::seed_from_u64(0);
    let mut robot = robot(&mut rng, 1, false);
    robot.base = Base::Fixed(Isometry3::identity());
    let mut joint = Joint::new("j", JointKind::Revolute, Isometry3::identity(), Vector3::z_axis());
    joint.set_origin(Isometry3::rotation(Vector3::x() * std::f64::consts::FRAC_PI_2));
    robot.links[0].joint = Some(joint);
    let mut data = Data::new(&robot);
    kinematics(&robot, &[std::f64::consts::FRAC_PI_2], &mut data);
    let x = link_pose(&data, 0) * Vector3::x();
    assert!((x - Vector3::z()).norm() < 1e-15, "x of the link points to {x:?}, expected z");
}

/// UR arms have limits of two turns either way: a position beyond half a turn is where it is.
#[test]
fn joints_with_limits_never_wrap() {
    let joint = |kind, limit| {
        let mut joint = Joint::new("j", kind, Isometry3::identity(), Vector3::z_axis());
        joint.limit = limit;
        joint
    };
    let wide = Some(Limit { lower: -6.3, upper: 6.3, stiffness: 1e3, damping: 1.0 });
    let mut rng = Rng::seed_from_u64(1);
    for (kind, limit, expected) in [
        (JointKind::Revolute, wide, 4.0),
        (JointKind::Revolute, None, 4.0 - std::f64::consts::TAU),
        (JointKind::Continuous, None, 4.0 - std::f64::consts::TAU),
        (JointKind::Prismatic, None, 4.0),
        (JointKind::Prismatic, wide, 4.0),
    ] {
        let mut robot = robot(&mut rng, 1, false);
        robot.links[0].joint = Some(joint(kind, limit));
        let mut state = [4.0, 0.5];
        wrap_state(&robot, &mut state);
        assert_eq!(state, [expected, 0.5], "{kind:?} with {limit:?}");
    }
}
