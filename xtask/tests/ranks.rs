//! Real processes: ranks that make one run, that end with each other, and parts of a data set.

mod common;

use std::net::{Ipv4Addr, TcpListener};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use common::{refused, xtask};

/// A run of seconds, in `out`. Losses are logged as often as checkpoints are written at 40 updates, so that means are over the same.
fn small<'a>(out: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    let options = "train --robot pendulum --recipe small --transitions 20000 --fresh 3200 --frames 50 --batch 16 --rollouts 2 \
                   --log-every 4 --validate-every 20 --out";
    options.split_whitespace().chain([out]).chain(more.iter().copied()).collect()
}

fn trained(args: &[&str]) {
    let run = xtask(args);
    assert!(run.status.success(), "{args:?}: {}", String::from_utf8_lossy(&run.stderr));
}

/// Starts so many ranks of one command.
fn start(args: &[&str], world: usize) -> Vec<Child> {
    let port = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).and_then(|free| free.local_addr()).expect("a free port").port();
    let rank = |rank: usize| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_xtask"));
        command.args(args).stdout(Stdio::null()).stderr(Stdio::piped());
        let all = [("RANK", rank), ("WORLD_SIZE", world), ("LOCAL_RANK", rank), ("MASTER_PORT", port.into())];
        command.envs(all.map(|(name, value)| (name, value.to_string()))).env("MASTER_ADDR", "127.0.0.1").env("RAYON_NUM_THREADS", "1");
        command.spawn().expect("started")
    };
    (0..world).map(rank).collect()
}

/// The same, to their ends: what rank 0 said, and whether all is well.
fn among(args: &[&str], world: usize) -> (String, bool) {
    let ended = start(args, world).into_iter().map(|rank| rank.wait_with_output().expect("ended")).collect::<Vec<_>>();
    (String::from_utf8_lossy(&ended[0].stderr).into_owned(), ended.iter().all(|rank| rank.status.success()))
}

/// Waits until a file is there while a process lives.
fn until(there: &Path, child: &mut Child) {
    while !there.exists() {
        assert!(child.try_wait().expect("a state").is_none_or(|status| status.success()), "the run ended by itself");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// (step, loss) of each line of a run's record.
fn losses(out: &Path) -> Vec<(u64, f64)> {
    let text = std::fs::read_to_string(out.join("metrics.jsonl")).expect("a record");
    let line = |line: &str| -> (u64, f64) {
        let line: serde_json::Value = serde_json::from_str(line).expect("JSON");
        (line["step"].as_u64().expect("a step"), line["loss"].as_f64().expect("a loss"))
    };
    text.lines().map(line).collect()
}

/// Largest relative difference of two records of the same steps.
fn off(a: &[(u64, f64)], b: &[(u64, f64)]) -> f64 {
    assert_eq!(a.iter().map(|l| l.0).collect::<Vec<_>>(), b.iter().map(|l| l.0).collect::<Vec<_>>(), "other steps");
    a.iter().zip(b).map(|(a, b)| (a.1 / b.1 - 1.0).abs()).fold(0.0, f64::max)
}

#[test]
fn one_two_and_four_ranks_make_the_same_run_and_one_goes_on_with_anothers() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let place = |name: &str| folder.path().join(name).to_str().expect("utf-8").to_string();
    let alone = place("alone");
    trained(&small(&alone, &["--updates", "40"]));
    let expected = losses(alone.as_ref());
    for ranks in [2, 4] {
        let out = place(&ranks.to_string());
        let (said, well) = among(&small(&out, &["--updates", "40"]), ranks);
        assert!(well, "{ranks} ranks: {said}");
        let off = off(&losses(out.as_ref()), &expected);
        println!("{ranks} ranks: losses from {:.3} to {:.3}, off those of one by {off:.1e}", expected[0].1, expected[expected.len() - 1].1);
        assert!(off < 1e-4 && Path::new(&out).join("model/model.safetensors").exists());
    }
    // Killed on four after its first checkpoint, gone on with on two, killed, and ended by one.
    let out = place("moved");
    for (world, kept) in [(4, "last.safetensors"), (2, "best.safetensors")] {
        let mut ranks = start(&small(&out, &["--updates", "40"]), world);
        until(&Path::new(&out).join(kept), &mut ranks[0]);
        ranks.iter_mut().for_each(|rank| drop(rank.kill()));
        ranks.iter_mut().for_each(|rank| _ = rank.wait().expect("ended"));
    }
    trained(&small(&out, &["--updates", "40"]));
    let off = off(&losses(out.as_ref()), &expected);
    println!("four ranks, then two, then one: off by {off:.1e}");
    assert!(off < 1e-4);
}

#[test]
fn a_killed_rank_ends_the_others_with_its_number() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let out = folder.path().join("run");
    let mut ranks = start(&small(out.to_str().expect("utf-8"), &["--updates", "1000000"]), 3);
    until(&out.join("best.safetensors"), &mut ranks[0]);
    ranks[2].kill().expect("killed");
    let since = Instant::now();
    for (rank, child) in ranks.into_iter().enumerate() {
        let ended = child.wait_with_output().expect("ended");
        let said = String::from_utf8_lossy(&ended.stderr);
        if rank < 2 {
            let last = said.lines().last().unwrap_or_default();
            assert!(ended.status.code() == Some(2) && last.contains("rank 2 of 3 ended: its connection closed"), "rank {rank}: {said}");
            println!("rank {rank} after {:.1} s: {last}", since.elapsed().as_secs_f64());
        }
    }
    assert!(since.elapsed() < Duration::from_secs(30), "{:?}", since.elapsed());
}

