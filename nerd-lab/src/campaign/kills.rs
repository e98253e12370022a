//! Runs that are killed at a random moment, every second one in the midst of writing a file. What stands there must be whole
//! files, and the same command must then come to what an unbroken run comes to, byte for byte.

use std::collections::BTreeMap;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Child, Command};
use std::time::{Duration, Instant};

use nerd_train::progress::bar;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::campaign::calm;
use crate::campaign::files::{below, whole};
use crate::campaign::found::Found;

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
        line: "rollout --robot pendulum --scene ground1 --states states.csv --frames 20000 --out run/r.csv",
        same: &["r.csv"],
    },
];

/// Kills of one run before it may end.
const STABS: u64 = 3;

/// What is counted of a command.
pub const KILLS: [&str; 5] = ["kills", "inside a write", "half-written", "other bytes after", "left over after"];

/// Kills so many runs.
pub fn kill(program: &Path, kills: u64, seed: u64, found: &mut Found) -> io::Result<()> {
    let (bar, mut done) = (bar("kills", kills), 0);
    for (k, job) in JOBS.iter().enumerate() {
        let wanted = (kills + k as u64) / JOBS.len() as u64;
        if wanted == 0 {
            continue;
        }
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(k as u64);
        let unbroken = job.finish(program, tempfile::tempdir()?.path())?;
        let mut trial = Trial { job, program, wanted, unbroken, kills: 0, inside: 0, faults: Default::default() };
        while trial.kills < wanted {
            trial.life(tempfile::tempdir()?.path(), &mut rng)?;
            bar.set(done + trial.kills);
        }
        done += trial.kills;
        let [half, other, left] = trial.faults.each_ref().map(|faults| faults.len() as u64);
        found.kills.insert(job.name.into(), [trial.kills, trial.inside, half, other, left]);
        found.faults.extend(trial.faults.into_iter().flatten().map(|words| format!("{}: {words}", job.name)));
    }
    bar.finish();
    Ok(())
}

/// Files that must come out the same, by name.
type Files = BTreeMap<PathBuf, Vec<u8>>;

impl Job {
    fn start(&self, program: &Path, folder: &Path) -> io::Result<Child> {
        std::fs::write(folder.join("states.csv"), "traj,step,q1,q2,qd1,qd2\n0,0,0.1,0.2,0,0\n")?;
        let mut command = Command::new(program);
        calm(&mut command).env_remove("RAYON_NUM_THREADS").args(self.line.split_whitespace());
        command.current_dir(folder).stderr(File::create(folder.join("said.txt"))?).spawn()
    }

    /// Runs to the end: how long that takes, and what it comes to.
    fn finish(&self, program: &Path, folder: &Path) -> io::Result<(Duration, Files)> {
        let started = Instant::now();
        if !self.start(program, folder)?.wait()?.success() {
            let said = std::fs::read_to_string(folder.join("said.txt"))?;
            return Err(io::Error::other(format!("`{}` failed: {}", self.line, said.lines().last().unwrap_or_default())));
        }
        let (took, run) = (started.elapsed(), folder.join("run"));
        let mut files = Files::new();
        for file in below(&run)? {
            let name = file.strip_prefix(&run).unwrap_or(&file);
            if self.same.iter().any(|same| name.starts_with(same)) {
                files.insert(name.into(), std::fs::read(&file)?);
            }
        }
        Ok((took, files))
    }
}

/// A command that is killed again and again.
struct Trial<'a> {
    job: &'a Job,
    program: &'a Path,
    wanted: u64,
    /// How long an unbroken run takes, and what it comes to.
    unbroken: (Duration, Files),
    kills: u64,
    inside: u64,
    /// Faults: half-written files, other bytes after, left over after.
    faults: [Vec<String>; 3],
}

impl Trial<'_> {
    /// One run, killed a few times and then let be.
    fn life(&mut self, folder: &Path, rng: &mut impl Rng) -> io::Result<()> {
        let (run, [half, other, left]) = (folder.join("run"), &mut self.faults);
        let unbroken = &self.unbroken.1;
        for _ in 0..rng.random_range(1..=STABS) {
            let aimed = self.kills % 2 == 1;
            let moment = self.unbroken.0.mul_f64(rng.random());
            if self.kills >= self.wanted || !stab(self.job.start(self.program, folder)?, &run, moment, aimed)? {
                break;
            }
            let (cut, done): (Vec<_>, Vec<_>) = below(&run)?.into_iter().partition(|f| temporary(f));
            self.kills += 1;
            self.inside += u64::from(!cut.is_empty());
            half.extend(done.iter().filter_map(|f| whole(f).err()));
        }
        match self.job.finish(self.program, folder) {
            Ok((_, files)) => {
                let names = files.keys().chain(unbroken.keys().filter(|name| !files.contains_key(*name)));
                let differ = names.filter(|name| files.get(*name) != unbroken.get(*name));
                other.extend(differ.map(|name| format!("{} has other bytes, or is there in one alone", name.display())));
                left.extend(below(&run)?.iter().filter(|f| temporary(f)).map(|f| f.display().to_string()));
            }
            Err(error) => other.push(error.to_string()),
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
