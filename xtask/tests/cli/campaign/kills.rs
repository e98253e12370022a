//! Runs ended by SIGTERM, killed, or killed while they write a file, in turn. All files that are left are whole. The
//! same command then reaches the result of an unbroken run, byte for byte.

use std::fs::File;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use super::files::{Files, below, read, whole};
use super::program;

const KILLS: u32 = 6;

#[test]
fn killed_runs_leave_whole_files_and_go_on() {
    same_after_kills("dataset --robot pendulum --transitions 60000 --frames 10 --out run", &[""]);
    same_after_kills(
        "train --robot cartpole --recipe small --embedding 16 --layers 1 --history 4 --transitions 4000 --frames 20 --updates 60 --batch 16 \
         --rollouts 2 --validate-every 3 --out run",
        &["model/model.safetensors", "model/normalizer.json", "run.json"],
    );
    let policy = "policy train cartpole-swingup --envs 16 --horizon 16 --iterations 30 --minibatch 64 --out run";
    same_after_kills(policy, &["policy/policy.safetensors"]);
    same_after_kills(
        "rollout --robot pendulum --scene ground1 --states states.csv --frames 20000 --out run/r.csv",
        &["r.csv"],
    );
}

/// A command, and the beginnings of names of files that must come out the same.
fn same_after_kills(line: &str, same: &[&str]) {
    let [unbroken, folder] = [(); 2].map(|()| tempfile::tempdir().expect("a temporary folder"));
    let (started, run) = (Instant::now(), folder.path().join("run"));
    let expected = finish(line, same, unbroken.path());
    let takes = started.elapsed();
    for k in 1..=KILLS {
        let way = [Way::Asked, Way::Killed, Way::Writing][(k as usize - 1) % 3];
        if !stab(start(line, folder.path()), &run, takes * k / (KILLS + 1), way) {
            break;
        }
        for name in read(&run).keys().filter(|name| !temporary(name)) {
            assert_eq!(whole(&run.join(name)), Ok(()), "{line}, kill {k}");
        }
    }
    // Runs ended by SIGTERM left a checkpoint, and later runs continued from there.
    assert!(
        !line.starts_with("policy") || run.join("last.safetensors").exists(),
        "{line}: no checkpoint after {KILLS} ends"
    );
    let found = finish(line, same, folder.path());
    let other = found.keys().chain(expected.keys()).find(|name| found.get(*name) != expected.get(*name));
    assert_eq!(other, None, "{line}: a file has other bytes, or is there in one run alone");
}

fn start(line: &str, folder: &Path) -> Child {
    std::fs::write(folder.join("states.csv"), "traj,step,q1,q2,qd1,qd2\n0,0,0.1,0.2,0,0\n").expect("written");
    let mut command = Command::new(program());
    command.args(line.split_whitespace()).current_dir(folder).env("NERD_COMMIT", "campaign").stdout(Stdio::null());
    command.stderr(File::create(folder.join("errors.txt")).expect("a file")).spawn().expect("started")
}

/// Runs to the end. Returns files that must come out the same, and temporary files that should have gone.
fn finish(line: &str, same: &[&str], folder: &Path) -> Files {
    let ended = start(line, folder).wait().expect("ended");
    assert!(ended.success(), "`{line}` failed: {}", crate::text(folder.join("errors.txt")));
    let mut files = read(&folder.join("run"));
    files.retain(|name, _| temporary(name) || same.iter().any(|same| name.starts_with(same)));
    files
}

/// How a process is ended: by SIGTERM, or killed, perhaps as soon as it writes a file.
#[derive(Clone, Copy, PartialEq)]
enum Way {
    Asked,
    Killed,
    Writing,
}

/// Ends a process after a while; returns whether it was still alive.
fn stab(mut child: Child, run: &Path, moment: Duration, way: Way) -> bool {
    let started = Instant::now();
    while child.try_wait().expect("a state").is_none() {
        if started.elapsed() >= moment && (way != Way::Writing || writing(run)) {
            if way == Way::Asked && cfg!(unix) {
                let asked = Command::new("kill").args(["-TERM", &child.id().to_string()]).status().expect("kill runs");
                let code = child.wait().expect("ended").code();
                assert!(
                    !asked.success() || code == Some(0) || code == Some(143),
                    "asked to end it ended with {code:?}"
                );
                return code != Some(0);
            }
            child.kill().expect("killed");
            // A process that had just ended was not killed.
            return child.wait().expect("ended").code().is_none();
        }
        std::thread::sleep(Duration::from_micros(200));
    }
    false
}

fn writing(run: &Path) -> bool {
    below(run).is_ok_and(|files| files.iter().any(|file| temporary(&file.to_string_lossy())))
}

fn temporary(name: &str) -> bool {
    name.ends_with(".tmp")
}
