//! Bad input ends with exit code 1 or 2, one line that names the culprit, and no file.

use crate::{Folder, command, refused};

/// Command lines, and after `=>` the culprit that the refusal names; OUT is a place where no file may be left.
const LINES: &str = include_str!("refusals.txt");

#[test]
fn bad_input_gets_one_line_and_no_file() {
    let folder = Folder::new();
    let header = "traj,step,q1,q2,qd1,qd2\n";
    for (name, rows) in [
        ("good.csv", "0,0,0.1,0.2,0,0\n0,1,,,,\n"),
        ("letters.csv", "0,0,0.1,x,0,0\n"),
        ("late.csv", "0,1,0.1,0.2,0,0\n"),
        ("starts.csv", "0,0,0,0,0,0\n"),
        ("many.csv", &(0..2000).map(|traj| format!("{traj},0,0,0,0,0\n")).collect::<String>()),
    ] {
        folder.write(name, format!("{header}{rows}"));
    }
    folder.write("empty.csv", "");
    folder.write("mb.toml", "environments = 4\nhorizon = 8\nminibatch = 33\n");
    folder.write("wrong.toml", "robot = \"cartpole\"\nhurry = 1\n");
    let out = folder.path("out");
    let place = |word: &str| match word {
        "OUT" => out.display().to_string(),
        file if ["csv", "toml"].iter().any(|end| file.ends_with(end)) && !file.contains('/') => {
            folder.path(file).display().to_string()
        }
        word => word.into(),
    };
    for (line, culprit) in LINES.lines().filter_map(|line| line.split_once(" => ")) {
        let line = line.split(' ').map(place).collect::<Vec<_>>().join(" ");
        refused(&line, &[], culprit);
        assert!(!out.exists(), "{line} left something");
    }
}

/// 2 where the command line cannot be read, 1 where what it asks for fails.
#[test]
fn wrong_usage_and_failures_have_codes_of_their_own() {
    for (line, code) in [
        ("list nothing", 2),
        ("rollout --nonsense", 2),
        ("evaluate --robot aunt", 1),
        ("inspect --robot aunt", 1),
        ("calibrate --solver magic", 2),
    ] {
        let run = command(line, &[]).output().expect("xtask starts");
        assert_eq!(run.status.code(), Some(code), "{line}: {}", String::from_utf8_lossy(&run.stderr));
    }
}

/// A success, a usage error and a failure with old names each have one line that names the new ones.
#[test]
fn old_names_are_read_with_one_line_that_names_the_new_ones() {
    let line = "evaluate --robot cartpole --frames 5 --solver articulated(settled)";
    let [(old, told), (new, quiet)] =
        ["--starts", "--trajectories"].map(|count| crate::done(&format!("{line} {count} 2"), &[]));
    assert_eq!(old, new);
    let notes =
        |text: &str| text.lines().filter(|line| line.starts_with("note: `--")).map(String::from).collect::<Vec<_>>();
    assert_eq!(notes(&told), ["note: `--starts` is `--trajectories`; old names are read for one version"]);
    assert!(notes(&quiet).is_empty() && quiet.contains("as `articulated accurate` to the bit"), "{quiet}");
    refused("policy evaluate --games 0", &[], "`--games` is `--episodes`");
    refused("evaluate --robot aunt --starts 2", &[], "`--starts` is `--trajectories`");
}

#[test]
fn asked_for_nothing_it_lists_its_verbs() {
    for (line, verbs) in [("", ["dataset", "rollout", "check"]), ("policy", ["train", "evaluate", "show"])] {
        let run = command(line, &[]).output().expect("xtask starts");
        let help = String::from_utf8_lossy(&run.stderr);
        assert_eq!(run.status.code(), Some(2), "{help}");
        assert!(verbs.iter().all(|verb| help.contains(&format!("\n  {verb} "))), "{help}");
    }
}