#[test]
fn what_cannot_be_shared_out_is_refused_in_a_line() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let out = folder.path().join("run");
    let out = out.to_str().expect("utf-8");
    for parts in ["0/3", "4/3", "1/0", "3", "x/y"] {
        refused(&["dataset", "--robot", "pendulum", "--part", parts, "--out", out], "--part");
    }
    let line = |args: &[&str], variables: &[(&str, &str)]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_xtask"));
        let run = command.args(args).envs(variables.iter().copied()).output().expect("started");
        let said = String::from_utf8_lossy(&run.stderr).into_owned();
        assert!(run.status.code() == Some(2) && said.trim_end().lines().count() == 1, "{args:?}: {said}");
        said
    };
    let all = [("RANK", "0"), ("WORLD_SIZE", "4"), ("LOCAL_RANK", "0"), ("MASTER_ADDR", "127.0.0.1"), ("MASTER_PORT", "1")];
    let train = small(out, &["--updates", "40"]);
    assert!(line(&train, &all[..2]).contains("LOCAL_RANK is not set"));
    assert!(line(&train, &all[..1]).contains("WORLD_SIZE is not set"));
    assert!(line(&["policy", "co-train", "cartpole-swingup", "--out", out], &all).contains("WORLD_SIZE is 4"));
    assert!(line(&["dataset", "--robot", "pendulum", "--out", out], &all).contains("--part"));
    let narrow: Vec<&str> = train.iter().map(|word| if *word == "16" { "1" } else { word }).collect();
    let narrow: Vec<&str> = narrow.into_iter().map(|word| if word == "3200" { "50" } else { word }).collect();
    let (said, well) = among(&narrow, 2);
    assert!(!well && said.contains("--batch 1: 2 ranks"), "{said}");
    assert!(!Path::new(out).exists(), "something was left");
}

#[test]
fn a_policy_learns_the_same_whoever_steps_its_environments() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let place = |name: &str| folder.path().join(name).to_str().expect("utf-8").to_string();
    let train = |out: &str, iterations: &str, ranks: usize| {
        let line = "policy train cartpole-swingup --envs 10 --horizon 16 --minibatch 80 --seed 3 --iterations";
        let (said, well) = among(&line.split(' ').chain([iterations, "--out", out]).collect::<Vec<_>>(), ranks);
        assert!(well, "{ranks} ranks: {said}");
        std::fs::read(Path::new(out).join("policy/policy.safetensors")).expect("a policy")
    };
    let expected = train(&place("1"), "12", 1);
    for ranks in [2, 3] {
        assert!(train(&place(&ranks.to_string()), "12", ranks) == expected, "{ranks} ranks came to another policy");
    }
    // A run of three ranks is gone on with by two, and by one.
    train(&place("moved"), "4", 3);
    train(&place("moved"), "8", 2);
    assert!(train(&place("moved"), "12", 1) == expected, "a run that moved came to another policy");
    let (said, well) = among(&["policy", "train", "cartpole-swingup", "--envs", "2", "--minibatch", "32", "--out", &place("no")], 3);
    assert!(!well && said.contains("3 ranks"), "{said}");
}

fn bytes(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let file = |f: std::io::Result<std::fs::DirEntry>| {
        let f = f.expect("a file");
        (f.file_name().into_string().expect("utf-8"), std::fs::read(f.path()).expect("read"))
    };
    let mut files: Vec<_> = std::fs::read_dir(folder).expect("a folder").map(file).collect();
    files.sort();
    files
}

#[test]
fn parts_make_the_whole_byte_by_byte() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let (whole, parts) = (folder.path().join("whole"), folder.path().join("parts"));
    let command = |out: &Path, more: &[&str]| -> Vec<String> {
        let line = "dataset --robot pendulum --transitions 17000 --frames 2 --seed 5 --out";
        line.split(' ').chain([out.to_str().expect("utf-8")]).chain(more.iter().copied()).map(String::from).collect()
    };
    let run = |out: &Path, more: &[&str]| {
        let args = command(out, more);
        let run = xtask(&args.iter().map(String::as_str).collect::<Vec<_>>());
        assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
        String::from_utf8_lossy(&run.stdout).into_owned()
    };
    let said = run(&whole, &[]);
    // Five shards in three parts: one alone, and again, then two at once.
    let alone = run(&parts, &["--part", "2/3"]);
    assert!(alone.contains("part 2/3") && !parts.join("manifest.json").exists(), "{alone}");
    run(&parts, &["--part", "2/3"]);
    let children = ["3/3", "1/3"].map(|part| {
        let args = command(&parts, &["--part", part]);
        let mut command = Command::new(env!("CARGO_BIN_EXE_xtask"));
        command.args(&args).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("started")
    });
    for child in children {
        let ended = child.wait_with_output().expect("ended");
        assert!(ended.status.success(), "{}", String::from_utf8_lossy(&ended.stderr));
    }
    assert_eq!(bytes(&whole).iter().map(|f| f.0.clone()).collect::<Vec<_>>().len(), 6);
    assert!(bytes(&parts) == bytes(&whole), "parts differ from the whole");
    // A part that was lost, then joined by the whole's own command.
    std::fs::remove_file(parts.join("shard-00003.safetensors")).expect("removed");
    std::fs::remove_file(parts.join("manifest.json")).expect("removed");
    let joined = run(&parts, &[]);
    assert_eq!(joined.split("sha256").nth(1), said.split("sha256").nth(1));
    assert!(bytes(&parts) == bytes(&whole), "the repaired data set differs");
}
