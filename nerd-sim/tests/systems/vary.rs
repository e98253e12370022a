//! Robots that differ within a batch: each moves as it does alone; refusals and recordings.

use nerd_sim::dataset::{Manifest, generate};
use nerd_sim::vary::{self, VarySpec};

use super::common::*;

fn between(low: f64, high: f64) -> Option<Range> {
    Some(Range { low, high })
}

fn varied(robot: &str, spec: VarySpec) -> Arc<System> {
    let mut system = (*built_in(robot)).clone();
    system.spec.vary = Some(spec);
    Arc::new(system)
}

fn everything() -> VarySpec {
    VarySpec {
        mass: between(0.5, 2.0),
        inertia: between(0.8, 1.2),
        com: between(-0.01, 0.01),
        friction: between(0.2, 1.0),
        gravity: between(5.0, 12.0),
        joint_damping: between(0.5, 2.0),
        armature: between(0.0, 0.02),
        ..Default::default()
    }
}

#[test]
fn each_moves_as_it_does_alone() {
    let system = varied("ant", everything());
    type Make = fn(&System) -> Box<dyn Solver>;
    let solvers: [Make; 3] = [
        |s| Box::new(Articulated::new(ArticulatedConfig::accurate(s))),
        |s| Box::new(Articulated::new(ArticulatedConfig::paper(s, Friction::Coulomb))),
        |_| Box::new(Rapier::new(RapierConfig::default())),
    ];
    for (k, solver) in solvers.iter().enumerate() {
        let mut all = vary::batch(&system, "plane", 70, 3).expect("a plane is always there");
        (0..70).for_each(|env| all.reset(env, &system.default_state()));
        let tau: Vec<f64> = (0..70 * 8).map(|i| 5.0 * (i as f64).sin()).collect();
        let (begun, mut together) = (all.clone(), solver(&system));
        (0..20).for_each(|_| together.step(&mut all, &tau).expect("it can be stepped"));
        for env in [0, 1, 33, 69] {
            let mut alone = Batch::new(begun.of(env), &begun.scenes[env], 1);
            alone.reset(0, begun.state(env));
            let mut own = solver(&system);
            (0..20).for_each(|_| own.step(&mut alone, &tau[env * 8..][..8]).expect("it can be stepped"));
            assert_eq!(alone.states, all.state(env), "solver {k}, environment {env}");
        }
        assert!(all.state(0) != all.state(1) && begun.of(0).robot.mass() != begun.of(1).robot.mass());
        // A batch of one robot afterwards moves as with a fresh solver.
        all.systems.clear();
        let mut fresh = all.clone();
        together.step(&mut all, &tau).expect("it can be stepped");
        solver(&system).step(&mut fresh, &tau).expect("it can be stepped");
        assert_eq!(all.states, fresh.states, "solver {k}: something of the varied robots is left");
    }
}

#[test]
fn what_does_not_fit_is_refused() {
    let ant = built_in("ant");
    let mut solver = Articulated::new(ArticulatedConfig::accurate(&ant));
    let said = |solver: &mut dyn Solver, systems: &[&Arc<System>]| {
        let mut batch = batch(&ant, "plane", 2);
        batch.systems = systems.iter().map(|system| Arc::clone(system)).collect();
        line(solver.step(&mut batch, &[0.0; 16]))
    };
    assert!(said(&mut solver, &[&ant]).contains("needs 2 `systems`"));
    assert!(said(&mut solver, &[&ant, &built_in("cube")]).contains("environment 1 is built otherwise"));
    // A hand-written solver that supports one robot.
    struct Still;
    impl Solver for Still {
        fn step(&mut self, batch: &mut Batch, torques: &[f64]) -> Result<(), StepError> {
            nerd_sim::solver::check(batch, torques, &mut Vec::new())
        }
    }
    assert!(said(&mut Still, &[&ant, &ant]).contains("one robot for all environments"));
    let (toml, urdf) = System::texts("cube").expect("built in");
    for (text, key) in [
        ("gain = \"U(1, 2)\"", "vary.gain: the robot has no joint"),
        ("mass = \"U(0, 1)\"", "vary.mass is U(0, 1); an end is 0"),
        ("friction = \"U(-1, 1)\"", "vary.friction is U(-1, 1); an end is -1"),
        ("gravity = \"U(-9.81, -9)\"", "vary.gravity is U(-9.81, -9); an end"),
        ("masses = \"U(1, 2)\"", "unknown field `masses`"),
    ] {
        let said = line(System::from_text("cube", urdf, Some(&format!("{toml}\n[vary]\n{text}\n"))));
        assert!(said.contains(key), "{text}: {said}");
    }
}

