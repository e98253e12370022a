//! The parent: a worker a core. One that dies or is late is killed, its case is a fault, and the next worker begins behind it.

use std::fs::File;
use std::io::{self, BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::Duration;

use crate::campaign::case::{Fault, Kind, Verdict};
use crate::campaign::source::Source;
use crate::campaign::{SECONDS, calm};

/// What may be added for a case of command lines, which has its own watch.
const SLACK: u64 = 20;

/// Tries all cases of a source; `told` hears of every one.
pub fn try_all(program: &Path, source: &Source, told: &(dyn Fn(u64, Verdict) + Sync)) -> io::Result<()> {
    let scratch = tempfile::tempdir()?;
    let crew = std::thread::available_parallelism().map_or(1, |n| n.get()) as u64;
    let foreman = |k| Foreman { program, source, stride: crew, said: &scratch.path().join(format!("worker-{k}.txt")) }.see_to(k, told);
    std::thread::scope(|scope| {
        let foremen: Vec<_> = (0..crew).map(|k| scope.spawn(move || foreman(k))).collect();
        foremen.into_iter().try_for_each(|f| f.join().unwrap_or_else(|_| Err(io::Error::other("a foreman died"))))
    })
}

/// Has one worker at a time, whose errors go to the file `said`.
struct Foreman<'a> {
    program: &'a Path,
    source: &'a Source,
    stride: u64,
    said: &'a Path,
}

impl Foreman<'_> {
    /// Sees to the cases `next, next + stride, ..`.
    fn see_to(&self, mut next: u64, told: &(dyn Fn(u64, Verdict) + Sync)) -> io::Result<()> {
        while next < self.source.count() {
            let (mut worker, lines) = self.hire(next)?;
            loop {
                let slack = if self.source.kind(next) == Some(Kind::Line) { SLACK } else { 0 };
                let (verdict, gone) = match lines.recv_timeout(Duration::from_secs(SECONDS + slack)) {
                    Ok(line) => (serde_json::from_str(&line)?, false),
                    Err(RecvTimeoutError::Timeout) => (Verdict::Fault(Fault::Time, format!("over {SECONDS} s")), true),
                    Err(RecvTimeoutError::Disconnected) if next >= self.source.count() => break,
                    Err(RecvTimeoutError::Disconnected) => (self.death(&mut worker)?, true),
                };
                told(next, verdict);
                next += self.stride;
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
    fn hire(&self, first: u64) -> io::Result<(Child, Receiver<String>)> {
        let mut command = Command::new(self.program);
        command.args(["campaign", "--work", &format!("{first},{}", self.stride)]).args(self.source.arguments());
        let mut worker = calm(&mut command).stdout(Stdio::piped()).stderr(File::create(self.said)?).spawn()?;
        let out = worker.stdout.take().ok_or_else(|| io::Error::other("a worker without a voice"))?;
        let (send, lines) = channel();
        std::thread::spawn(move || BufReader::new(out).lines().map_while(Result::ok).try_for_each(|line| send.send(line)));
        Ok((worker, lines))
    }

    /// Why a worker died: of memory, of a signal, or of an error of the campaign itself.
    fn death(&self, worker: &mut Child) -> io::Result<Verdict> {
        let status = worker.wait()?;
        let words = String::from_utf8_lossy(&std::fs::read(self.said)?).trim().replace('\n', " ");
        // What makes cases must not fail, whatever becomes of them.
        if status.code().is_some() {
            return Err(io::Error::other(format!("the campaign failed: {words}")));
        }
        let fault = if words.contains("memory allocation of") { Fault::Memory } else { Fault::Abort };
        Ok(Verdict::Fault(fault, format!("{status}: {words}")))
    }
}
