//! States: the two forms of a velocity, robot-centric frames, angles, contact thresholds.
//!
//! Tolerances: at distance L from the origin a state rounds positions by 1e-16 L, and the twist's linear part (p_dot +
//! p x w) by 1e-16 L |w|; a frame cannot restore digits lost to this rounding. Hence 1e-14 at 1 m, 1e-9 at 100 km, a
//! few tens of roundings each. Contact thresholds and angles are exact by definition.

mod common;

use std::f64::consts::{PI, TAU};

use common::*;
use nerd_core::state::wrap_state;

/// The root's material at the world's origin moves at the spatial twist, the root's origin at the local velocity.
#[test]
fn the_two_forms_of_a_velocity_are_one_motion() {
    for (robot, mut rng) in robots() {
        let (q, local) = state(&mut rng, &robot);
        let x = whole(&robot, &q, &local);
        let (places, twist) = robot.split(&x);
        assert_eq!(places, q);
        if robot.floating() {
            let (a, b) = (Motion::from_slice(twist.0), Motion::from_slice(&local.0));
            assert!(
                (a.ang - b.ang).norm() == 0.0 && (a.at(&vector(&q)) - b.lin).norm() < 1e-14,
                "{a:?} and {b:?} are two motions"
            );
        }
        assert!(gap(&twist.to_local(&robot, &q).0, &local.0) < 1e-15, "there and back");
        // One second at this velocity rotates and translates by it.
        let mut there = x.clone();
        local.advance(&robot, &mut there, 1.0);
        let mut way = vec![0.0; robot.nv()];
        nerd_core::state::difference(&robot, &q, &there, &mut way);
        let wrapped: Vec<f64> = way.iter().zip(&local.0).map(|(a, b)| a - b).collect();
        assert!(wrapped.iter().all(|x| x.abs() < 1e-13), "moved by {way:?} in a second at {local:?}");
    }
}

/// The state in a world moved by `by`.
fn carried(robot: &Robot, x: &[f64], by: &Isometry3<f64>) -> Vec<f64> {
    let (q, twist) = robot.split(x);
    let (mut q, mut qd) = (q.to_vec(), twist.to_local(robot, q));
    for k in [0, 3] {
        let turned = by.rotation * vector(&qd.0[k..]);
        qd.0[k..k + 3].copy_from_slice(turned.as_slice());
    }
    let (p, r) = (by.transform_point(&vector(&q).into()).coords, by.rotation * quaternion(&q[3..7]));
    q[..3].copy_from_slice(p.as_slice());
    write_quaternion(&mut q[3..7], &r);
    whole(robot, &q, &qd)
}

fn seen(robot: &Robot, frame: &RootFrame, x: &[f64]) -> Vec<f64> {
    let mut out = vec![0.0; x.len()];
    frame.state_in(robot, x, &mut out);
    out
}

#[test]
fn in_its_own_frame_the_root_is_at_zero_and_moves_by_turned_velocities() {
    let mut worst = [0.0f64; 2];
    for (robot, mut rng) in robots() {
        let (q, qd) = state(&mut rng, &robot);
        let x = whole(&robot, &q, &qd);
        if robot.floating() {
            // (1) to (4), the last as R^T p_dot; joints unchanged.
            let back = quaternion(&x[3..7]).inverse();
            let (w, v) = (back * vector(&qd.0), back * vector(&qd.0[3..]));
            let own = [&[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], &q[7..], w.as_slice(), v.as_slice(), &qd.0[6..]].concat();
            worst[0] = worst[0].max(gap(&seen(&robot, &RootFrame::of(&x), &x), &own));
        }
        let frame = RootFrame::at(&pose(&mut rng, 2.0));
        let (there, mut back) = (seen(&robot, &frame, &x), vec![0.0; x.len()]);
        frame.state_out(&robot, &there, &mut back);
        worst[1] = worst[1].max(gap(&back, &x));
        assert!(robot.floating() || there == x, "a fixed base's joint coordinates do not depend on the frame");
    }
    assert!(worst.iter().all(|w| *w < 1e-14), "own frame, round trip: {worst:?} off, allowed 1e-14");
}