#[test]
fn data_keep_what_was_drawn() {
    let (toml, urdf) = System::texts("cube").expect("built in");
    let text = format!("{toml}\n[vary]\nmass = \"U(0.5, 2)\"\nfriction = \"U(0.2, 1)\"\n");
    let system = Arc::new(System::from_text("cube", urdf, Some(&text)).expect("it is right"));
    assert_eq!(vary::columns(&system), [format!("mass:{}", system.robot.links[0].name), "friction".into()]);
    let config = GenerateConfig { transitions: 400, frames: 100, shard_trajectories: 4, ..Default::default() };
    let mut solver = Articulated::new(ArticulatedConfig::accurate(&system));
    let recording = record(&system, &mut solver, &config, 0, 4).expect("it can be recorded");
    assert_eq!(recording.drawn.len(), 8);
    assert!(
        recording.drawn.chunks(2).all(|d| (0.5..2.0).contains(&d[0]) && (0.2..1.0).contains(&d[1])),
        "{:?}",
        recording.drawn
    );
    let plain = built_in("cube");
    let old = record(&plain, &mut solver, &config, 0, 4).expect("it can be recorded");
    let d = system.robot.state_dim();
    assert!(old.drawn.is_empty() && old.arrays().len() == 6);
    assert_eq!(old.states[..d], recording.states[..d], "the first start is another one");
    assert!(old.states != recording.states);
    // Written to shards and read back.
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let manifest =
        generate(&system, &mut solver, "accurate", &config, folder, &mut |_, _| {}).expect("it can be written");
    let read =
        Manifest::read(folder).and_then(|m| m.shard(folder, &manifest.shards[0], &system)).expect("it can be read");
    assert_eq!(read, recording);
    let refused = line(manifest.shard(folder, &manifest.shards[0], &plain));
    assert!(refused.contains("system"), "{refused}");
}

/// Sensor noise is white with the drawn deviation, comes from each trajectory's stream, and is part of a shard.
#[test]
fn sensors_with_noise_show_it() {
    let noisy = |size: f64| varied("pendulum", VarySpec { noise: between(size, size), ..Default::default() });
    let (system, config) =
        (noisy(0.003), GenerateConfig { transitions: 1600, shard_trajectories: 16, hold: 4, ..Default::default() });
    let record = |system: &Arc<System>, first, count| {
        record(system, &mut *Truth::Articulated.solver(system), &config, first, count).expect("it can be recorded")
    };
    let all = record(&system, 0, 16);
    assert!(vary::columns(&system) == ["noise"] && all.drawn == [0.003; 16]);
    for (k, size) in [(0, 0.003), (1, 0.003), (2, 0.003 / system.frame_time), (3, 0.003 / system.frame_time)] {
        let gap = |row: usize| all.shown[4 * row + k] - all.states[4 * (row + row / 100) + k];
        let gaps: Vec<f64> =
            (0..1600).map(gap).map(|x| if k < 2 { nerd_core::state::wrap(x) / size } else { x / size }).collect();
        let mean = |x: &mut dyn Iterator<Item = f64>| x.sum::<f64>() / 1600.0;
        let [shift, square] = [mean(&mut gaps.iter().copied()), mean(&mut gaps.iter().map(|x| x * x))];
        let next = mean(&mut gaps.windows(2).map(|x| x[0] * x[1]));
        // About four standard errors each.
        assert!(
            shift.abs() < 0.1 && (square - 1.0).abs() < 0.15 && next.abs() < 0.1,
            "number {k}: {shift}, {square}, {next}"
        );
    }
    let part = record(&system, 5, 2);
    assert_eq!(part.shown, all.shown[5 * 400..7 * 400]);
    let still = record(&noisy(0.0), 0, 16);
    assert!(still.states == all.states && still.torques == all.torques && still.sha256() != all.sha256());
    let plain = varied("pendulum", VarySpec::default());
    assert!(record(&plain, 0, 16).shown.is_empty() && plain.sha256() != system.sha256());
    let folder = tempfile::tempdir().expect("a folder");
    let made =
        generate(&system, &mut *Truth::Articulated.solver(&system), "accurate", &config, folder.path(), &mut |_, _| {});
    let read = made.and_then(|m| Ok(m.shard(folder.path(), &m.shards[0], &system)?)).expect("it can be read");
    assert!(read == all);
    let said =
        nerd_sim::trajectories::Trajectories { shown: Vec::new(), ..all }.check(&system).expect_err("nothing is shown");
    assert!(said.contains("`shown` has 0 numbers"), "{said}");
}

