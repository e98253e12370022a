//! Tasks from files: equality with the former Rust versions, refusals, and no text that crashes the reader.

use nerd_sim::articulated::device::Reach;
use nerd_sim::prelude::*;
use nerd_tasks::{Compiled, FileTask, Task, View, Work, named};

use crate::some;

const STATES: usize = 200;

/// Observation; torques; and reward, error and end of a task in state k.
fn said(task: &Compiled, work: &mut Work, scene: &Scene, k: usize) -> [Vec<f64>; 3] {
    let system = work.system.clone();
    let mut state = task.reset(&system, &mut stream(1, k as u64));
    state.iter_mut().zip(some(system.robot.state_dim(), k, 0.5)).for_each(|(x, y)| *x += y);
    let mut goal = vec![0.0; task.goal_dim()];
    task.draw_goal(&mut stream(2, k as u64), &mut goal);
    let view = View { state: &state, goal: &goal, scene };
    let (mut seen, mut torques) = (vec![0.0; task.observation_dim()], vec![0.0; system.robot.joint_count()]);
    task.observe(view, work, &mut seen);
    task.act(view, &some(task.action_dim(), k, 1.2), work, &mut torques);
    let judged = vec![
        task.reward(view, &torques, work),
        task.error(view, work).unwrap_or(-1.0),
        f64::from(u8::from(task.terminated(view, work))),
    ];
    [seen, torques, judged]
}

/// Sums of observations, of torques, and of reward, error and end over [`STATES`] states, from the former Rust tasks.
/// The files gave exactly the same numbers.
const IN_RUST: [(&str, [f64; 3]); 9] = [
    ("cartpole-swingup", [11.294364767008492, 2591.9722545670847, 3752.4535172325836]),
    ("franka-reach", [318.00063502467793, 15.38650322112247, 3656.832115863449]),
    ("franka-reach-torque", [318.00063502467793, 9.855598017402272, 3656.832115863449]),
    ("ant-run", [1016.1294828264802, 200.496420517001, -114.89669919991694]),
    ("ant-spin", [1016.1294828264802, 200.496420517001, -197.28067126826738]),
    ("ant-spin-track", [1016.1294828264802, 200.496420517001, -381.2851051517133]),
    ("ant-point", [974.6951287665278, 200.496420517001, 2924.8071661388562]),
    ("anymal-forward", [1014.1103633991313, -1188.5124946601768, 119.89946701926304]),
    ("anymal-side", [1014.1103633991313, -1188.5124946601768, 95.953363317151]),
];

#[test]
fn files_say_what_rust_said() {
    for (name, expected) in IN_RUST {
        let task = named(name).expect("registered");
        let system = task.system().expect("built in");
        let (mut work, scene, mut sums) = (Work::new(&system), system.scene(task.scene()).expect("a scene"), [0.0; 3]);
        let task = Compiled::new(task, &system);
        for k in 0..STATES {
            for (sum, part) in sums.iter_mut().zip(said(&task, &mut work, &scene, k)) {
                *sum += part.iter().enumerate().map(|(j, x)| x * (1.0 + (j + k) as f64 * 0.01)).sum::<f64>();
            }
        }
        let off = sums.iter().zip(expected).map(|(a, b)| (a - b).abs() / (1.0 + b.abs())).fold(0.0, f64::max);
        assert!(off < 1e-12, "{name}: {sums:?}, {off:.1e} off");
    }
}

