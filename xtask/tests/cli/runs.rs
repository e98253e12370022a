//! Runs of seconds: files that they leave; how they are stopped, continued and refused.

use std::process::{Child, Stdio};
use std::{path::Path, time::Duration};

use crate::{Folder, bytes, command, done, json, refused, root, text};

/// Trains a model in seconds; its folder follows.
const TRAIN: &str = "train --robot cartpole --recipe small --transitions 20000 --updates 6 --batch 16 --rollouts 2 --validate-every 3 --out";
const POLICY: &str = "policy train cartpole-swingup --envs 8 --horizon 16 --minibatch 64 --seed 3";

/// Starts a run, waits until `far` holds, and kills the run.
fn killed(line: &str, out: &Path, far: impl Fn() -> bool) {
    let mut child: Child = command(line, &[out]).stderr(Stdio::null()).stdout(Stdio::null()).spawn().expect("started");
    while !far() {
        assert!(child.try_wait().expect("a state").is_none(), "the run ended by itself");
        std::thread::sleep(Duration::from_millis(5));
    }
    child.kill().expect("killed");
    child.wait().expect("ended");
}

#[test]
fn a_model_is_trained_called_again_used_and_refused_to_others() {
    let folder = Folder::new();
    let (out, table) = (folder.path("run"), folder.path("table"));
    let weights = || bytes(out.join("model/model.safetensors"));
    done(TRAIN, &[&out]);
    let first = weights();
    done(TRAIN, &[&out]);
    assert!(first == weights(), "a finished run that is called again changes nothing");
    refused(&TRAIN.replace("cartpole", "pendulum"), &[&out], "cartpole");
    for (option, was) in
        [("--learning-rate 0.002", "0.001"), ("--hold 2", "`hold` was 1"), ("--frames 50", "`frames` was 100")]
    {
        refused(&TRAIN.replace("--out", &format!("{option} --out")), &[&out], was);
    }
    let model = out.join("model");
    let evaluate = format!("evaluate --solver neural --trajectories 2 --frames 5 --model {}", model.display());
    done(&format!("{evaluate} --robot cartpole --out"), &[&table]);
    let json = json(table.join("passive/result.json"));
    for field in ["commit", "command", "machine", "seed", "date"] {
        assert!(!json["provenance"][field].is_null(), "no {field} in {json}");
    }
    assert!(json["rows"][0]["report"]["error"][0].as_f64().is_some_and(f64::is_finite), "{json}");
    for (more, culprit) in [
        ("--robot pendulum", "`cartpole`"),
        ("--robot cartpole --preset converged", "--preset"),
        ("--robot cartpole --truth paper", "`articulated accurate`, not `articulated paper coulomb`"),
    ] {
        refused(&format!("{evaluate} {more}"), &[], culprit);
    }
}

#[test]
fn a_killed_run_is_finished_and_what_is_damaged_is_named() {
    let folder = Folder::new();
    let out = folder.path("run");
    let metrics = out.join("metrics.jsonl");
    let long = TRAIN.replace("--updates 6", "--updates 1000000");
    killed(&long, &out, || {
        std::fs::read_to_string(&metrics).is_ok_and(|lines| lines.matches("validation").count() > 1)
    });
    // With a line cut short, minutes are missing, but the model is not.
    let sessions = out.join("sessions.jsonl");
    let cut = std::fs::read_to_string(&sessions).unwrap_or_default() + "{\"first\": 6, \"la";
    std::fs::write(&sessions, cut).expect("written");
    let finish = long.replace("--out", "--finish --out");
    assert!(done(&finish, &[&out]).1.contains("sessions.jsonl, line"));
    assert!(text(out.join("model/README.md")).contains("the run was ended there"));
    let best = out.join("best.safetensors");
    let mut damaged = bytes(&best);
    *damaged.last_mut().expect("bytes") ^= 1;
    std::fs::write(&best, damaged).expect("written");
    refused(&finish, &[&out], "best.safetensors is damaged");
}

#[test]
fn a_file_has_the_keys_of_the_options_which_override_it() {
    let folder = Folder::new();
    let settings = "robot = \"cartpole\"\nembedding = 48\nlayers = 2\nhead-width = 12\nvalidation-windows = 4096\nlog-every = 20\n\
                    transitions = 20000\nupdates = 600\nbatch = 16\nrollouts = 2\nvalidate-every = 3\n";
    let (file, [first, second]) =
        (folder.write("my.toml", settings), ["first", "second"].map(|name| folder.path(name)));
    done(&format!("train {} --updates 6 --out", file.display()), &[&first]);
    done(TRAIN, &[&second]);
    let weights = |out: &Path| bytes(out.join("model/model.safetensors"));
    assert!(
        weights(&first) == weights(&second),
        "the same settings, from a file and from options, led to other weights"
    );
    let stopped = done(&TRAIN.replace("--updates 6", "--updates 1000000 --minutes 0.0001"), &[&folder.path("third")]).1;
    assert!(stopped.contains("stopped at update"), "{stopped}");
}

