//! The model written for MuJoCo holds all of the robot; states come back as they went; and where there is a MuJoCo
//! (`NERD_MUJOCO`, the path of a Python that has it), it moves as ours does.

use std::path::{Path, PathBuf};

use nerd_lab::mujoco::player::{self, Gaps};
use nerd_lab::mujoco::{Referee, Scheme, apart, from_mujoco, to_mujoco};
use nerd_sim::{mjcf::mjcf, prelude::*};
use nerd_tasks::named;
use nerd_train::onnx::export;
use nerd_train::ppo::{Arena, Policy, PpoConfig, Shape};

/// A robot and one of its scenes.
fn place(robot: &str, scene: &str) -> (Arc<System>, Arc<Scene>) {
    let system = System::named(robot).expect("built in");
    let scene = system.scene(scene).expect("scene");
    (system, scene)
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
    // The cube is one box, the others a ball a contact point; where there is nothing to touch, there are no shapes.
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

/// MuJoCo refuses a range of nothing, a ball of radius 0 and a body called `world`, which a URDF may have.
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
    assert!(range[1] > range[0] && range[1] - range[0] < 1e-6 && radius[0] > 0.0 && radius[0] < 1e-6, "{range:?} {radius:?}");
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
    // A root at (1, 0, 0) that turns with 2 rad/s about the world's z and stands still, its body turned a quarter about x.
    let system = System::named("cube").expect("built in");
    let half = 0.5f64.sqrt();
    let ours = [1.0, 0.0, 0.0, half, 0.0, 0.0, half, 0.0, 0.0, 2.0, 0.0, -2.0, 0.0];
    let theirs = to_mujoco(&system.robot, &ours);
    let expected = [1.0, 0.0, 0.0, half, half, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0, 0.0];
    assert!(theirs.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{theirs:?}");
}

/// Passive, contact-free, a second of RK4 at fine steps: the same robot, or it would not come to the same place. Limits
/// without their damping, with which ours may pull and MuJoCo's not; to 1e-4 of their force they are the same springs,
/// and a second has several bounces.
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
        let fine = ArticulatedConfig { substeps: 256, contact_substeps: 1024, ..ArticulatedConfig::converged(Friction::Coulomb) };
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

/// MuJoCo reads a file of its own as we do, whatever it leaves to its compiler; and the built-in robots as we write them.
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
        let settings = r#"<compiler eulerseq="ZYx" balanceinertia="true" settotalmass="30"/><option gravity="1 2 -9"/>"#;
        let text = format!(
            r#"<mujoco>{settings}<worldbody><body name="root">{root}<geom size=".2"/>{body}</body></worldbody>{equality}</mujoco>"#
        );
        std::fs::write(&path, text).expect("a file");
        let gap = apart(&python, &path, 100).expect("read by both");
        assert!(gap < 1e-9, "{root}: accelerations are {gap:.1e} from MuJoCo's");
    }
    for name in ["ant", "anymal", "cube"] {
        let gap = apart(&python, &Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../nerd-sim/assets/{name}.urdf")), 100);
        assert!(*gap.as_ref().expect("read by both") < 1e-9, "{name}: accelerations are {gap:?} from MuJoCo's");
    }
}

/// Policies of random weights: what MuJoCo's player makes of its states by contract and ONNX is what task and policy make of them.
#[test]
fn an_exported_policy_is_played_by_its_contract_alone() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("policy.onnx");
    let task = |name: &str, seen: &str| {
        let path = folder.path().join(name);
        let text = format!("robot = 'anymal'\nsteps = 40\nobservation = ['q - rest', '{seen}', 'action']\nreward = '1'\n");
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
            player::play(python, &out, &contract, &policy, Arena::Truth(Truth::Articulated).episodes(name, 2, 3).expect("episodes"))
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
