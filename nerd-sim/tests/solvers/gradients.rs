//! Gradients of a frame against central differences, on states visited under random torques.

use nerd_core::tangent::{difference, moved};
use nerd_sim::prelude::*;
use rand::RngExt;

use super::common::differences::*;
use super::common::*;

mod parameters;
mod rest;
mod spins;

/// Largest gradient error of a cable: its light links amplify rounding.
const LIGHT: f64 = 1e-5;
/// The same for torsional and rolling friction: their drag changes much within 1e-3 rad/s.
const HELD: f64 = 1e-5;

/// Settings with four implicit substeps.
fn four() -> ArticulatedConfig {
    ArticulatedConfig::implicit(4, Friction::Coulomb)
}

/// Random torques for every joint of `envs` environments.
fn pushed(system: &System, envs: usize, random: &mut impl RngExt) -> Vec<f64> {
    let amplitudes = system.torque_amplitudes();
    (0..envs).flat_map(|_| &amplitudes).map(|a| a * random.random_range(-1.0..=1.0)).collect()
}

/// A batch at its starts for evaluation.
fn begun(system: &Arc<System>, scene: &str, envs: usize) -> Batch {
    let mut batch = batch(system, scene, envs);
    (0..envs).for_each(|env| batch.reset(env, &start(system, Start::Reset, &mut stream(0, env as u64))));
    batch
}

/// ANYmal with its PD law inside the substeps; one joint has a velocity law, one none.
fn served() -> Arc<System> {
    altered("anymal", |system| {
        system.spec.control.as_mut().expect("a position law").servo = true;
        // Soft gains: under stiff ones the solves of more frames do not converge.
        system.spec.joints.iter_mut().for_each(|joint| (joint.kp, joint.kd) = (40.0, 4.0));
        (system.spec.joints[1].kp, system.spec.joints[2].kp, system.spec.joints[2].kd) = (0.0, 0.0, 0.0);
    })
}

/// The worst gradient error at a state. `None` where differences disagree among themselves, or the solves of a substep
/// do not converge.
fn error(config: ArticulatedConfig, batch: &Batch, state: &[f64], torques: &[f64], exact: f64) -> Option<f64> {
    let mut solver = settled(config);
    let next = stepped(&mut solver, batch, state, torques);
    let gone_back = solver.vjp(&only(batch, state), torques, 0, &[]).expect("a frame").next;
    assert_eq!(next, gone_back, "not the frame that a step makes");
    if endless(config, batch, state, torques, &next) {
        return None;
    }
    // Torques have smaller, linear effects, so their differences are larger.
    errors(&mut solver, batch, state, torques, [3e-5, 3e-2], (exact, true)).map(|errors| errors[0].max(errors[1]))
}

/// Checks gradients in every tenth of `frames` frames under random torques.
fn check(what: &str, mut batch: Batch, frames: usize, exact: f64) {
    let (system, mut solver, mut random) = (batch.system.clone(), settled(four()), stream(1, 0));
    let (mut errors, mut left_out, joints) = (Vec::new(), 0, system.robot.joint_count());
    for frame in 0..frames {
        let torques = pushed(&system, batch.len(), &mut random);
        for env in (0..batch.len()).filter(|_| frame % 10 == 0) {
            let torques = &torques[env * joints..(env + 1) * joints];
            match error(four(), &batch, batch.state(env), torques, exact) {
                Some(error) => errors.push(error),
                None => left_out += 1,
            }
        }
        solver.step(&mut batch, &torques).expect("steps");
    }
    assert!(told(what, errors, left_out, exact), "{what}");
}

#[test]
fn gradients_of_a_frame_are_those_of_central_differences() {
    let on_ground = [("cube", "ground"), ("ant", "ground"), ("anymal", "ground"), ("pendulum", "ground1")];
    for (name, scene) in
        on_ground.into_iter().chain(["pendulum", "cartpole", "franka", "ant"].map(|name| (name, "free")))
    {
        check(&format!("{name}, {scene}"), begun(&built_in(name), scene, 4), 100, EXACT);
    }
}

