//! Tokens and targets: every form's target leads to the next state; tokens are independent of position and heading.

use nerd_model::form::{Form, View};
use nerd_model::{base::Base, features::Features};
use nerd_sim::prelude::*;

fn forms() -> impl Iterator<Item = Form> {
    [Base::State, Base::Trapezoid]
        .into_iter()
        .flat_map(|base| [View::Own, View::Moving].map(|view| Form { base, view, told: false }))
}

fn system(robot: &str) -> Arc<System> {
    System::named(robot).expect("built in")
}

/// Tolerance: f32 rounding of a change of a few units.
#[test]
fn what_is_predicted_leads_to_the_next_state_in_every_form() {
    for robot in ["pendulum", "cartpole", "cube", "ant"] {
        let system = system(robot);
        let (d, root) = (system.robot.state_dim(), system.robot.root_coords());
        for form in forms() {
            let mut features = Features::new(&system, form);
            let (mut target, mut made, mut worst) = (vec![0.0f32; d], vec![0.0; d], 0.0f64);
            for k in 0..50 {
                let [state, next] = [0, 1].map(|i| start(&system, Start::Sample, &mut stream(42, 2 * k + i)));
                features.target(&state, &next, &mut target);
                let change: Vec<f64> = target.iter().map(|x| f64::from(*x)).collect();
                features.apply(&state, &change, &mut made);
                for (i, (a, b)) in made.iter().zip(&next).enumerate() {
                    let wraps = (root..system.robot.nq()).contains(&i)
                        && system.robot.joints().nth(i - root).is_some_and(|j| j.wraps());
                    worst = worst.max(if wraps { wrap(a - b).abs() } else { (a - b).abs() / b.abs().max(1.0) });
                }
            }
            assert!(worst < 1e-5, "{robot}, {form:?}: {worst:.1e} from the next state");
        }
    }
}

/// The token of a state in a scene with one tilted plane, after the whole world is moved by `motion`.
fn told(robot: &str, view: View, motion: &Isometry3<f64>, k: u64) -> Vec<f32> {
    let mut system = (*system(robot)).clone();
    if let nerd_core::robot::Base::Fixed(pose) = &mut system.robot.base {
        *pose = motion * *pose;
    }
    let system = Arc::new(system);
    let (by, turn, nq) = (motion.translation.vector, motion.rotation, system.robot.nq());
    let mut state = start(&system, Start::Sample, &mut stream(43, k));
    if system.robot.floating() {
        let (p, r) = (vector(&state[..3]), quaternion(&state[3..7]));
        let (w, v) = (turn * vector(&state[nq..]), turn * vector(&state[nq + 3..]));
        state[..3].copy_from_slice((turn * p + by).as_slice());
        write_quaternion(&mut state[3..7], &(turn * r));
        state[nq..nq + 3].copy_from_slice(w.as_slice());
        // The twist is about the world's origin.
        state[nq + 3..nq + 6].copy_from_slice((v + by.cross(&w)).as_slice());
    }
    let (normal, offset) = (Vector3::new(0.1, 0.99, -0.1).normalize(), 0.6);
    let plane = Plane { normal: turn * normal, offset: offset + (turn * normal).dot(&by) };
    let mut scene = Scene::free(turn * system.gravity());
    scene.colliders.push(Collider::plane(plane, system.spec.material));
    let torques: Vec<f64> = (0..system.robot.joint_count()).map(|i| 10.0 * (i as f64).sin()).collect();
    let mut events = Vec::new();
    contacts(&system, &scene, &state, &mut Data::new(&system.robot), &mut events);
    let form = Form { view, ..Base::State.into() };
    let mut out = vec![0.0; Features::inputs(&system, form)];
    Features::new(&system, form).token(&state, &events, &torques, &scene.gravity, &mut out);
    out
}