/// Invalid files, with key and column of the fault.
#[test]
fn what_is_wrong_with_a_file_is_said_with_its_place() {
    let text = |change: (&str, &str)| {
        let text = include_str!("../../assets/walk.toml");
        assert!(text.contains(change.0), "{change:?}");
        text.replace(change.0, change.1)
    };
    let cases = [
        (("\"up\"", "\"upp\""), "observation.2, column 1: no word `upp`: choose from vx, vy, yaw_rate, action_rate, "),
        (
            ("\"q - default_q\"", "\"q - 2 * velocity\""),
            "observation.4, column 5: 12 numbers with 3: as many are needed, or one",
        ),
        (("max(0, 0.3", "max(0, (0.3"), "reward, column "),
        (("max(0, 0.3", "pow(0.3, 0.3"), "reward, column 8: no function `pow`: choose from exp, "),
        (("step * max(0,", "q + max(0,"), "reward: one number is needed, and this has 12; write sum(..) or mean(..)"),
        (("height < 0.4 * standing", "torque[0] < 1"), "terminated, column 16: `torque` is known in the reward alone"),
        (("gap[body]", "gap[\\\"wing\\\"]"), "terminated, column 51: no link with contact points `wing`: choose from "),
        (
            ("joint_deviation = ", "joint_deviation = \"1 + joint_deviation\"\n#"),
            "let.joint_deviation, column 5: `joint_deviation` speaks of itself",
        ),
        (("vx = ", "mass = "), "command.mass: there is a word `mass`; choose another name"),
        (("joint_deviation = ", "spare = \"uq\"\njoint_deviation = "), "let.spare, column 1: no word `uq`"),
        (("0.1 m/s", "10 cm/s"), "tolerance is \"10 cm/s\": `cm` is no SI unit (m, rad, s, kg, N); write \"0.1 m/s\""),
        (("frames = 4", "frames = 0"), "task `my.toml`: frames is 0; a number from 1 to 1000 is needed"),
        (("0.005", "\"1/50\""), "frame_time: a number of seconds is needed, without quotes"),
        (("0.005", "5.0"), "task `my.toml`: frame_time is 5 s; a number from 1e-6 to 1"),
        (("observation = ", "# "), "task `my.toml`: missing field `observation`"),
        (("\"up\"", "\"up[3]\""), "observation.2, column 4: no number 3: it has 3, counted from 0"),
        (("step * max(0,", "step if up[2] > 0 else max(0,"), "write select(condition, a, b)"),
        (
            ("joint_deviation = ", "spare = [1]\njoint_deviation = "),
            "let.spare is array: an expression in quotes is needed, or a number",
        ),
        (
            ("\"U(-1, 1)\"         #", "\"U(1, -1)\" #"),
            "`U(1, -1)` is not a range: write U(low, high), the low end first, without units",
        ),
        (("frames = 4", "frame = 4"), "unknown field `frame`"),
        (
            ("frames = 4", "levels = 4\nframes = 4"),
            "levels: an episode that succeeds by `error` goes on to higher [terrain]",
        ),
        (
            ("[let]", "[terrain]\nkind = \"mud\"\nheight = 1.0\n[let]"),
            "unknown variant `mud`, expected one of `rubble`",
        ),
        (
            ("[let]", "[terrain]\nkind = \"waves\"\nheight = -1.0\n[let]"),
            "terrain: `height` is -1 m; a number from 0 to 10 is needed",
        ),
        (("\"up\"", "\"height_scan(q, [0])\""), "observation.2, column 13: known numbers are needed"),
        (("\"U(-1, 1)\"         #", "1 #"), "a range \"U(low, high)\" is needed, or a list of them"),
    ];
    let mut wrong = Vec::new();
    for (change, expected) in cases {
        let said =
            FileTask::new("my.toml", &text(change), Some("anymal")).err().map(|e| e.to_string()).unwrap_or_default();
        if !(said.starts_with("task `my.toml`: ") && said.contains(expected) && !said.contains('\n')) {
            wrong.push(format!("{change:?}: {said}"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    // A number is an expression.
    let numbers = text(("joint_deviation = ", "spare = -3\njoint_deviation = ")).replace("\"0.1 m/s\"", "0.1");
    assert_eq!(
        FileTask::new("my.toml", &numbers, Some("anymal")).map(|task| task.tolerance().0).map_err(|e| e.to_string()),
        Ok(0.1)
    );
    let said = |name: &str| named(name).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(said("walk").contains("name one with --robot"), "{}", said("walk"));
    assert!(said("walk@cartpole").contains("the base of `cartpole` is fixed"), "{}", said("walk@cartpole"));
    assert_eq!(
        said("cartpole-swingup@pendulum"),
        "task `cartpole-swingup` is for `cartpole`: those for any robot are walk, rough, stand, reach"
    );
    assert!(named("ant-run@ant").is_ok() && said("wlk@ant").starts_with("no task `wlk`: "), "{}", said("wlk@ant"));
    let lead = said("wlk@no/lead.toml");
    assert!(
        lead.starts_with("no task `wlk` and no file `wlk@no/lead.toml`: choose from ") && lead.contains("walk"),
        "{lead}"
    );
    assert!(said("no/such.toml").contains("no/such.toml"), "{}", said("no/such.toml"));
    assert!(
        said("walk@cube").ends_with("`cube` has no joint that moves: there is nothing to act with"),
        "{}",
        said("walk@cube")
    );
    for (name, [task, robot]) in
        [("a@b/my.toml@c@d/go2.xml", ["a@b/my.toml", "c@d/go2.xml"]), ("walk@lead.toml", ["walk", "lead.toml"])]
    {
        assert_eq!(nerd_tasks::parts(name), (task, Some(robot)));
    }
    assert_eq!(nerd_tasks::parts("a@b/my.toml"), ("a@b/my.toml", None));
}

/// A file with old keys and words is the task of one with the new ones; old and new together are refused.
#[test]
fn old_names_of_a_file_are_read_as_the_new_ones() {
    let new = "terrain = { kind = \"rubble\", height = 0.1 }\nsteps = 9\nframes = 2\nobservation = [\"ang_vel\", \"world_ang_vel\", \"q - default_q\", \
               \"height_scan([0.1], [0])\", \"near\"]\nreward = \"-mean((torque / torque_limit).squared())\"\nterminated = \"height < 0.1\"\n\
               error = \"norm(ang_vel)\"\ntolerance = \"0.5 rad/s\"\n[let]\nnear = \"default_q[0] - scan\"\nscan = \"2\"\n";
    let names = [
        ("world_ang_vel", "world_spin"),
        ("ang_vel", "spin"),
        ("default_q", "rest"),
        ("height_scan(", "scan("),
        ("torque_limit", "most"),
        ("terminated", "over"),
        ("error", "miss"),
        ("tolerance", "allowed"),
    ];
    let old = names.iter().fold(new.to_string(), |text, (new, old)| text.replace(new, old));
    let [task, read] = [new, &old].map(|text| FileTask::new("mine.toml", text, Some("anymal")).expect("a task"));
    let system = task.system().expect("a robot");
    assert_eq!((read.text(), read.tolerance()), (Some(&*old), task.tolerance()));
    let kernels = |task| {
        Compiled::new(Box::new(task) as Box<dyn Task>, &system).kernels(Reach::default(), false).expect("kernels")
    };
    assert_eq!(kernels(task), kernels(read));
    let said = FileTask::new("mine.toml", &new.replacen("error", "miss = \"1\"\nerror", 1), Some("anymal"))
        .err()
        .map(|e| e.to_string());
    let expected = "task `mine.toml`: `miss` is the old name of `error`, and both are given; leave `miss` out";
    assert_eq!(said.as_deref(), Some(expected));
}

/// Every numeric key refuses numbers too large for any run.
#[test]
fn every_number_of_a_file_has_bounds() {
    let whole = "steps = 500\nframes = 4\nsubsteps = 1\nframe_time = 0.005\nactions = 12\nlevels = 4\ntolerance = 0.1\nobservation = [\"q\"]\n\
                 reward = \"1\"\nerror = \"1\"\n[command]\nvx = \"U(-1, 1)\"\n[terrain]\nkind = \"rubble\"\nheight = 0.1\ncell = 0.1\n";
    let read =
        |text: &str| FileTask::new("my.toml", text, Some("anymal")).err().map_or_else(String::new, |e| e.to_string());
    assert_eq!(read(whole), "");
    let mut wrong = Vec::new();
    for line in whole.lines().filter(|line| {
        line.contains(|c: char| c.is_ascii_digit()) && !line.contains("q\"") && !line.starts_with(['r', 'e'])
    }) {
        let (key, _) = line.split_once(" = ").expect("a key");
        for odd in ["1000000000", "9223372036854775807", "-1", "1e300", "-1e300", "inf", "nan"] {
            let value = if key == "vx" { format!("\"U(-1e300, {odd})\"") } else { odd.into() };
            let said = read(&whole.replace(line, &format!("{key} = {value}")));
            if !said.contains(key) || said.lines().count() != 1 {
                wrong.push(format!("{key} = {value}: `{said}`"));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// A height scan follows the root's heading at any tilt; on flat ground it is flat.
#[test]
fn a_height_scan_looks_ahead() {
    let text = |terrain: &str| {
        format!(
            "steps = 1\nactions = 1\nact = \"[]\"\nscene = \"plane\"\nobservation = [\"height_scan([0.3, -0.2], [0, 0.1])\", \"ground\", \"height\"]\nreward = \"1\"\n{terrain}"
        )
    };
    let rough = text("[terrain]\nkind = \"rubble\"\nheight = 0.2").replace("scene = \"plane\"\n", "");
    for (text, flat) in [(rough, false), (text(""), true)] {
        let task = FileTask::new("height_scan", &text, Some("cube")).expect("a task");
        let system = Task::system(&task).expect("the cube");
        let (scene, mut seen) =
            (system.scene(Task::scene(&task)).expect("its scene"), vec![0.0; task.observation_dim()]);
        let mut state = system.default_state();
        state[..3].copy_from_slice(&[1.3, -0.7, 0.9]);
        // A quarter turn left, then nose down and a roll about the nose.
        let turn = |axis: Vector3<f64>, angle: f64| UnitQuaternion::new(axis * angle);
        let pose = turn(Vector3::z(), std::f64::consts::FRAC_PI_2) * turn(Vector3::y(), 0.4) * turn(Vector3::x(), 0.3);
        state[3..7].copy_from_slice(pose.coords.as_slice());
        let task = Compiled::new(Box::new(task) as Box<dyn Task>, &system);
        task.observe(View { state: &state, goal: &[], scene: &scene }, &mut Work::new(&system), &mut seen);
        let below = |x: f64, y: f64| scene.terrain().map_or(0.0, |(_, field)| field.at(x, y).0);
        let ground = below(1.3, -0.7);
        let expected = [below(1.3, -0.4), below(1.2, -0.4), below(1.3, -0.9), below(1.2, -0.9), ground, 0.9 - ground];
        let off = seen.iter().zip(&expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(off < 1e-12 && (ground == 0.0) == flat, "{seen:?}, by hand {expected:?}");
    }
}

/// Mutated files: characters changed, removed or doubled. Each is read or refused.
#[test]
fn no_text_brings_a_task_down() {
    let whole = include_str!("../../assets/walk.toml");
    let letters: Vec<char> = whole.chars().collect();
    let mut read = 0;
    for k in 0..300usize {
        let (at, odd) = (k * 7919 % letters.len(), "()[]{}.\"'-+*/<>&|!,0123456789eqx\\#\n");
        let mut text = letters.clone();
        match k % 3 {
            0 => text[at] = odd.chars().nth(k % odd.len()).unwrap_or(' '),
            1 => _ = text.remove(at),
            _ => text.extend_from_within(at..(at + 40).min(letters.len())),
        }
        let text: String = text.into_iter().collect();
        read += usize::from(FileTask::new("mutant", &text, Some("ant")).is_ok());
    }
    assert!(read > 30 && read < 270, "{read} of 300 were read");
    // Texts nested too deeply for any parser.
    for deep in [
        "(".repeat(1500),
        "-".repeat(1500),
        "1+".repeat(900),
        "return ".repeat(250),
        "!".repeat(40) + "1",
        "[q".to_string() + &",q".repeat(900),
    ] {
        let text = whole.replace("max(0, 0.3", &format!("max(0, {deep} + 0.3"));
        assert!(FileTask::new("deep", &text, Some("ant")).is_err(), "{deep}");
    }
    // Chains of names nested too deeply: 400 names, 16 levels each.
    let chain = |names: usize, each: usize| {
        let name = |k| format!("a{k} = \"{}a{}{}\"\n", "exp(".repeat(each), k + 1, ")".repeat(each));
        let lets: String = (0..names).map(name).collect();
        let text = format!("steps = 5\nobservation = [\"q\"]\nreward = \"a0\"\n[let]\n{lets}a{names} = \"sum(q)\"\n");
        FileTask::new("chain", &text, Some("cartpole")).err().map_or_else(String::new, |e| e.to_string())
    };
    for (names, each) in [(400, 16), (100_000, 0), (5000, 30)] {
        let said = chain(names, each);
        assert!(
            said.contains("go more than 600 deep into each other") && said.lines().count() == 1,
            "{names} names: {said}"
        );
    }
    assert_eq!(chain(40, 6), "");
    let twice = (0..40).map(|k| format!("a{} = \"[a{k}, a{k}]\"\n", k + 1)).collect::<String>();
    let text =
        whole.replace("[let]", &format!("[let]\na0 = \"q\"\n{twice}")).replace("max(0, 0.3", "max(0, sum(a40) + 0.3");
    let said = FileTask::new("twice", &text, Some("ant")).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(said.contains("are borne"), "{said}");
}
