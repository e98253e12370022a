//! The model written for MuJoCo holds all of the robot, and states survive conversion. With a MuJoCo (`NERD_MUJOCO`,
//! the path of a Python that has it) the model moves as ours does.

use std::path::{Path, PathBuf};

use nerd_cli::experiments::{Experiment, carried::Carried};
use nerd_cli::mujoco::player::{self, Gaps, Model, Played};
use nerd_cli::mujoco::{apart, compare, from_mujoco, to_mujoco};
use nerd_lab::mujoco::{Referee, Scheme};
use nerd_sim::{mjcf::mjcf, prelude::*};
use nerd_tasks::named;
use nerd_train::onnx::export;
use nerd_train::ppo::{Arena, Policy, PolicyRun, PpoConfig, Shape};
use nerd_train::spec::SolverSpec;

/// A robot and one of its scenes.
fn place(robot: &str, scene: &str) -> (Arc<System>, Arc<Scene>) {
    let system = System::named(robot).expect("built in");
    let scene = system.scene(scene).expect("scene");
    (system, scene)
}

/// The robot of a file.
fn read(path: &Path) -> Arc<System> {
    System::named(&path.display().to_string()).expect("a robot")
}

fn python() -> Option<PathBuf> {
    let python = std::env::var("NERD_MUJOCO").ok().map(PathBuf::from);
    if python.is_none() {
        println!("skipped: no MuJoCo");
    }
    python
}

#[test]
fn every_body_joint_and_mass_is_there() {
    // The cube is one box, the others are a ball for each contact point. Without colliders there are no shapes.
    for (robot, scene, planes, shapes) in
        [("pendulum", "ground1", 1, 4), ("ant", "ground", 1, 25), ("cube", "ground", 1, 1), ("ant", "free", 0, 0)]
    {
        let (system, scene) = place(robot, scene);
        let (model, text) = (&system.robot, mjcf(&system, &scene, &[]).expect("written"));
        let count = |what: &str| text.matches(what).count();
        for (what, expected) in [
            ("<body ", model.links.len()),
            ("</body>", model.links.len()),
            ("<joint ", model.joint_count()),
            ("<freejoint/>", usize::from(model.floating())),
            ("type=\"plane\"", planes),
            ("<geom", planes + shapes),
        ] {
            assert_eq!(count(what), expected, "{robot}: {what}");
        }
        assert_eq!(count("type=\"sphere\"") + count("type=\"box\""), shapes, "{robot}: shapes");
        let values = |name: &'static str| text.split(name).skip(1).filter_map(|rest| rest.split('"').next());
        let mass: f64 = values("<inertial mass=\"").filter_map(|mass| mass.parse::<f64>().ok()).sum();
        assert!((mass / model.mass() - 1.0).abs() < 1e-12, "{robot}: {mass} kg, not {}", model.mass());
        assert!(values("<joint name=\"").eq(model.joints().map(|j| j.name.as_str())), "{robot}: order of the joints");
    }
}

/// MuJoCo refuses an empty range, a ball of radius 0 and a body called `world`, which a URDF may have.
#[test]
fn what_mujoco_refuses_is_written_as_it_takes_it() {
    let urdf = r#"<robot name="r"><link name="a"/><link name="world"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
        <collision><geometry><sphere radius="0"/></geometry></collision></link><joint name="j" type="revolute"><parent link="a"/><child link="world"/><axis xyz="0 1 0"/>
        <limit lower="0.5" upper="0.5" effort="1" velocity="1"/></joint></robot>"#;
    let system = Arc::new(System::bare("r", urdf, false).expect("a robot"));
    let text = mjcf(&system, &system.scene("plane").expect("a plane"), &[]).expect("written");
    let numbers = |key: &str| -> Vec<f64> {
        let value = text.split(key).nth(1).and_then(|rest| rest.split('"').next()).expect("a value");
        value.split(' ').map(|x| x.parse().expect("a number")).collect()
    };
    let (range, radius) = (numbers("range=\""), numbers("type=\"sphere\" size=\""));
    assert!(
        range[1] > range[0] && range[1] - range[0] < 1e-6 && radius[0] > 0.0 && radius[0] < 1e-6,
        "{range:?} {radius:?}"
    );
    assert_eq!(text.matches("<body name=\"world link\"").count(), 1, "{text}");
    let Some(python) = python() else { return };
    let batch = Batch::new(&system, &system.scene("plane").expect("a plane"), 1);
    Referee::new(&python, &batch, 1).expect("MuJoCo takes it");
}