#[test]
fn a_policy_is_trained_continued_played_and_shown() {
    let folder = Folder::new();
    let [whole, table, page] = ["whole", "tables", "page.html"].map(|name| folder.path(name));
    let train = |out: &Path, iterations: usize| done(&format!("{POLICY} --iterations {iterations} --out"), &[out]);
    train(&whole, 11);
    train(&whole, 30);
    let again = done(&format!("{POLICY} --iterations 30 --json --out"), &[&whole]);
    let row = &serde_json::from_str::<serde_json::Value>(&again.0).expect("JSON")["policy"][0];
    assert!(
        row["iterations"] == 30.0
            && row["steps/s"].is_null()
            && again.1.contains("were done before; more --iterations"),
        "{again:?}"
    );
    assert_eq!(text(whole.join("metrics.jsonl")).lines().count(), 30, "one line for each iteration");
    let card = text(whole.join("policy/README.md"));
    assert!(["commit", "command", "machine", "seed"].iter().all(|word| card.contains(word)), "{card}");
    refused("policy train cartpole-swingup --solver rapier --out", &[&whole], "another --out");
    let policy = whole.join("policy");
    done(&format!("policy evaluate --episodes 3 --truth-only --policy {} --out", policy.display()), &[&table]);
    let json = json(table.join("policy/result.json"));
    assert!(json["provenance"]["commit"].is_string() && json["rows"][0]["real"]["mean"].as_f64().is_some(), "{json}");
    done(&format!("policy show --policy {} --out", policy.display()), &[&page]);
    let html = text(&page);
    assert!(
        html.contains("\"poses\":[[[") && !html.contains("http") && !html.contains("src="),
        "a page that loads nothing"
    );
    let walker = folder.path("walker");
    let crawler = folder.path("crawler.urdf");
    std::fs::copy(root().join("nerd-sim/assets/ant.urdf"), &crawler).expect("copied");
    folder.write("crawler.toml", "like = \"urdf\"\nfloating = true\n");
    let train = format!(
        "policy train walk --robot {} --envs 2 --horizon 8 --minibatch 16 --iterations 1 --out",
        crawler.display()
    );
    done(&train, &[&walker]);
    refused("policy evaluate --policy", &[&walker.join("policy")], "models/crawler: there is no model: train one");
    let show = format!("policy show --policy {} --command", walker.join("policy").display());
    done(&format!("{show} vx=0.50,yaw_rate=-0.25,vy=0 --out"), &[&page]);
    let html = text(&page);
    assert!(
        html.contains("walk-crawler in articulated, vx 0.5, vy 0, yaw_rate -0.25"),
        "{}",
        &html[..html.len().min(400)]
    );
    refused(&format!("{show} speed=1 --out"), &[&page], "choose from vx, vy, yaw_rate");
    // The weights of the policy under another task's name.
    let config = text(policy.join("config.json"));
    std::fs::write(policy.join("config.json"), config.replace("cartpole-swingup", "ant-run")).expect("written");
    refused("policy evaluate --policy", &[&policy], "ant-run` needs");
}

#[test]
fn a_data_set_has_one_writer_at_a_time() {
    let folder = Folder::new();
    let out = folder.path("data");
    let small = "dataset --robot pendulum --transitions 300 --frames 30 --seed 1 --out";
    let first = || out.join("shard-00000.safetensors").exists();
    let checked = || {
        let there = first();
        if there {
            refused(small, &[&out], "in use");
        }
        there
    };
    killed("dataset --robot pendulum --transitions 1000000000 --out", &out, checked);
    done(small, &[&out]);
}