/// Measurements of a free root have noise of the given size, on velocities over the frame time; the motion has none.
#[test]
fn a_free_root_is_measured_with_noise() {
    let noisy = |place: f64, turn: f64| {
        varied(
            "cube",
            VarySpec {
                root_noise: between(place, place),
                orientation_noise: between(turn, turn),
                ..Default::default()
            },
        )
    };
    let record = |system: &Arc<System>| {
        let config = GenerateConfig { transitions: 1600, shard_trajectories: 16, ..Default::default() };
        record(system, &mut *Truth::Articulated.solver(system), &config, 0, 16).expect("it can be recorded")
    };
    let (system, still) = (noisy(1e-3, 5e-3), record(&noisy(0.0, 0.0)));
    let (all, dt) = (record(&system), system.frame_time);
    assert!(
        vary::columns(&system) == ["root_noise", "orientation_noise"]
            && all.states == still.states
            && still.shown.len() == all.shown.len()
    );
    let mut squares = [0.0; 4];
    for row in 0..1600 {
        let local = |x: &[f64]| {
            let (p, w) = (vector(&x[..3]), vector(&x[7..10]));
            (p, quaternion(&x[3..7]), w, vector(&x[10..13]) + w.cross(&p))
        };
        let at = row + row / 100;
        let ((p, q, w, v), (p0, q0, w0, v0)) =
            (local(&all.shown[13 * row..][..13]), local(&all.states[13 * at..][..13]));
        let gaps =
            [(p - p0) / 1e-3, (q0.inverse() * q).scaled_axis() / 5e-3, (v - v0) * dt / 1e-3, (w - w0) * dt / 5e-3];
        squares.iter_mut().zip(gaps).for_each(|(sum, gap)| *sum += gap.norm_squared() / 4800.0);
    }
    // About four standard errors.
    assert!(squares.iter().all(|s| (s - 1.0).abs() < 0.08), "{squares:?}");
    let fixed = System::texts("pendulum").expect("built in");
    let said = line(System::from_text(
        "pendulum",
        fixed.1,
        Some(&format!("{}\n[vary]\norientation_noise = \"U(0, 0.1)\"\n", fixed.0)),
    ));
    assert!(said.contains("vary.orientation_noise: the robot's root is not free"), "{said}");
}

#[test]
fn contacts_of_a_family_are_as_stiff_and_damped_as_drawn() {
    let system = varied(
        "cube",
        VarySpec { stiffness: between(0.5, 2.0), contact_damping: between(0.5, 2.0), ..Default::default() },
    );
    let (own, drawn) = vary::draw(&system, &mut nerd_sim::sampling::stream(3, 0));
    let ([now, was], [stiffer, damped]) = ([own.spec.material, system.spec.material], [drawn[0], drawn[1]]);
    let apart = (now.stiffness / was.stiffness - stiffer).abs() + (now.damping / was.damping - stiffer * damped).abs();
    assert!(
        vary::columns(&system) == ["stiffness", "contact_damping"] && apart < 1e-12 && stiffer != damped,
        "{drawn:?}"
    );
}

/// A cube on the slope of 10 degrees from rest: `v = g (sin a - mu cos a) t` where that is positive.
#[test]
fn each_slides_by_its_own_friction() {
    let system =
        varied("cube", VarySpec { friction: between(0.0, 0.3), mass: between(0.5, 2.0), ..Default::default() });
    let mut batch = vary::batch(&system, "slope", 12, 0).expect("a slope is always there");
    let (slope, g, mut slid) = (f64::to_radians(10.0), system.gravity().norm(), 0);
    let half = system.robot.contact_points.iter().map(|p| p.local.x.abs()).fold(0.0, f64::max);
    let up = -system.gravity() / g;
    for env in 0..12 {
        let mut state = system.default_state();
        // Flat on the slope, slightly inside, where the contacts carry the cube's weight.
        let ground = &batch.scenes[env].colliders[0];
        let normal = ground.pose.rotation * vector(&ground.shape.as_halfspace().expect("a plane").normal.to_array());
        let turn = nalgebra::UnitQuaternion::rotation_between(&up, &normal).expect("not upside down");
        let weight = batch.of(env).robot.mass() * g * slope.cos();
        let sunk = weight / 4.0 / batch.of(env).spec.material.stiffness;
        state[..3].copy_from_slice((normal * (half - sunk)).as_slice());
        state[3..7].copy_from_slice(turn.coords.as_slice());
        batch.reset(env, &state);
    }
    let frames = 30;
    run(&mut implicit(16), &mut batch, 0.0, frames);
    for env in 0..12 {
        let mu = batch.of(env).spec.material.friction;
        let expected = (g * (slope.sin() - mu * slope.cos()) * frames as f64 * system.frame_time).max(0.0);
        let s = batch.state(env);
        let speed = (vector(&s[10..]) + vector(&s[7..]).cross(&vector(s))).norm();
        assert!(
            (speed - expected).abs() < 0.01 * g * slope.sin() * 0.5 + 2e-3,
            "mu {mu:.3}: {speed} m/s, textbook {expected}"
        );
        slid += usize::from(expected > 0.0);
    }
    assert!((1..12).contains(&slid), "{slid} of 12 should slide: the draw is no test");
}
