//! The kernels of the articulated solver against the solver itself, without a device: their text is compiled as C++ and run on the CPU.

mod cpp;

use std::path::Path;
use std::sync::Arc;

use nerd_sim::articulated::device::{Reach, Real, packed, program, record};
use nerd_sim::dataset::{GenerateConfig, begin};
use nerd_sim::drive::holding;
use nerd_sim::nerd_core::dynamics::{Data, kinematics, point_position};
use nerd_sim::prelude::*;
use nerd_sim::sampling::{Start, start, stream};

/// A batch after its frames, and what went wrong by environment.
struct Stepped {
    states: Vec<f64>,
    faults: Vec<i32>,
    forces: Vec<f64>,
}

fn run(made: &Path, batch: &Batch, config: &ArticulatedConfig, torques: &[f64], frames: usize) -> Stepped {
    let (system, n, reach) = (&batch.system, batch.len(), Reach::of(batch));
    let mut input: Vec<u8> = [n, frames, n].iter().flat_map(|x| (*x as i32).to_le_bytes()).collect();
    let mut numbers = |values: &[f64]| input.extend(values.iter().flat_map(|x| x.to_le_bytes()));
    numbers(&batch.states);
    numbers(torques);
    for scene in &batch.scenes {
        numbers(&record(scene, system, config, reach).expect("a scene with kernels"));
    }
    input.extend((0..n as i32).flat_map(i32::to_le_bytes));
    input.extend(packed(&batch.drives).iter().flat_map(|x| x.to_le_bytes()));
    let output = cpp::talk(made, input);
    let (d, points) = (system.robot.state_dim(), system.robot.contact_points.len());
    assert_eq!(output.len(), 8 * n * d + 4 * n + 24 * n * points);
    let doubles = |bytes: &[u8]| bytes.as_chunks::<8>().0.iter().map(|b| f64::from_le_bytes(*b)).collect();
    let (states, rest) = output.split_at(8 * n * d);
    let (faults, forces) = rest.split_at(4 * n);
    let faults = faults.as_chunks::<4>().0.iter().map(|b| i32::from_le_bytes(*b)).collect();
    Stepped { states: doubles(states), faults, forces: doubles(forces) }
}

/// A batch of random starts a while later, torques of an eighth of the gain.
fn batch(system: &Arc<System>, scene: &str, n: usize, which: Start) -> (Batch, Vec<f64>) {
    let scene = system.scene(scene).expect("a scene");
    let mut batch = Batch::new(system, &scene, n);
    for env in 0..n {
        let state = start(system, which, &mut stream(5, env as u64));
        batch.reset(env, &state);
    }
    // Until most of them touch something.
    let mut solver = Articulated::new(ArticulatedConfig::accurate(system));
    for _ in 0..25 {
        solver.step(&mut batch, &vec![0.0; n * system.robot.joint_count()]).expect("it can be stepped");
    }
    let gains: Vec<f64> = system.joint_specs().map(|j| j.torque.max(0.1) / 8.0).collect();
    let torques = (0..n * gains.len()).map(|k| gains[k % gains.len()] * (k as f64 * 0.7).sin()).collect();
    (batch, torques)
}

/// The largest difference of states, relative to 1 and to their size, and of forces, relative to the robot's weight.
fn apart(kernels: &Stepped, batch: Batch, config: ArticulatedConfig, torques: &[f64], frames: usize) -> [f64; 2] {
    let (states, forces) = differences(kernels, batch, config, torques, frames);
    [states, vec![forces]].map(|all| all.into_iter().fold(0.0, f64::max))
}

/// The largest difference of each environment's state, and that of all forces.
fn differences(kernels: &Stepped, mut batch: Batch, config: ArticulatedConfig, torques: &[f64], frames: usize) -> (Vec<f64>, f64) {
    batch.watch();
    let mut solver = Articulated::new(config);
    for _ in 0..frames {
        solver.step(&mut batch, torques).expect("it can be stepped");
    }
    assert!(kernels.faults.iter().all(|f| *f == 0), "{:?}", kernels.faults);
    assert!(kernels.states.iter().chain(&kernels.forces).all(|x| x.is_finite()));
    let weight = batch.system.robot.mass() * 9.81;
    let states: Vec<f64> = kernels.states.iter().zip(&batch.states).map(|(a, b)| (a - b).abs() / (1.0 + b.abs())).collect();
    let states = states.chunks_exact(batch.system.robot.state_dim()).map(|own| own.iter().copied().fold(0.0, f64::max)).collect();
    let told = batch.forces.iter().flat_map(|f| f.iter().copied().collect::<Vec<_>>());
    let forces = kernels.forces.iter().zip(told).map(|(a, b)| (a - b).abs() / (weight + b.abs())).fold(0.0, f64::max);
    (states, forces)
}