#[test]
fn states_come_back_as_they_went() {
    for robot in ["pendulum", "ant", "cube"] {
        let system = System::named(robot).expect("built in");
        for k in 0..20 {
            let ours = start(&system, Start::Sample, &mut stream(3, k));
            let back = from_mujoco(&system.robot, &to_mujoco(&system.robot, &ours));
            let gap = ours.iter().zip(&back).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(gap < 1e-13, "{robot}: {gap:.1e}");
        }
    }
    // A root at (1, 0, 0), at rest but for 2 rad/s about the world's z, with its body rotated a quarter about x.
    let system = System::named("cube").expect("built in");
    let half = 0.5f64.sqrt();
    let ours = [1.0, 0.0, 0.0, half, 0.0, 0.0, half, 0.0, 0.0, 2.0, 0.0, -2.0, 0.0];
    let theirs = to_mujoco(&system.robot, &ours);
    let expected = [1.0, 0.0, 0.0, half, half, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0, 0.0];
    assert!(theirs.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{theirs:?}");
}

/// Passive motion without contact, a second of RK4 at fine steps, ends in the same place. Limits have no damping, since
/// ours may pull and MuJoCo's may not. To 1e-4 of their force they are the same springs, and a second has several
/// bounces.
#[test]
fn mujoco_moves_as_ours_does() {
    let Some(python) = python() else { return };
    // A cable's springs are stepped by our implicit step, which is of second order.
    let cable = concat!(env!("CARGO_MANIFEST_DIR"), "/../nerd-sim/assets/cables/lead.toml");
    for (name, limits, bound) in [
        ("pendulum", false, 1e-9),
        ("cartpole", false, 1e-9),
        ("ant", false, 1e-9),
        ("anymal", false, 1e-9),
        ("ant", true, 0.1),
        (cable, false, 0.02),
    ] {
        let mut system = (*System::named(name).expect("built in")).clone();
        for joint in system.robot.joints_mut() {
            joint.limit = joint.limit.filter(|_| limits).map(|l| Limit { damping: 0.0, ..l });
        }
        let system = Arc::new(system);
        let scene = system.scene("free").expect("scene");
        let mut batch = Batch::new(&system, &scene, 8);
        (0..8).for_each(|env| batch.reset(env, &start(&system, Start::Sample, &mut stream(7, env as u64))));
        let mut mujoco = Referee::new(&python, &batch, 60).expect("MuJoCo");
        let theirs = mujoco.play(Scheme::Rk4, 256, false).expect("played");
        let fine = ArticulatedConfig {
            substeps: 256,
            contact_substeps: 1024,
            ..ArticulatedConfig::converged(Friction::Coulomb)
        };
        let mut ours = Articulated::new(fine);
        let (mut worst, coords, nq) = (0.0f64, system.robot.root_coords(), system.robot.nq());
        for frame in &theirs.frames {
            ours.step(&mut batch, &vec![0.0; 8 * system.robot.joint_count()]).expect("stepped");
            for (a, b) in batch.states.chunks(system.robot.state_dim()).zip(frame.chunks(system.robot.state_dim())) {
                // A quaternion and its negative are one pose.
                let sign = if coords > 0 && a[6] * b[6] < 0.0 { -1.0 } else { 1.0 };
                for (k, (x, y)) in a.iter().zip(b).enumerate() {
                    let y = if (3..coords).contains(&k) { sign * y } else { *y };
                    let gap = if (coords..nq).contains(&k) { wrap(x - y) } else { x - y };
                    worst = worst.max(gap.abs());
                }
            }
        }
        assert!(worst < bound, "{name}: MuJoCo is {worst:.1e} away, allowed {bound:.0e}");
    }
}

/// MuJoCo reads a file as we do, whatever the file leaves to the compiler, and built-in robots as we write them.
#[test]
fn a_file_accelerates_as_mujoco_reads_it() {
    let Some(python) = python() else { return };
    let body = r#"<body name="b" pos=".1 .2 .3" euler="20 90 -30"><joint name="a" axis="1 2 3" pos=".1 0 0" ref="20" damping=".3" stiffness="2" springref="9"/>
        <joint name="c" type="slide" axis="0 1 1" ref=".2" armature=".1"/><geom type="capsule" fromto="0 0 0 .1 .2 .3" size=".05"/>
        <geom type="ellipsoid" size=".1 .2 .3" pos=".1 0 0" axisangle="1 0 1 40"/><frame pos="0 .1 0" euler="0 45 0"><geom type="box" size=".1 .05 .2" mass="2"/></frame>
        <body zaxis="1 1 0"><joint name="d" armature=".2" stiffness="4" springref="30"/><geom type="cylinder" size=".1 .2" density="300"/>
        <body xyaxes="0 1 0 -1 1 0" pos=".2 0 0"><joint name="e"/><inertial pos="0 0 .1" quat="1 1 0 0" mass="1" diaginertia=".1 .1 .5"/></body></body></body>"#;
    let equality = r#"<equality><joint joint1="d" joint2="a" polycoef=".1 .5 0 0 0"/></equality>"#;
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("r.xml");
    for root in ["", "<freejoint/>"] {
        let settings =
            r#"<compiler eulerseq="ZYx" balanceinertia="true" settotalmass="30"/><option gravity="1 2 -9"/>"#;
        let text = format!(
            r#"<mujoco>{settings}<worldbody><body name="root">{root}<geom size=".2"/>{body}</body></worldbody>{equality}</mujoco>"#
        );
        std::fs::write(&path, text).expect("a file");
        let gap = apart(&python, &path, &read(&path), 100).expect("read by both");
        assert!(gap < 1e-9, "{root}: accelerations are {gap:.1e} from MuJoCo's");
    }
    for name in ["ant", "anymal", "cube"] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../nerd-sim/assets/{name}.urdf"));
        let gap = apart(&python, &path, &read(&path), 100);
        assert!(*gap.as_ref().expect("read by both") < 1e-9, "{name}: accelerations are {gap:?} from MuJoCo's");
    }
}

