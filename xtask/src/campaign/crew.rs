//! The parent: a worker a core. One that dies or is late is killed, its case is a fault, and the next worker begins behind it.

use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::Duration;

use anyhow::{Context, Result, bail};

use super::case::{Fault, Kind, Verdict};
use super::child::{SECONDS, SLACK};

/// Tries all cases; `told` hears of every one.
pub fn campaign(cases: u64, seed: u64, scratch: &Path, told: &(dyn Fn(u64, Verdict) + Sync)) -> Result<()> {
    let crew = std::thread::available_parallelism().map_or(1, |n| n.get()) as u64;
    std::thread::scope(|scope| {
        let foremen: Vec<_> = (0..crew).map(|k| scope.spawn(move || foreman(k, crew, cases, seed, scratch, told))).collect();
        foremen.into_iter().try_for_each(|f| f.join().unwrap_or_else(|_| bail!("a foreman died")))
    })
}

/// Sees to the cases `next, next + stride, ..`.
fn foreman(mut next: u64, stride: u64, cases: u64, seed: u64, scratch: &Path, told: &(dyn Fn(u64, Verdict) + Sync)) -> Result<()> {
    let said = scratch.join(format!("worker-{next}.txt"));
    while next < cases {
        let (mut worker, lines) = hire(next, stride, cases, seed, &said)?;
        loop {
            let slack = if Kind::of(next) == Kind::Line { SLACK } else { 0 };
            let (verdict, gone) = match lines.recv_timeout(Duration::from_secs(SECONDS + slack)) {
                Ok(line) => (serde_json::from_str(&line).with_context(|| format!("a worker said `{line}`"))?, false),
                Err(RecvTimeoutError::Timeout) => (Verdict::Fault(Fault::Time, format!("over {SECONDS} s")), true),
                Err(RecvTimeoutError::Disconnected) if next >= cases => break,
                Err(RecvTimeoutError::Disconnected) => (death(&mut worker, &said)?, true),
            };
            told(next, verdict);
            next += stride;
            if gone {
                break;
            }
        }
        worker.kill().ok();
        worker.wait()?;
    }
    Ok(())
}

/// A worker, and what it will say.
fn hire(first: u64, stride: u64, cases: u64, seed: u64, said: &Path) -> Result<(Child, Receiver<String>)> {
    let mut command = Command::new(std::env::current_exe()?);
    let numbers = [("--cases", cases), ("--seed", seed), ("--first", first), ("--stride", stride)];
    command.arg("campaign").args(numbers.iter().flat_map(|(flag, n)| [flag.to_string(), n.to_string()]));
    command.envs([("NERD_COMMIT", "campaign"), ("RAYON_NUM_THREADS", "1"), ("RUST_BACKTRACE", "0")]);
    let mut worker = command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(File::create(said)?).spawn()?;
    let out = worker.stdout.take().context("a worker without a voice")?;
    let (send, lines) = channel();
    std::thread::spawn(move || BufReader::new(out).lines().map_while(Result::ok).try_for_each(|line| send.send(line)));
    Ok((worker, lines))
}

/// Why a worker died: of memory, of a signal, or of an error of the campaign itself.
fn death(worker: &mut Child, said: &Path) -> Result<Verdict> {
    let status = worker.wait()?;
    let words = String::from_utf8_lossy(&std::fs::read(said)?).trim().replace('\n', " ");
    // What makes cases must not fail, whatever becomes of them.
    if status.code().is_some() {
        bail!("the campaign failed: {words}");
    }
    let fault = if words.contains("memory allocation of") { Fault::Memory } else { Fault::Abort };
    Ok(Verdict::Fault(fault, format!("{status}: {words}")))
}
