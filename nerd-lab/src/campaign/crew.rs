//! Cases are tried in processes of the program itself, one a core, under a limit of memory. A worker writes of each case what became
//! of it into a file. One that dies or is late is killed, its case is a fault, and the next worker begins behind it.

use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use anyhow::{Result, bail};

use super::case::Kind;
use super::files::{read, scratch};
use super::judge::{Call, Case, Outcome, Verdict, judge};

/// What a case may take.
const TIME: Duration = Duration::from_secs(10);
/// Address space of a worker (bytes).
const MEMORY: u64 = 4 << 30;

/// A worker, with its order: the seed, how many cases there are, its first one, how much further its next one is, the folders of good
/// files and of verdicts.
pub fn work(call: Call, order: &[String]) -> Result<()> {
    let [seed, count, first, stride, good, folder] = order else { bail!("a worker needs six words") };
    let (seed, count, first, stride): (u64, u64, u64, u64) = (seed.parse()?, count.parse()?, first.parse()?, stride.parse()?);
    let (good, here) = (read(Path::new(good))?, scratch()?);
    let mut out = OpenOptions::new().append(true).open(verdicts(Path::new(folder), first % stride))?;
    std::env::set_current_dir(here.path())?;
    nerd_train::progress::quiet();
    #[cfg(unix)]
    rlimit::setrlimit(rlimit::Resource::AS, MEMORY, MEMORY)?;
    keep_panics();
    for number in (first..count).step_by(stride as usize) {
        let verdict = caught(&Kind::of(number).make(seed, number, &good), call)?;
        out.write_all((serde_json::to_string(&verdict)? + "\n").as_bytes())?;
    }
    Ok(())
}

static PANIC: Mutex<String> = Mutex::new(String::new());

/// From now on panics are kept, not printed.
pub fn keep_panics() {
    std::panic::set_hook(Box::new(|info| *PANIC.lock().unwrap_or_else(PoisonError::into_inner) = info.to_string().replace('\n', " ")));
}

/// What becomes of a case, in a process that keeps panics.
pub fn caught(case: &Case, call: Call) -> Result<Verdict> {
    catch_unwind(AssertUnwindSafe(|| judge(case, call))).unwrap_or_else(|_| {
        let words = PANIC.lock().unwrap_or_else(PoisonError::into_inner).clone();
        Ok(Verdict(Outcome::Panic, words))
    })
}

fn verdicts(folder: &Path, k: u64) -> PathBuf {
    folder.join(format!("{k}.jsonl"))
}

/// One place of the crew: its worker, what that writes, a line of that so far, when it last wrote, its next case.
struct Place {
    worker: Child,
    verdicts: BufReader<File>,
    line: String,
    heard: Instant,
    next: u64,
}

/// Tries so many cases of a seed; `hear` is called with each one's number and verdict.
pub fn try_all(program: &Path, (seed, count): (u64, u64), good: &Path, hear: &mut dyn FnMut(u64, Verdict)) -> Result<()> {
    let (stride, folder) = (std::thread::available_parallelism().map_or(1, |n| n.get()) as u64, scratch()?);
    let errors = |k: u64| folder.path().join(format!("{k}.txt"));
    let hire = |next: u64| -> Result<Child> {
        let order = format!("{seed},{count},{next},{stride},{},{}", good.display(), folder.path().display());
        let mut command = Command::new(program);
        command.args(["campaign", "--work", &order]).envs([("NERD_COMMIT", "campaign"), ("RAYON_NUM_THREADS", "1")]);
        Ok(command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(File::create(errors(next % stride))?).spawn()?)
    };
    let mut crew = Vec::new();
    for next in 0..stride.min(count) {
        File::create(verdicts(folder.path(), next))?;
        let verdicts = BufReader::new(File::open(verdicts(folder.path(), next))?);
        crew.push(Place { worker: hire(next)?, verdicts, line: String::new(), heard: Instant::now(), next });
    }
    while !crew.is_empty() {
        std::thread::sleep(Duration::from_millis(20));
        for place in &mut crew {
            let ended = place.worker.try_wait()?;
            // What is half written is read to its end later.
            while place.verdicts.read_line(&mut place.line)? > 0 && place.line.ends_with('\n') {
                hear(place.next, serde_json::from_str(&place.line)?);
                (place.heard, place.next) = (Instant::now(), place.next + stride);
                place.line.clear();
            }
            let late = place.heard.elapsed() > TIME;
            if place.next >= count || ended.is_none() && !late {
                continue;
            }
            place.worker.kill()?;
            let (status, words) = (place.worker.wait()?, std::fs::read_to_string(errors(place.next % stride))?.trim().replace('\n', " "));
            let outcome = match ended.map(|status| status.code()) {
                None => Outcome::Time,
                Some(None) if words.contains("memory allocation of") => Outcome::Memory,
                Some(None) => Outcome::Abort,
                // What makes cases must not fail, whatever becomes of them.
                Some(Some(_)) => bail!("the campaign failed: {words}"),
            };
            hear(place.next, Verdict(outcome, format!("{status}: {words}")));
            (place.heard, place.next) = (Instant::now(), place.next + stride);
            if place.next < count {
                place.worker = hire(place.next)?;
                place.line.clear();
            }
        }
        crew.retain(|place| place.next < count);
    }
    Ok(())
}