/// A weight carried by its bearings: rounding does not count as a difference of accelerations.
#[test]
fn where_nothing_accelerates_the_difference_itself_counts() {
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("cart.xml");
    let joints = r#"<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/><joint axis="0 0 1"/>"#;
    let text = format!(
        r#"<mujoco><worldbody><body>{joints}<geom size=".1" mass="60" pos="0 0 .035"/></body></worldbody></mujoco>"#
    );
    std::fs::write(&path, text).expect("a file");
    let gap = apart(&python, &path, &read(&path), 100).expect("read by both");
    assert!(gap < 1e-9, "accelerations of nothing are {gap:.1e} (m/s^2, rad/s^2) from MuJoCo's");
}

/// A foot by priority, shins by a pair, links that pass each other and the floor: as in MuJoCo. Differences are named.
#[test]
fn masses_and_contact_are_those_of_mujocos_compiler() {
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let file = |name: &str, [friction, mass, affinity, margin]: [&str; 4]| {
        let leg = |k: usize| {
            format!(
                r#"<body name="thigh{k}" pos="{k} 0 0"><joint name="hip{k}"/><geom size=".1" mass="{mass}" pos="0 0 -.2" margin="{margin}"/>
                <body name="shin{k}" pos="0 0 -.4"><joint name="knee{k}"/><geom name="shin{k}" size=".1" conaffinity="{affinity}"/>
                <geom name="foot{k}" size=".05" pos="0 0 -.3" priority="1" condim="6" conaffinity="3" friction="{friction} .02 .001"/></body></body>"#
            )
        };
        let legs = [0, 1].map(leg).concat();
        let contact = r#"<contact><exclude body1="thigh0" body2="thigh1"/><pair geom1="shin0" geom2="shin1" condim="4" friction=".3 .3 .2"/></contact>"#;
        let world = r#"<geom name="floor" type="plane" size="1 1 1" contype="2" conaffinity="0"/><geom type="box" size=".1 .1 .1" pos="3 0 0"/>"#;
        let text = format!(
            r#"<mujoco><worldbody>{world}<body name="trunk"><freejoint/><geom size=".2"/>{legs}</body></worldbody>{contact}</mujoco>"#
        );
        let path = folder.path().join(name);
        std::fs::write(&path, text).expect("a file");
        path
    };
    let usual = [".4", "2", "1", ".01"];
    let path = file("robot.xml", usual);
    let same = compare(&python, &path, &read(&path)).expect("read by both");
    // 2 feet meet the floor, 7 moving geoms the box. Of their 21 pairs 12 meet: not 2 on one shin, 6 on neighbours, 1
    // excluded.
    assert_eq!(same.differences, [""; 0], "{} bodies, {} pairs", same.bodies, same.pairs);
    assert_eq!([same.bodies, same.pairs], [5, 2 + 7 + 12], "moving bodies and pairs that touch");
    for (k, value, what) in [
        (0, ".8", "friction 0.800 here, 0.400 in MuJoCo"),
        (1, "3", "mass of `thigh0`: 3.00 kg here, 2.00 in MuJoCo"),
        (2, "3", "touch here, not in MuJoCo"),
        (3, "0", "margin 0 here, 0.0100 in MuJoCo"),
    ] {
        let mut other = usual;
        other[k] = value;
        let found = compare(&python, &path, &read(&file("other.xml", other))).expect("read by both").differences;
        assert!(found.first().is_some_and(|first| first.contains(what)), "{what}: {found:?}");
    }
}