#[test]
fn a_token_sees_neither_place_nor_heading() {
    let up = Vector3::y_axis();
    for (robot, view) in
        ["pendulum", "ant"].into_iter().flat_map(|robot| [View::Own, View::Moving].map(|view| (robot, view)))
    {
        let mut seen = 0;
        for k in 0..20 {
            let here = told(robot, view, &Isometry3::identity(), k);
            let (points, d) = (system(robot).robot.contact_points.len(), system(robot).robot.state_dim());
            // Normals, or velocities of contact points.
            let first = if view == View::Own { d } else { d + 7 * points };
            seen += here[first..first + 3 * points].iter().filter(|x| **x != 0.0).count();
            for (by, heading) in [
                (Vector3::new(3.0, -1.0, 2.0), 0.0),
                (Vector3::zeros(), 2.0),
                (Vector3::new(300.0, 20.0, -500.0), -1.3),
            ] {
                let there = told(
                    robot,
                    view,
                    &Isometry3::from_parts(by.into(), UnitQuaternion::from_axis_angle(&up, heading)),
                    k,
                );
                let worst = here.iter().zip(&there).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
                assert!(worst < 1e-5, "{robot}, {view:?}, start {k}, moved {by:?} and turned {heading}: {worst:.1e}");
            }
        }
        assert!(seen > 0, "{robot}, {view:?}: no point was near enough to be seen; the test shows nothing");
    }
}

/// A network that replaces dynamics may see the robot's position and velocity, the geometry of contacts, torques and
/// gravity's direction. These, and the state after a prediction, are bit-identical for a robot with other masses,
/// inertias, springs, damping and materials.
#[test]
fn a_pure_model_sees_no_dynamics() {
    for robot in ["cartpole", "pendulum", "cube", "franka", "ant", "anymal"] {
        let own = system(robot);
        let mut other = System::clone(&own);
        for link in &mut other.robot.links {
            link.inertia.mass *= 7.0;
            link.inertia.com += Vector3::new(0.1, -0.2, 0.3);
            link.inertia.inertia *= 3.0;
            if let Some(joint) = &mut link.joint {
                // With a spring an angle counts full turns, so its coordinate would change.
                if !joint.wraps() {
                    (joint.stiffness, joint.rest) = (joint.stiffness + 1.0, joint.rest + 0.1);
                }
                (joint.damping, joint.friction, joint.armature) =
                    (joint.damping + 1.0, joint.friction + 1.0, joint.armature + 1.0);
            }
        }
        other.spec.material.friction += 0.5;
        other.spec.material.stiffness *= 2.0;
        let (other, scene, mut data) = (Arc::new(other), own.usual_scenes()[0], Data::new(&own.robot));
        let scene = own.scene(scene).expect("its own");
        let mut weaker = Scene::clone(&scene);
        weaker.gravity *= 0.5;
        for form in forms() {
            let (mut features, mut others) = (Features::new(&own, form), Features::new(&other, form));
            let torques: Vec<f64> = (0..own.robot.joint_count()).map(|k| k as f64).collect();
            let change: Vec<f64> = (0..own.robot.state_dim()).map(|k| 0.1 + 0.01 * k as f64).collect();
            let [mut token, mut same] = [0, 1].map(|_| vec![0.0f32; Features::inputs(&own, form)]);
            let [mut next, mut then] = [0, 1].map(|_| vec![0.0; own.robot.state_dim()]);
            for k in 0..20 {
                let (state, mut events) = (start(&own, Start::Reset, &mut stream(11, k)), Vec::new());
                contacts(&own, &scene, &state, &mut data, &mut events);
                features.token(&state, &events, &torques, &scene.gravity, &mut token);
                others.token(&state, &events, &torques, &weaker.gravity, &mut same);
                features.apply(&state, &change, &mut next);
                others.apply(&state, &change, &mut then);
                assert!(token == same && next == then, "{robot}, {form:?}: start {k} shows what it is made of");
            }
        }
    }
}
