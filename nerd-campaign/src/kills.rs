//! Runs that are killed at a random moment, every second one in the midst of writing a file. What stands there must be whole
//! files, and the same command must then come to what an unbroken run comes to, byte for byte.

use std::collections::BTreeMap;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Child, Command};
use std::time::{Duration, Instant};

use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::files::{below, whole};
use crate::{Table, calm};

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
        line: "train --robot cartpole --preset small --embedding 16 --layers 1 --history 4 --transitions 4000 --frames 20 --updates 60 \
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

/// What the kills of a command came to.
#[derive(Default)]
struct Count {
    kills: u64,
    inside: u64,
    half: Vec<String>,
    other: Vec<String>,
    left: Vec<String>,
}

/// Kills so many runs; `told` hears how many so far. One row a command, and the faults in words.
pub fn kill(program: &Path, kills: u64, seed: u64, told: &dyn Fn(u64)) -> io::Result<(Table, Vec<String>)> {
    let header = ["command", "kills", "inside a write", "half-written", "other bytes after", "left over after"].into();
    let (mut table, mut faults, mut done) = (Table { header, rows: Vec::new() }, Vec::new(), 0);
    for (k, job) in JOBS.iter().enumerate() {
        let wanted = (kills + k as u64) / JOBS.len() as u64;
        if wanted == 0 {
            continue;
        }
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(k as u64);
        let mut trial = Trial { job, program, wanted, took: Duration::ZERO, unbroken: Files::new(), count: Count::default() };
        (trial.took, trial.unbroken) = trial.finish(tempfile::tempdir()?.path())?;
        while trial.count.kills < wanted {
            trial.life(tempfile::tempdir()?.path(), &mut rng)?;
            told(done + trial.count.kills);
        }
        let Count { kills, inside, half, other, left } = trial.count;
        done += kills;
        let numbers = [kills, inside, half.len() as u64, other.len() as u64, left.len() as u64].map(|n| n.to_string());
        table.rows.push([job.name.to_string()].into_iter().chain(numbers).collect());
        faults.extend([half, other, left].into_iter().flatten().map(|words| format!("{}: {words}", job.name)));
    }
    Ok((table, faults))
}

/// Files that must come out the same, by name.
type Files = BTreeMap<PathBuf, Vec<u8>>;

struct Trial<'a> {
    job: &'a Job,
    program: &'a Path,
    wanted: u64,
    /// How long an unbroken run takes.
    took: Duration,
    /// What it comes to.
    unbroken: Files,
    count: Count,
}

impl Trial<'_> {
    fn start(&self, folder: &Path) -> io::Result<Child> {
        std::fs::write(folder.join("states.csv"), "traj,step,q1,q2,qd1,qd2\n0,0,0.1,0.2,0,0\n")?;
        let mut command = Command::new(self.program);
        calm(&mut command).env_remove("RAYON_NUM_THREADS").args(self.job.line.split_whitespace());
        command.current_dir(folder).stderr(File::create(folder.join("said.txt"))?).spawn()
    }

    /// Runs to the end: how long that takes, and what it comes to.
    fn finish(&self, folder: &Path) -> io::Result<(Duration, Files)> {
        let started = Instant::now();
        if !self.start(folder)?.wait()?.success() {
            let said = std::fs::read_to_string(folder.join("said.txt"))?;
            return Err(io::Error::other(format!("`{}` failed: {}", self.job.line, said.lines().last().unwrap_or_default())));
        }
        let (took, run) = (started.elapsed(), folder.join("run"));
        let mut files = Files::new();
        for file in below(&run)? {
            let name = file.strip_prefix(&run).unwrap_or(&file);
            if self.job.same.iter().any(|same| name.starts_with(same)) {
                files.insert(name.into(), std::fs::read(&file)?);
            }
        }
        Ok((took, files))
    }

    /// One run, killed a few times and then let be.
    fn life(&mut self, folder: &Path, rng: &mut impl Rng) -> io::Result<()> {
        let run = folder.join("run");
        for _ in 0..rng.random_range(1..=STABS) {
            let aimed = self.count.kills % 2 == 1;
            let moment = self.took.mul_f64(rng.random());
            if self.count.kills >= self.wanted || !stab(self.start(folder)?, &run, moment, aimed)? {
                break;
            }
            let (cut, done): (Vec<_>, Vec<_>) = below(&run)?.into_iter().partition(|f| temporary(f));
            self.count.kills += 1;
            self.count.inside += u64::from(!cut.is_empty());
            self.count.half.extend(done.iter().filter_map(|f| whole(f).err()));
        }
        match self.finish(folder) {
            Ok((_, files)) => {
                let names = files.keys().chain(self.unbroken.keys().filter(|name| !files.contains_key(*name)));
                let differ = names.filter(|name| files.get(*name) != self.unbroken.get(*name));
                self.count.other.extend(differ.map(|name| format!("{} has other bytes, or is there in one alone", name.display())));
                self.count.left.extend(below(&run)?.iter().filter(|f| temporary(f)).map(|f| f.display().to_string()));
            }
            Err(error) => self.count.other.push(error.to_string()),
        }
        Ok(())
    }
}

/// Kills a process after a while; if aimed, as soon as it writes a file from then on. Whether it was still alive.
fn stab(mut child: Child, run: &Path, moment: Duration, aimed: bool) -> io::Result<bool> {
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
