//! The built-in robots: figures of the reference system, controllers and sampling boxes.

use super::common::*;

/// Mass (kg), joints, contact points.
#[test]
fn masses_joints_and_contact_points_are_the_references() {
    for (name, mass, joints, points) in [
        ("cartpole", 52.5, 2, 0),
        ("pendulum", 51.31268, 2, 4),
        ("cube", 1.1510227, 0, 8),
        ("franka", 18.7827, 7, 0),
        ("ant", 117.05, 8, 25),
        ("anymal", 53.16426, 12, 14),
        ("anymal-paper", 53.35426, 12, 14),
    ] {
        let robot = &built_in(name).robot;
        assert!((robot.mass() / mass - 1.0).abs() < 1e-4, "{name}: {} kg, reference {mass}", robot.mass());
        assert_eq!((robot.joint_count(), robot.contact_points.len()), (joints, points), "{name}");
    }
}

/// The reference's files hold actions (`a_*`) beside the torques that its controllers computed from them.
#[test]
fn controllers_are_the_references() {
    for (robot, file) in
        [("franka", "franka_pd_random_action_warp1.8.1.csv"), ("anymal-paper", "anymal_random_action_warp1.8.1.csv")]
    {
        let Some(table) = Reference::read(file) else { return };
        let system = built_in(robot);
        let mut controller = Controller::new(&system);
        let (states, torques) = (table.places(&system.spec.state_columns), table.places(&system.spec.torque_columns));
        let actions: Vec<String> = system.spec.torque_columns.iter().map(|c| c.replace("tau_", "a_")).collect();
        let actions = table.places(&actions);
        let (mut worst, mut rows, mut out) = (0.0f64, 0, vec![0.0; torques.len()]);
        for row in &table.rows {
            let numbers = |places: &[usize]| places.iter().map(|i| row[*i]).collect::<Option<Vec<_>>>();
            // The last row of a trajectory has no action.
            let (Some(state), Some(action), Some(expected)) = (numbers(&states), numbers(&actions), numbers(&torques))
            else {
                continue;
            };
            controller.torques(&state, &action, &mut out);
            worst = out.iter().zip(&expected).map(|(a, b)| (a - b).abs()).fold(worst, f64::max);
            rows += 1;
        }
        assert!(rows > 100 && worst < 1e-3, "{file}: {rows} rows, torques differ by up to {worst:.1e} N m");
    }
}

#[test]
fn starts_keep_to_their_boxes() {
    for env in 0..200 {
        for name in ["ant", "ant-paper", "anymal"] {
            let system = built_in(name);
            let (state, nq) = (start(&system, Start::Sample, &mut stream(0, env)), system.robot.nq());
            let (p, q, w, v) =
                (vector(&state[..3]), quaternion(&state[3..7]), vector(&state[nq..]), vector(&state[nq + 3..]));
            let said = &system.spec.root.as_ref().expect("a free root").sample;
            let within = |x: &Vector3<f64>, ranges: &[Range; 3]| {
                x.iter().zip(ranges).all(|(x, range)| (range.low - 1e-12..range.high + 1e-12).contains(x))
            };
            assert!(within(&p, &said.position), "{name} at {p:?}");
            let (turning, moving) = (q.inverse() * w, q.inverse() * (v + w.cross(&p)));
            assert!(within(&turning, &said.ang_vel), "{name} turns in the body with {turning:?}");
            assert!(within(&moving, &said.velocity), "{name} moves in the body with {moving:?}");
            let tilt = quaternion(&system.default_state()[3..7]).angle_to(&q);
            assert!(tilt <= said.tilt.high.max(-said.tilt.low) + 1e-12, "{name} tilted by {tilt}");
        }

        let system = built_in("cube");
        let cube = start(&system, Start::Reset, &mut stream(0, env));
        let (mut data, mut events) = (Data::new(&system.robot), Vec::new());
        contacts(&system, &system.scene("ground").expect("scene"), &cube, &mut data, &mut events);
        let lowest = events.iter().map(|e| e.distance).fold(f64::INFINITY, f64::min);
        assert!(lowest >= 1e-3, "a corner of the cube starts {lowest} m above the ground");
    }
}

/// Data of each robot is finite, near its ground, and driven if the robot has joints.
#[test]
fn every_robot_is_recorded() {
    for name in System::built_in() {
        let system = built_in(name);
        let config = GenerateConfig { transitions: 160, frames: 20, ..Default::default() };
        let recording = record(&system, &mut *system.spec.truth.solver(&system), &config, 0, 8).expect("recorded");
        assert!(recording.states.iter().all(|x| x.is_finite()), "{name}");
        let driven = recording.torques.iter().any(|t| *t != 0.0);
        assert_eq!(driven, system.robot.joint_count() > 0, "{name}: torques");
        let nearest = recording.depths.iter().fold(f64::INFINITY, |a, b| a.min(*b));
        assert!(
            system.spec.data_scene.is_none() || nearest < 0.1,
            "{name}: nothing comes nearer to the ground than {nearest} m"
        );
    }
}

/// A start below the clearance is drawn again. A robot that has no start above it is refused when read.
#[test]
fn a_clearance_that_no_start_has_is_refused() {
    let ball = urdf(&[link("ball", 1.0, [0.0; 3], [1.0; 3], &collision([0.0; 3], r#"<sphere radius="0.1"/>"#))]);
    let zero = r#"["U(0, 0)", "U(0, 0)", "U(0, 0)"]"#;
    let toml = format!(
        "data_scene = \"ground\"\n{}[root]\nposition = [0.0, 0.0, 1.0]\nquaternion = [0.0, 0.0, 0.0, 1.0]\n[root.sample]\nposition = [\"U(0, 0)\", \"U(0, 0)\", \"U(-1, 0.5)\"]\ntilt = \"U(0, 0)\"\nangular = {zero}\nlinear = {zero}\nclearance = 0.3\n{GROUND}",
        keys(true, 9.81)
    );
    let system = System::from_text("ball", &ball, Some(&toml)).expect("some starts are clear");
    let lowest =
        (0..200).map(|env| start(&system, Start::Sample, &mut stream(0, env))[2]).fold(f64::INFINITY, f64::min);
    assert!(
        (0.3..0.35).contains(&lowest),
        "lowest of 200 starts {lowest} m, the contact law's distance is to the centre"
    );
    let error = line(System::from_text("ball", &ball, Some(&changed(&toml, "clearance = 0.3", "clearance = 0.6"))));
    assert!(error.contains("[root.sample]") && error.contains("clearance"), "{error}");
}

/// No point of a built-in robot creeps by more than 1 mm/s under 30 N, for the cube under its friction limit.
#[test]
fn thirty_newtons_move_a_foot_by_a_millimetre_a_second() {
    for (name, force) in [("pendulum", 30.0), ("ant", 30.0), ("anymal", 30.0), ("cube", 1.7)] {
        let system = built_in(name);
        let ground =
            system.scene(system.usual_scenes().into_iter().find(|s| *s != "free").expect("a ground")).expect("scene");
        let creep = force / ground.colliders[0].material.mean(&system.spec.material).friction_damping;
        assert!(creep < 1.001e-3, "{name}: {creep:.2e} m/s under {force} N");
    }
}
