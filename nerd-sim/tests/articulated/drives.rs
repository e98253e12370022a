//! Drives inside the substeps: known motions, stability at any gain, efforts, velocities, and who refuses them.

use std::sync::Arc;

use nerd_sim::prelude::*;

/// A rod of 1 kg with an inertia of 0.25 kg m^2 about its hinge's vertical axis: no gravity along it.
const ROD: &str = r#"<robot name="rod"><link name="base"/><link name="rod"><inertial><mass value="1"/><origin xyz="0 0 0"/>
<inertia ixx="0.25" iyy="0.25" izz="0.25" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="continuous"><parent link="base"/><child link="rod"/><axis xyz="0 0 1"/>
<limit effort="5" velocity="3" lower="0" upper="0"/></joint></robot>"#;
const INERTIA: f64 = 0.25;

fn rod() -> Arc<System> {
    Arc::new(System::bare("rod", ROD, false).expect("it is a robot"))
}

fn driven(drive: Drive, substeps: usize, frames: usize) -> Vec<f64> {
    let system = rod();
    let mut batch = Batch::new(&system, &system.scene("free").expect("free is always there"), 1);
    batch.drives = vec![drive];
    let mut simulation = Simulation::new(batch, Articulated::new(ArticulatedConfig::implicit(substeps, Friction::Coulomb)));
    let mut motion = Vec::new();
    for _ in 0..frames {
        simulation.step(&[0.0]).expect("it can be stepped");
        motion.extend_from_slice(simulation.batch.state(0));
    }
    motion
}

/// `I qdd = -kp q - kd qd` from rest at -0.5 from the target: the damped oscillator's textbook solution.
#[test]
fn a_soft_drive_is_the_damped_oscillator() {
    let (kp, kd, target) = (4.0, 0.4, 0.5);
    let (decay, natural) = (kd / (2.0 * INERTIA), f64::sqrt(kp / INERTIA));
    let w = (natural * natural - decay * decay).sqrt();
    let exact = |t: f64| target - target * (-decay * t).exp() * ((w * t).cos() + decay / w * (w * t).sin());
    let error = |substeps| {
        let motion = driven(Drive { kp, kd, target, ..Drive::default() }, substeps, 60);
        let errors = (0..60).map(|k| (motion[2 * k] - exact((k + 1) as f64 / 60.0)).abs());
        errors.fold(0.0, f64::max)
    };
    let [coarse, fine] = [error(4), error(8)];
    assert!(fine < 1e-4, "{fine} rad from the exact motion");
    assert!((3.3..4.7).contains(&(coarse / fine)), "not of second order: {coarse} at 4 substeps, {fine} at 8");
}

#[test]
fn any_gain_is_stable_and_comes_to_its_target() {
    for (kp, kd) in [(10.0, 2.0), (1e4, 50.0), (1e6, 1e3), (1e9, 1e6), (1e9, 0.0), (0.0, 1e9)] {
        let motion = driven(Drive { kp, kd, target: 0.3, ..Drive::default() }, 4, 300);
        let (most, end) = (motion.chunks(2).map(|s| s[0].abs()).fold(0.0, f64::max), motion[598]);
        assert!(most < 0.7, "kp {kp}, kd {kd}: {most} rad on the way to 0.3");
        let expected = if kp > 0.0 { 0.3 } else { 0.0 };
        assert!(kd == 0.0 || (end - expected).abs() < 1e-3, "kp {kp}, kd {kd}: at {end} rad after five seconds, not {expected}");
    }
}

/// Under its effort alone: `q = tau t^2 / (2 I)` until the largest velocity of the joint, and no faster.
#[test]
fn effort_and_velocity_are_bounds() {
    let motion = driven(Drive { kp: 1e5, kd: 0.0, target: 1e3, effort: 0.5, ..Drive::default() }, 4, 180);
    let half = 0.5 * 0.5 / INERTIA * 0.25;
    assert!((motion[2 * 29] - half).abs() < 1e-9, "{} rad after half a second at full effort, not {half}", motion[58]);
    let fastest = motion.chunks(2).map(|s| s[1]).fold(0.0, f64::max);
    let frame = 0.5 / INERTIA / 60.0;
    assert!((3.0..3.0 + frame).contains(&fastest), "{fastest} rad/s, where the joint's largest velocity is 3");
}

#[test]
fn what_is_no_drive_has_a_line() {
    let system = rod();
    let mut batch = Batch::new(&system, &system.scene("free").expect("free is always there"), 1);
    let mut solver = Articulated::new(ArticulatedConfig::accurate(&system));
    batch.drives = vec![Drive::default(); 2];
    let said = solver.step(&mut batch, &[0.0]).expect_err("two drives for one joint").to_string();
    assert!(said.contains("1 `drives`") && said.contains("it has 2"), "{said}");
    batch.drives = vec![Drive { kp: f64::NAN, ..Drive::default() }];
    let said = solver.step(&mut batch, &[0.0]).expect_err("NaN is no gain").to_string();
    assert!(said.contains("`hinge`") && said.contains("kp is NaN"), "{said}");
}

#[cfg(feature = "rapier")]
#[test]
fn a_solver_without_drives_refuses_them() {
    let system = rod();
    let mut batch = Batch::new(&system, &system.scene("free").expect("free is always there"), 1);
    batch.drives = vec![Drive::default()];
    let said = Rapier::new(RapierConfig::default()).step(&mut batch, &[0.0]).expect_err("rapier has none").to_string();
    assert!(said.contains("no drives inside its frame"), "{said}");
}
