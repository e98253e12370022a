//! Actuator and sensor model of individual robots: effects follow textbook laws, and drawn values act like a file's.

use nerd_sim::rig::{Motors, Rig};
use nerd_sim::vary::{Told, VarySpec, columns, draw};

use super::common::*;

const FRAMES: usize = 12;

fn just(x: f64) -> Option<Range> {
    Some(Range { low: x, high: x })
}

/// The pendulum with these numbers, each drawn from a range of zero width.
fn pendulum(vary: VarySpec) -> Arc<System> {
    let mut system = (*built_in("pendulum")).clone();
    system.spec.vary = Some(vary);
    draw(&Arc::new(system), &mut stream(0, 0)).0
}

fn solver() -> Articulated {
    Articulated::new(ArticulatedConfig::accurate(&built_in("pendulum")))
}

fn asked(frame: usize) -> Vec<f64> {
    vec![400.0 * (1.3 * frame as f64 + 0.4).sin(), 300.0 * (0.7 * frame as f64).cos()]
}

const START: [f64; 4] = [0.3, -1.2, 2.0, -3.0];

/// States `[frame]` of an individual robot with its actuators and sensors.
fn behind(own: &Arc<System>, frames: usize) -> Vec<Vec<f64>> {
    let mut batch = at(&built_in("pendulum"), "free", &START);
    batch.systems = vec![own.clone()];
    let mut rig = Rig::new(solver());
    let step = |frame| {
        rig.step(&mut batch, &asked(frame)).expect("it can be stepped");
        batch.states.clone()
    };
    (0..frames).map(step).collect()
}

/// States of the plain robot from `start`, under torques that `act` computes from a frame and the state before it.
fn plain(start: &[f64], act: impl Fn(usize, &[f64]) -> Vec<f64>) -> Vec<Vec<f64>> {
    let (mut solver, mut batch) = (solver(), at(&built_in("pendulum"), "free", start));
    let step = |frame| {
        let torques = act(frame, batch.state(0));
        solver.step(&mut batch, &torques).expect("it can be stepped");
        batch.states.clone()
    };
    (0..FRAMES).map(step).collect()
}