#[test]
fn gradients_know_joints_that_rub_spring_follow_and_are_driven() {
    let rubbing = altered("ant", |system| system.robot.joints_mut().for_each(|j| j.friction = 0.5));
    check("joints with dry friction", begun(&rubbing, "ground", 4), 60, EXACT);
    let sprung = altered("ant", |system| system.robot.joints_mut().for_each(|j| (j.stiffness, j.rest) = (30.0, 0.2)));
    check("joints with springs", begun(&sprung, "ground", 4), 60, EXACT);
    let damped =
        altered("ant", |system| system.robot.joints_mut().for_each(|j| (j.damping, j.stiffness) = (50.0, 1e4)));
    check("joints with stiff springs and dampers", begun(&damped, "ground", 4), 60, EXACT);
    let mut driven = begun(&built_in("ant"), "ground", 4);
    driven.drives =
        vec![Drive { kp: 50.0, kd: 3.0, target: 0.3, speed: 0.1, effort: 8.0 }; 4 * driven.system.robot.joint_count()];
    check("drives, some at their effort", driven, 60, EXACT);
    let mut served = begun(&served(), "ground", 4);
    served.servo = true;
    check("servos, of position laws and of one of velocity", served, 60, EXACT);
    let cable = "[cable]\nlength = 0.5\ndiameter = 0.008\nmass = 0.08\nbending = 1e-3\ndamping = 1e-5\nlinks = 6\nat = [0.0, 0.0, 0.3]\n";
    let cable = Arc::new(System::from_toml("cable", cable).expect("a cable"));
    check("a cable, solved along its tree", begun(&cable, "free", 4), 60, LIGHT);
    let grip = {
        let finger = |name: &str, y: f64| {
            link(name, 0.1, [0.0, y, 0.1], [1e-4; 3], &collision([0.0, y, 0.2], r#"<sphere radius="0.02"/>"#))
        };
        let slide = |name: &str, child: &str, more: &str| {
            let limit = r#"<limit lower="-0.05" upper="0.05" effort="10" velocity="10"/>"#;
            joint(name, "prismatic", ["palm", child], &format!(r#"<axis xyz="0 1 0"/>{limit}{more}"#))
        };
        let parts = [
            link("palm", 1.0, [0.0; 3], [1e-3; 3], &collision([0.0; 3], r#"<sphere radius="0.05"/>"#)),
            finger("left", 0.05),
            finger("right", -0.05),
            slide("a", "left", ""),
            slide("b", "right", r#"<mimic joint="a" multiplier="-1.5"/>"#),
        ];
        Arc::new(System::bare("grip", &urdf(&parts), true).expect("a gripper"))
    };
    let mut grips = begun(&grip, "plane", 8);
    // They land about the tenth frame. While one only rolls, dampers switch on and off all the time.
    grips
        .states
        .chunks_exact_mut(grip.robot.state_dim())
        .enumerate()
        .for_each(|(env, state)| state[2] += 0.17 + 0.004 * env as f64);
    check("a finger that follows another", grips, 20, EXACT);
}

#[test]
fn gradients_know_lifted_links_and_a_damped_root() {
    let lifted = Arc::new(System::from_text("lifted", LIFTED, Some("like = \"urdf\"")).expect("a robot"));
    for scene in ["ground", "free"] {
        check(&format!("weight taken off, in {scene}"), begun(&lifted, scene, 4), 60, EXACT);
    }
}

#[test]
fn gradients_know_torsional_and_rolling_friction_and_margins() {
    for (name, scene) in [("cube", "ground"), ("ant", "ground")] {
        let turning = altered(name, |s| {
            (s.spec.material.torsion, s.spec.material.rolling, s.spec.material.margin) = (0.02, 0.01, 0.005)
        });
        check(&format!("{name} with torsional and rolling friction"), begun(&turning, scene, 4), 100, HELD);
    }
    let crawler = crawler();
    assert!(crawler.surfaces.turns(), "no geom turns");
    let mut all = batch(&crawler, "plane", 4);
    drop_low(&mut all);
    check("geoms of a file", all, 100, HELD);
}

#[test]
fn gradients_of_what_repetition_leaves_are_near() {
    for name in ["ant", "anymal"] {
        let (system, mut random) = (built_in(name), stream(4, 0));
        let mut batch = begun(&system, "ground", 8);
        let rows = 2 * system.robot.nv();
        let identity = identity(rows).repeat(8);
        let mut errors = Vec::new();
        for _ in 0..50 {
            let torques = pushed(&system, 8, &mut random);
            let [own, exact] = [implicit(4), settled(four())]
                .map(|mut s| s.vjp(&batch, &torques, rows, &identity).expect("gradients").states);
            errors.extend(own.chunks(rows * rows).zip(exact.chunks(rows * rows)).map(|(a, b)| apart(a, b)));
            implicit(4).step(&mut batch, &torques).expect("steps");
        }
        errors.sort_by(f64::total_cmp);
        let (median, most) = (errors[errors.len() / 2], errors[errors.len() * 9 / 10]);
        println!(
            "{name}: gradients as it steps against those of settled drags {median:.1e} (median), {most:.1e} (nine of ten)"
        );
        assert!(median < 1e-3, "{name}");
    }
}

#[test]
fn what_has_no_slopes_is_refused_in_a_line() {
    let system = built_in("ant");
    let (batch, torques) = (begun(&system, "ground", 2), vec![0.0; 16]);
    let refused = |solver: &mut dyn Solver, batch: &Batch, gradients: usize| {
        line(solver.vjp(batch, &torques, 1, &vec![0.0; gradients]))
    };
    let mut euler = Articulated::new(ArticulatedConfig::paper(&system, Friction::Coulomb));
    assert!(refused(&mut euler, &batch, 56).contains("symplectic Euler"));
    assert!(refused(&mut settled(four()), &batch, 55).contains("55 gradients for 1 rows of 2 environments"));
    let mut lost = batch.clone();
    lost.states[0] = f64::NAN;
    assert!(refused(&mut settled(four()), &lost, 56).contains("environment 0"));
    let discs = altered("ant", |system| {
        let disc = ContactPoint::disc(0, Vector3::zeros(), Vector3::z_axis(), 0.1, 0.01);
        system.robot.contact_points.extend(disc);
    });
    assert!(refused(&mut settled(four()), &begun(&discs, "ground", 2), 56).contains("rim"));
}

/// A built-in robot with a change.
fn altered(name: &str, change: fn(&mut System)) -> Arc<System> {
    let mut system = (*built_in(name)).clone();
    change(&mut system);
    Arc::new(system)
}

/// Random numbers between -1 and 1.
fn direction(n: usize, random: &mut impl RngExt) -> Vec<f64> {
    (0..n).map(|_| random.random_range(-1.0..=1.0)).collect()
}

/// Jacobian-vector products along random directions: against central differences, and against the adjoint.
#[test]
fn a_linearised_frame_goes_along_any_direction() {
    for (name, scene) in [("cartpole", "free"), ("cube", "ground"), ("ant", "ground"), ("anymal", "ground")] {
        let (system, mut solver, mut random) = (built_in(name), settled(four()), stream(3, 0));
        let robot = &system.robot;
        let (size, joints, envs) = (2 * robot.nv(), robot.joint_count(), 20);
        let mut batch = begun(&system, scene, envs);
        for _ in 0..40 {
            solver.step(&mut batch, &pushed(&system, envs, &mut random)).expect("steps");
        }
        let torques = pushed(&system, envs, &mut random);
        let [along, row] = [(); 2].map(|()| direction(envs * size, &mut random));
        let pushes = direction(envs * joints, &mut random);
        let forward = solver.linearise(&batch, &torques).expect("a frame").forward(&along, &pushes);
        let back = solver.vjp(&batch, &torques, 1, &row).expect("gradients");
        let mut errors: Vec<f64> = (0..envs)
            .map(|e| {
                let (s, t) = (e * size..(e + 1) * size, e * joints..(e + 1) * joints);
                let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
                let there = dot(&forward[s.clone()], &row[s.clone()]);
                let again =
                    dot(&back.states[s.clone()], &along[s.clone()]) + dot(&back.torques[t.clone()], &pushes[t.clone()]);
                let most = norm(forward[s.clone()].iter().copied()) * norm(row[s.clone()].iter().copied());
                assert!((there - again).abs() < 1e-12 * most, "{name}: tangent {there}, adjoint {again}");
                let (expected, _) = central(3e-6, |by| {
                    let mut state = batch.state(e).to_vec();
                    let change: Vec<f64> = along[s.clone()].iter().map(|x| x * by).collect();
                    moved(robot, batch.state(e), &change, &mut state);
                    let torques: Vec<f64> =
                        torques[t.clone()].iter().zip(&pushes[t.clone()]).map(|(t, p)| t + p * by).collect();
                    difference(
                        robot,
                        &back.next[e * robot.state_dim()..][..robot.state_dim()],
                        &stepped(&mut solver, &batch, &state, &torques),
                    )
                });
                apart(&forward[s], &expected)
            })
            .collect();
        errors.sort_by(f64::total_cmp);
        let most = errors[envs * 9 / 10 - 1];
        assert!(most < EXACT, "{name}, {scene}: error along a direction {most:.1e} in nine of ten states");
    }
}