/// A chain on the ground, of links with two hinges each: deep enough that solver and kernels go along the tree and look for whips.
fn chain(links: usize) -> String {
    let (length, mass) = (0.05, 0.01);
    let link = |k: usize| {
        let (above, place) =
            if k == 0 { ("base".to_string(), "0 0 0.1".to_string()) } else { (format!("b{}", k - 1), format!("{length} 0 0")) };
        format!(
            r#"<link name="a{k}"/><joint name="pitch{k}" type="continuous"><parent link="{above}"/><child link="a{k}"/><origin xyz="{place}"/>
            <axis xyz="0 1 0"/><dynamics damping="0.0003"/></joint><link name="b{k}"><inertial><origin xyz="0.025 0 0"/><mass value="{mass}"/>
            <inertia ixx="1e-7" iyy="2.5e-6" izz="2.5e-6" ixy="0" ixz="0" iyz="0"/></inertial><collision><origin xyz="{length} 0 0"/>
            <geometry><sphere radius="0.005"/></geometry></collision></link><joint name="yaw{k}" type="continuous"><parent link="a{k}"/>
            <child link="b{k}"/><axis xyz="0 0 1"/><dynamics damping="0.0003"/></joint>"#
        )
    };
    format!(r#"<robot name="chain"><link name="base"/>{}</robot>"#, (0..links).map(link).collect::<String>())
}

#[test]
fn a_long_chain_moves_as_the_solver_has_it() {
    let Some(compiler) = cpp::compiler() else {
        println!("skipped: no compiler of C++ on this machine");
        return;
    };
    let folder = tempfile::tempdir().expect("a folder");
    let mut system = System::bare("chain", &chain(12), false).expect("a robot");
    system.spec.material = Material { stiffness: 300.0, damping: 1.0, friction_damping: 10.0, friction: 0.5 };
    let (system, config) = (Arc::new(system), ArticulatedConfig::implicit(64, Friction::Coulomb));
    let mut batch = Batch::new(&system, &system.scene("plane").expect("a plane"), 8);
    let (d, joints) = (system.robot.state_dim(), system.robot.joint_count());
    batch.states.iter_mut().enumerate().for_each(|(k, x)| *x = if k % d < joints { 0.2 * (k as f64).sin() } else { 0.0 });
    let torques = vec![0.0; batch.len() * joints];
    let mut solver = Articulated::new(ArticulatedConfig::implicit(4, Friction::Coulomb));
    (0..20).for_each(|_| solver.step(&mut batch, &torques).expect("it can be stepped"));
    let made = cpp::compile(compiler, &program(&system, &config, Real::F64, Reach::of(&batch)), folder.path(), "chain");
    let one = apart(&run(&made, &batch, &config, &torques, 1), batch.clone(), config, &torques, 1);
    println!("states {:.1e}, forces {:.1e}", one[0], one[1]);
    let mut touched = batch.clone();
    touched.watch();
    solver.step(&mut touched, &torques).expect("it can be stepped");
    let touching = touched.forces.iter().filter(|f| f.norm() > 0.0).count();
    assert!(touching > 10, "{touching} points touch");
    let mut driven = batch.clone();
    // A drive that its effort holds all the time is no whip, and its bound is kept.
    let drive = Drive { kp: 1e5, kd: 10.0, target: 2.0, effort: 1e-3, ..Drive::default() };
    driven.drives = vec![drive; driven.len() * joints];
    let made = cpp::compile(compiler, &program(&system, &config, Real::F64, Reach::of(&driven)), folder.path(), "driven");
    let both = apart(&run(&made, &driven, &config, &torques, 1), driven.clone(), config, &torques, 1);
    println!("driven: states {:.1e}, forces {:.1e}", both[0], both[1]);
    assert!(both[0] < 1e-7, "driven: states {:e} apart", both[0]);
    assert!(one[0] < 1e-10 && one[1] < 1e-10, "states {:e}, forces {:e} apart", one[0], one[1]);
}

/// Leads that have fallen across floor and pegs for so many frames, each among pegs of its own, and the gripper's forces.
fn leads(frames: usize) -> (Batch, Vec<f64>) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/cables/lead-pegs.toml");
    let system = System::named(path.to_str().expect("a path")).expect("the lead");
    let config = GenerateConfig { transitions: 30 * frames, frames, ..GenerateConfig::default() };
    let mut batch = begin(&system, &config, 0, 30).expect("leads");
    let torques: Vec<f64> = (0..30 * 86).map(|k| if k % 86 < 3 { 5.0 * (k as f64).sin() } else { 0.0 }).collect();
    let mut solver = Articulated::new(ArticulatedConfig::implicit(4, Friction::Coulomb));
    (0..frames).for_each(|_| solver.step(&mut batch, &torques).expect("it can be stepped"));
    (batch, torques)
}

