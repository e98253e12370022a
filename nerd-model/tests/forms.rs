//! Forms of tokens and targets: what is predicted leads to the next state in every form, and a view sees what it should.

use std::sync::Arc;

use nalgebra::Vector3;
use nerd_core::contact::ContactEvent;
use nerd_core::state::wrap;
use nerd_model::base::Base;
use nerd_model::features::Features;
use nerd_model::form::{Form, View};
use nerd_model::normalizer::Moments;
use nerd_model::turns::Turns;
use nerd_sim::prelude::*;
use nerd_sim::sampling::{Start, start, stream};

const FORMS: [Form; 6] = [
    Form { base: Base::State, view: View::Own, turns: Turns::Parent },
    Form { base: Base::State, view: View::World, turns: Turns::Parent },
    Form { base: Base::State, view: View::Blind, turns: Turns::Parent },
    Form { base: Base::Nothing, view: View::Own, turns: Turns::Parent },
    Form { base: Base::Nothing, view: View::World, turns: Turns::Parent },
    Form { base: Base::Nothing, view: View::Blind, turns: Turns::Parent },
];

fn system(robot: &str) -> Arc<System> {
    System::named(robot).expect("built in")
}

/// Pairs of states a frame apart, from the box of the training data, with random torques.
fn frames(system: &Arc<System>) -> Vec<(Vec<f64>, Vec<f64>)> {
    let n = 64;
    let mut batch = Batch::new(system, &system.scene(system.usual_scenes().last().expect("a scene")).expect("scene"), n);
    (0..n).for_each(|env| batch.reset(env, &start(system, Start::Sample, &mut stream(3, env as u64))));
    let before = batch.clone();
    let torques: Vec<f64> = (0..n * system.robot.joint_count()).map(|i| 20.0 * (i as f64).sin()).collect();
    Articulated::new(ArticulatedConfig::paper(system, Friction::Coulomb)).step(&mut batch, &torques).expect("finite");
    (0..n).map(|env| (before.state(env).to_vec(), batch.state(env).to_vec())).collect()
}

#[test]
fn what_is_predicted_leads_to_the_next_state_in_every_form() {
    for robot in ["pendulum", "ant"] {
        let system = system(robot);
        let d = system.robot.state_dim();
        let (coords, pairs) = (system.robot.root_coords(), frames(&system));
        for form in FORMS {
            let mut features = Features::new(&system, form);
            let (mut target, mut made, mut worst) = (vec![0.0f32; d], vec![0.0; d], 0.0f64);
            for (state, next) in &pairs {
                features.target(state, state, next, &mut target);
                let change: Vec<f64> = target.iter().map(|x| f64::from(*x)).collect();
                features.apply(state, state, &change, &mut made);
                for (k, (a, b)) in made.iter().zip(next).enumerate() {
                    let turns = k >= coords && system.robot.joints().nth(k - coords).is_some_and(|j| j.wraps());
                    worst = worst.max(if turns { wrap(a - b) } else { a - b }.abs());
                }
            }
            // Targets are f32; the Ant's twist about the world's origin is tens of m/s.
            assert!(worst < 1e-5, "{robot}, {form:?}: {worst:.1e} from the next state");
        }
    }
}

/// A frame turns a link by well under a radian, so what a network is asked for may not jump where an angle wraps.
#[test]
fn an_absolute_angle_has_no_seam() {
    let system = system("pendulum");
    let mut features = Features::new(&system, Base::Nothing);
    let mut target = vec![0.0f32; 4];
    let (state, next) = ([3.1, 0.0, 5.0, 0.0], [wrap(3.1 + 0.08), 0.0, 5.0, 0.0]);
    features.target(&state, &state, &next, &mut target);
    assert!((f64::from(target[0]) - 3.18).abs() < 1e-6, "from 3.1 to 3.18 rad is said as {}", target[0]);
}

fn token(system: &Arc<System>, form: Form, state: &[f64], depth: f64) -> Vec<f32> {
    let event =
        |_| ContactEvent { p0: Vector3::zeros(), p1: Vector3::new(0.1, 0.0, 0.2), normal: Vector3::y(), distance: depth, collider: 0 };
    let events: Vec<_> = (0..system.robot.contact_points.len()).map(event).collect();
    let mut out = vec![0.0; Features::inputs(system, form)];
    let torques = vec![0.5; system.robot.joint_count()];
    Features::new(system, form).token(state, state, &events, &torques, &Vector3::new(0.0, -9.81, 0.0), &mut out);
    out
}

#[test]
fn the_end_to_end_form_sees_state_and_torques_alone() {
    for robot in ["pendulum", "ant"] {
        let system = system(robot);
        let state = start(&system, Start::Sample, &mut stream(4, 0));
        let width = system.robot.state_dim() + system.robot.joint_count();
        for form in FORMS {
            let (near, far) = (token(&system, form, &state, 0.01), token(&system, form, &state, 0.02));
            let blind = form.view == View::Blind;
            assert_eq!(near.len() == width, blind, "{robot}, {form:?}: {} numbers", near.len());
            assert_eq!(near == far, blind, "{robot}, {form:?}: a contact's depth is {}seen", if near == far { "not " } else { "" });
        }
        let blind = token(&system, FORMS[2], &state, 0.01);
        assert!(blind.iter().zip(&state).all(|(t, s)| f64::from(*t) == f64::from(*s as f32)), "the state is not seen as it is");
    }
}

#[test]
fn world_views_see_where_the_robot_stands_and_its_own_does_not() {
    let system = system("ant");
    let state = start(&system, Start::Reset, &mut stream(5, 0));
    let nq = system.robot.nq();
    let mut there = state.clone();
    // 20 m along x; the twist about the world's origin changes with it, v += by x w.
    there[0] += 20.0;
    there[nq + 4] -= 20.0 * state[nq + 2];
    there[nq + 5] += 20.0 * state[nq + 1];
    for form in FORMS {
        // Far from any contact, so that the event's place in the world plays no part.
        let (a, b) = (token(&system, form, &state, 10.0), token(&system, form, &there, 10.0));
        let gap = a.iter().zip(&b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        if form.view == View::Own {
            assert!(gap < 1e-5, "{form:?} sees a move of 20 m as {gap:.1e}");
        } else {
            assert!(gap > 19.0, "{form:?} sees a move of 20 m as {gap:.1e}");
        }
    }
}

#[test]
fn identity_moments_leave_rows_as_they_are() {
    let rows: Vec<f32> = (0..300).map(|i| (i as f32 * 0.37).sin() * 10f32.powi(i % 9 - 4)).collect();
    let mut normal = rows.clone();
    Moments::identity(3).normalize(&mut normal);
    assert_eq!(rows, normal);
}
