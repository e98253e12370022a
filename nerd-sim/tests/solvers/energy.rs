//! Nothing gains energy: bodies that are tossed and spin, at any number of substeps.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use nerd_core::dynamics::totals;
use rand::RngExt;

use crate::common::*;

/// A free rigid body by its name: coin, rod, box or top.
fn body(name: &str) -> Arc<System> {
    Arc::new(System::bare(name, &text(name), true).expect("a body"))
}

fn text(name: &str) -> String {
    let disc = r#"<cylinder radius="0.05" length="0.01"/>"#;
    let (mass, com, inertia, shapes) = match name {
        "coin" => (0.1, [0.0; 3], [6.3e-5, 6.3e-5, 1.25e-4], collision([0.0; 3], disc)),
        "rod" => (0.3, [0.0; 3], [4e-3, 4e-3, 1.5e-5], collision([0.0; 3], r#"<capsule radius="0.01" length="0.4"/>"#)),
        "box" => (1.0, [0.0; 3], [3.5e-3, 7.7e-3, 1.08e-2], collision([0.0; 3], r#"<box size="0.3 0.2 0.05"/>"#)),
        // A top that stands on its tip, its root.
        _ => {
            let tip = collision([0.0; 3], r#"<sphere radius="0.005"/>"#);
            (0.2, [0.0, 0.0, 0.05], [1.3e-4, 1.3e-4, 2.5e-4], collision([0.0, 0.0, 0.05], disc) + &tip)
        }
    };
    urdf(&[link("body", mass, com, inertia, &shapes)])
}

/// Tosses of each kind; `NERD_TOSSES` sets more.
fn tosses() -> usize {
    std::env::var("NERD_TOSSES").ok().and_then(|n| n.parse().ok()).unwrap_or(16)
}

/// Largest gain of kinetic and potential energy within `frames` frames, relative to the initial kinetic energy plus m g
/// h. Tosses are random, from a height (m) with an angular velocity (rad/s) and a speed (m/s).
fn gain(
    system: &Arc<System>,
    scene: &Arc<Scene>,
    substeps: usize,
    [height, spin, speed]: [f64; 3],
    frames: usize,
) -> f64 {
    let n = tosses();
    let (mut batch, mut data, mut random) = (Batch::new(system, scene, n), Data::new(&system.robot), stream(3, 0));
    for env in 0..n {
        let mut drawn = |size: f64| Vector3::from_fn(|_, _| random.random_range(-1.0..1.0f64)).normalize() * size;
        let (turn, w, v) = (drawn(3.0), drawn(spin), drawn(speed));
        let attitude = UnitQuaternion::new_normalize(Quaternion::from_parts(turn.x.abs(), turn));
        let place = scene.gravity.try_normalize(0.0).unwrap_or(-Vector3::z()) * -height;
        let (nq, state) = (system.robot.nq(), batch.state_mut(env));
        state[..3].copy_from_slice(place.as_slice());
        state[3..7].copy_from_slice(attitude.coords.as_slice());
        state[nq..nq + 3].copy_from_slice(w.as_slice());
        state[nq + 3..nq + 6].copy_from_slice((v - w.cross(&place)).as_slice());
        // Joint velocities, if there are joints.
        state[nq + 6..].iter_mut().for_each(|x| *x = 4.0 * random.random_range(-1.0..1.0f64));
    }
    let mut energy = |state: &[f64]| {
        let own = totals(&system.robot, state, &mut data);
        let size = own.kinetic + own.mass * scene.gravity.norm() * height;
        (own.energy(&scene.gravity), size)
    };
    let first: Vec<(f64, f64)> = (0..n).map(|env| energy(batch.state(env))).collect();
    let (mut solver, mut worst) = (implicit(substeps), 0.0f64);
    for _ in 0..frames {
        run(&mut solver, &mut batch, 0.0, 1);
        worst = first
            .iter()
            .enumerate()
            .map(|(env, (begun, size))| (energy(batch.state(env)).0 - begun) / size)
            .fold(worst, f64::max);
    }
    worst
}

/// Free rotation at up to 200 rad/s for 10 s, with a plane far below and without.
#[test]
fn what_spins_in_flight_keeps_its_energy() {
    for name in ["coin", "rod", "box", "top"] {
        let mut system = (*body(name)).clone();
        system.spec.gravity = [0.0; 3];
        let system = Arc::new(system);
        for (scene, substeps) in [("plane", 1), ("plane", 4), ("plane", 8), ("free", 4)] {
            let place = system.scene(scene).expect("a scene");
            for spin in [5.0, 30.0, 200.0] {
                let found = gain(&system, &place, substeps, [100.0, spin, 0.0], 600);
                assert!(found < 1e-4, "{name} at {spin} rad/s in `{scene}`, x{substeps}: gains {found:.1e}");
            }
        }
    }
}

#[test]
fn tosses_gain_no_energy() {
    for name in ["coin", "rod", "box", "top"] {
        let system = body(name);
        let scene = system.scene("plane").expect("a plane");
        for substeps in [1, 4, 8] {
            for spin in [10.0, 100.0] {
                let found = gain(&system, &scene, substeps, [1.0, spin, 2.0], 180);
                println!("{} tosses of a {name} at {spin} rad/s, x{substeps}: gain {found:.1e}", tosses());
                assert!(found < 1e-3, "{name} at {spin} rad/s, x{substeps}: gains {found:.1e}");
            }
        }
    }
}

/// Boxes and balls without friction or damping, on cells of terrain and on edges.
#[test]
fn rough_ground_gives_boxes_and_balls_no_energy() {
    let grounds = [
        ("rubble", "terrain = { kind = \"rubble\", height = 0.05, cell = 0.05 }"),
        ("slopes", "terrain = { kind = \"slopes\", height = 0.3, cell = 0.1 }"),
        ("steps", "terrain = { kind = \"steps\", height = 0.1, cell = 0.1 }"),
        (
            "edges",
            "box = [{ size = [0.4, 0.4, 0.2], position = [0.0, 0.0, 0.1] }]\npeg = [{ radius = 0.05, height = 0.3, position = [0.0, 0.4, 0.15] }]",
        ),
    ];
    let ball = || urdf(&[link("body", 1.0, [0.0; 3], [4e-3; 3], &collision([0.0; 3], r#"<sphere radius="0.1"/>"#))]);
    for (ground, shapes) in grounds {
        for (name, urdf) in [("box", text("box")), ("ball", ball())] {
            let slick = "material = { stiffness = 1e4, damping = 0.0, friction_damping = 0.0, friction = 0.0 }\n";
            let toml = format!("like = \"urdf\"\nfloating = true\n{slick}{GROUND}{shapes}\n");
            let system = Arc::new(System::from_text(name, &urdf, Some(&toml)).expect("a body"));
            let scene = system.scene("ground").expect("its own");
            for substeps in [1, 4, 8] {
                let found = gain(&system, &scene, substeps, [0.8, 5.0, 1.0], 180);
                assert!(found < 1e-3, "{name} on {ground}, x{substeps}: gains {found:.1e}");
            }
        }
    }
}

/// The shipped cube, at steps of up to a quarter of a second.
#[test]
fn long_steps_give_no_energy() {
    for time in [1.0 / 60.0, 0.08, 0.1, 0.16, 0.25] {
        let mut system = (*built_in("cube")).clone();
        system.frame_time = time;
        let system = Arc::new(system);
        let scene = system.scene("ground").expect("level");
        for substeps in [1, 4] {
            let found = gain(&system, &scene, substeps, [0.5, 0.0, 0.0], (4.0 / time) as usize);
            assert!(found < 1e-3, "at {time} s, x{substeps}: gains {found:.1e}");
        }
    }
}

/// A chain with self-collision that claps together.
#[test]
fn links_on_each_other_give_no_energy() {
    let rod = |k: usize| {
        link(
            &format!("l{k}"),
            1.0,
            [0.0, 0.0, -0.1],
            [3.4e-3, 3.4e-3, 2e-4],
            &collision([0.0, 0.0, -0.1], r#"<cylinder radius="0.02" length="0.2"/>"#),
        )
    };
    let hinge = |k: usize| {
        joint(
            &format!("j{k}"),
            "continuous",
            [&format!("l{}", k - 1), &format!("l{k}")],
            r#"<origin xyz="0 0 -0.2"/><axis xyz="0 1 0"/>"#,
        )
    };
    let parts: Vec<String> = (0..5).map(rod).chain((1..5).map(hinge)).collect();
    for (name, material) in [
        ("default", ""),
        ("undamped", "material = { stiffness = 1e4, damping = 0.0, friction_damping = 0.0, friction = 0.0 }\n"),
    ] {
        let toml =
            format!("like = \"urdf\"\nfloating = true\nself_collision = true\ngravity = [0.0, 0.0, 0.0]\n{material}");
        let system = Arc::new(System::from_text("chain", &urdf(&parts), Some(&toml)).expect("a chain"));
        let scene = system.scene("free").expect("nothing else");
        for substeps in [1, 4, 8] {
            let found = gain(&system, &scene, substeps, [1.0, 0.5, 0.0], 200);
            assert!(found < 1e-3, "{name}, x{substeps}: gains {found:.1e}");
        }
    }
}

/// Robots of files in `NERD_ROBOTS`, a path a line, fall limp on their ground at frames of 1/240 s to 1/4 s. Energy
/// with springs never rises above its minimum so far by more than a thousandth.
#[test]
fn robots_of_strangers_gain_no_energy_at_any_step() {
    let Ok(paths) = std::env::var("NERD_ROBOTS") else {
        println!("skipped: no NERD_ROBOTS");
        return;
    };
    let mut faults = Vec::new();
    for path in paths.lines() {
        let loaded = System::named(path).expect("a robot");
        for time in [1.0 / 240.0, 1.0 / 60.0, 0.05, 0.1, 0.25] {
            for substeps in [1, 4] {
                let mut system = (*loaded).clone();
                (system.frame_time, system.spec.control) = (time, None);
                let system = Arc::new(system);
                let scene = system.scene("ground").or_else(|_| system.scene("plane")).expect("ground");
                let (mut solver, mut data) = (implicit(substeps), Data::new(&system.robot));
                let mut energy = |state: &[f64]| {
                    let own = totals(&system.robot, state, &mut data);
                    (own.energy(&scene.gravity), own.kinetic + own.mass * scene.gravity.norm() * 0.5)
                };
                let (mut worst, mut stored) = (0.0f64, system.data());
                for seed in 0..4 {
                    let mut batch = Batch::new(&system, &scene, 1);
                    let mut state = start(&system, Start::Reset, &mut stream(31, seed));
                    let (nq, dofs) = (system.robot.nq(), system.robot.root_dofs());
                    state[nq + dofs..]
                        .iter_mut()
                        .enumerate()
                        .for_each(|(k, rate)| *rate = if (k as u64 + seed).is_multiple_of(2) { 2.0 } else { -2.0 });
                    if dofs > 0 {
                        state[2] += 0.3;
                    }
                    batch.reset(0, &state);
                    let ((begun, size), kept) = (energy(&state), system.stored(&scene, &state, &mut stored));
                    let mut least = begun + kept;
                    for frame in 0..(3.0 / time) as usize {
                        if let Err(e) = solver.step(&mut batch, &vec![0.0; system.robot.joint_count()]) {
                            faults.push(format!("{path} at {time} s, x{substeps}, frame {frame}: {e}"));
                            break;
                        }
                        let now = energy(batch.state(0)).0 + system.stored(&scene, batch.state(0), &mut stored);
                        least = least.min(now);
                        worst = worst.max((now - least) / (size + kept));
                    }
                }
                println!("{path} at {time:.4} s, x{substeps}: gain {worst:.1e}");
                if worst > 1e-3 {
                    faults.push(format!("{path} at {time} s, x{substeps}: gains {worst:.1e}"));
                }
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}
