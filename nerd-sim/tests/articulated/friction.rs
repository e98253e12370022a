//! Dry friction of a joint: a slide of 2 kg decelerates uniformly and stops for good. Loaded below its friction force,
//! the slide creeps by at most 1 mm in a second. Above, the excess force accelerates it. A hinge on the slide stays
//! put.

use super::common::*;

/// A slide along `axis` carries a pendulum about y, with dry friction `friction` (N) and `hinge` (N m).
fn slide(axis: &str, friction: f64, hinge: f64) -> Arc<System> {
    let body = |name: &str, mass: f64| link(name, mass, [0.0, 0.0, -0.5], [0.1; 3], "");
    let dry = |axis: &str, friction: f64| {
        format!(
            r#"<axis xyz="{axis}"/><limit lower="-9" upper="9" effort="1" velocity="1"/><dynamics damping="0" friction="{friction}"/>"#
        )
    };
    let parts = [
        base(),
        body("cart", 2.0),
        body("bob", 1e-3),
        joint("slide", "prismatic", ["base", "cart"], &dry(axis, friction)),
        joint("hinge", "continuous", ["cart", "bob"], &dry("0 1 0", hinge)),
    ];
    Arc::new(System::bare("slide", &urdf(&parts), false).expect("valid"))
}

/// State after `frames` frames of 1/60 s from the slide's velocity `v`.
fn after(system: &Arc<System>, config: ArticulatedConfig, v: f64, frames: usize) -> Vec<f64> {
    end(&mut Articulated::new(config), at(system, "free", &[0.0, 0.0, v, 0.0]), 0.0, frames)
}

/// Settings, each with its relative tolerance; errors are of first order in the substep.
fn settings(system: &System) -> [(ArticulatedConfig, f64); 3] {
    let law = Friction::Coulomb;
    [
        (ArticulatedConfig::converged(law), 2e-3),
        (ArticulatedConfig::paper(system, law), 0.02),
        (ArticulatedConfig::implicit(4, law), 0.05),
    ]
}

#[test]
fn a_slide_slows_down_evenly_and_stops() {
    // 4 N stop 2.001 kg from 1 m/s after half a second and a quarter of a metre. The hinge sticks.
    let system = slide("1 0 0", 4.0, 1.0);
    for (config, allowed) in settings(&system) {
        let half = after(&system, config, 1.0, 15);
        let end = after(&system, config, 1.0, 60);
        assert!(
            (half[2] / (1.0 - 0.25 * 4.0 / 2.001) - 1.0).abs() < allowed,
            "{config:?}: {} m/s after 1/4 s",
            half[2]
        );
        assert!((end[0] / (2.001 / 8.0) - 1.0).abs() < allowed, "{config:?}: stops at {} m", end[0]);
        assert!(end[2].abs() < 1e-9, "{config:?}: {} m/s at rest", end[2]);
        assert!(end[1].abs() < 1e-3, "{config:?}: the hinge turned by {} rad", end[1]);
    }
}

#[test]
fn what_is_held_creeps_and_what_is_not_falls() {
    // The weight is 19.63 N.
    for (friction, held) in [(21.0, true), (15.0, false), (5.0, false)] {
        let system = slide("0 0 1", friction, 1.0);
        for (config, allowed) in settings(&system) {
            let (z, fall) = (after(&system, config, 0.0, 60)[0], 0.5 * (9.81 - friction / 2.001));
            let right = if held { (-1e-3..=0.0).contains(&z) } else { (-z / fall - 1.0).abs() < allowed };
            assert!(right, "{config:?}, {friction} N: {z} m, free fall against it {fall} m");
        }
    }
}

#[cfg(feature = "rapier")]
#[test]
fn rapier_refuses_it_by_name() {
    let mut batch = batch(&slide("1 0 0", 4.0, 0.0), "free", 1);
    let said = line(Rapier::new(RapierConfig::default()).step(&mut batch, &[0.0; 2]));
    assert!(said.contains("`slide`") && said.contains("dry friction"), "{said}");
}