/// Policies of random weights: MuJoCo's player, from contract and ONNX, gives the observations and actions of task and
/// policy.
#[test]
fn an_exported_policy_is_played_by_its_contract_alone() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("policy.onnx");
    let task = |name: &str, seen: &str| {
        let path = folder.path().join(name);
        let text = format!(
            "robot = 'anymal'\nsteps = 40\nobservation = ['q - default_q', '{seen}', 'action']\nreward = '1'\n"
        );
        std::fs::write(&path, text).expect("a file");
        path.display().to_string()
    };
    let [clock, sine] = [task("clock.toml", "1 - 0.5 * time"), task("sine.toml", "sin(9 * time)")];
    let all = ["cartpole-swingup", "ant-point", "anymal-side", &clock].map(|name| (name, "MuJoCo"));
    for (name, said) in all.into_iter().chain([(&*sine, "observation 12: ")]) {
        let (task, ppo) = (named(name).expect("a task"), PpoConfig { stack: 2, ..PpoConfig::default() });
        let policy = Policy::new(Shape::of(&*task, &ppo), &mut stream(5, 0));
        let contract = export(&policy, &*task, &out).expect("written");
        let games = |python: &Path| {
            let episodes = Arena::Solver(SolverSpec::default()).episodes(name, 2, 3).expect("episodes");
            player::play(python, Model::Ours, &out, &contract, &policy, episodes)
        };
        let refused = games(Path::new("/bin/true")).expect_err("no MuJoCo").to_string();
        assert!(refused.contains(said) && !refused.contains('\n'), "{refused}");
        let Some(python) = python().filter(|_| name != sine) else { continue };
        let played = games(&python).expect("played");
        assert_eq!(played.games.len(), 2);
        let Gaps { observation, action, torque } = played.apart;
        assert!(observation < 1e-9 && action < 1e-4 && torque < 1e-4, "{name}: {:?}", played.apart);
    }
}

/// A crate on a floor, both of friction 0.1, under gravity inclined by 20 degrees; `actuator` drives a wheel on the
/// crate.
fn crate_file(floor: &str, joint: &str, actuator: &str) -> String {
    format!(
        r#"<mujoco><option timestep="0.003" gravity="3.355 0 -9.218"/><worldbody>{floor}<body name="crate" pos="0 0 .05"><freejoint/>
        <geom type="box" size=".1 .1 .05" mass="4" friction=".1"/><body name="wheel"><joint {joint} axis="0 0 1" armature=".01"/>
        <geom size=".03" mass=".1" contype="0" conaffinity="0"/></body></body></worldbody><actuator>{actuator}</actuator></mujoco>"#
    )
}

const FLOOR: &str = r#"<geom type="plane" size="0 0 1" friction=".1"/>"#;
const CRATE: &str = "steps = 60\nobservation = ['q', 'qd', 'time']\nreward = 'world_velocity[0]'\n";

/// Plays a policy of random weights by a robot's own file.
fn by_file(python: &Path, file: &str, task: &str) -> anyhow::Result<Played> {
    let folder = tempfile::tempdir()?;
    let [path, text, out] = ["r.xml", "task.toml", "policy.onnx"].map(|name| folder.path().join(name));
    std::fs::write(&path, file)?;
    std::fs::write(&text, task)?;
    let name = format!("{}@{}", text.display(), path.display());
    let task = named(&name)?;
    let policy = Policy::new(Shape::of(&*task, &PpoConfig::default()), &mut stream(5, 0));
    let contract = export(&policy, &*task, &out)?;
    player::play(
        python,
        Model::File(&path),
        &out,
        &contract,
        &policy,
        Arena::Solver(SolverSpec::default()).episodes(&name, 2, 3)?,
    )
}

