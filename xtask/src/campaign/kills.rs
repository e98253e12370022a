//! Runs that are killed at a random moment, every second one in the midst of writing a file. What stands there must be whole
//! files, and the same command must then come to what an unbroken run comes to, byte for byte.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::files::{below, whole};
use crate::table::markdown;

/// A command and the files that must come out the same; of a folder, all.
struct Job {
    name: &'static str,
    line: &'static str,
    same: &'static [&'static str],
}

const JOBS: [Job; 4] = [
    Job { name: "dataset", line: "dataset --robot pendulum --transitions 60000 --frames 10 --out run", same: &[""] },
    Job {
        name: "train",
        line: "train --robot cartpole --recipe small --embedding 16 --layers 1 --history 4 --transitions 4000 --frames 20 --updates 60 \
               --batch 16 --rollouts 2 --validate-every 3 --out run",
        same: &["model/model.safetensors", "model/normalizer.json", "run.json"],
    },
    Job {
        name: "policy train",
        line: "policy train cartpole-swingup --envs 16 --horizon 16 --iterations 30 --minibatch 64 --out run",
        same: &["policy/policy.safetensors"],
    },
    Job {
        name: "rollout",
        line: "rollout --robot pendulum --scene ground1 --states states.csv --steps 20000 --out run/r.csv",
        same: &["r.csv"],
    },
];

/// Kills of one run before it may end.
const STABS: u64 = 3;

/// What the kills came to.
#[derive(Default)]
pub struct Kills {
    rows: Vec<Vec<String>>,
    /// What went wrong.
    pub faults: Vec<String>,
}

impl Kills {
    /// One row a command.
    pub fn table(&self) -> String {
        markdown(&["command", "kills", "inside a write", "half-written", "other bytes after", "left over after"], &self.rows)
    }
}

/// Counts of a job.
#[derive(Default)]
struct Count {
    kills: u64,
    inside: u64,
    half: Vec<String>,
    other: Vec<String>,
    left: Vec<String>,
}

/// Kills so many runs.
pub fn kill(kills: u64, seed: u64) -> Result<Kills> {
    let mut all = Kills::default();
    if kills == 0 {
        return Ok(all);
    }
    let bar = crate::common::bar("kills", kills);
    let mut done = 0;
    for (k, job) in JOBS.iter().enumerate() {
        let wanted = (kills + k as u64) / JOBS.len() as u64;
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(k as u64);
        let unbroken = tempfile::tempdir()?;
        let took = job.unbroken(unbroken.path())?;
        let mut count = Count::default();
        while count.kills < wanted {
            let folder = tempfile::tempdir()?;
            job.life(folder.path(), unbroken.path(), took, wanted, &mut rng, &mut count)?;
            bar.set(done + count.kills);
        }
        done += count.kills;
        let numbers = [count.kills, count.inside, count.half.len() as u64, count.other.len() as u64, count.left.len() as u64];
        all.rows.push(std::iter::once(job.name.to_string()).chain(numbers.map(|n| n.to_string())).collect());
        all.faults.extend([count.half, count.other, count.left].concat().into_iter().map(|words| format!("{}: {words}", job.name)));
    }
    bar.finish();
    Ok(all)
}

impl Job {
    fn start(&self, folder: &Path) -> Result<Child> {
        std::fs::write(folder.join("states.csv"), "traj,step,q1,q2,qd1,qd2\n0,0,0.1,0.2,0,0\n")?;
        let mut command = Command::new(std::env::current_exe()?);
        command.args(self.line.split_whitespace()).current_dir(folder).env("NERD_COMMIT", "campaign");
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(std::fs::File::create(folder.join("said.txt"))?);
        Ok(command.spawn()?)
    }

    /// Runs to the end, which takes so long.
    fn unbroken(&self, folder: &Path) -> Result<Duration> {
        let started = Instant::now();
        let status = self.start(folder)?.wait()?;
        let said = std::fs::read_to_string(folder.join("said.txt"))?;
        ensure!(status.success(), "`{}` failed: {}", self.line, said.lines().last().unwrap_or_default());
        Ok(started.elapsed())
    }

    /// One run, killed a few times and then let be.
    fn life(&self, folder: &Path, unbroken: &Path, took: Duration, wanted: u64, rng: &mut impl Rng, count: &mut Count) -> Result<()> {
        let run = folder.join("run");
        for _ in 0..rng.random_range(1..=STABS) {
            let aimed = count.kills % 2 == 1;
            let moment = took.mul_f64(rng.random());
            if count.kills >= wanted || !stab(self.start(folder)?, &run, moment, aimed)? {
                break;
            }
            count.kills += 1;
            let files = if run.exists() { below(&run)? } else { Vec::new() };
            count.inside += u64::from(files.iter().any(|f| temporary(f)));
            count.half.extend(files.iter().filter(|f| !temporary(f)).filter_map(|f| whole(f).err()));
        }
        let said = match self.unbroken(folder) {
            Ok(_) => None,
            Err(e) => Some(e.to_string()),
        };
        let failed = said.is_some();
        count.other.extend(said);
        if failed {
            return Ok(());
        }
        count.left.extend(below(&run)?.iter().filter(|f| temporary(f)).map(|f| f.display().to_string()));
        for name in self.same {
            count.other.extend(differs(&run.join(name), &unbroken.join("run").join(name))?);
        }
        Ok(())
    }
}

/// Kills a process after a while; if aimed, as soon as it writes a file from then on. Whether it was still alive.
fn stab(mut child: Child, run: &Path, moment: Duration, aimed: bool) -> Result<bool> {
    let started = Instant::now();
    loop {
        if child.try_wait()?.is_some() {
            return Ok(false);
        }
        let writing = || below(run).is_ok_and(|files| files.iter().any(|f| temporary(f)));
        if started.elapsed() >= moment && (!aimed || writing()) {
            child.kill()?;
            // A process that had just ended was not killed.
            return Ok(child.wait()?.code().is_none());
        }
        std::thread::sleep(Duration::from_micros(200));
    }
}

fn temporary(path: &Path) -> bool {
    path.extension().is_some_and(|e| e == "tmp")
}

/// Files that are not the same in both.
fn differs(a: &Path, b: &Path) -> Result<Vec<String>> {
    let names = |root: &Path| -> Result<Vec<PathBuf>> {
        let files = if root.is_dir() { below(root)? } else { vec![root.to_path_buf()] };
        files.iter().map(|f| Ok(f.strip_prefix(root)?.to_path_buf())).collect()
    };
    let (ours, theirs) = (names(a)?, names(b)?);
    if ours != theirs {
        return Ok(vec![format!("{ours:?} in place of {theirs:?}")]);
    }
    let read = |root: &Path, name: &Path| {
        let path = if name.as_os_str().is_empty() { root.to_path_buf() } else { root.join(name) };
        std::fs::read(&path).with_context(|| path.display().to_string())
    };
    let mut found = Vec::new();
    for name in &ours {
        if read(a, name)? != read(b, name)? {
            found.push(format!("{} has other bytes", a.join(name).display()));
        }
    }
    Ok(found)
}
