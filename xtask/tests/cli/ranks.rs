//! Ranks, as a launcher starts them: they make one run, go on with each other's, and end with each other.

use std::net::{Ipv4Addr, TcpListener};
use std::path::Path;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use crate::{Folder, command, done, text};

/// A run of seconds. Losses are logged as often as checkpoints are written at 40 updates, so that means are over the same.
const TRAIN: &str = "train --robot pendulum --recipe small --transitions 20000 --fresh 3200 --frames 50 --batch 16 --rollouts 2 --log-every 4 \
                     --validate-every 20 --updates 40 --out";
const POLICY: &str = "policy train cartpole-swingup --envs 10 --horizon 16 --minibatch 80 --seed 3";

/// Starts so many ranks of one command.
fn start(line: &str, out: &Path, world: usize) -> Vec<Child> {
    let port = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).and_then(|free| free.local_addr()).expect("a free port").port();
    let rank = |rank: usize| {
        let all = [("RANK", rank), ("WORLD_SIZE", world), ("LOCAL_RANK", rank), ("MASTER_PORT", port.into()), ("RAYON_NUM_THREADS", 1)];
        let mut command = command(line, &[out]);
        command.envs(all.map(|(name, value)| (name, value.to_string()))).env("MASTER_ADDR", "127.0.0.1");
        command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("started")
    };
    (0..world).map(rank).collect()
}

/// The same, to their ends: what rank 0 said, and whether all is well.
fn among(line: &str, out: &Path, world: usize) -> (String, bool) {
    let ended: Vec<_> = start(line, out, world).into_iter().map(|rank| rank.wait_with_output().expect("ended")).collect();
    (String::from_utf8_lossy(&ended[0].stderr).into_owned(), ended.iter().all(|rank| rank.status.success()))
}

fn until(there: &Path, child: &mut Child) {
    while !there.exists() {
        assert!(child.try_wait().expect("a state").is_none_or(|status| status.success()), "the run ended by itself");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// (step, loss) of each line of a run's record.
fn losses(out: &Path) -> Vec<(u64, f64)> {
    let line = |line: &str| -> (u64, f64) {
        let line: serde_json::Value = serde_json::from_str(line).expect("JSON");
        (line["step"].as_u64().expect("a step"), line["loss"].as_f64().expect("a loss"))
    };
    text(out.join("metrics.jsonl")).lines().map(line).collect()
}

#[test]
fn one_two_and_four_ranks_make_the_same_run_and_one_goes_on_with_anothers() {
    let folder = Folder::new();
    let alone = folder.path("alone");
    done(TRAIN, &[&alone]);
    let expected = losses(&alone);
    // Largest relative difference of the losses.
    let off = |out: &Path| {
        let found = losses(out);
        assert_eq!(found.iter().map(|l| l.0).collect::<Vec<_>>(), expected.iter().map(|l| l.0).collect::<Vec<_>>(), "other steps");
        found.iter().zip(&expected).map(|(a, b)| (a.1 / b.1 - 1.0).abs()).fold(0.0, f64::max)
    };
    for ranks in [2, 4] {
        let out = folder.path(&ranks.to_string());
        let (words, well) = among(TRAIN, &out, ranks);
        assert!(well && out.join("model/model.safetensors").exists(), "{ranks} ranks: {words}");
        assert!(off(&out) < 1e-4, "{ranks} ranks: losses off those of one by {:.1e}", off(&out));
    }
    // Killed on four after its first checkpoint, gone on with on two, killed, and ended by one.
    let out = folder.path("moved");
    for (world, kept) in [(4, "last.safetensors"), (2, "best.safetensors")] {
        let mut ranks = start(TRAIN, &out, world);
        until(&out.join(kept), &mut ranks[0]);
        ranks.iter_mut().for_each(|rank| drop(rank.kill()));
        ranks.iter_mut().for_each(|rank| _ = rank.wait().expect("ended"));
    }
    done(TRAIN, &[&out]);
    assert!(off(&out) < 1e-4, "four ranks, then two, then one: off by {:.1e}", off(&out));
}

#[test]
fn a_killed_rank_ends_the_others_with_its_number() {
    let folder = Folder::new();
    let out = folder.path("run");
    let mut ranks = start(&TRAIN.replace("--updates 40", "--updates 1000000"), &out, 3);
    until(&out.join("best.safetensors"), &mut ranks[0]);
    ranks[2].kill().expect("killed");
    let since = Instant::now();
    for (rank, child) in ranks.into_iter().enumerate() {
        let ended = child.wait_with_output().expect("ended");
        let error = String::from_utf8_lossy(&ended.stderr);
        let named = error.lines().last().unwrap_or_default().contains("rank 2 of 3 ended: its connection closed");
        assert!(rank == 2 || ended.status.code() == Some(2) && named, "rank {rank}: {error}");
    }
    assert!(since.elapsed() < Duration::from_secs(30), "{:?}", since.elapsed());
}

#[test]
fn a_policy_of_three_ranks_goes_on_with_one() {
    let (folder, out) = (Folder::new(), "moved");
    for (iterations, ranks) in [(4, 3), (8, 1)] {
        let (words, well) = among(&format!("{POLICY} --iterations {iterations} --out"), &folder.path(out), ranks);
        assert!(well, "{ranks} ranks: {words}");
    }
}

#[test]
fn what_cannot_be_shared_out_is_refused_in_a_line() {
    let folder = Folder::new();
    let out = folder.path("run");
    for (line, world, culprit) in [
        (&TRAIN.replace("--batch 16", "--batch 1").replace("3200", "50")[..], 2, "--batch 1: 2 ranks"),
        ("policy train cartpole-swingup --envs 2 --minibatch 32 --out", 3, "3 ranks"),
        ("dataset --robot pendulum --out", 2, "--part"),
    ] {
        let (words, well) = among(line, &out, world);
        assert!(!well && words.contains(culprit), "{line}: {words}");
    }
    let run = command(TRAIN, &[&out]).env("RANK", "0").output().expect("started");
    assert!(String::from_utf8_lossy(&run.stderr).contains("WORLD_SIZE is not set"));
    assert!(!out.exists(), "something was left");
}