#[test]
fn leads_among_pegs_move_as_the_solver_has_them() {
    let Some(compiler) = cpp::compiler() else {
        println!("skipped: no compiler of C++ on this machine");
        return;
    };
    let folder = tempfile::tempdir().expect("a folder");
    let (batch, torques) = leads(40);
    let mut watched = batch.clone();
    watched.watch();
    Articulated::new(ArticulatedConfig::implicit(4, Friction::Coulomb)).step(&mut watched, &torques).expect("it can be stepped");
    // How many ends of rods touch, and how many of them are nearest to a peg.
    let (mut all, mut aside, mut data) = (0, 0, Data::new(&batch.system.robot));
    for env in 0..watched.len() {
        kinematics(&batch.system.robot, watched.state(env), &mut data);
        for (point, force) in batch.system.robot.contact_points.iter().zip(watched.forces_on(env)).filter(|(_, f)| f.norm() > 0.0) {
            let event = watched.scenes[env].contact(&point_position(&data, point.link, &point.local));
            (all, aside) = (all + usize::from(force.norm() > 0.0), aside + usize::from(event.collider > 0));
        }
    }
    assert!(all > 60 && aside > 3, "{all} ends of rods touch, {aside} of them a peg");
    for substeps in [1, 4, 16] {
        let config = ArticulatedConfig::implicit(substeps, Friction::Coulomb);
        let apart = [Real::F64, Real::F32].map(|real| {
            let made = cpp::compile(compiler, &program(&batch.system, &config, real, Reach::of(&batch)), folder.path(), "lead");
            apart(&run(&made, &batch, &config, &torques, 1), batch.clone(), config, &torques, 1)
        });
        println!(
            "x{substeps}, {all} touching, {aside} of them pegs: states {:.1e}, forces {:.1e}; in 32 bits {:.1e}, {:.1e}",
            apart[0][0], apart[0][1], apart[1][0], apart[1][1]
        );
        assert!(apart[0][0] < 1e-7 && apart[1][0] < 0.1, "x{substeps}: states {:e} apart, in 32 bits {:e}", apart[0][0], apart[1][0]);
    }
}

/// One substep is too long for leads that whip. It is cut; uncut, it is another motion.
#[test]
fn whips_are_cut_as_the_solver_cuts_them() {
    let Some(compiler) = cpp::compiler() else {
        println!("skipped: no compiler of C++ on this machine");
        return;
    };
    let folder = tempfile::tempdir().expect("a folder");
    let (mut batch, torques) = leads(20);
    let d = batch.system.robot.state_dim();
    batch.states.iter_mut().enumerate().filter(|(k, _)| k % d >= d / 2 + 6).for_each(|(k, x)| *x += 12.0 * (k as f64).sin());
    let config = ArticulatedConfig::implicit(1, Friction::Coulomb);
    let text = program(&batch.system, &config, Real::F64, Reach::of(&batch));
    let by = |text: &str, name: &str| {
        let made = cpp::compile(compiler, text, folder.path(), name);
        apart(&run(&made, &batch, &config, &torques, 1), batch.clone(), config, &torques, 1)[0]
    };
    let (cut, uncut) = (by(&text, "cut"), by(&text.replace("#define HALVINGS 6", "#define HALVINGS 0"), "uncut"));
    println!("cut {cut:.1e}, uncut {uncut:.1e} apart");
    assert!(cut < 1e-6 && uncut > 1e-2, "cut {cut:e}, uncut {uncut:e} apart");
}

