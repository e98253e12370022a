//! What rapier must do behind the solver interface. Each test guards a fault that rapier has when used plainly: state
//! that lives outside (q, qd), a floating root that drifts with its centre of mass off the origin, silence about numbers
//! that are not finite, default damping, hard limits in place of the model's.
use std::sync::Arc;

use nalgebra::{UnitQuaternion, Vector3};
use nerd_sim::prelude::*;

fn pendulum() -> Arc<System> {
    System::named("pendulum").expect("built in")
}

/// `n` environments of a robot, each with a state and torques of its own.
fn spread(system: &Arc<System>, scene: &str, n: usize) -> (Batch, Vec<f64>) {
    let mut batch = Batch::new(system, &system.scene(scene).expect("scene"), n);
    for (i, x) in batch.states.iter_mut().enumerate() {
        *x = (0.7 * i as f64).sin() * 2.0;
    }
    let torques = (0..n * system.robot.joint_count()).map(|i| 30.0 * (i as f64).cos()).collect();
    (batch, torques)
}

fn bytes(states: &[f64]) -> Vec<u64> {
    states.iter().map(|x| x.to_bits()).collect()
}

fn articulated() -> Articulated {
    Articulated::new(ArticulatedConfig { substeps: 16, ..ArticulatedConfig::converged(Friction::Coulomb) })
}