/// The crate slides at `(g sin a - mu g cos a) t` from any start height. The file's steps do not divide a frame. A
/// joint without a name gets torques; a joint with a position actuator of the same gains gets targets.
#[test]
fn a_policy_is_played_with_the_settings_of_the_file() {
    let Some(python) = python() else { return };
    let servo = r#"<position joint="turn" kp="5" kv="1" gear="2"/>"#;
    for (joint, actuator, control) in [("", "", "torques"), ("name=\"turn\"", servo, "position actuators")] {
        let played =
            by_file(&python, &crate_file(FLOOR, joint, actuator), CRATE).unwrap_or_else(|e| panic!("{control}: {e}"));
        let (settings, Gaps { observation, action, torque }) = (&played.settings, played.apart);
        assert_eq!((settings.timestep, &*settings.control, &*settings.cone), (0.003, control, "pyramidal"));
        assert_eq!(settings.friction, [[0.1, 0.1]]);
        assert!(observation < 1e-9 && action < 1e-4 && torque < 1e-4, "{control}: {:?}", played.apart);
        // Over steps k of 1/60 s the sum of a k / 60 is a 60 61 / 2 / 60.
        let expected = (3.355 - 0.1 * 9.218) * 61.0 / 2.0;
        for game in &played.games {
            assert!(
                (game.reward / expected - 1.0).abs() < 0.02,
                "{control}: sum of velocities {}, not {expected}",
                game.reward
            );
        }
    }
}

/// A file without a ground gets a plane, with a note. A file with another ground than the task is refused.
#[test]
fn the_ground_of_a_file_is_that_of_the_task() {
    let Some(python) = python() else { return };
    let bare = by_file(&python, &crate_file("", "", ""), CRATE).expect("played");
    assert!(
        bare.settings.ground.contains("the file has none") && bare.settings.friction == [[1.0, 1.0]],
        "{:?}",
        bare.settings
    );
    let floor = FLOOR.replace("/>", " pos=\"0 0 1\"/>");
    let refused = by_file(&python, &crate_file(&floor, "", ""), &format!("scene = 'plane'\n{CRATE}"))
        .expect_err("another ground")
        .to_string();
    assert!(refused.contains("scene `plane`"), "{refused}");
}

/// The smallest policy, trained for an iteration: a row for the truth and one for each kind of settings. A URDF brings
/// no settings.
#[test]
fn a_policy_is_carried_by_both_settings_or_by_ours_alone() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let write = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).expect("a file");
        path.display().to_string()
    };
    let (task, file) = (
        write("slide.toml", CRATE),
        write("crate.xml", &crate_file(FLOOR, "name=\"turn\"", "<motor joint=\"turn\"/>")),
    );
    let config = PpoConfig { environments: 2, horizon: 4, minibatch: 8, iterations: 1, ..PpoConfig::default() };
    for (robot, rows) in
        [(&*file, vec!["truth", "MuJoCo, file", "MuJoCo, ours"]), ("ant", vec!["truth", "MuJoCo, ours"])]
    {
        let run = PolicyRun {
            task: format!("{task}@{robot}"),
            arena: Arena::Solver(SolverSpec::default()),
            config: config.clone(),
            seed: 0,
            minutes: None,
            out: folder.path().join(format!("run{}", rows.len())),
        };
        let mut carried = Carried::default();
        (carried.policy, carried.episodes) = (vec![run.train().expect("trained").policy], 2);
        if robot == "ant" {
            carried.settings = "file".into();
            let refused = carried.measure().expect_err("no MJCF").to_string();
            assert!(refused.contains("`ant` is no MJCF") && refused.contains("--settings"), "{refused}");
            carried.settings = "both".into();
        }
        let Some(python) = python() else { continue };
        carried.mujoco = python;
        let table = carried.measure().expect("played").tables.remove(0);
        assert_eq!(table.rows.iter().map(|row| &*row[1]).collect::<Vec<_>>(), rows);
        assert_eq!(table.note.contains("timestep (s) 0.003 and 0.0000998"), rows.len() == 3, "{}", table.note);
    }
}
