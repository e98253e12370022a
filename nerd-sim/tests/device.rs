//! Kernels of the articulated solver against the solver itself, without a GPU: their text is compiled as C++ for the
//! CPU.

#[path = "device/back.rs"]
mod back;
mod common;
mod cpp;
#[path = "device/driven.rs"]
mod driven;
#[path = "device/fallen.rs"]
mod fallen;
#[path = "device/family.rs"]
mod family;
#[path = "device/fields.rs"]
mod fields;
#[path = "device/hulls.rs"]
mod hulls;
#[path = "device/lifted.rs"]
mod lifted;
#[path = "device/paired.rs"]
mod paired;
#[path = "device/resting.rs"]
mod resting;
#[path = "device/spinning.rs"]
mod spinning;

use common::*;
use cpp::{Compiler, bytes, doubles};
use nerd_sim::articulated::device::{Reach, Real, back_program, goes_back, packed, program, records};
use nerd_sim::{dataset::begin, drive::holding, range::Range, rig::Rig, vary, vary::VarySpec};

/// Errors of kernels against the solver after some frames. Of each environment's state, the largest |difference| over 1
/// + |x|. Of all forces, the largest |difference| over the robot's weight + |f|.
#[derive(Debug)]
struct Apart {
    states: Vec<f64>,
    forces: f64,
}

impl Apart {
    /// The largest error of all environments, without the `but` worst ones.
    fn states(&self, but: usize) -> f64 {
        let mut sorted = self.states.clone();
        sorted.sort_by(f64::total_cmp);
        sorted[sorted.len() - 1 - but]
    }
}

/// A batch under constant torques, for kernels and solver.
struct Case {
    batch: Batch,
    torques: Vec<f64>,
    config: ArticulatedConfig,
}

impl Case {
    fn text(&self, real: Real) -> String {
        program(&self.batch.system, &self.config, real, Reach::of(&self.batch))
    }

    /// Inputs of kernels: states, torques, scenes, scene of each environment, drives.
    fn buffers(&self) -> Vec<Vec<u8>> {
        let batch = &self.batch;
        let (scenes, whose) = records(batch, Reach::of(batch)).expect("scenes with kernels");
        let numbers = [&batch.states, &self.torques, &scenes].map(|numbers| bytes(numbers, f64::to_le_bytes));
        let whose = bytes(&whose, i32::to_le_bytes);
        numbers.into_iter().chain([whose, bytes(&packed(&batch.drives), f64::to_le_bytes)]).collect()
    }

    fn apart(&self, compiler: &Compiler, real: Real, frames: usize) -> Apart {
        self.apart_by(compiler, &self.text(real), frames)
    }

    fn apart_by(&self, compiler: &Compiler, text: &str, frames: usize) -> Apart {
        let (mut batch, system, n) = (self.batch.clone(), &self.batch.system, self.batch.len());
        let (d, points) = (system.robot.state_dim(), system.robot.contact_points.len());
        let kernel = format!("advance(b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7], {n}, {frames}, 1);");
        let buffers = [self.buffers(), [24 * n * points, 4 * n, 4 * n].map(|size| vec![0; size]).into()].concat();
        let found = compiler.launch(text, &format!("for (; blockIdx.x < {n}; blockIdx.x++) {kernel}"), &buffers);
        assert!(found[6].iter().all(|byte| *byte == 0), "faults {:?}", found[6]);
        let (states, forces) = (doubles(&found[0]), doubles(&found[5]));
        assert!(states.iter().chain(&forces).all(|x| x.is_finite()));
        batch.watch();
        let mut solver = Articulated::new(self.config);
        (0..frames).for_each(|_| solver.step(&mut batch, &self.torques).expect("it can be stepped"));
        let weight = system.robot.mass() * 9.81;
        let off: Vec<f64> = states.iter().zip(&batch.states).map(|(a, b)| (a - b).abs() / (1.0 + b.abs())).collect();
        let told = batch.forces.iter().flat_map(|f| f.iter().copied().collect::<Vec<_>>());
        Apart {
            states: off.chunks_exact(d).map(|own| own.iter().copied().fold(0.0, f64::max)).collect(),
            forces: forces.iter().zip(told).map(|(a, b)| (a - b).abs() / (weight + b.abs())).fold(0.0, f64::max),
        }
    }
}

