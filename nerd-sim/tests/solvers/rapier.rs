//! rapier behind the solver interface. Each test guards against a fault of plain rapier. Its free roots drift when the
//! centre of mass is off the origin, it keeps state outside (q, qd), and it sees contact too late. Its joints have
//! default damping, and hard limits in place of the model's springs.

use super::common::*;

/// The tip hits the ground at about 10 m/s, 40 mm an outer step. Contact is seen at most one such step late.
#[test]
fn the_pendulum_does_not_sink_into_the_ground() {
    let system = built_in("pendulum");
    let (mut batch, mut solver) = (batch(&system, "ground1", 8), Rapier::new(RapierConfig::default()));
    for env in 0..8 {
        // Level with the pivot, 2 m above the plane, at rest: nothing touches at the start.
        let lean = 0.05 * env as f64;
        batch.reset(env, &[lean, 0.3 - lean, 0.0, 0.0]);
    }
    let (mut data, mut events) = (Data::new(&system.robot), Vec::new());
    let depths: Vec<f64> = (0..300)
        .map(|_| {
            run(&mut solver, &mut batch, 0.0, 1);
            let depths = (0..8).flat_map(|env| {
                contacts(&system, &batch.scenes[env], batch.state(env), &mut data, &mut events);
                let depth = |(event, point): (&ContactEvent, &ContactPoint)| point.radius - event.distance;
                events.iter().zip(&system.robot.contact_points).map(depth).collect::<Vec<_>>()
            });
            depths.fold(0.0, f64::max)
        })
        .collect();
    let worst = depths.iter().copied().fold(0.0, f64::max);
    assert!(worst < 0.04, "{worst:.3e} m at impact, bound 0.04 m");
    assert!(depths[299] < 1e-3, "{:.3e} m at rest, bound 1e-3 m", depths[299]);
}

