//! Gradients of a frame by the numbers of a material and by parameters of robot and scene.

use super::*;

/// Gradients with respect to the numbers of a material, one perturbed at a time.
#[test]
fn gradients_by_a_material_are_those_of_central_differences() {
    type Key = fn(&mut Material) -> &mut f64;
    let keys: [(&str, Key); 7] = [
        ("stiffness", |m| &mut m.stiffness),
        ("damping", |m| &mut m.damping),
        ("friction_damping", |m| &mut m.friction_damping),
        ("friction", |m| &mut m.friction),
        ("torsion", |m| &mut m.torsion),
        ("rolling", |m| &mut m.rolling),
        ("margin", |m| &mut m.margin),
    ];
    let ball = altered("cube", |s| {
        (s.spec.material.torsion, s.spec.material.rolling, s.spec.material.margin) = (0.02, 0.01, 0.005)
    });
    for (what, system, scene, said) in [("cube", ball, "ground", false), ("geoms of a file", crawler(), "plane", true)]
    {
        let (mut solver, mut random) = (settled(four()), stream(5, 0));
        let (rows, joints) = (2 * system.robot.nv(), system.robot.joint_count());
        // All colliders and the robot have one material.
        let with = |material: Material| {
            let (mut own, mut scene) = ((*system).clone(), (*system.scene(scene).expect("a scene")).clone());
            own.spec.material = material;
            own.one_friction = said.then_some(material.friction);
            scene.colliders.iter_mut().for_each(|c| c.material = material);
            (Arc::new(own), Arc::new(scene))
        };
        let nominal = system.spec.material;
        let (own, place) = with(nominal);
        let mut batch = Batch::new(&own, &place, 4);
        match said {
            true => drop_low(&mut batch),
            false => (0..4).for_each(|env| batch.reset(env, &start(&own, Start::Reset, &mut stream(0, env as u64)))),
        }
        let counted = if said { 4 } else { 7 };
        let (mut errors, mut left_out) = (vec![Vec::new(); 7], 0);
        for frame in 0..120 {
            let torques = pushed(&own, batch.len(), &mut random);
            for env in (0..batch.len()).filter(|_| frame % 10 == 0) {
                let (state, torques) = (batch.state(env), &torques[env * joints..(env + 1) * joints]);
                let gradients =
                    solver.back_by_numbers(&only(&batch, state), torques, rows, &identity(rows)).expect("gradients");
                if endless(four(), &batch, state, torques, &gradients.next) {
                    left_out += counted;
                    continue;
                }
                for (k, (_, number)) in keys.iter().enumerate().take(counted) {
                    let moved = |by: f64| {
                        let mut material = nominal;
                        *number(&mut material) += by;
                        with(material)
                    };
                    let size = 1e-2 * number(&mut nominal.clone()).abs();
                    let of = |by: f64| moved(by).clone();
                    let [up, down] = [size, -size].map(|by| nerd_sim::articulated::numbers(&of(by).0, &of(by).1));
                    let by: Vec<f64> = up.iter().zip(&down).map(|(up, down)| (up - down) / (2.0 * size)).collect();
                    let found: Vec<f64> = gradients
                        .numbers
                        .chunks_exact(by.len())
                        .map(|row| row.iter().zip(&by).map(|(a, b)| a * b).sum())
                        .collect();
                    let (expected, agrees) = central(size, |by| {
                        let (system, scene) = moved(by);
                        difference(
                            &system.robot,
                            &gradients.next,
                            &stepped(&mut solver, &Batch::new(&system, &scene, 1), state, torques),
                        )
                    });
                    if norm(expected.iter().copied()).max(norm(found.iter().copied())) * size < 1e-9 {
                        continue;
                    }
                    match agrees > HELD {
                        true => left_out += 1,
                        false => errors[k].push(apart(&found, &expected)),
                    }
                }
            }
            solver.step(&mut batch, &torques).expect("steps");
        }
        for ((name, _), errors) in keys.iter().zip(&errors).filter(|(_, errors)| !errors.is_empty()) {
            println!(
                "  {what}, {name}: {} states, error {:.1e} (worst)",
                errors.len(),
                errors.iter().copied().fold(0.0, f64::max)
            );
        }
        let idle = errors.iter().take(counted).filter(|errors| errors.is_empty()).count();
        assert!(idle <= 1, "{what}: {idle} numbers did nothing in any state");
        assert!(told(what, errors.concat(), left_out, HELD), "{what}");
    }
}

