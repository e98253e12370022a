//! Runs of seconds: what they leave, how they are stopped, continued and refused to others.

use std::process::{Child, Stdio};
use std::{path::Path, time::Duration};

use crate::{Folder, bytes, command, done, json, refused, root, text};

/// A model of seconds; its folder follows.
const TRAIN: &str =
    "train --robot cartpole --recipe small --transitions 20000 --updates 6 --batch 16 --rollouts 2 --validate-every 3 --out";
const POLICY: &str = "policy train cartpole-swingup --envs 8 --horizon 16 --minibatch 64 --seed 3";

/// Starts a run, waits until it has gone so far, and kills it.
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
    for (option, was) in [("--rate 0.002", "0.001"), ("--hold 2", "`hold` was 1"), ("--frames 50", "`frames` was 100")] {
        refused(&TRAIN.replace("--out", &format!("{option} --out")), &[&out], was);
    }
    let model = out.join("model");
    let evaluate = format!("evaluate --solver neural --starts 2 --frames 5 --model {}", model.display());
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
    killed(&long, &out, || std::fs::read_to_string(&metrics).is_ok_and(|lines| lines.matches("validation").count() > 1));
    // A line cut short: its minutes are missing, the model is not.
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
    let (file, [first, second]) = (folder.write("my.toml", settings), ["first", "second"].map(|name| folder.path(name)));
    done(&format!("train {} --updates 6 --out", file.display()), &[&first]);
    done(TRAIN, &[&second]);
    let weights = |out: &Path| bytes(out.join("model/model.safetensors"));
    assert!(weights(&first) == weights(&second), "the same settings, from a file and from options, led to other weights");
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
    assert!(row["iterations"] == 30.0 && row["steps/s"].is_null() && again.1.contains("were done before; more --iterations"), "{again:?}");
    assert_eq!(text(whole.join("metrics.jsonl")).lines().count(), 30, "one line for each iteration");
    let card = text(whole.join("policy/README.md"));
    assert!(["commit", "command", "machine", "seed"].iter().all(|word| card.contains(word)), "{card}");
    refused("policy train cartpole-swingup --solver rapier --out", &[&whole], "another --out");
    let policy = whole.join("policy");
    done(&format!("policy evaluate --games 3 --truth-only --policy {} --out", policy.display()), &[&table]);
    let json = json(table.join("policy/result.json"));
    assert!(json["provenance"]["commit"].is_string() && json["rows"][0]["real"]["mean"].as_f64().is_some(), "{json}");
    done(&format!("policy show --policy {} --out", policy.display()), &[&page]);
    let html = text(&page);
    assert!(html.contains("\"poses\":[[[") && !html.contains("http") && !html.contains("src="), "a page that loads nothing");
    let walker = folder.path("walker");
    let crawler = folder.path("crawler.urdf");
    std::fs::copy(root().join("nerd-sim/assets/ant.urdf"), &crawler).expect("copied");
    folder.write("crawler.toml", "like = \"urdf\"\nfloating = true\n");
    let train = format!("policy train walk --robot {} --envs 2 --horizon 8 --minibatch 16 --iterations 1 --out", crawler.display());
    done(&train, &[&walker]);
    refused("policy evaluate --policy", &[&walker.join("policy")], "models/crawler: there is no model: train one");
    let show = format!("policy show --policy {} --command", walker.join("policy").display());
    done(&format!("{show} ahead=0.50,turn=-0.25,aside=0 --out"), &[&page]);
    let html = text(&page);
    assert!(html.contains("walk-crawler in articulated accurate, ahead 0.5, aside 0, turn -0.25"), "{}", &html[..html.len().min(400)]);
    refused(&format!("{show} speed=1 --out"), &[&page], "choose from ahead, aside, turn");
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
