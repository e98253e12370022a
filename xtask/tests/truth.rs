//! Models of another truth: data of rapier are the same bytes for any number of threads, and a model that learned from them
//! is held against rapier and nothing else.

mod common;

use std::path::Path;
use std::process::Command;

use common::{refused, xtask};

const NAME: &str = "rapier 16 steps 4 iterations";

fn done(args: &[&str]) {
    let run = xtask(args);
    assert!(run.status.success(), "{args:?}: {}", String::from_utf8_lossy(&run.stderr));
}

fn json(path: &Path) -> serde_json::Value {
    serde_json::from_slice(&std::fs::read(path).expect("written")).expect("JSON")
}

#[test]
fn data_of_rapier_are_the_same_bytes_for_any_number_of_threads() {
    let folder = tempfile::tempdir().expect("temporary folder");
    for robot in ["pendulum", "ant"] {
        let shard = |threads: &str| {
            let out = folder.path().join(robot).join(threads);
            let run = Command::new(env!("CARGO_BIN_EXE_xtask"))
                .args(["dataset", "--robot", robot, "--truth", "rapier", "--transitions", "720", "--frames", "20", "--seed", "3", "--out"])
                .arg(&out)
                .env("RAYON_NUM_THREADS", threads)
                .output()
                .expect("xtask starts");
            assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
            std::fs::read(out.join("shard-00000.safetensors")).expect("a shard")
        };
        let (one, two) = (shard("1"), shard("2"));
        assert!(one == two, "{robot}: one thread and two record other bytes");
    }
}

#[test]
fn a_model_of_rapier_is_held_against_rapier() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let path = |name: &str| folder.path().join(name).to_str().expect("utf-8").to_string();
    let (data, out, table) = (path("data"), path("run"), path("table"));
    let model = path("run/model");
    done(&["dataset", "--robot", "pendulum", "--truth", "rapier", "--transitions", "2000", "--out", &data]);
    let train = |truth: &str, out: &str, check: &dyn Fn(&[&str])| {
        let small = ["--recipe", "small", "--transitions", "1000", "--updates", "6", "--batch", "16", "--rollouts", "1"];
        let run = ["train", "--robot", "pendulum", "--base", "flight", "--truth", truth, "--data", &data, "--out", out];
        check(&[&run[..], &small].concat());
    };
    train("articulated", &path("other"), &|args| refused(args, NAME));
    train("rapier", &out, &done);
    let config = json(&folder.path().join("run/model/config.json"));
    assert_eq!((&config["truth"], &config["base"]), (&NAME.into(), &"exact_flight".into()), "{config}");

    let learned = ["--solver", "neural", "--model", &model];
    let measure = [&["evaluate", "--robot", "pendulum", "--scene", "ground1", "--starts", "2", "--frames", "5"][..], &learned].concat();
    done(&[&measure[..], &["--out", &table]].concat());
    let row = &json(&Path::new(&table).join("passive/result.json"))["rows"][0];
    assert_eq!((&row["truth"], &row["paper"]), (&NAME.into(), &serde_json::Value::Null), "{row}");
    done(&[&measure[..], &["--truth", "rapier"]].concat());
    refused(&[&measure[..], &["--truth", "articulated"]].concat(), "`rapier 16 steps 4 iterations`, not `articulated accurate`");

    let charts = path("charts");
    let short = ["--starts", "1", "--frames", "2", "--substeps", "1", "--scene", "ground1", "--model", &model, "--out", &charts];
    done(&[&["chart", "--robot", "pendulum"][..], &short].concat());
    let chart = json(&folder.path().join("charts/chart-pendulum-ground1/result.json"));
    let points = chart["points"].as_array().expect("points");
    let learned = points.iter().find(|p| p["series"].as_str().is_some_and(|s| s.starts_with("NeRD "))).expect("the model");
    assert!(learned["own"] == true && learned["series"].as_str().is_some_and(|s| s.ends_with(NAME)), "{learned}");
}