#[cfg(feature = "calibrate")]
#[test]
fn gradients_by_parameters_are_those_of_central_differences() {
    use nerd_sim::calibrate::{Engine, Parameter, Subject};
    let contact = ["friction", "stiffness", "damping", "gravity", "height", "tilt.x", "tilt.y", "size"];
    let cube = ["mass", "com.x", "com.z", "inertia", "spread.y", "rounding"].map(String::from);
    // Parameters of two links and a joint.
    let parts = |robot: &str| {
        let robot = &built_in(robot).robot;
        let [trunk, limb] = [0, 4].map(|link| &robot.links[link].name);
        let joint = &robot.joints().nth(2).expect("a joint").name;
        let joints = ["joint-damping", "joint-friction", "armature"].map(|name| format!("{name}:{joint}"));
        let links =
            [format!("mass:{trunk}"), format!("com.y:{limb}"), format!("inertia:{limb}"), format!("mass:{limb}")];
        links.into_iter().chain(joints)
    };
    let arm = [
        "gravity".to_string(),
        "mass:pole".into(),
        "com.z:pole".into(),
        "inertia:pole".into(),
        "joint-damping:hinge".into(),
    ];
    for (name, scene, names) in [
        ("cube", "ground", contact.map(String::from).into_iter().chain(cube).collect::<Vec<_>>()),
        ("ant", "ground", contact.map(String::from).into_iter().chain(parts("ant")).collect()),
        ("anymal", "ground", contact.map(String::from).into_iter().chain(parts("anymal")).collect()),
        ("franka", "free", parts("franka").collect()),
        ("cartpole", "free", arm.into()),
    ] {
        let (mut solver, mut random) = (settled(four()), stream(3, 0));
        let system = built_in(name);
        let parameters: Vec<Parameter> =
            names.iter().map(|n| Parameter::named(&system, n).unwrap_or_else(|e| panic!("{e}"))).collect();
        let mut values: Vec<f64> = parameters.iter().map(|p| p.nominal).collect();
        for (p, value) in parameters.iter().zip(&mut values) {
            // Inside its bounds: a friction or a radius of zero has only a one-sided derivative.
            *value += 0.01 * (p.high - *value);
        }
        let subject =
            Subject::new(&system, scene, Engine::Articulated(ArticulatedConfig::accurate(&system))).expect("a subject");
        let own = subject.with(&parameters, &values).expect("values");
        let by = subject.numbers_by(&parameters, &values).expect("values");
        let (robot, joints) = (&own.system.robot, own.system.robot.joint_count());
        let rows = 2 * robot.nv();
        let identity = identity(rows);
        let mut batch = Batch::new(&own.system, &own.scene, 8);
        (0..8).for_each(|env| batch.reset(env, &start(&own.system, Start::Reset, &mut stream(0, env as u64))));
        let (mut errors, mut left_out) = (vec![Vec::new(); parameters.len()], 0);
        for frame in 0..100 {
            let torques = pushed(&own.system, batch.len(), &mut random);
            for env in (0..batch.len()).filter(|_| frame % 20 == 0) {
                let (state, torques) = (batch.state(env), &torques[env * joints..(env + 1) * joints]);
                let gradients =
                    solver.back_by_numbers(&only(&batch, state), torques, rows, &identity).expect("gradients");
                if endless(four(), &batch, state, torques, &gradients.next) {
                    left_out += parameters.len();
                    continue;
                }
                for (k, by) in by.iter().enumerate() {
                    let found: Vec<f64> = gradients
                        .numbers
                        .chunks_exact(by.len())
                        .map(|row| row.iter().zip(by).map(|(a, b)| a * b).sum())
                        .collect();
                    let size = 2e-3 * (parameters[k].high - parameters[k].low);
                    let (expected, agrees) = central(size, |size| {
                        let mut values = values.clone();
                        values[k] += size;
                        let other = subject.with(&parameters, &values).expect("values");
                        let next = stepped(&mut solver, &Batch::new(&other.system, &other.scene, 1), state, torques);
                        difference(robot, &gradients.next, &next)
                    });
                    if norm(expected.iter().copied()).max(norm(found.iter().copied())) * size < 1e-9 {
                        continue;
                    }
                    // A reference, so better than the tolerance.
                    match 1.5 * agrees > EXACT {
                        true => left_out += 1,
                        false => errors[k].push(apart(&found, &expected)),
                    }
                }
            }
            solver.step(&mut batch, &torques).expect("steps");
        }
        for (name, errors) in names.iter().zip(&errors) {
            println!(
                "  {name}: {} states, error {:.1e} (worst)",
                errors.len(),
                errors.iter().copied().fold(0.0, f64::max)
            );
        }
        let idle = errors.iter().filter(|errors| errors.is_empty()).count();
        assert!(idle <= 1, "{name}: {idle} parameters did nothing in any state");
        assert!(told(name, errors.concat(), left_out, EXACT), "{name}");
    }
}