/// Cubes above, beside and within a peg that lies a little: on its top, its side, its edges and its foot.
#[test]
fn cubes_meet_a_peg_as_the_solver_has_it() {
    let Some(compiler) = cpp::compiler() else {
        println!("skipped: no compiler of C++ on this machine");
        return;
    };
    let folder = tempfile::tempdir().expect("a folder");
    let toml = "like = \"cube\"\n[[scene]]\nname = \"ground\"\nplane = { height = 0.0, angles = [0.0, 0.0, 0.0] }\n[[scene]]\nname = \"peg\"\nplane = { height = 0.0, angles = [0.2, 0.1, 0.0] }\n\
                peg = [{ radius = 0.3, height = 0.5, at = [0.1, 0.2, 0.3] }, { radius = 0.1, height = 0.2, at = [0.5, 0.2, 0.3] }]";
    let (assets, file) = (Path::new(env!("CARGO_MANIFEST_DIR")).join("assets"), folder.path().join("cubes.urdf"));
    std::fs::copy(assets.join("cube.urdf"), &file).expect("copied");
    std::fs::write(file.with_extension("toml"), toml).expect("written");
    let system = System::named(file.to_str().expect("a path")).expect("cubes");
    let mut batch = Batch::new(&system, &system.scene("peg").expect("a scene"), 200);
    for env in 0..batch.len() {
        let (k, mut state) = (env as f64, batch.state(env).to_vec());
        state[..3].copy_from_slice(&[0.1 + 0.5 * (1.3 * k).sin(), 0.2 + 0.5 * (2.1 * k).cos(), 0.6 + 0.5 * (0.7 * k).sin()]);
        let turn = [0.3 * k.sin(), 0.4 * (1.7 * k).sin(), 0.5 * k.cos(), 1.0];
        let length = turn.iter().map(|x| x * x).sum::<f64>().sqrt();
        (0..4).for_each(|i| state[3 + i] = turn[i] / length);
        batch.reset(env, &state);
    }
    let (config, torques) = (ArticulatedConfig::implicit(2, Friction::Coulomb), Vec::new());
    let made = cpp::compile(compiler, &program(&system, &config, Real::F64, Reach::of(&batch)), folder.path(), "cubes");
    let one = apart(&run(&made, &batch, &config, &torques, 1), batch.clone(), config, &torques, 1);
    println!("states {:.1e}, forces {:.1e}", one[0], one[1]);
    assert!(one[0] < 1e-9 && one[1] < 1e-7, "states {:e}, forces {:e} apart", one[0], one[1]);
}

/// Too few springs to be a chain: both go by the matrix. One is soft, one too stiff for its substep; both pull to some angle.
#[test]
fn springs_pull_as_the_solver_has_them() {
    let Some(compiler) = cpp::compiler() else {
        println!("skipped: no compiler of C++ on this machine");
        return;
    };
    let folder = tempfile::tempdir().expect("a folder");
    let mut system = System::bare("arm", &chain(1), false).expect("a robot");
    let springs = [(0.02, 0.4), (50.0, -0.3)];
    system.robot.links.iter_mut().filter_map(|link| link.joint.as_mut()).zip(springs).for_each(|(joint, (stiffness, rest))| {
        (joint.stiffness, joint.rest) = (stiffness, rest);
    });
    let system = Arc::new(system);
    for (scene, config) in [
        ("plane", ArticulatedConfig::implicit(2, Friction::Coulomb)),
        ("free", ArticulatedConfig::implicit(8, Friction::Coulomb)),
        ("plane", ArticulatedConfig::explicit(2, Friction::Coulomb)),
    ] {
        let mut batch = Batch::new(&system, &system.scene(scene).expect("a scene"), 8);
        batch.states.iter_mut().enumerate().for_each(|(k, x)| *x = 0.5 * (k as f64).sin());
        let torques = vec![1e-3; batch.len() * system.robot.joint_count()];
        let made = cpp::compile(compiler, &program(&system, &config, Real::F64, Reach::of(&batch)), folder.path(), "arm");
        let few = apart(&run(&made, &batch, &config, &torques, 3), batch.clone(), config, &torques, 3);
        println!("{scene}, x{}: states {:.1e}, forces {:.1e}", config.contact_substeps, few[0], few[1]);
        assert!(few[0] < 1e-9 && few[1] < 1e-7, "{scene}: states {:e}, forces {:e} apart", few[0], few[1]);
    }
}

