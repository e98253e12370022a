//! A worker: a process of its own under the limits, which tries case after case and says after each what became of it.

use std::io::Write;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Mutex;

use anyhow::Result;

use super::bench::Bench;
use super::case::{Fault, Files, Kind, Verdict};
use super::child::limit_memory;

/// Tries the cases `first, first + stride, ..` below `end`, one line of JSON to stdout each.
pub fn work(seed: u64, cases: impl Iterator<Item = u64>) -> Result<()> {
    limit_memory()?;
    quiet();
    let bench = Bench::new()?;
    let mut out = std::io::stdout().lock();
    for number in cases {
        let kind = Kind::of(number);
        let verdict = caught(kind, &kind.make(seed, number, &bench), &bench)?;
        writeln!(out, "{}", serde_json::to_string(&verdict)?)?;
        out.flush()?;
    }
    Ok(())
}

/// The words of the last panic.
static SAID: Mutex<String> = Mutex::new(String::new());

/// Panics are kept, not printed.
pub fn quiet() {
    std::panic::set_hook(Box::new(|info| {
        if let Ok(mut said) = SAID.lock() {
            *said = info.to_string().replace('\n', " ");
        }
    }));
}

/// Judges a case; a panic is a verdict, too.
pub fn caught(kind: Kind, files: &Files, bench: &Bench) -> Result<Verdict> {
    catch_unwind(AssertUnwindSafe(|| kind.judge(files, bench))).unwrap_or_else(|_| {
        let said = SAID.lock().map(|said| said.clone()).unwrap_or_default();
        Ok(Verdict::Fault(Fault::Panic, said))
    })
}
