//! Vector-Jacobian products of tokens, of predictions and of a whole frame, against central differences.

mod common;

use common::{fallen, model, pure, some, worse, worst};
use nerd_core::tangent::{self, difference};
use nerd_model::form::{Form, View};
use nerd_model::gradients::{Seen, apply_back, token_back};
use nerd_model::prelude::*;
use nerd_model::{base::Base, features::Features, trapezoid};

/// A state moved by `by` along tangent direction k.
fn moved(system: &System, state: &[f64], k: usize, by: f64) -> Vec<f64> {
    let (mut to, mut change) = (state.to_vec(), vec![0.0; 2 * system.robot.nv()]);
    change[k] = by;
    tangent::moved(&system.robot, state, &change, &mut to);
    to
}

const ROBOTS: [(&str, &str); 6] = [
    ("cartpole", "free"),
    ("pendulum", "ground1"),
    ("cube", "ground"),
    ("franka", "free"),
    ("ant", "ground"),
    ("anymal", "ground"),
];

#[test]
fn a_gradient_by_a_token_comes_to_the_state_as_differences_say() {
    let views = [View::Own, View::Moving];
    for ((robot, scene), view) in ROBOTS.into_iter().flat_map(|robot| views.map(|view| (robot, view))) {
        let form = Form { view, ..Base::State.into() };
        let system = System::named(robot).expect("built in");
        let scene = system.scene(scene).expect("built in");
        let (mut features, mut data) = (Features::new(&system, form), Data::new(&system.robot));
        let inputs = Features::inputs(&system, form);
        let (by_token, torques) = (some(inputs, 1.0), some(system.robot.joint_count(), 1.0));
        let (mut off, mut near) = (0.0f64, 0);
        for seed in 0..40 {
            let first = start(&system, if seed % 2 == 0 { Start::Reset } else { Start::Sample }, &mut stream(7, seed));
            let mut simulation =
                Simulation::new(Batch::new(&system, &scene, 1), Articulated::new(ArticulatedConfig::accurate(&system)));
            simulation.reset(0, &first);
            (0..seed).for_each(|_| simulation.step(&vec![0.0; system.robot.joint_count()]).expect("a frame"));
            let state = simulation.batch.state(0).to_vec();
            let mut events = Vec::new();
            let mut token = |state: &[f64]| {
                let mut token = vec![0.0f32; inputs];
                contacts(&system, &scene, state, &mut data, &mut events);
                features.token(state, &events, &torques, &scene.gravity, &mut token);
                token.iter().zip(&by_token).map(|(x, g)| f64::from(*x) * g).sum::<f64>()
            };
            // Fourth order: nearness curves within millimetres, and tokens are f32.
            let h = 4e-4;
            let mut change =
                |k: usize, by: f64| token(&moved(&system, &state, k, by)) - token(&moved(&system, &state, k, -by));
            let expected = (0..2 * system.robot.nv()).map(|k| (8.0 * change(k, h) - change(k, 2.0 * h)) / (12.0 * h));
            let expected: Vec<f64> = expected.collect();
            let mut gradient = vec![0.0; 2 * system.robot.nv()];
            contacts(&system, &scene, &state, &mut data, &mut events);
            // A token is discontinuous where a contact crosses its threshold.
            if events.iter().zip(&system.robot.contact_points).any(|(e, p)| (e.distance - p.threshold()).abs() < 0.01) {
                continue;
            }
            near += events.iter().zip(&system.robot.contact_points).filter(|(e, p)| e.distance < p.threshold()).count();
            token_back(
                &system.robot,
                &Seen { state: &state, contacts: &events, gravity: scene.gravity, view, frame_time: system.frame_time },
                &by_token,
                &mut data,
                &mut gradient,
            );
            off = worse(off, worst(&gradient, &expected));
        }
        assert!(off < 2e-3, "{robot}, {view:?}: {off:.1e} of the largest gradient off");
        assert!(near > 0 || scene.colliders.is_empty(), "{robot} touches nothing");
    }
}

