//! Drives inside the substeps: known motions, stability at any gain, torque and velocity limits, solvers that refuse
//! them.

use super::common::*;

const INERTIA: f64 = 0.25;

/// A rod of 1 kg on a vertical hinge, so that gravity does no work.
fn rod(drives: &[Drive]) -> Batch {
    let hinge = r#"<axis xyz="0 0 1"/><limit effort="5" velocity="3" lower="0" upper="0"/>"#;
    let parts =
        [base(), link("rod", 1.0, [0.0; 3], [INERTIA; 3], ""), joint("hinge", "continuous", ["base", "rod"], hinge)];
    let system = Arc::new(System::bare("rod", &urdf(&parts), false).expect("a robot"));
    Batch { drives: drives.to_vec(), ..batch(&system, "free", 1) }
}

/// Angle and angular velocity after each frame.
fn driven(drive: Drive, substeps: usize, frames: usize) -> Vec<Vec<f64>> {
    motion(&mut implicit(substeps), rod(&[drive]), 0.0, frames)
}

/// `I qdd = -kp (q - target) - kd qd` from rest, 0.5 rad below the target: the damped oscillator's textbook solution.
#[test]
fn a_soft_drive_is_the_damped_oscillator() {
    let (kp, kd, target) = (4.0, 0.4, 0.5);
    let (decay, natural) = (kd / (2.0 * INERTIA), f64::sqrt(kp / INERTIA));
    let w = (natural * natural - decay * decay).sqrt();
    let exact = |t: f64| target - target * (-decay * t).exp() * ((w * t).cos() + decay / w * (w * t).sin());
    let [coarse, fine] = [4, 8].map(|substeps| {
        let motion = driven(Drive { kp, kd, target, ..Drive::default() }, substeps, 60);
        motion.iter().enumerate().map(|(k, s)| (s[0] - exact((k + 1) as f64 / 60.0)).abs()).fold(0.0, f64::max)
    });
    assert!(fine < 1e-4, "{fine} rad from the exact motion");
    assert!((3.3..4.7).contains(&(coarse / fine)), "not of second order: {coarse} at 4 substeps, {fine} at 8");
}

#[test]
fn any_gain_is_stable_and_comes_to_its_target() {
    for (kp, kd) in [(10.0, 2.0), (1e4, 50.0), (1e6, 1e3), (1e9, 1e6), (1e9, 0.0), (0.0, 1e9)] {
        let motion = driven(Drive { kp, kd, target: 0.3, ..Drive::default() }, 4, 300);
        let (most, end) = (motion.iter().map(|s| s[0].abs()).fold(0.0, f64::max), motion[299][0]);
        assert!(most < 0.7, "kp {kp}, kd {kd}: {most} rad on the way to 0.3");
        let expected = if kp > 0.0 { 0.3 } else { 0.0 };
        assert!(
            kd == 0.0 || (end - expected).abs() < 1e-3,
            "kp {kp}, kd {kd}: at {end} rad after five seconds, not {expected}"
        );
    }
}

/// At the torque limit, `q = tau t^2 / (2 I)` until the joint reaches its velocity limit.
#[test]
fn effort_and_velocity_are_bounds() {
    let motion = driven(Drive { kp: 1e5, kd: 0.0, target: 1e3, effort: 0.5, ..Drive::default() }, 4, 180);
    let half = 0.5 * 0.5 / INERTIA * 0.25;
    assert!(
        (motion[29][0] - half).abs() < 1e-9,
        "{} rad after half a second at full effort, not {half}",
        motion[29][0]
    );
    let fastest = motion.iter().map(|s| s[1]).fold(0.0, f64::max);
    let frame = 0.5 / INERTIA / 60.0;
    assert!((3.0..3.0 + frame).contains(&fastest), "{fastest} rad/s, where the joint's largest velocity is 3");
}

#[test]
fn drives_that_cannot_be_held_are_refused() {
    let step = |drives: &[Drive]| line(implicit(4).step(&mut rod(drives), &[0.0]));
    let said = step(&[Drive::default(); 2]);
    assert!(said.contains("1 `drives`") && said.contains("it has 2"), "{said}");
    let said = step(&[Drive { kp: f64::NAN, ..Drive::default() }]);
    assert!(said.contains("`hinge`") && said.contains("kp is NaN"), "{said}");
    #[cfg(feature = "rapier")]
    {
        let said = line(Rapier::new(RapierConfig::default()).step(&mut rod(&[Drive::default()]), &[0.0]));
        assert!(said.contains("no drives inside its frame"), "{said}");
    }
}

/// A trunk of 10 kg stands on a foot of 50 g through a slide. Its PD law is stiff enough to stop the trunk within a
/// frame. As a drive inside the substeps (`servo`), the law lets the trunk sink by `m g / kp`. Held constant over the
/// frame, the force does not react to the ground, and the trunk sinks further.
#[test]
fn a_servo_bears_what_a_law_that_is_held_does_not() {
    let inner = r#"<axis xyz="0 0 1"/><limit lower="-0.2" upper="0.2" effort="1000" velocity="10"/>"#;
    let foot = collision([0.0, 0.0, -0.01], r#"<box size="0.4 0.4 0.02"/>"#);
    let parts = [
        link("trunk", 10.0, [0.0; 3], [0.1; 3], ""),
        joint("slide", "prismatic", ["trunk", "foot"], inner),
        link("foot", 0.05, [0.0; 3], [1e-3; 3], &foot),
    ];
    let toml = "like = \"urdf\"\nfloating = true\n[[joint]]\nname = \"slide\"\nkp = 2e4\nkd = 500.0\ngain = 1e3\n";
    let system = Arc::new(System::from_text("hopper", &urdf(&parts), Some(toml)).expect("a robot"));
    let [servo, held] = [true, false].map(|servo| {
        let mut batch = batch(&system, "plane", 1);
        batch.state_mut(0)[2] = 0.02;
        batch.servo = servo;
        let mut controller = Controller::new(&system);
        controller.servo = servo;
        let (mut solver, mut torques) = (implicit(4), [0.0]);
        for _ in 0..120 {
            controller.torques(batch.state(0), &[0.0], &mut torques);
            solver.step(&mut batch, &torques).expect("steps");
        }
        batch.joint(0, "slide").expect("a joint")[0]
    });
    // The slide's coordinate grows as the foot approaches the trunk.
    let expected = 10.0 * GRAVITY / 2e4;
    assert!((servo - expected).abs() < 2e-4, "a servo gives way by {servo} m, not m g / kp = {expected}");
    assert!(held > 10.0 * expected, "the law that is held gives way by {held} m: then a servo is not needed");
}