/// A floating body whose centre of mass is 0.1 m off its origin, with a second one on a hinge if `jointed`.
fn floating(jointed: bool, gravity: f64) -> Arc<System> {
    let body = |name: &str| {
        format!(
            r#"<link name="{name}"><inertial><origin xyz="0.1 0 0"/><mass value="2"/>
        <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.04"/></inertial>
        <collision><origin xyz="0.1 0 0"/><geometry><sphere radius="0.1"/></geometry></collision></link>"#
        )
    };
    let hinge = r#"<joint name="hinge" type="continuous"><parent link="a"/><child link="b"/><origin xyz="0.2 0 0"/><axis xyz="0 0.6 0.8"/></joint>"#;
    let urdf = format!(r#"<robot name="floater">{}{}</robot>"#, body("a"), if jointed { body("b") + hinge } else { String::new() });
    let q: Vec<_> = "px py pz qx qy qz qw".split(' ').chain(jointed.then_some("q")).map(|c| format!("\"{c}\"")).collect();
    let qd: Vec<_> = "wx wy wz vx vy vz".split(' ').chain(jointed.then_some("qd")).map(|c| format!("\"{c}\"")).collect();
    let joint =
        "[[joint]]\nname = \"hinge\"\nsample = { q = \"U(-1, 1)\", qd = \"U(-1, 1)\" }\nreset = { q = \"U(-1, 1)\", qd = \"U(-1, 1)\" }\n";
    let spec = format!(
        "urdf = \"\"\nfloating = true\nframe_time = \"1/60\"\ngravity = [0.0, 0.0, {gravity:?}]\nsubsteps = 16\nstate_columns = [{}, {}]\ntorque_columns = [{}]\n{}\n[[scene]]\nname = \"ground\"\nplane = {{ height = 0.0, angles = [0.0, 0.0, 0.0] }}\n",
        q.join(", "),
        qd.join(", "),
        if jointed { "\"tau\"" } else { "" },
        if jointed { joint } else { "" },
    );
    Arc::new(System::from_text("floater", &urdf, Some(&spec)).expect("valid"))
}

/// Centre of mass of a floating body (link 0).
fn com(state: &[f64]) -> Vector3<f64> {
    let turn: UnitQuaternion<f64> = nerd_core::state::quaternion(&state[3..7]);
    nerd_core::state::vector(state) + turn * Vector3::new(0.1, 0.0, 0.0)
}

#[test]
fn the_next_state_is_a_function_of_the_present_one_under_contact() {
    let system = pendulum();
    let (mut batch, torques) = spread(&system, "ground1", 8);
    let mut travelled = Rapier::new(RapierConfig::default());
    let mut touched = 0;
    for frame in 0..120 {
        let mut again = batch.clone();
        travelled.step(&mut batch, &torques).expect("finite");
        if frame % 10 == 0 {
            Rapier::new(RapierConfig::default()).step(&mut again, &torques).expect("finite");
            assert_eq!(bytes(&batch.states), bytes(&again.states), "frame {frame}: a fresh solver gives another next state");
        }
        let mut data = nerd_core::dynamics::Data::new(&system.robot);
        let mut events = Vec::new();
        for env in 0..batch.len() {
            nerd_sim::scene::contacts(&system.robot, &batch.scenes[env], batch.state(env), &mut data, &mut events);
            touched += events.iter().zip(&system.robot.contact_points).filter(|(e, p)| e.distance < p.radius + 1e-3).count();
        }
    }
    println!("{touched} contacts in 960 frames");
    assert!(touched > 100, "only {touched} contacts: the test shows nothing");
}

/// Deepest penetration (m) of any contact point over 300 frames from a fall, and at its end.
fn penetration(config: RapierConfig) -> (f64, f64) {
    let system = pendulum();
    let (mut batch, _) = spread(&system, "ground1", 8);
    let torques = vec![0.0; 16];
    let mut solver = Rapier::new(config);
    let mut data = nerd_core::dynamics::Data::new(&system.robot);
    let (mut events, mut worst, mut last) = (Vec::new(), 0.0_f64, 0.0_f64);
    for env in 0..batch.len() {
        // Level with the pivot, 2 m above the plane, at rest: nothing touches at the start.
        let lean = 0.05 * env as f64;
        batch.reset(env, &[lean, 0.3 - lean, 0.0, 0.0]);
    }
    for _ in 0..300 {
        solver.step(&mut batch, &torques).expect("finite");
        last = 0.0;
        for env in 0..batch.len() {
            nerd_sim::scene::contacts(&system.robot, &batch.scenes[env], batch.state(env), &mut data, &mut events);
            for (event, point) in events.iter().zip(&system.robot.contact_points) {
                last = last.max(point.radius - event.distance);
            }
        }
        worst = worst.max(last);
    }
    (worst, last)
}

/// The tip meets the ground at about 10 m/s, 40 mm per outer step of 1/240 s: contact is seen at most one such step late.
#[test]
fn the_pendulum_does_not_sink_into_the_ground() {
    let (worst, last) = penetration(RapierConfig::default());
    let (fine, _) = penetration(RapierConfig { steps: 16, ..Default::default() });
    println!("penetration: default {worst:.2e} m, after 5 s {last:.2e} m; 16 outer steps {fine:.2e} m");
    assert!(worst < 0.04, "{worst:.3e} m at impact, bound 0.04 m");
    assert!(last < 1e-3, "{last:.3e} m at rest, bound 1e-3 m");
    assert!(fine < 0.01, "{fine:.3e} m at 16 outer steps, bound 0.01 m");
}

/// Newton's first law. rapier, given the body's origin, moves the centre of mass by 0.2 m.
#[test]
fn the_centre_of_mass_of_a_spinning_floater_stays_where_it_is() {
    for jointed in [false, true] {
        let system = floating(jointed, 0.0);
        let mut batch = Batch::new(&system, &system.scene("free").expect("scene"), 1);
        let state = batch.state_mut(0);
        let spin = Vector3::new(0.0, 0.0, 3.0);
        // The origin starts at 0, so the twist's linear part is the origin's velocity, that of a rest of the whole's centre.
        let centre = if jointed { 0.2 } else { 0.1 };
        let speed = -spin.cross(&Vector3::new(centre, 0.0, 0.0));
        let nq = system.robot.nq();
        state[nq..nq + 3].copy_from_slice(spin.as_slice());
        state[nq + 3..nq + 6].copy_from_slice(speed.as_slice());
        let whole = |state: &[f64]| {
            if !jointed {
                return com(state);
            }
            let mut data = nerd_core::dynamics::Data::new(&system.robot);
            nerd_core::dynamics::kinematics(&system.robot, state, &mut data);
            let at = |link: usize| nerd_core::dynamics::point_position(&data, link, &Vector3::new(0.1, 0.0, 0.0));
            (at(0) + at(1)) * 0.5
        };
        let start = whole(batch.state(0));
        let mut solver = Rapier::new(RapierConfig::default());
        let torques = vec![0.0; system.robot.joint_count()];
        let mut moved = 0.0_f64;
        for _ in 0..60 {
            solver.step(&mut batch, &torques).expect("finite");
            moved = moved.max((whole(batch.state(0)) - start).norm());
        }
        let w = nerd_core::state::vector(&batch.state(0)[nq..]).norm();
        println!("jointed {jointed}: centre of mass moved {moved:.2e} m in 1 s, root spin {w:.6} rad/s");
        // A multibody keeps the momentum of the whole to first order in the substep, a free body to rounding.
        assert!(moved < 1e-3, "jointed {jointed}: {moved:.2e} m, bound 1e-3 m");
        if !jointed {
            assert!((w - 3.0).abs() < 1e-6, "spin {w} rad/s, 3 at the start about a principal axis: damping is left on");
        }
    }
}

/// Free flight of two bodies on a hinge under gravity and torque, against Runge-Kutta: the difference must halve with the
/// substep, or root coordinates, twists or torques are converted wrongly.
#[test]
fn a_floating_robot_converges_to_the_articulated_solution() {
    let system = floating(true, -9.81);
    let run = |mut solver: Box<dyn Solver>| {
        let mut batch = Batch::new(&system, &system.scene("free").expect("scene"), 1);
        let turn = UnitQuaternion::from_euler_angles(0.4, -0.3, 0.9);
        let mut state = vec![0.5, -0.2, 1.0];
        state.extend_from_slice(turn.coords.as_slice());
        state.extend([0.3, 1.0, -0.5, 0.8, 0.2, 0.4, 0.1, -1.0]);
        batch.reset(0, &state);
        (0..20).try_for_each(|_| solver.step(&mut batch, &[0.05])).expect("finite");
        batch.states
    };
    let reference = run(Box::new(articulated()));
    let error = |n: usize| {
        let found = run(Box::new(Rapier::new(RapierConfig { iterations: 1, steps: n, ..Default::default() })));
        found.iter().zip(&reference).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    };
    let (coarse, fine) = (error(32), error(64));
    println!("floating, hinged: {coarse:.2e} at 32 outer steps, {fine:.2e} at 64");
    assert!((1.6..2.5).contains(&(coarse / fine)), "{coarse:.2e} to {fine:.2e}: ratio {:.2}, first order is 2", coarse / fine);
    assert!(fine < 2e-2, "{fine:.2e} at 64 outer steps, bound 2e-2");
}

/// The cart runs past its end at 4 m/s into the model's spring (1e4 N/m, 10 N s/m), as in `articulated`.
#[test]
fn limits_are_the_springs_of_the_model() {
    let system = System::named("cartpole").expect("built in");
    let run = |mut solver: Box<dyn Solver>| {
        let mut batch = Batch::new(&system, &system.scene("free").expect("scene"), 1);
        batch.reset(0, &[3.9, 0.2, 4.0, 0.5]);
        let mut far = 0.0_f64;
        for _ in 0..40 {
            solver.step(&mut batch, &[0.0, 0.0]).expect("finite");
            far = far.max(batch.state(0)[0]);
        }
        (batch.state(0)[0], far)
    };
    let (x, far) = run(Box::new(articulated()));
    let rapier = |steps: usize| run(Box::new(Rapier::new(RapierConfig { iterations: 4, steps, ..Default::default() })));
    let (coarse, fine) = (rapier(4), rapier(64));
    println!(
        "cart after 40 frames {x:.4} m, farthest {far:.4} m; rapier 4x4 {:.4}, {:.4}, 4x64 {:.4}, {:.4}",
        coarse.0, coarse.1, fine.0, fine.1
    );
    assert!(far > 4.1, "the spring is not met: {far:.3} m");
    assert!((fine.0 - x).abs() < 1e-2, "{:.4} m against {x:.4} m, bound 1e-2 m", fine.0);
}

/// The reference's cube dropped flat from 0.2 m: it stays down at 0, at 0.5 it rebounds to a quarter of the height. rapier
/// makes the impact a few per cent too weak or too strong, as its step falls.
#[test]
fn contacts_bounce_as_far_as_they_are_told_to() {
    let system = System::named("cube").expect("built in");
    let rebound = |restitution: f64| {
        let mut batch = Batch::new(&system, &system.scene("ground").expect("scene"), 1);
        let mut state = system.default_state();
        state[2] = 0.0524 + 0.2;
        batch.reset(0, &state);
        let mut solver = Rapier::new(RapierConfig { restitution, ..Default::default() });
        let heights: Vec<f64> = (0..70)
            .map(|_| {
                solver.step(&mut batch, &[]).expect("a frame");
                batch.state(0)[2] - 0.0524
            })
            .collect();
        let landed = heights.windows(2).position(|w| w[1] > w[0] + 1e-4).unwrap_or(heights.len() - 1);
        heights[landed..].iter().fold(f64::MIN, |a, b| a.max(*b))
    };
    let (none, half) = (rebound(0.0), rebound(0.5));
    println!("rebound {none:.4} m at 0, {half:.4} m at 0.5");
    assert!(none < 1e-3 && (half / 0.05 - 1.0).abs() < 0.2, "{none} m, {half} m");
    let mut batch = Batch::new(&system, &system.scene("ground").expect("scene"), 1);
    let error = Rapier::new(RapierConfig { restitution: 1.5, ..Default::default() }).step(&mut batch, &[]).expect_err("too much");
    assert!(error.to_string().contains("restitution is 1.5"), "{error}");
}