/// The deepest point of a disc or a hull moves over its link. Its depth changes as if the point were fixed on the link,
/// and not by rotation about the disc's axis.
#[test]
fn depths_of_discs_and_hulls_change_as_differences_say() {
    let cube = System::named("cube").expect("built in");
    let (mut wheel, scene) = (System::clone(&cube), cube.scene("ground").expect("built in"));
    let corners = [[0.05, 0.04, 0.03], [-0.05, 0.02, 0.01], [0.0, -0.06, 0.02], [0.01, 0.0, -0.05]].map(Vector3::from);
    wheel.robot.contact_points =
        ContactPoint::disc(0, Vector3::new(0.01, 0.02, 0.0), Vector3::y_axis(), 0.05, 0.005).to_vec();
    wheel.robot.contact_points.push(ContactPoint::hull(0, corners.to_vec(), 0.002));
    let (wheel, mut data, mut events) = (Arc::new(wheel), Data::new(&cube.robot), Vec::new());
    let (points, d) = (wheel.robot.contact_points.len(), wheel.robot.state_dim());
    let mut by = vec![0.0; Features::inputs(&wheel, Base::State)];
    // Gradient with respect to the depth of the disc's deepest point, and of the hull.
    (by[d + 6 * points], by[d + 6 * points + 3]) = (1.0, 2.0);
    let (mut off, mut near, h) = (0.0f64, 0, 1e-6);
    for seed in 0..40 {
        let mut state = start(&wheel, Start::Sample, &mut stream(13, seed));
        state[2] = 0.05;
        let mut depths = |state: &[f64]| {
            contacts(&wheel, &scene, state, &mut data, &mut events);
            (events[0].distance + 2.0 * events[3].distance, events.clone())
        };
        let expected: Vec<f64> = (0..6)
            .map(|k| (depths(&moved(&wheel, &state, k, h)).0 - depths(&moved(&wheel, &state, k, -h)).0) / (2.0 * h))
            .collect();
        let events = depths(&state).1;
        if [0, 3].iter().any(|k| events[*k].distance > 0.09) {
            continue;
        }
        near += 1;
        let mut gradient = vec![0.0; 12];
        token_back(
            &wheel.robot,
            &Seen { state: &state, contacts: &events, gravity: scene.gravity, view: View::Own, frame_time: 0.01 },
            &by,
            &mut data,
            &mut gradient,
        );
        off = worse(off, worst(&gradient[..6], &expected));
    }
    assert!(near > 10 && off < 1e-5, "{near} starts near the ground: {off:.1e} of the largest gradient off");
}

#[test]
fn a_gradient_by_the_next_state_comes_to_prediction_and_state_as_differences_say() {
    for ((robot, _), base) in
        ROBOTS.into_iter().flat_map(|robot| [Base::State, Base::Trapezoid].map(|base| (robot, base)))
    {
        let system: Arc<System> = System::named(robot).expect("built in");
        let (mut features, d, n) = (Features::new(&system, base), system.robot.state_dim(), 2 * system.robot.nv());
        let state = start(&system, Start::Sample, &mut stream(9, 1));
        let mut change = some(d, 0.1);
        if system.robot.floating() {
            change[6] = 1.1;
        }
        let upstream = some(n, 1.0);
        let mut apply = |state: &[f64], change: &[f64]| {
            let mut next = vec![0.0; d];
            features.apply(state, change, &mut next);
            next
        };
        let next = apply(&state, &change);
        let value =
            |to: &[f64]| difference(&system.robot, &next, to).iter().zip(&upstream).map(|(x, g)| x * g).sum::<f64>();
        let h = 1e-5;
        let by_state: Vec<f64> = (0..n)
            .map(|k| {
                let [ahead, behind] = [h, -h].map(|h| value(&apply(&moved(&system, &state, k, h), &change)));
                (ahead - behind) / (2.0 * h)
            })
            .collect();
        let by_prediction: Vec<f64> = (0..d)
            .map(|k| {
                let [ahead, behind] = [h, -h].map(|h| {
                    let mut change = change.clone();
                    change[k] += h;
                    value(&apply(&state, &change))
                });
                (ahead - behind) / (2.0 * h)
            })
            .collect();
        let (mut gradient, mut by_change) = (vec![0.0; n], vec![0.0; d]);
        let (time, prediction) = (system.frame_time, change.clone());
        if base == Base::Trapezoid {
            trapezoid::carry(&system.robot, time, &state, &mut change, 1.0);
        }
        apply_back(&system.robot, &state, &change, &upstream, &mut gradient, &mut by_change);
        if base == Base::Trapezoid {
            trapezoid::back(&system.robot, time, &state, &prediction, &mut by_change, &mut gradient);
        }
        let off = [worst(&gradient, &by_state), worst(&by_change, &by_prediction)];
        assert!(
            worse(off[0], off[1]) < 1e-6,
            "{robot}, {base:?}: by the state {:.1e}, by the prediction {:.1e} off",
            off[0],
            off[1]
        );
    }
}

