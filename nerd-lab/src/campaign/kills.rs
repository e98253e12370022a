//! Runs that are killed at a random moment, every second one in the midst of writing a file. What is there must be whole files, and
//! the same command must then come to what an unbroken run comes to, byte for byte.

use std::process::{Child, Command, Stdio};
use std::{collections::BTreeSet, fs::File};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::files::{Files, below, read, whole};
use crate::prelude::*;

/// Commands, and the files that must come out the same; of a folder, all.
const JOBS: [(&str, &[&str]); 4] = [
    ("dataset --robot pendulum --transitions 60000 --frames 10 --out run", &[""]),
    (
        "train --robot cartpole --recipe small --embedding 16 --layers 1 --history 4 --transitions 4000 --frames 20 --updates 60 --batch 16 \
         --rollouts 2 --validate-every 3 --out run",
        &["model/model.safetensors", "model/normalizer.json", "run.json"],
    ),
    ("policy train cartpole-swingup --envs 16 --horizon 16 --iterations 30 --minibatch 64 --out run", &["policy/policy.safetensors"]),
    ("rollout --robot pendulum --scene ground1 --states states.csv --frames 20000 --out run/r.csv", &["r.csv"]),
];

/// Kills of one run before it may end.
const STABS: u64 = 3;

pub const KILLS: [&str; 4] = ["kills", "inside a write", "half-written", "other after"];

pub type Counts = BTreeMap<String, [u64; KILLS.len()]>;

/// Kills so many runs in all; what was wrong goes to `faults`.
pub fn kill(program: &Path, kills: u64, seed: u64, faults: &mut Vec<String>) -> Result<Counts> {
    let (bar, mut done, mut all) = (bar("kills", kills), 0, Counts::new());
    for (k, (line, same)) in JOBS.iter().enumerate() {
        let wanted = (kills + k as u64) / JOBS.len() as u64;
        if wanted == 0 {
            continue;
        }
        let command = line.split(" --").next().unwrap_or_default();
        let counts = all.entry(command.into()).or_default();
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(k as u64);
        let started = Instant::now();
        let unbroken = finish(program, line, same, tempfile::tempdir()?.path())?;
        let takes = started.elapsed();
        while counts[0] < wanted {
            let folder = tempfile::tempdir()?;
            let run = folder.path().join("run");
            // One run is killed a few times and then let be.
            for _ in 0..rng.random_range(1..=STABS) {
                let aimed = counts[0] % 2 == 1;
                let mut stabbed = || stab(start(program, line, folder.path())?, &run, takes.mul_f64(rng.random()), aimed);
                if counts[0] == wanted || !stabbed()? {
                    break;
                }
                let files = read(&run)?;
                let half = files.keys().filter(|name| !temporary(name)).filter_map(|name| whole(&run.join(name)).err());
                let before = faults.len();
                faults.extend(half.map(|words| format!("{command}: {words}")));
                counts[0] += 1;
                counts[1] += u64::from(writing(&run));
                counts[2] += (faults.len() - before) as u64;
            }
            let files = finish(program, line, same, folder.path())?;
            let names: BTreeSet<&String> = files.keys().chain(unbroken.keys()).collect();
            for name in names.into_iter().filter(|name| files.get(*name) != unbroken.get(*name)) {
                counts[3] += 1;
                faults.push(format!("{command}: {name} has other bytes, or is there in one run alone"));
            }
            bar.set(done + counts[0]);
        }
        done += counts[0];
    }
    bar.finish();
    Ok(all)
}

fn start(program: &Path, line: &str, folder: &Path) -> Result<Child> {
    std::fs::write(folder.join("states.csv"), "traj,step,q1,q2,qd1,qd2\n0,0,0.1,0.2,0,0\n")?;
    let mut command = Command::new(program);
    command.args(line.split(' ')).current_dir(folder).env("NERD_COMMIT", "campaign").stdout(Stdio::null());
    Ok(command.stderr(File::create(folder.join("errors.txt"))?).spawn()?)
}

/// Runs to the end: the files that must come out the same, and those that should have gone.
fn finish(program: &Path, line: &str, same: &[&str], folder: &Path) -> Result<Files> {
    if !start(program, line, folder)?.wait()?.success() {
        bail!("`{line}` failed: {}", std::fs::read_to_string(folder.join("errors.txt"))?.lines().last().unwrap_or_default());
    }
    let mut files = read(&folder.join("run"))?;
    files.retain(|name, _| temporary(name) || same.iter().any(|same| name.starts_with(same)));
    Ok(files)
}

/// Kills a process after a while; if aimed, as soon as it writes a file from then on. Whether it was still alive.
fn stab(mut child: Child, run: &Path, moment: Duration, aimed: bool) -> Result<bool> {
    let started = Instant::now();
    while child.try_wait()?.is_none() {
        if started.elapsed() >= moment && (!aimed || writing(run)) {
            child.kill()?;
            // A process that had just ended was not killed.
            return Ok(child.wait()?.code().is_none());
        }
        std::thread::sleep(Duration::from_micros(200));
    }
    Ok(false)
}

fn writing(run: &Path) -> bool {
    below(run).is_ok_and(|files| files.iter().any(|file| temporary(&file.to_string_lossy())))
}

fn temporary(name: &str) -> bool {
    name.ends_with(".tmp")
}