/// What stands written out for small robots has loops for large ones; both are the solver.
#[test]
fn loops_move_as_what_is_written_out() {
    let Some(compiler) = cpp::compiler() else {
        println!("skipped: no compiler of C++ on this machine");
        return;
    };
    let folder = tempfile::tempdir().expect("a folder");
    for (name, config) in [
        ("anymal", ArticulatedConfig::implicit(4, Friction::Coulomb)),
        ("ant", ArticulatedConfig::explicit(16, Friction::Coulomb)),
        ("franka", ArticulatedConfig::implicit(4, Friction::Coulomb)),
    ] {
        let system = System::named(name).expect("built in");
        let scene = if name == "franka" { "free" } else { "ground" };
        let (batch, torques) = batch(&system, scene, 40, Start::Sample);
        let text = program(&system, &config, Real::F64, Reach::of(&batch));
        let [known, wanted] = [1, 0].map(|on| format!("#define UNROLLED {on}\n"));
        assert!(text.contains(&known));
        let [written, looped] = [text.clone(), text.replace(&known, &wanted)].map(|text| {
            let made = cpp::compile(compiler, &text, folder.path(), name);
            apart(&run(&made, &batch, &config, &torques, 3), batch.clone(), config, &torques, 3)
        });
        println!("{name}: states {:.1e} written out, {:.1e} in loops; forces {:.1e}, {:.1e}", written[0], looped[0], written[1], looped[1]);
        assert!(written[0] < 1e-9 && looped[0] < 1e-9, "{name}: states {:e} and {:e} apart", written[0], looped[0]);
    }
}

#[test]
fn kernels_move_as_the_solver_does() {
    let Some(compiler) = cpp::compiler() else {
        println!("skipped: no compiler of C++ on this machine");
        return;
    };
    let folder = tempfile::tempdir().expect("a folder");
    let implicit = |system: &System| ArticulatedConfig::accurate(system);
    let paper = |system: &System| ArticulatedConfig::paper(system, Friction::Huber);
    let explicit = |_: &System| ArticulatedConfig::explicit(64, Friction::Coulomb);
    type Preset<'a> = &'a dyn Fn(&System) -> ArticulatedConfig;
    let table: [(&str, &str, Preset); 12] = [
        ("pendulum", "free", &implicit),
        ("cartpole", "free", &explicit),
        ("pendulum", "ground1", &implicit),
        ("cube", "ground", &implicit),
        ("cube", "ground", &explicit),
        ("cube", "box", &implicit),
        ("cube", "steps", &implicit),
        ("ant", "box", &implicit),
        ("ant", "ground", &implicit),
        ("ant-paper", "ground", &paper),
        ("anymal", "ground", &implicit),
        ("franka", "free", &implicit),
    ];
    for (k, (name, scene, preset)) in table.into_iter().enumerate() {
        let system = System::named(name).expect("built in");
        let config = preset(&system);
        let (mut batch, torques) = batch(&system, scene, 40, Start::Sample);
        let made = |batch: &Batch, real| program(&system, &config, real, Reach::of(batch));
        let double = cpp::compile(compiler, &made(&batch, Real::F64), folder.path(), &format!("double{k}"));
        let one = apart(&run(&double, &batch, &config, &torques, 1), batch.clone(), config, &torques, 1);
        println!("{name} {scene} f64: states {:.1e}, forces {:.1e}", one[0], one[1]);
        assert!(one[0] < 1e-9 && one[1] < 1e-7, "{name} on {scene}: states {:e}, forces {:e} apart", one[0], one[1]);
        let single = cpp::compile(compiler, &made(&batch, Real::F32), folder.path(), &format!("single{k}"));
        let (mut one, forces) = differences(&run(&single, &batch, &config, &torques, 1), batch.clone(), config, &torques, 1);
        one.sort_by(f64::total_cmp);
        // Over an edge between two boxes 32 bits may take the other one: there a tenth may be apart.
        let worst = one[one.len() - 1 - if scene == "steps" { one.len() / 10 } else { 0 }];
        println!("{name} {scene} f32: states {:.1e} ({worst:.1e} but for edges), forces {forces:.1e}", one[one.len() - 1]);
        assert!(worst < 1e-3, "{name} on {scene} in f32: states {worst:e} apart");
        if system.robot.joint_count() > 0 && name == "ant" {
            let held: Vec<_> = (0..batch.len()).flat_map(|env| holding(&system, batch.state(env))).collect();
            batch.drives = held;
            let driven = cpp::compile(compiler, &made(&batch, Real::F64), folder.path(), &format!("driven{k}"));
            let one = apart(&run(&driven, &batch, &config, &torques, 3), batch.clone(), config, &torques, 3);
            assert!(one[0] < 1e-8, "{name} under drives: {:e} apart", one[0]);
        }
    }
}