#[test]
#[allow(clippy::type_complexity)]
fn a_learned_frame_goes_back_to_state_and_torques_as_differences_say() {
    for (robot, scene) in ROBOTS {
        let system = System::named(robot).expect("built in");
        // Large outputs: a prediction is as large as the state it is added to.
        let mut solver = Neural::on_cpu(pure(&system, 0.0, 4.0));
        let (d, nv, joints, n, rows) = (system.robot.state_dim(), system.robot.nv(), system.robot.joint_count(), 20, 2);
        let batch = fallen(&system, scene, n, (Start::Reset, 7), 20);
        let (torques, grad_next) = (some(n * joints, 1.0), some(n * rows * 2 * nv, 1.0));
        let found = solver.vjp(&batch, &torques, rows, &grad_next).expect("gradients");
        let mut stepped = batch.clone();
        solver.step(&mut stepped, &torques).expect("a frame");
        let apart = found.next.iter().zip(&stepped.states).map(|(a, b)| (a - b).abs()).fold(0.0, worse);
        assert!(apart < 1e-5, "{robot}: the frame of the way back is {apart:.1e} from the step");

        // For every environment and gradient row, the product of the row with the state after the frame. All
        // environments move along one direction at once.
        let mut values = |change: &dyn Fn(&mut [f64], &mut [f64])| -> Vec<f64> {
            let (mut moved, mut torques) = (batch.clone(), torques.clone());
            (0..n).for_each(|env| change(moved.state_mut(env), &mut torques[env * joints..][..joints]));
            solver.step(&mut moved, &torques).expect("a frame");
            let one = |i: usize| {
                let lies = difference(&system.robot, &found.next[i / rows * d..][..d], moved.state(i / rows));
                lies.iter().zip(&grad_next[i * 2 * nv..]).map(|(x, g)| x * g).sum::<f64>()
            };
            (0..n * rows).map(one).collect()
        };
        let mut gradient = |h: f64, change: &dyn Fn(f64, &mut [f64], &mut [f64])| -> Vec<f64> {
            let mut apart = |h: f64| -> Vec<f64> {
                let [ahead, behind] = [h, -h].map(|h| values(&|state, torques| change(h, state, torques)));
                ahead.iter().zip(&behind).map(|(a, b)| a - b).collect()
            };
            apart(h).iter().zip(apart(2.0 * h)).map(|(one, two)| (8.0 * one - two) / (12.0 * h)).collect()
        };
        let by_state: Vec<Vec<f64>> = (0..2 * nv)
            .map(|k| gradient(1e-3, &|by, state, _| state.copy_from_slice(&moved(&system, state, k, by))))
            .collect();
        let by_torque: Vec<Vec<f64>> =
            (0..joints).map(|k| gradient(3e-2, &|by, _, torques| torques[k] += by)).collect();
        let near = |env: usize| {
            let (mut data, mut events) = (Data::new(&system.robot), Vec::new());
            contacts(&system, &batch.scenes[env], batch.state(env), &mut data, &mut events);
            // A token is discontinuous where a contact crosses its threshold.
            events.iter().zip(&system.robot.contact_points).any(|(e, p)| (e.distance - p.threshold()).abs() < 0.005)
        };
        let (mut off, mut count) = ([0.0f64; 2], 0);
        for i in (0..n * rows).filter(|i| !near(i / rows)) {
            let expected = |of: &[Vec<f64>]| of.iter().map(|all| all[i]).collect::<Vec<f64>>();
            off[0] = worse(off[0], worst(&found.states[i * 2 * nv..][..2 * nv], &expected(&by_state)));
            off[1] = worse(off[1], worst(&found.torques[i * joints..][..joints], &expected(&by_torque)));
            count += 1;
        }
        assert!(count >= 8, "{robot}: {count} gradients");
        assert!(off.iter().all(|off| *off < 1.5e-2), "{robot}: by the state and by torques {off:?} of the largest off");
    }
}

#[test]
fn a_network_that_remembers_has_no_gradients() {
    let system = System::named("pendulum").expect("built in");
    let batch = Batch::new(&system, &system.scene("free").expect("built in"), 1);
    let said = Neural::on_cpu(model(&system, Base::State))
        .vjp(&batch, &[0.0; 2], 1, &[0.0; 4])
        .expect_err("refused")
        .to_string();
    assert!(said.contains("sees more than one frame") && !said.contains('\n'), "{said}");
}