/// Random starts of a built-in robot, stepped until most touch something; torques of up to an eighth of the limit.
fn sampled(name: &str, scene: &str, config: ArticulatedConfig) -> Case {
    let system = if scene == "terrain" { on_rubble(name) } else { built_in(name) };
    let mut batch = batch(&system, scene, 40);
    (0..40).for_each(|env| batch.reset(env, &start(&system, Start::Sample, &mut stream(5, env as u64))));
    run(&mut Articulated::new(ArticulatedConfig::accurate(&system)), &mut batch, 0.0, 25);
    let gains: Vec<f64> = system.joint_specs().map(|j| j.torque.max(0.1) / 8.0).collect();
    let torques = (0..40 * gains.len()).map(|k| gains[k % gains.len()] * (k as f64 * 0.7).sin()).collect();
    Case { batch, torques, config }
}

/// Errors of the kernels' gradients against the solver's, one an environment, sorted. Each is the largest over next
/// states and gradients by states and torques, relative to the largest entry of a row.
fn back_apart(case: &Case, compiler: &Compiler, real: Real) -> Vec<f64> {
    const ROWS: usize = 2;
    let (batch, robot) = (&case.batch, &case.batch.system.robot);
    let (n, d, wide, joints) = (batch.len(), robot.state_dim(), 2 * robot.nv(), robot.joint_count());
    let by: Vec<f64> = (0..n * ROWS * wide).map(|k| (1.0 + k as f64 * 1.7).sin()).collect();
    goes_back(&case.config, batch).expect("it has gradients on a card");
    let kernel = format!("gradients(b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7], b[8], b[9], {n}, {ROWS});");
    let launches = format!(
        "for (; blockIdx.y < {ROWS}; blockIdx.y++) for (blockIdx.x = 0; blockIdx.x < {n}; blockIdx.x++) {kernel}
         std::fprintf(stderr, \"%zu bytes of a thread\\n\", sizeof(Work) + sizeof(Explicit) + sizeof(Back));"
    );
    let made = [8 * n * d, 8 * by.len(), 8 * n * ROWS * joints, 4 * n].map(|size| vec![0; size]);
    let buffers = [case.buffers(), vec![bytes(&by, f64::to_le_bytes)], made.into()].concat();
    let found =
        compiler.launch(&back_program(&batch.system, &case.config, real, Reach::of(batch)), &launches, &buffers);
    assert!(found[9].iter().all(|byte| *byte == 0), "faults {:?}", found[9]);
    let gradients = Articulated::new(case.config).vjp(batch, &case.torques, ROWS, &by).expect("gradients");
    let mut worst = vec![0.0f64; n];
    for (found, own, wide) in
        [(&found[6], &gradients.next, d), (&found[7], &gradients.states, wide), (&found[8], &gradients.torques, joints)]
    {
        let found = doubles(found);
        let rows = found.len() / n / wide.max(1);
        for (k, (a, b)) in found.chunks(wide.max(1)).zip(own.chunks(wide.max(1))).enumerate() {
            let size = b.iter().fold(1e-6f64, |most, x| most.max(x.abs()));
            assert!(a.iter().all(|x| x.is_finite()), "{a:?}");
            let off = a.iter().zip(b).fold(0.0f64, |most, (a, b)| most.max((a - b).abs()));
            worst[k / rows] = worst[k / rows].max(off / size);
        }
    }
    worst.sort_by(f64::total_cmp);
    worst
}

/// A chain of links with two hinges each. Twelve links are deep enough that solver and kernels solve along the tree.
fn chain(links: usize) -> String {
    let (ball, mut parts) = (collision([0.05, 0.0, 0.0], r#"<sphere radius="0.005"/>"#), vec![base()]);
    for k in 0..links {
        let (above, place) = if k == 0 { ("base".into(), "0 0 0.1") } else { (format!("b{}", k - 1), "0.05 0 0") };
        let [a, b] = ["a", "b"].map(|name| format!("{name}{k}"));
        let hinge = |axis: &str| format!(r#"<axis xyz="{axis}"/><dynamics damping="0.0003"/>"#);
        parts.push(format!(r#"<link name="{a}"/>"#));
        parts.push(joint(
            &format!("pitch{k}"),
            "continuous",
            [&above, &a],
            &(format!(r#"<origin xyz="{place}"/>"#) + &hinge("0 1 0")),
        ));
        parts.push(link(&b, 0.01, [0.025, 0.0, 0.0], [1e-7, 2.5e-6, 2.5e-6], &ball));
        parts.push(joint(&format!("yaw{k}"), "continuous", [&a, &b], &hinge("0 0 1")));
    }
    urdf(&parts)
}

#[test]
fn a_long_chain_moves_as_the_solver_has_it() {
    let Some(compiler) = Compiler::find() else { return };
    let mut system = System::bare("chain", &chain(12), false).expect("a robot");
    system.spec.material = Material { stiffness: 300.0, damping: 1.0, friction_damping: 10.0, ..Material::default() };
    let system = Arc::new(system);
    let mut batch = batch(&system, "plane", 8);
    let (d, joints) = (system.robot.state_dim(), system.robot.joint_count());
    batch
        .states
        .iter_mut()
        .enumerate()
        .for_each(|(k, x)| *x = if k % d < joints { 0.2 * (k as f64).sin() } else { 0.0 });
    run(&mut implicit(4), &mut batch, 0.0, 20);
    let torques = vec![0.0; batch.len() * joints];
    let mut case = Case { batch, torques, config: ArticulatedConfig::implicit(64, Friction::Coulomb) };
    let mut touched = case.batch.clone();
    run(&mut implicit(4), &mut touched, 0.0, 1);
    let touching = touched.forces.iter().filter(|f| f.norm() > 0.0).count();
    assert!(touching > 10, "{touching} points touch");
    let free = case.apart(&compiler, Real::F64, 1);
    // A drive that is always at its torque limit is no whip, and the limit holds.
    let drive = Drive { kp: 1e5, kd: 10.0, target: 2.0, effort: 1e-3, ..Drive::default() };
    case.batch.drives = vec![drive; case.batch.len() * joints];
    let driven = case.apart(&compiler, Real::F64, 1);
    assert!(free.states(0) < 1e-10 && free.forces < 1e-10, "{free:?}");
    assert!(driven.states(0) < 1e-7, "driven: {driven:?}");
}

/// Cables that have fallen across floor and pegs for `frames` frames, each among different pegs, with gripper forces.
fn leads(frames: usize, substeps: usize) -> Case {
    let system = System::named(concat!(env!("CARGO_MANIFEST_DIR"), "/assets/cables/lead-pegs.toml")).expect("the lead");
    let config = GenerateConfig { transitions: 60 * frames, frames, ..GenerateConfig::default() };
    let mut batch = begin(&system, &config, 0, 60).expect("leads");
    let torques: Vec<f64> = (0..60 * 86).map(|k| if k % 86 < 3 { 5.0 * (k as f64).sin() } else { 0.0 }).collect();
    let mut solver = implicit(4);
    (0..frames).for_each(|_| solver.step(&mut batch, &torques).expect("it can be stepped"));
    Case { batch, torques, config: ArticulatedConfig::implicit(substeps, Friction::Coulomb) }
}

#[test]
fn leads_among_pegs_move_as_the_solver_has_them() {
    let Some(compiler) = Compiler::find() else { return };
    let mut case = leads(40, 1);
    let (mut watched, system) = (case.batch.clone(), &case.batch.system);
    implicit(4).step(&mut watched, &case.torques).expect("it can be stepped");
    // Count the rod ends that touch, and how many are nearest to a peg.
    let (mut all, mut aside, mut data) = (0, 0, Data::new(&system.robot));
    for env in 0..watched.len() {
        kinematics(&system.robot, watched.state(env), &mut data);
        for (point, _) in system.robot.contact_points.iter().zip(watched.forces_on(env)).filter(|(_, f)| f.norm() > 0.0)
        {
            let event = watched.scenes[env].contact(&point_position(&data, point.link, &point.local));
            (all, aside) = (all + 1, aside + usize::from(event.collider > 0));
        }
    }
    assert!(all > 60 && aside > 3, "{all} ends of rods touch, {aside} of them a peg");
    for substeps in [1, 4, 16] {
        case.config = ArticulatedConfig::implicit(substeps, Friction::Coulomb);
        let [double, single] = [Real::F64, Real::F32].map(|real| case.apart(&compiler, real, 1).states(0));
        assert!(double < 1e-7 && single < 0.1, "x{substeps}: states {double:e} apart, in 32 bits {single:e}");
    }
}

/// Whipping cables need more than one substep: the substep is halved, up to six times. Without halving the motion
/// differs.
#[test]
fn whips_are_cut_as_the_solver_cuts_them() {
    let Some(compiler) = Compiler::find() else { return };
    let mut case = leads(20, 1);
    let d = case.batch.system.robot.state_dim();
    case.batch
        .states
        .iter_mut()
        .enumerate()
        .filter(|(k, _)| k % d >= d / 2 + 6)
        .for_each(|(k, x)| *x += 12.0 * (k as f64).sin());
    let text = case.text(Real::F64);
    let uncut = changed(&text, "#define MAX_HALVINGS 6", "#define MAX_HALVINGS 0");
    let [cut, uncut] = [text, uncut].map(|text| case.apart_by(&compiler, &text, 1).states(0));
    assert!(cut < 1e-6 && uncut > 1e-2, "cut {cut:e}, uncut {uncut:e} apart");
}

/// Cubes above, beside and within a slightly tilted peg: on its top, its side, its edges and its foot.
#[test]
fn cubes_meet_a_peg_as_the_solver_has_it() {
    let Some(compiler) = Compiler::find() else { return };
    let toml = "like = \"cube\"\n[[scene]]\nname = \"ground\"\nplane = { height = 0.0, angles = [0.0, 0.0, 0.0] }\n[[scene]]\nname = \"peg\"\nplane = { height = 0.0, angles = [0.2, 0.1, 0.0] }\n\
                peg = [{ radius = 0.3, height = 0.5, position = [0.1, 0.2, 0.3] }, { radius = 0.1, height = 0.2, position = [0.5, 0.2, 0.3] }]";
    let cube = System::texts("cube").expect("built in").1;
    let system = Arc::new(System::from_text("cubes", cube, Some(toml)).expect("cubes"));
    let mut batch = batch(&system, "peg", 200);
    for env in 0..batch.len() {
        let (k, mut state) = (env as f64, batch.state(env).to_vec());
        state[..3].copy_from_slice(&[
            0.1 + 0.5 * (1.3 * k).sin(),
            0.2 + 0.5 * (2.1 * k).cos(),
            0.6 + 0.5 * (0.7 * k).sin(),
        ]);
        let turn = [0.3 * k.sin(), 0.4 * (1.7 * k).sin(), 0.5 * k.cos(), 1.0];
        let length = turn.iter().map(|x| x * x).sum::<f64>().sqrt();
        (0..4).for_each(|i| state[3 + i] = turn[i] / length);
        batch.reset(env, &state);
    }
    let case = Case { batch, torques: Vec::new(), config: ArticulatedConfig::implicit(2, Friction::Coulomb) };
    let one = case.apart(&compiler, Real::F64, 1);
    assert!(one.states(0) < 1e-9 && one.forces < 1e-7, "{one:?}");
}

/// Too few springs for a chain: both solve with the mass matrix. One spring is soft, one too stiff for its substep;
/// both have a nonzero rest angle.
#[test]
fn springs_pull_as_the_solver_has_them() {
    let Some(compiler) = Compiler::find() else { return };
    let mut system = System::bare("chain", &chain(1), false).expect("a robot");
    for (joint, spring) in system.robot.joints_mut().zip([(0.02, 0.4), (50.0, -0.3)]) {
        (joint.stiffness, joint.rest) = spring;
    }
    let system = Arc::new(system);
    for (scene, config) in [
        ("plane", ArticulatedConfig::implicit(2, Friction::Coulomb)),
        ("free", ArticulatedConfig::implicit(8, Friction::Coulomb)),
    ] {
        let mut batch = batch(&system, scene, 8);
        batch.states.iter_mut().enumerate().for_each(|(k, x)| *x = 0.5 * (k as f64).sin());
        let few = Case { batch, torques: vec![1e-3; 16], config }.apart(&compiler, Real::F64, 3);
        assert!(few.states(0) < 1e-9 && few.forces < 1e-7, "{scene}, {config:?}: {few:?}");
    }
}

/// Self-collision: clapping arms, solved with the mass matrix, and a curled-up chain of twelve links, along the tree.
#[test]
fn links_on_each_other_move_as_the_solver_has_them() {
    let Some(compiler) = Compiler::find() else { return };
    let hinge = |name: &str, child: &str, x: f64| {
        joint(name, "continuous", ["trunk", child], &format!(r#"<origin xyz="{x} 0.01 0"/><axis xyz="0 1 {x}"/>"#))
    };
    let arm = |name: &str| {
        link(
            name,
            0.3,
            [0.0, 0.0, 0.15],
            [2e-3, 2e-3, 1e-4],
            &collision([0.0, 0.0, 0.15], r#"<box size="0.05 0.12 0.3"/>"#),
        )
    };
    let parts = [
        link("trunk", 1.0, [0.0; 3], [5e-3; 3], ""),
        arm("left"),
        arm("right"),
        hinge("l", "left", -0.1),
        hinge("r", "right", 0.1),
    ];
    let ball = |text: String| text.replace(r#"<sphere radius="0.005"/>"#, r#"<sphere radius="0.02"/>"#);
    for (name, text, floating, angle) in [("arms", urdf(&parts), true, 0.45), ("chain", ball(chain(12)), false, 0.65)] {
        let toml = format!("like = \"urdf\"\nfloating = {floating}\nself_collision = true\nmesh_points = 0\n");
        let system = Arc::new(System::from_text(name, &text, Some(&toml)).expect("a robot"));
        let (mut batch, robot) = (batch(&system, "free", 8), &system.robot);
        let (d, nq, coords) = (robot.state_dim(), robot.nq(), robot.root_coords());
        for (k, x) in batch.states.iter_mut().enumerate().filter(|(k, _)| (coords..nq).contains(&(k % d))) {
            let noise = 0.05 * (k as f64).sin();
            // Arms turn to each other; the chain curls by every other hinge.
            let (first, second) = if floating { (angle, -angle) } else { (angle, 0.0) };
            *x = noise + if (k % d - coords).is_multiple_of(2) { first } else { second };
        }
        let without =
            System::from_text(name, &text, Some(&toml.replace("true\nmesh", "false\nmesh"))).expect("a robot");
        let torques = vec![0.0; 8 * robot.joint_count()];
        let case = Case { batch: batch.clone(), torques, config: ArticulatedConfig::implicit(16, Friction::Coulomb) };
        let mut alone = Batch { system: Arc::new(without), ..batch.clone() };
        run(&mut implicit(16), &mut alone, 0.0, 2);
        run(&mut implicit(16), &mut batch, 0.0, 2);
        let touch = batch.states.iter().zip(&alone.states).fold(0.0f64, |most, (a, b)| most.max((a - b).abs()));
        let [double, single] = [Real::F64, Real::F32].map(|real| case.apart(&compiler, real, 2).states(0));
        assert!(touch > 1e-2 && double < 1e-9 && single < 1e-2, "{name}: {double:e}, {single:e}, {touch}");
    }
}

#[test]
fn kernels_move_as_the_solver_does() {
    let Some(compiler) = Compiler::find() else { return };
    for (name, scene) in [
        ("pendulum", "free"),
        ("cartpole", "free"),
        ("pendulum", "ground1"),
        ("cube", "ground"),
        ("cube", "box"),
        ("cube", "steps"),
        ("ant", "box"),
        ("ant", "ground"),
        ("cube", "terrain"),
        ("ant", "terrain"),
        ("anymal", "ground"),
        ("franka", "free"),
    ] {
        let mut case = sampled(name, scene, ArticulatedConfig::accurate(&built_in(name)));
        let [double, single] = [Real::F64, Real::F32].map(|real| case.apart(&compiler, real, 1));
        // Over an edge between two boxes f32 may select the other one, so a tenth may differ.
        let worst = single.states(if scene == "steps" { case.batch.len() / 10 } else { 0 });
        assert!(double.states(0) < 1e-9 && double.forces < 1e-7, "{name} on {scene}: {double:?}");
        assert!(worst < 1e-3, "{name} on {scene} in f32: {single:?}");
        if name == "ant" {
            case.batch.drives =
                (0..case.batch.len()).flat_map(|env| holding(&case.batch.system, case.batch.state(env))).collect();
            let driven = case.apart(&compiler, Real::F64, 3);
            assert!(driven.states(0) < 1e-8, "{name} under drives: {driven:?}");
        }
        // Code that is unrolled for small robots uses loops for large ones.
        if ["ant", "anymal", "franka"].contains(&name) {
            let loops = changed(&case.text(Real::F64), "#define UNROLLED 1\n", "#define UNROLLED 0\n");
            let looped = case.apart_by(&compiler, &loops, 3).states(0);
            assert!(looped < 1e-9, "{name} on {scene} in loops: {looped:e}");
        }
    }
}