/// Free flight of two bodies on a hinge, with centres of mass off their origins, under gravity and torque, against
/// Runge-Kutta. The error must halve with the substep. Otherwise root coordinates, twists or torques are converted
/// wrongly.
#[test]
fn a_floating_robot_converges_to_the_articulated_solution() {
    let [a, b] = ["a", "b"].map(|name| link(name, 2.0, [0.1, 0.0, 0.0], [0.02, 0.03, 0.04], ""));
    let hinge = joint("hinge", "continuous", ["a", "b"], r#"<origin xyz="0.2 0 0"/><axis xyz="0 0.6 0.8"/>"#);
    let system = Arc::new(System::bare("floater", &urdf(&[a, b, hinge]), true).expect("valid"));
    let turn = UnitQuaternion::from_euler_angles(0.4, -0.3, 0.9);
    let rest = [0.3, 1.0, -0.5, 0.8, 0.2, 0.4, 0.1, -1.0];
    let state = [&[0.5, -0.2, 1.0], turn.coords.as_slice(), &rest].concat();
    let after = |solver: &mut dyn Solver| end(solver, at(&system, "free", &state), 0.05, 20);
    let fine = ArticulatedConfig { substeps: 16, ..ArticulatedConfig::converged(Friction::Coulomb) };
    let reference = after(&mut Articulated::new(fine));
    let [coarse, fine] = [32, 64].map(|steps| {
        let found = after(&mut Rapier::new(RapierConfig { iterations: 1, steps, ..Default::default() }));
        found.iter().zip(&reference).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    });
    assert!(
        (1.6..2.5).contains(&(coarse / fine)),
        "{coarse:.2e} to {fine:.2e}: ratio {:.2}, first order is 2",
        coarse / fine
    );
    assert!(fine < 2e-2, "{fine:.2e} at 64 outer steps, bound 2e-2");
}

/// The Ant slides and turns on the ground, from one state at two headings. The friction of rapier acts along two
/// tangents. With tangents along the robot's axes the motion does not depend on the heading, along the world's axes it
/// does.
#[test]
fn along_its_own_axes_a_robot_moves_alike_wherever_it_heads() {
    let system = built_in("ant");
    let begun = start(&system, Start::Sample, &mut stream(5, 0));
    let headed = |angle: f64| {
        let (turn, mut state) = (UnitQuaternion::from_axis_angle(&Vector3::y_axis(), angle), begun.clone());
        let nq = system.robot.nq();
        let orientation = turn * quaternion(&state[3..7]);
        write_quaternion(&mut state[3..7], &orientation);
        for first in [0, nq, nq + 3] {
            let turned = turn * vector(&state[first..first + 3]);
            state[first..first + 3].copy_from_slice(turned.as_slice());
        }
        at(&system, "ground", &state)
    };
    let [own, world] = [true, false].map(|own_axes| {
        let after =
            |angle| end(&mut Rapier::new(RapierConfig { own_axes, ..Default::default() }), headed(angle), 0.0, 40);
        let joints = |state: &[f64]| state[7..system.robot.nq()].to_vec();
        let pairs = joints(&after(0.0)).into_iter().zip(joints(&after(1.0)));
        pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    });
    assert!(
        own < 1e-8 && world > 1e-3,
        "joints differ by {own:.1e} rad along its own axes, by {world:.1e} along the world's"
    );
}

/// The reference's cube, dropped flat from 0.2 m, stays down at restitution 0 and rebounds to a quarter at 0.5. The
/// impact is a few per cent off, depending on where rapier's step falls.
#[test]
fn contacts_bounce_as_far_as_they_are_told_to() {
    let system = built_in("cube");
    let mut start = system.default_state();
    start[2] = 0.0524 + 0.2;
    let dropped = at(&system, "ground", &start);
    let solver = |restitution| Rapier::new(RapierConfig { restitution, ..Default::default() });
    let [none, half] = [0.0, 0.5].map(|restitution| {
        let heights: Vec<f64> =
            motion(&mut solver(restitution), dropped.clone(), 0.0, 70).iter().map(|s| s[2] - 0.0524).collect();
        let landed = heights.windows(2).position(|w| w[1] > w[0] + 1e-4).unwrap_or(heights.len() - 1);
        heights[landed..].iter().fold(f64::MIN, |a, b| a.max(*b))
    });
    assert!(none < 1e-3 && (half / 0.05 - 1.0).abs() < 0.2, "{none} m, {half} m");
    let said = line(solver(1.5).step(&mut dropped.clone(), &[]));
    assert!(said.contains("restitution is 1.5"), "{said}");
}

/// A crate on the floor of an MJCF: each pair of geoms has its friction, and geoms that never meet fall through.
/// Contact properties that rapier lacks are refused.
#[test]
fn geoms_of_a_file_meet_as_it_says() {
    let after = |geom: &str, frames: usize| {
        let text = format!(
            r#"<mujoco><worldbody><geom type="plane" size="5 5 .1" friction="1"/><body name="crate" pos="0 0 .1"><freejoint/>
            <geom type="box" size=".1 .1 .1" density="500" {geom}/></body></worldbody></mujoco>"#
        );
        let system = Arc::new(System::from_text("crate", &text, None).expect("a robot"));
        let mut batch = batch(&system, "plane", 1);
        (batch.states[2], batch.states[10]) = (0.1, 1.0);
        let mut solver = Rapier::new(RapierConfig::default());
        (0..frames).try_for_each(|_| solver.step(&mut batch, &[])).map(|()| batch.states)
    };
    let (slid, way) = (after(r#"friction=".2" priority="1""#, 90).expect("steps")[0], 1.0 / (2.0 * 0.2 * 9.81));
    // rapier acts on a contact one frame later.
    assert!((slid - way - 1.0 / 60.0).abs() < 0.005, "it slides by {slid} m, not {way}");
    let smooth = after(r#"condim="1" priority="1""#, 60).expect("steps")[0];
    assert!((smooth - 1.0).abs() < 0.02, "without friction it slides by {smooth} m in 1 s");
    let (through, fallen) = (after(r#"contype="2" conaffinity="2""#, 30).expect("steps")[2], 0.1 - 0.5 * 9.81 * 0.25);
    assert!((through - fallen).abs() < 0.05, "what meets nothing is at {through} m, not {fallen}");
    let lifted = after(r#"margin=".03""#, 60).expect("steps")[2];
    assert!((lifted - 0.13).abs() < 0.002, "over its margin it rests at {lifted} m");
    assert!(line(after(r#"condim="6""#, 1)).contains("rolling friction"));
}
