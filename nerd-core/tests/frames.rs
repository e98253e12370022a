//! Equations (1) to (8) of the paper's appendix A.1: what a network sees does not depend on where the world's origin
//! is nor on where its axes point.
//!
//! Bounds: a state at distance L from the origin holds positions to 1e-16 L and the twist's linear part
//! (p_dot + p x w) to 1e-16 L |w|; the frame cannot give back what those roundings took. Hence 1e-14 at 1 m,
//! 1e-9 at 100 km, each a few tens of roundings.

mod common;

use common::*;
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use nerd_core::dynamics::{to_local, to_world};
use nerd_core::frames::RootFrame;
use nerd_core::robot::Robot;
use nerd_core::state::{quaternion, vector, write_quaternion};

/// A state `[q, qd]` with the twist about the world origin, and the local velocities it came from.
fn world_state(rng: &mut Rng, robot: &Robot) -> (Vec<f64>, Vec<f64>) {
    let (mut q, qd) = state(rng, robot);
    let mut twist = qd.clone();
    to_world(robot, &q, &mut twist);
    q.extend(twist);
    (q, qd)
}

/// The same motion seen from a world moved by `by`.
fn carried(robot: &Robot, x: &[f64], by: &Isometry3<f64>) -> Vec<f64> {
    let (mut q, mut qd) = (x[..robot.nq()].to_vec(), x[robot.nq()..].to_vec());
    to_local(robot, &q, &mut qd);
    for k in [0, 3] {
        let turned = by.rotation * vector(&qd[k..]);
        qd[k..k + 3].copy_from_slice(turned.as_slice());
    }
    let (p, r) = (by.transform_point(&vector(&q).into()).coords, by.rotation * quaternion(&q[3..7]));
    q[..3].copy_from_slice(p.as_slice());
    write_quaternion(&mut q[3..7], &r);
    to_world(robot, &q, &mut qd);
    q.extend(qd);
    q
}

#[test]
fn in_its_own_frame_the_root_stands_at_zero_and_moves_by_turned_velocities() {
    let mut worst = 0.0f64;
    for (robot, mut rng) in robots().filter(|(r, _)| r.floating()) {
        let (x, qd) = world_state(&mut rng, &robot);
        let mut seen = vec![0.0; x.len()];
        RootFrame::of(&x).state_in(&robot, &x, &mut seen);
        let nq = robot.nq();
        // (1) to (4), the last as R^T p_dot; joints as they were.
        let back = quaternion(&x[3..7]).inverse();
        let (w, v) = (back * vector(&qd), back * vector(&qd[3..]));
        let own = [&[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], &x[7..nq], w.as_slice(), v.as_slice(), &qd[6..]].concat();
        worst = worst.max(gap(&seen, &own));
    }
    println!("own frame: {worst:.1e}");
    assert!(worst < 1e-14, "own frame is off by {worst:.1e}, allowed 1e-14");
}

#[test]
fn into_a_frame_and_out_again_gives_the_state_back() {
    let mut worst = 0.0f64;
    for (robot, mut rng) in robots() {
        let (x, frame) = (world_state(&mut rng, &robot).0, RootFrame::at(&pose(&mut rng, 2.0)));
        let (mut seen, mut back) = (vec![0.0; x.len()], vec![0.0; x.len()]);
        frame.state_in(&robot, &x, &mut seen);
        frame.state_out(&robot, &seen, &mut back);
        worst = worst.max(gap(&back, &x));
        if !robot.floating() {
            assert_eq!(seen, x, "a fixed base's joint coordinates do not depend on the frame");
        }
    }
    println!("round trip: {worst:.1e}");
    assert!(worst < 1e-14, "the round trip is off by {worst:.1e}, allowed 1e-14");
}

#[test]
fn moving_and_turning_the_world_changes_nothing() {
    for (distance, bound) in [(0.0, 1e-14), (1.0, 1e-14), (1e5, 1e-9)] {
        let mut worst = 0.0f64;
        for (robot, mut rng) in robots().filter(|(r, _)| r.floating()) {
            let before = world_state(&mut rng, &robot).0;
            // The next state, a frame of 1/60 s later, is seen from the frame of the one before: (5) to (8).
            let nq = robot.nq();
            let mut local = before[nq..].to_vec();
            to_local(&robot, &before[..nq], &mut local);
            let mut after = moved(&robot, &before[..nq], &local, 1.0 / 60.0);
            to_world(&robot, &after, &mut local);
            after.extend(local);

            let yaw = UnitQuaternion::from_scaled_axis(vector3(&mut rng, 3.0));
            let by = Isometry3::from_parts(Vector3::new(distance, -distance, distance).into(), yaw);
            for x in [&before, &after] {
                let [here, there] = [Isometry3::identity(), by].map(|by| {
                    let (root, x) = (carried(&robot, &before, &by), carried(&robot, x, &by));
                    let mut seen = vec![0.0; x.len()];
                    RootFrame::of(&root).state_in(&robot, &x, &mut seen);
                    seen
                });
                worst = worst.max(gap(&there, &here));
            }
        }
        println!("world moved by {distance:.0e} m: {worst:.1e}");
        assert!(worst < bound, "a world moved by {distance:.0e} m changes what is seen by {worst:.1e}, allowed {bound:.0e}");
    }
}

#[test]
fn points_turn_and_move_directions_only_turn() {
    let frame = RootFrame {
        origin: Vector3::new(1.0, 2.0, 3.0),
        rotation: UnitQuaternion::from_euler_angles(0.0, 0.0, std::f64::consts::FRAC_PI_2),
    };
    let (point, direction) = (frame.point(&Vector3::new(1.0, 3.0, 3.0)), frame.direction(&Vector3::y()));
    assert!((point - Vector3::x()).norm() < 1e-15 && (direction - Vector3::x()).norm() < 1e-15, "{point} {direction}");
}
