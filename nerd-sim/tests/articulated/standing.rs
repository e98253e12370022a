//! A robot without a material in its file stands: its feet stick by Coulomb's law. Regularised friction lets a foot
//! creep at its tangential force over the tangential damping: 1 mm in 5 s at 30 N.

use super::common::*;

/// ANYmal in its default pose with the default material, z up, and gains that carry its weight.
fn quadruped() -> Arc<System> {
    let mut system = (*built_in("anymal")).clone();
    system.spec.material = Material::default();
    system.spec.gravity = [0.0, 0.0, -9.81];
    system.spec.joints.iter_mut().for_each(|j| (j.kp, j.kd) = (1500.0, 40.0));
    Arc::new(system)
}

/// The same scene with a sideways gravity (m/s^2) added.
fn leaning(scene: &Scene, aside: f64) -> Arc<Scene> {
    let mut scene = scene.clone();
    scene.gravity.x = aside;
    Arc::new(scene)
}

/// Positions of the base and a foot after every frame of 6 s under the PD law. `aside` (m/s^2) acts from 1 s on.
fn stand(config: ArticulatedConfig, aside: f64) -> Vec<[Vector3<f64>; 2]> {
    let system = quadruped();
    let mut state = system.default_state();
    state[..3].copy_from_slice(&[0.0, 0.0, 0.6]);
    write_quaternion(&mut state[3..7], &nalgebra::UnitQuaternion::identity());
    let mut batch = at(&system, "plane", &state);
    let (mut controller, mut solver) = (Controller::new(&system), Articulated::new(config));
    let foot = system.robot.contact_points.iter().rfind(|p| p.link == 12).expect("a foot on the last shank");
    let (mut data, mut tau, still) = (Data::new(&system.robot), vec![0.0; 12], vec![0.0; 12]);
    let frame = |frame| {
        if frame == 60 && aside != 0.0 {
            batch.scenes[0] = leaning(&batch.scenes[0], aside);
        }
        controller.torques(batch.state(0), &still, &mut tau);
        solver.step(&mut batch, &tau).expect("finite");
        kinematics(&system.robot, batch.state(0), &mut data);
        [vector(batch.state(0)), point_position(&data, foot.link, &foot.local)]
    };
    (0..360).map(frame).collect()
}

/// Few implicit substeps hold the height as well as many. Explicit substeps are too long for such stiff friction: feet
/// would tremble about rest and the robot sink. The solver therefore steps these frames implicitly.
#[test]
fn a_standing_quadruped_holds_its_height() {
    for (name, config) in [
        ("implicit x4", ArticulatedConfig::implicit(4, Friction::Coulomb)),
        ("implicit x32", ArticulatedConfig::implicit(32, Friction::Coulomb)),
        ("paper", ArticulatedConfig::paper(&quadruped(), Friction::Coulomb)),
        ("explicit x16", ArticulatedConfig::explicit(16, Friction::Coulomb)),
        ("explicit x64", ArticulatedConfig::explicit(64, Friction::Huber)),
    ] {
        let path = stand(config, 0.0);
        // The first second is the landing.
        let (low, high) = path[60..].iter().fold((f64::MAX, f64::MIN), |(a, b), [p, _]| (a.min(p.z), b.max(p.z)));
        let aside = path.iter().map(|[p, _]| p.xy().norm()).fold(0.0, f64::max);
        assert!(
            low > 0.6 && high - low < 5e-3 && aside < 0.05,
            "{name}: its base sinks from {high} to {low} m, {aside} m aside"
        );
    }
}

/// 16 N to the side, where 260 N would slide the robot. Its legs deflect, its feet stay.
#[test]
fn a_push_below_the_friction_does_not_move_it() {
    for substeps in [4, 32] {
        let path = stand(ArticulatedConfig::implicit(substeps, Friction::Coulomb), 0.3);
        let slid = (path[359][1] - path[119][1]).norm();
        assert!(
            path[359][0].z > 0.6 && slid < 5e-3,
            "implicit x{substeps}: pushed aside a foot slides by {slid} m in 4 s, allowed 5 mm"
        );
    }
}