/// For every verb and option, before anything is measured or written.
#[cfg(unix)]
#[test]
fn paths_that_are_not_utf8_are_refused_at_the_start() {
    use std::os::unix::ffi::OsStrExt;
    let folder = Folder::new();
    let odd = folder.0.path().join(std::ffi::OsStr::from_bytes(b"caf\xe9"));
    let lines = "policy train cartpole-swingup --iterations 1 --out\npolicy train\npolicy train cartpole-swingup --config\ncheck-robots\nevaluate --robot \
                 pendulum --out\nchart --out\nreproduce --out\nrollout --robot pendulum --states\ndataset --robot pendulum --out\ntrain\ntrain \
                 --recipe small --from\ninspect --robot\nlive --policy\nlist robots --model\nreport --out";
    for line in lines.lines() {
        refused(line, &[&odd], "is not UTF-8");
    }
    assert!(!odd.exists());
    // The program also runs inside a folder of such a name.
    std::fs::create_dir(&odd).expect("a folder");
    let mut command =
        command("policy train cartpole-swingup --envs 4 --horizon 4 --iterations 1 --minibatch 8 --out run", &[]);
    let run = command.current_dir(&odd).output().expect("xtask starts");
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    assert!(odd.join("run/policy/policy.safetensors").exists());
}

/// For every verb that writes: a file of that name which the program did not write stays, byte by byte. The program's
/// own files are written again.
#[test]
fn files_of_a_users_own_are_not_replaced() {
    const TRAIN: &str = "train --robot pendulum --recipe small --embedding 8 --layers 1 --history 4 --transitions 200 --frames 20 --updates 2 \
                         --batch 4 --rollouts 1 --out";
    const POLICY: &str = "policy train cartpole-swingup --envs 4 --horizon 4 --iterations 1 --minibatch 8 --out";
    const OWN: &[u8] = b"{\"step\": 1, \"loss\": 0.5}\n";
    let folder = Folder::new();
    let states = folder.write("states.csv", "traj,step,q1,q2,qd1,qd2\n0,0,0.1,0.2,0,0\n");
    let policy = "models/policies/cartpole-swingup-neural-200";
    let rollout = format!("rollout --robot pendulum --frames 3 --states {} --out", states.display());
    for (line, names) in [
        (
            TRAIN,
            "metrics.jsonl run.json sessions.jsonl last.safetensors best.safetensors model/README.md model/config.json",
        ),
        (
            POLICY,
            "metrics.jsonl run.json sessions.jsonl last.safetensors policy/README.md policy/policy.safetensors policy/task.toml",
        ),
        ("dataset --robot pendulum --transitions 40 --frames 4 --out", "manifest.json shard-00000.safetensors"),
        (
            "evaluate --robot pendulum --solver rapier --trajectories 1 --frames 3 --out",
            "passive/README.md passive/result.json passive/notes.txt",
        ),
        ("check-robots nerd-core/assets/arm.urdf --out", "urdfs/README.md urdfs/result.json"),
        (&rollout, "r.csv states.csv"),
        (&format!("policy show --policy {policy} --out"), "show.html"),
        (&format!("policy export --policy {policy} --out"), "p.onnx p.json"),
    ] {
        let verb = line.split(' ').take(2).collect::<Vec<_>>().join("-");
        for (k, name) in names.split(' ').enumerate() {
            let place = folder.path(&format!("{verb}-{k}"));
            std::fs::create_dir_all(place.join(name).parent().expect("a folder")).expect("folders");
            let own: &[u8] = if name == "states.csv" {
                b"traj,step,q1,q2,qd1,qd2\n0,0,0.10,0.2,0,0\n0,1,0.10,0.2,0,0\n"
            } else {
                OWN
            };
            std::fs::write(place.join(name), own).expect("written");
            let file = [".csv", ".html", ".onnx", ".json"].iter().any(|end| name.ends_with(end))
                && !line.contains("train")
                && !name.contains('/');
            let file = file && !line.starts_with("dataset");
            let out = if file { place.join(name.replace(".json", ".onnx")) } else { place.clone() };
            refused(line, &[&out], name.split('/').next().unwrap_or_default());
            assert_eq!(crate::bytes(place.join(name)), own, "{line}: {name} was replaced");
            let kept = std::fs::read_dir(place.join(name).parent().expect("a folder")).expect("a folder").count();
            assert_eq!(kept, 1, "{line}: something was left beside {name}");
        }
        let (_, first) = (names, names.split(' ').next().unwrap_or_default());
        let fresh = folder.path(&format!("{verb}-fresh"));
        let out = if first.ends_with("csv") || first.ends_with("html") || first.ends_with("onnx") {
            fresh.join(first)
        } else {
            fresh
        };
        crate::done(line, &[&out]);
        crate::done(line, &[&out]);
    }
}
