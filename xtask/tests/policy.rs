//! `policy` as its users meet it: a short run, stopped and continued, played, shown; and bad input.

mod common;

use common::{refused, xtask};

#[test]
fn a_policy_is_trained_continued_played_and_shown() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let path = |name: &str| folder.path().join(name).to_str().expect("utf-8").to_string();
    let (whole, broken) = (path("whole"), path("broken"));
    let train = |out: &str, iterations: &str, more: &[&str]| {
        let small = ["--envs", "8", "--horizon", "16", "--minibatch", "64", "--seed", "3"];
        let run = xtask(
            &[["policy", "train", "cartpole-swingup", "--iterations", iterations, "--out", out].as_slice(), small.as_slice(), more]
                .concat(),
        );
        assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    };
    train(&whole, "30", &[]);
    train(&broken, "11", &[]);
    train(&broken, "30", &[]);
    let read = |file: String| std::fs::read(&file).unwrap_or_else(|e| panic!("{file}: {e}"));
    let weights = |out: &str| read(format!("{out}/policy/policy.safetensors"));
    assert!(weights(&whole) == weights(&broken), "the broken run's policy differs from the unbroken one's");
    let lines = String::from_utf8(read(format!("{broken}/metrics.jsonl"))).expect("utf-8");
    assert_eq!(lines.lines().count(), 30, "one line for each iteration");
    let card = String::from_utf8(read(format!("{whole}/policy/README.md"))).expect("utf-8");
    assert!(["commit", "command", "machine", "seed"].iter().all(|word| card.contains(word)), "{card}");
    // Asked for again, a finished run stays as it is.
    train(&whole, "30", &[]);
    assert!(card == String::from_utf8_lossy(&read(format!("{whole}/policy/README.md"))), "a finished run's card has changed");
    let other = ["policy", "train", "cartpole-swingup", "--solver", "rapier", "--out", &whole];
    ["another --out", "articulated accurate", "rapier 16 steps"].iter().for_each(|word| refused(&other, word));

    let (policy, table, page) = (format!("{whole}/policy"), path("tables"), path("page.html"));
    let run = xtask(&["policy", "evaluate", "--policy", &policy, "--games", "3", "--truth-only", "--out", &table]);
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let json: serde_json::Value = serde_json::from_slice(&read(format!("{table}/policy/result.json"))).expect("JSON");
    assert!(json["provenance"]["commit"].is_string() && json["rows"][0]["real"]["mean"].as_f64().is_some(), "{json}");
    let run = xtask(&["policy", "show", "--policy", &policy, "--out", &page]);
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let html = String::from_utf8(read(page)).expect("utf-8");
    assert!(html.contains("\"poses\":[[[") && !html.contains("http") && !html.contains("src="), "a page that loads nothing");
    refused(&["policy", "evaluate", "ant-run", "--policy", &policy], "knows its task");
    refused(&["policy", "show", "ant-run", "--policy", &policy, "--out", &path("no.html")], "knows its task");
    // The weights of the policy under another task's name.
    let config = std::fs::read_to_string(format!("{whole}/policy/config.json")).expect("text");
    std::fs::write(format!("{whole}/policy/config.json"), config.replace("cartpole-swingup", "ant-run")).expect("written");
    refused(&["policy", "evaluate", "--policy", &policy], "ant-run` needs");
}

#[test]
fn what_cannot_be_trained_is_refused_in_one_line() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let settings = folder.path().join("wrong.toml");
    std::fs::write(&settings, "environments = 8\nhurry = 1\n").expect("written");
    let (settings, out) = (settings.to_str().expect("utf-8"), folder.path().join("run"));
    let out = out.to_str().expect("utf-8");
    for (args, culprit) in [
        (["policy", "train", "juggle"].as_slice(), "juggle"),
        (&["policy", "train", "ant-run", "--envs", "0"], "environments"),
        (&["policy", "train", "ant-run", "--iterations", "0"], "--iterations"),
        (&["policy", "train", "ant-run", "--horizon", "1000000000000"], "horizon"),
        (&["policy", "train", "ant-run", "--envs", "18446744073709551615"], "environments"),
        (&["policy", "train", "ant-run", "--envs", "1000000", "--horizon", "2000"], "memory"),
        (&["policy", "train", "ant-run", "--minibatch", "0"], "minibatch"),
        (&["policy", "train", "ant-run", "--until", "nan"], "--until"),
        (&["policy", "train", "ant-run", "--minutes=-1"], "--minutes"),
        (&["policy", "train", "ant-run", "--model", "models/ant"], "--model"),
        (&["policy", "train", "ant-run", "--device", "cuda"], "--device"),
        (&["policy", "train", "ant-run", "--solver", "magic"], "magic"),
        (&["policy", "train", "ant-run", "--solver", "neural", "--model", "nowhere"], "nowhere"),
        (&["policy", "train", "ant-run", "--config", settings], "hurry"),
        (&["policy", "evaluate", "--policy", "nowhere"], "nowhere"),
        (&["policy", "co-train", "juggle"], "juggle"),
        (&["policy", "co-train", "ant-run", "anymal-side"], "`anymal`"),
        (&["policy", "co-train", "ant-run", "--rounds", "0"], "--rounds"),
        (&["policy", "co-train", "ant-run"], "--recipe"),
        (&["policy", "co-train", "ant-run", "--model", "models/cartpole-paper"], "cartpole-paper"),
    ] {
        let args = if args[1].ends_with("train") { [args, &["--out", out]].concat() } else { args.to_vec() };
        refused(&args, culprit);
        assert!(!std::path::Path::new(out).exists(), "{args:?} left something");
    }
}
