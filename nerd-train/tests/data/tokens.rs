//! Tokens are in the robot's axes, wherever the robot is, and data of another system are refused.

use nerd_sim::dataset::{generate, read_shard, write_shard};
use nerd_train::prepare::read;

use crate::*;

fn recorded(system: &Arc<System>) -> Trajectories {
    let config = GenerateConfig { transitions: 320, frames: 20, ..Default::default() };
    record(system, &mut *Truth::Articulated.solver(system), &config, 0, 16).unwrap()
}

/// The same motion on the same ground, elsewhere.
fn moved(system: &System, here: &Trajectories, by: Vector3<f64>) -> Trajectories {
    let (mut there, nq) = (here.clone(), system.robot.nq());
    for state in there.states.chunks_exact_mut(system.robot.state_dim()) {
        let (q, qd) = state.split_at_mut(nq);
        q[..3].iter_mut().zip(&by).for_each(|(p, by)| *p += by);
        // The twist's linear part is the velocity of the body's point at the world's origin.
        let v = by.cross(&vector(&qd[..3]));
        qd[3..6].iter_mut().zip(&v).for_each(|(x, v)| *x += v);
    }
    there.points.chunks_exact_mut(3).for_each(|p| p.iter_mut().zip(&by).for_each(|(p, by)| *p += by));
    there
}

#[test]
fn a_robot_100_km_away_is_seen_as_the_one_at_the_origin() {
    let folder = tempfile::tempdir().unwrap();
    for robot in ["ant", "cube"] {
        let system = System::named(robot).unwrap();
        let here = recorded(&system);
        let touching = here.depths.iter().filter(|d| **d < 0.1).count();
        assert!(touching > 50, "{robot}: {touching} points near the ground, too few to tell");
        // The Ant's ground is x-z, the cube's x-y.
        let by = if robot == "ant" { Vector3::new(1e5, 0.0, -1e5) } else { Vector3::new(1e5, -1e5, 0.0) };
        let path = folder.path().join(robot);
        write_shard(&path, &moved(&system, &here, by), &Default::default()).unwrap();
        let there = read_shard(&path).unwrap().0;
        for form in [Form::default(), Base::Trapezoid.into(), Form { view: View::Moving, ..Base::State.into() }] {
            let (a, b) = (tokens(&system, &here, 1, form), tokens(&system, &there, 1, form));
            // f64 rounds 1e5 m to 1.5e-11 m, and likewise the part 1e5 w of v. Both are below the rounding of the
            // tokens.
            let gap = |a: &[f32], b: &[f32]| {
                a.iter().zip(b).map(|(a, b)| (a - b).abs() / (1.0 + a.abs())).fold(0.0, f32::max)
            };
            let (x, y) = (gap(&a.x, &b.x), gap(&a.y, &b.y));
            assert!(x < 1e-6 && y < 1e-6, "{robot}, {form:?}: tokens {x:.1e}, targets {y:.1e} apart");
        }
    }
}

#[test]
fn data_of_another_system_are_refused_with_both_named() {
    let folder = tempfile::tempdir().unwrap();
    let (urdf, toml) = (
        include_str!("../../../nerd-sim/assets/cartpole.urdf"),
        include_str!("../../../nerd-sim/assets/cartpole.toml"),
    );
    let of = |toml: &str| Arc::new(System::from_text("cartpole", urdf, Some(toml)).unwrap());
    let system = of(toml);
    let config = GenerateConfig { transitions: 60, frames: 10, shard_trajectories: 4, ..Default::default() };
    let mut truth = Articulated::new(ArticulatedConfig::paper(&system, Friction::Coulomb));
    generate(&system, &mut truth, "paper", &config, folder.path(), &mut |_, _| ()).unwrap();
    let refused = |system: &Arc<System>, truth: &str| {
        read(system, truth, folder.path(), 1, Form::default()).map(|_| ()).unwrap_err().to_string()
    };
    assert!(read(&system, "paper", folder.path(), 1, Form::default()).is_ok());
    let lighter = of(&toml.replacen("armature = 0.01", "armature = 0.02", 1));
    let error = refused(&lighter, "paper");
    assert!(
        error.contains(&system.robot_sha256()) && error.contains(&lighter.robot_sha256()) && error.contains("masses"),
        "{error}"
    );
    let error = refused(&of(&toml.replacen("torque = 1500.0", "torque = 1.0", 1)), "paper");
    assert!(error.contains(&system.sha256()) && error.contains("driven"), "{error}");
    assert!(refused(&system, "rapier").contains("`paper`, not `rapier`"));
    // A shard of another system among the right ones.
    let path = folder.path().join("shard-00001.safetensors");
    let (recording, mut header) = read_shard(&path).unwrap();
    header.insert("system_sha256".into(), lighter.sha256());
    write_shard(&path, &recording, &header).unwrap();
    let error = refused(&system, "paper");
    assert!(error.contains("shard-00001") && error.contains(&lighter.sha256()), "{error}");
}