#[test]
fn moving_and_turning_the_world_changes_nothing() {
    for (distance, bound) in [(0.0, 1e-14), (1.0, 1e-14), (1e5, 1e-9)] {
        let mut worst = 0.0f64;
        for (robot, mut rng) in robots().filter(|(r, _)| r.floating()) {
            let (q, qd) = state(&mut rng, &robot);
            let before = whole(&robot, &q, &qd);
            // The next state, a frame of 1/60 s later, is expressed in the root frame of the previous state: (5) to
            // (8).
            let after = whole(&robot, &moved(&robot, &q, &qd, 1.0 / 60.0), &qd);
            let yaw = UnitQuaternion::from_scaled_axis(vector3(&mut rng, 3.0));
            let by = Isometry3::from_parts(Vector3::new(distance, -distance, distance).into(), yaw);
            for x in [&before, &after] {
                let [here, there] = [Isometry3::identity(), by]
                    .map(|by| seen(&robot, &RootFrame::of(&carried(&robot, &before, &by)), &carried(&robot, x, &by)));
                worst = worst.max(gap(&there, &here));
            }
        }
        assert!(
            worst < bound,
            "a world moved by {distance:.0e} m changes what is seen by {worst:.1e}, allowed {bound:.0e}"
        );
    }
}

/// A joint with a changed frame equals a joint created with that frame.
#[test]
fn a_joint_that_is_changed_is_the_joint_made_so() {
    for (robot, mut rng) in robots() {
        let (mut changed, mut made) = (robot.clone(), robot.clone());
        for (a, b) in changed.joints_mut().zip(made.joints_mut()) {
            let origin = pose(&mut rng, 0.3);
            a.set_origin(origin);
            let armature = b.armature;
            *b = Joint::new(b.name.clone(), b.kind, origin, *b.axis());
            b.armature = armature;
        }
        assert_eq!(changed, made);
    }
}

/// UR arms have limits of two turns either way: positions beyond half a turn are kept.
#[test]
fn joints_with_limits_never_wrap() {
    let wide = Some(Limit { lower: -6.3, upper: 6.3, stiffness: 1e3, damping: 1.0 });
    let mut robot = robot(&mut Rng::seed_from_u64(1), 1, false);
    for (kind, limit, expected) in [
        (JointKind::Revolute, wide, 4.0),
        (JointKind::Revolute, None, 4.0 - TAU),
        (JointKind::Continuous, None, 4.0 - TAU),
        (JointKind::Prismatic, None, 4.0),
        (JointKind::Prismatic, wide, 4.0),
    ] {
        let joint = robot.joints_mut().next().expect("one joint");
        (joint.kind, joint.limit) = (kind, limit);
        let mut state = [4.0, 0.5];
        wrap_state(&robot, &mut state);
        assert_eq!(state, [expected, 0.5], "{kind:?} with {limit:?}");
    }
}

#[test]
fn a_contact_is_seen_nearer_than_four_thicknesses_and_a_tenth() {
    for (thickness, xi) in [(0.0, 0.1), (1e-5, 0.1), (0.025, 0.1), (0.08, 0.32), (0.1, 0.4), (0.25, 1.0)] {
        let point = ContactPoint { thickness, ..ContactPoint::new(0, Vector3::zeros(), 0.0) };
        assert_eq!(point.threshold(), xi, "thickness {thickness} m");
    }
}

#[test]
fn wrapped_angles_lie_in_one_turn_and_mean_the_same() {
    let below = f64::from_bits(PI.to_bits() - 1);
    for (x, y) in [(0.0, 0.0), (PI, -PI), (-PI, -PI), (below, below), (-below, -below), (TAU, 0.0), (-TAU, 0.0)] {
        assert_eq!(wrap(x), y, "wrap({x})");
    }
    for x in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        assert!(wrap(x).is_nan(), "wrap({x}) = {}", wrap(x));
    }
    for x in [1e9, -1e15, 1e18, -1e18, 1e300, f64::MAX, f64::MIN] {
        assert!((-PI..PI).contains(&wrap(x)), "wrap({x:e}) = {}", wrap(x));
    }
    for turns in -1000..1000 {
        // Within three floats of an odd multiple of pi, rounding decides.
        let centre = PI * f64::from(2 * turns + 1);
        let seam = (-3..=3).map(|ulps| f64::from_bits((centre.to_bits() as i64 + ulps) as u64));
        for x in seam.chain([-0.9, -0.3, 0.2, 0.7].map(|part| centre + PI * part)) {
            let y = wrap(x);
            assert!((-PI..PI).contains(&y), "wrap({x}) = {y}");
            assert_eq!(wrap(y), y, "wrapping twice");
            let turns = (x - y) / TAU;
            let slip = (turns - turns.round()).abs() * TAU;
            assert!(slip < 1e-15 * (10.0 + x.abs()), "wrap({x}) = {y} is off by {slip:e}");
        }
    }
}