/// In a long run of a policy and of a model.
#[cfg(unix)]
#[test]
fn a_signal_ends_a_run_with_a_checkpoint_a_policy_and_its_own_code() {
    use std::time::Instant;
    const POLICY: &str =
        "policy train cartpole-swingup --envs 16 --horizon 16 --iterations 1000000 --minibatch 64 --out";
    const MODEL: &str = "train --robot cartpole --recipe small --embedding 16 --layers 1 --history 4 --transitions 4000 --frames 20 --updates \
                         10000000 --batch 16 --rollouts 2 --validate-every 3 --log-every 3 --out";
    for (line, signal, code, left) in [
        (
            POLICY,
            "-INT",
            130,
            &["last.safetensors", "policy/policy.safetensors", "policy/config.json", "sessions.jsonl"][..],
        ),
        (POLICY, "-TERM", 143, &["last.safetensors", "policy/policy.safetensors"]),
        (MODEL, "-TERM", 143, &["last.safetensors", "best.safetensors", "sessions.jsonl"]),
    ] {
        let folder = Folder::new();
        let out = folder.path("run");
        // The second run continues from the first one's checkpoint.
        for _ in 0..2 {
            let seen = text_or_none(&out.join("metrics.jsonl"));
            let mut run = command(line, &[&out])
                .stdout(std::process::Stdio::null())
                .stderr(std::process::Stdio::piped())
                .spawn()
                .expect("starts");
            let begun = Instant::now();
            while text_or_none(&out.join("metrics.jsonl")).len() <= seen.len() {
                assert!(begun.elapsed() < Duration::from_secs(120), "{line}: nothing was learned in two minutes");
                std::thread::sleep(Duration::from_millis(20));
            }
            std::thread::sleep(Duration::from_millis(200));
            let asked =
                std::process::Command::new("kill").args([signal, &run.id().to_string()]).status().expect("kill runs");
            let begun = Instant::now();
            let ended = run.wait().expect("ends");
            let mut said = String::new();
            std::io::Read::read_to_string(&mut run.stderr.take().expect("piped"), &mut said).expect("a text");
            assert!(asked.success() && ended.code() == Some(code), "{line}: {signal} ended it with {ended}: {said}");
            assert!(begun.elapsed() < Duration::from_secs(30), "{line}: it took {:?} to end", begun.elapsed());
            assert!(said.contains("the same command goes on from it"), "{line}: {said}");
            let missing: Vec<_> = left.iter().filter(|name| !out.join(name).exists()).collect();
            assert!(missing.is_empty(), "{line}: no {missing:?} after {signal}");
        }
    }
}

#[cfg(unix)]
fn text_or_none(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_default()
}

/// With a step of a thousand frames, and with data that takes hours to record.
#[test]
fn minutes_are_obeyed_while_anything_long_runs() {
    let folder = Folder::new();
    let task = |frames: u32| {
        let text =
            format!("robot = \"ant\"\nsteps = 100\nframes = {frames}\nobservation = [\"q\", \"qd\"]\nreward = \"1\"\n");
        folder.write(&format!("task{frames}.toml"), text).display().to_string()
    };
    refused(
        &format!("policy train {} --minutes 0.01 --out", task(1_000_000_000)),
        &[&folder.path("a")],
        "frames is 1000000000",
    );
    let long = format!("policy train {} --envs 4 --horizon 1000 --minutes 0.01 --out", task(1000));
    let begun = std::time::Instant::now();
    refused(&long, &[&folder.path("b")], "stopped in the first iteration");
    let policy = begun.elapsed().as_secs_f64();
    refused(
        "train --robot ant --transitions 1000000 --minutes 0.01 --out",
        &[&folder.path("c")],
        "time was over while data was recorded",
    );
    let both = begun.elapsed().as_secs_f64();
    assert!(policy < 60.0 && both < 90.0, "after {policy:.0} s and {both:.0} s, 0.6 s and a few were asked for");
    assert!(!folder.path("b").exists() && !folder.path("c").exists());
}

/// Memory has room for the stacks of few threads: a line says so, and one thread does the work. Stacks are large, so
/// that the last one that does not fit leaves room for everything else.
#[cfg(target_os = "linux")]
#[test]
fn threads_that_cannot_be_had_are_a_line() {
    let folder = Folder::new();
    let line =
        format!("ulimit -v 1000000; exec {} {SMALL} {}", env!("CARGO_BIN_EXE_xtask"), folder.path("run").display());
    let run = std::process::Command::new("sh")
        .args(["-c", &line])
        .envs([("RAYON_NUM_THREADS", "2000"), ("RUST_MIN_STACK", "100000000")])
        .output()
        .expect("starts");
    let said = String::from_utf8_lossy(&run.stderr);
    assert!(run.status.success() && said.contains("no threads can be started"), "{}: {said}", run.status);
    assert!(folder.path("run/model/model.safetensors").exists());
}

/// A model of no worth, in a second.
#[cfg(target_os = "linux")]
const SMALL: &str = "train --robot pendulum --recipe small --embedding 8 --layers 1 --history 4 --transitions 200 --frames 20 --updates 2 --batch 4 \
                     --rollouts 1 --out";
