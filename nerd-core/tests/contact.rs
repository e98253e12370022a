//! Contact mask (paper A.1) and angles in [-pi, pi): exact by definition; only congruence of wrapped angles is bounded
//! by the rounding of the angle given, 1e-16 of it.

use std::f64::consts::{PI, TAU};

use nalgebra::Vector3;
use nerd_core::contact::{ContactEvent, ContactPoint};
use nerd_core::state::wrap;
use proptest::prelude::*;

fn point(thickness: f64) -> ContactPoint {
    ContactPoint { link: 0, local: Vector3::zeros(), radius: 0.0, thickness }
}

#[test]
fn threshold_is_four_thicknesses_and_at_least_a_tenth() {
    for (thickness, xi) in [(0.0, 0.1), (1e-5, 0.1), (0.025, 0.1), (0.08, 0.32), (0.1, 0.4), (0.25, 1.0)] {
        assert_eq!(point(thickness).threshold(), xi, "thickness {thickness} m");
    }
}

#[test]
fn a_contact_is_seen_nearer_than_its_threshold_and_zero_beyond() {
    let (x, n) = (Vector3::new(1.0, 2.0, 3.0), Vector3::y());
    let event = |distance| ContactEvent { p0: x, p1: x - n * distance, normal: n, distance, collider: 3 };
    for seen in [-2.0, 0.0, 0.3999] {
        assert_eq!(event(seen).masked(&point(0.1)), event(seen), "at {seen} m");
    }
    for hidden in [0.4, 1.0, f64::INFINITY, f64::NAN] {
        assert_eq!(event(hidden).masked(&point(0.1)), ContactEvent::default(), "at {hidden} m");
    }
    assert_eq!(ContactEvent::none(x).masked(&point(0.1)), ContactEvent::default(), "an empty scene");
}

#[test]
fn angles_at_the_seam() {
    let below = f64::from_bits(PI.to_bits() - 1);
    for (x, y) in [(0.0, 0.0), (PI, -PI), (-PI, -PI), (below, below), (TAU, 0.0), (-TAU, 0.0)] {
        assert_eq!(wrap(x), y, "wrap({x})");
    }
    assert_eq!(wrap(-below), -below);
}

#[test]
fn what_is_no_angle_stays_none_and_what_is_huge_comes_into_range() {
    for x in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        assert!(wrap(x).is_nan(), "wrap({x}) = {}", wrap(x));
    }
    for x in [1e9, -1e15, 1e18, -1e18, 1e300, f64::MAX, f64::MIN] {
        let y = wrap(x);
        assert!((-PI..PI).contains(&y), "wrap({x:e}) = {y}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn wrapped_angles_lie_in_one_turn_and_mean_the_same(turns in -1000i32..1000, part in -1.0f64..1.0, ulps in -3i64..3, seam: bool) {
        // Half the cases within three floats of an odd multiple of pi, where rounding decides.
        let centre = PI * f64::from(2 * turns + 1);
        let x = if seam { f64::from_bits((centre.to_bits() as i64 + ulps) as u64) } else { centre + PI * part };
        let y = wrap(x);
        prop_assert!((-PI..PI).contains(&y), "wrap({x}) = {y}");
        prop_assert_eq!(wrap(y), y, "wrapping twice");
        let turns = (x - y) / TAU;
        let slip = (turns - turns.round()).abs() * TAU;
        prop_assert!(slip < 1e-15 * (10.0 + x.abs()), "wrap({}) = {} is off by {:e}", x, y, slip);
    }
}