#[test]
fn torques_come_late_and_weak() {
    let before = |frame: usize, k: usize| if frame < k { vec![0.0; 2] } else { asked(frame - k) };
    for (delay, [now, one, two]) in
        [(0.25, [0.75, 0.25, 0.0]), (1.0, [0.0, 1.0, 0.0]), (1.5, [0.0, 0.5, 0.5]), (2.0, [0.0, 0.0, 1.0])]
    {
        let own = pendulum(VarySpec { delay: just(delay), strength: just(0.85), ..Default::default() });
        let late = |frame: usize, _: &[f64]| -> Vec<f64> {
            let rows = [before(frame, 0), before(frame, 1), before(frame, 2)];
            (0..2).map(|j| 0.85 * (now * rows[0][j] + one * rows[1][j] + two * rows[2][j])).collect()
        };
        let (found, expected) = (behind(&own, FRAMES), plain(&START, late));
        let apart = found.concat().iter().zip(&expected.concat()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(apart < 1e-9, "delay {delay}: {apart} apart");
        assert!(found != plain(&START, |frame, _| asked(frame)), "delay {delay} does nothing");
    }
}

#[test]
fn sensors_show_what_is_moved_and_torques_ripple_with_the_place() {
    let own = pendulum(VarySpec { zero: just(0.07), ..Default::default() });
    let start: Vec<f64> = START.iter().enumerate().map(|(k, x)| if k < 2 { x + 0.07 } else { *x }).collect();
    let moved = plain(&start, |frame, _| asked(frame));
    for (frame, (shown, real)) in behind(&own, FRAMES).iter().zip(&moved).enumerate() {
        for k in 0..4 {
            let apart = shown[k] + if k < 2 { 0.07 } else { 0.0 } - real[k];
            let apart = if k < 2 { nerd_core::state::wrap(apart) } else { apart };
            assert!(apart.abs() < 1e-9, "frame {frame}, number {k}: {apart}");
        }
    }
    let own = pendulum(VarySpec { ripple: just(40.0), ..Default::default() });
    let ripple =
        |frame: usize, state: &[f64]| (0..2).map(|j| asked(frame)[j] + 40.0 * (6.0 * state[j]).sin()).collect();
    let (found, expected) = (behind(&own, FRAMES), plain(&START, ripple));
    assert_eq!(found, expected, "a ripple is the sine of six turns");
}

/// A direct-current motor: full torque at rest, half at half its top speed, zero at top speed, and full braking torque.
#[test]
fn torque_falls_with_speed_along_a_line() {
    let own = pendulum(VarySpec { top_speed: just(8.0), ..Default::default() });
    let most: Vec<f64> =
        own.robot.joints().zip(own.joint_specs()).map(|(joint, spec)| spec.torque_limit(joint)).collect();
    let mut broken = at(&built_in("pendulum"), "free", &[0.3, -1.2, f64::NAN, 1.0]);
    broken.systems = vec![own.clone()];
    let said = Rig::new(solver()).step(&mut broken, &[1.0, 1.0]).expect_err("a speed is NaN").to_string();
    assert!(said.contains("NaN"), "{said}");
    for (speed, side, share) in [
        (0.0, 1.0, 1.0),
        (4.0, 1.0, 0.5),
        (8.0, 1.0, 0.0),
        (20.0, 1.0, 0.0),
        (4.0, -1.0, 1.0),
        (-2.0, 1.0, 1.0),
        (-2.0, -1.0, 0.75),
    ] {
        let start = [0.3, -1.2, speed, speed];
        let (mut solver, mut bare) = (Rig::new(solver()), solver());
        let [mut found, mut expected] =
            [at(&built_in("pendulum"), "free", &start), at(&built_in("pendulum"), "free", &start)];
        found.systems = vec![own.clone()];
        let torques = |share: f64| most.iter().map(|most| side * share * most).collect::<Vec<_>>();
        solver.step(&mut found, &torques(3.0)).expect("it can be stepped");
        bare.step(&mut expected, &torques(share)).expect("it can be stepped");
        let apart = found.states.iter().zip(&expected.states).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(apart < 1e-12, "at {speed} rad/s, side {side}: {apart} from {share} of {most:?} N m");
    }
}

/// Drawn damping, dry friction and armature act like a file's.
#[test]
fn what_brakes_joints_is_as_in_a_file() {
    let (toml, urdf) = System::texts("pendulum").expect("built in");
    let urdf = urdf.replace("<axis xyz=\"0 0 1\"/>", "<axis xyz=\"0 0 1\"/><dynamics damping=\"7\" friction=\"11\"/>");
    let written = Arc::new(
        System::from_text("pendulum", &urdf, Some(&toml.replace("armature = 0.01", "armature = 0.51"))).expect("right"),
    );
    let own =
        pendulum(VarySpec { damping: just(7.0), dry_friction: just(11.0), armature: just(0.5), ..Default::default() });
    let mut batch = at(&written, "free", &START);
    let mut solver = solver();
    let step = |frame| {
        solver.step(&mut batch, &asked(frame)).expect("it can be stepped");
        batch.states.clone()
    };
    let expected: Vec<_> = (0..FRAMES).map(step).collect();
    assert_eq!(behind(&own, FRAMES), expected);
    assert_ne!(expected, plain(&START, |frame, _| asked(frame)));
}

/// A reset clears delayed torques. A solver without motors refuses such a robot. Without motors
/// `Rig` changes nothing.
#[test]
fn memory_and_refusals() {
    let own = pendulum(VarySpec { delay: just(2.0), zero: just(-0.02), ..Default::default() });
    let mut batch = Batch::new(&own, &own.scene("free").expect("a scene"), 2);
    let mut simulation = Simulation::new(batch.clone(), Rig::new(solver()));
    let twice = |frame: usize| [asked(frame), asked(frame + 50)].concat();
    (0..5).for_each(|frame| simulation.step(&twice(frame)).expect("it can be stepped"));
    let rest = own.default_state();
    simulation.reset(1, &rest);
    simulation.step(&[0.0; 4]).expect("it can be stepped");
    let fresh = simulation.batch.state(1).to_vec();
    batch.reset(0, &rest);
    Rig::new(solver()).step(&mut batch, &[0.0; 4]).expect("it can be stepped");
    assert_eq!(fresh, batch.state(0), "torques from before a reset act after it");

    let said = line(solver().step(&mut batch, &[0.0; 4]));
    assert!(said.contains("nerd_sim::rig::Rig"), "{said}");
    let (mut ideal, mut alone) = (at(&built_in("ant"), "plane", &built_in("ant").default_state()), implicit(4));
    let mut same = ideal.clone();
    run(&mut Rig::new(implicit(4)), &mut ideal, 3.0, 20);
    run(&mut alone, &mut same, 3.0, 20);
    assert_eq!(ideal.states, same.states);

    // A fault leaves the sensor readings unchanged.
    batch.state_mut(1)[3] = f64::NAN;
    let (shown, mut rig) = (batch.state(1)[..3].to_vec(), Rig::new(solver()));
    assert!(rig.step(&mut batch, &[0.0; 4]).is_err());
    assert_eq!(batch.state(1)[..3], shown[..]);
    assert!(Motors::default().ideal() && !own.motors.ideal());
    for (text, key) in [
        ("delay = \"U(0, 3)\"", "vary.delay is U(0, 3)"),
        ("zero = \"U(2, 1)\"", "is not a range"),
        ("ripple = \"U(-1, 1)\"", "vary.ripple"),
    ] {
        let (toml, urdf) = System::texts("pendulum").expect("built in");
        let said = line(System::from_text("pendulum", urdf, Some(&format!("{toml}\n[vary]\n{text}\n"))));
        assert!(said.contains(key), "{text}: {said}");
    }
    let (toml, urdf) = System::texts("cube").expect("built in");
    let said = line(System::from_text("cube", urdf, Some(&format!("{toml}\n[vary]\ndelay = \"U(0, 1)\"\n"))));
    assert!(said.contains("vary.delay: the robot has no joint"), "{said}");
}

/// Parameters for conditioning are scaled to -1..1 over each range, in the order of the columns, without ripples.
#[test]
fn what_is_told() {
    let range = |low, high| Some(Range { low, high });
    let mut system = (*built_in("pendulum")).clone();
    system.spec.vary =
        Some(VarySpec { mass: range(0.7, 1.3), ripple: range(0.0, 9.0), delay: range(0.0, 2.0), ..Default::default() });
    let (system, told) = (Arc::new(system.clone()), Told::new(&system));
    let names = ["mass:link1", "mass:link2", "ripple:joint1", "ripple:joint2", "delay"];
    assert_eq!(columns(&system), names);
    let close = |drawn: &[f64], expected: [f64; 3]| {
        let found: Vec<f64> = told.numbers(drawn).collect();
        assert!(
            found.len() == told.count() && found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12),
            "{drawn:?}: {found:?}"
        );
    };
    close(&[0.7, 1.3, 5.0, 5.0, 0.5], [-1.0, 1.0, -0.5]);
    close(&[], [0.0, 0.0, -1.0]);
    let (own, drawn) = draw(&system, &mut stream(5, 1));
    assert_eq!(own.drawn, drawn);
    assert_eq!((own.motors.ripple[0], own.motors.delay), (drawn[2], drawn[4]));
    assert!(own.robot.links[0].inertia.mass == system.robot.links[0].inertia.mass * drawn[0]);
    assert!(own.robot_sha256() != system.robot_sha256());
}
