//! A worker: a process of its own under the limits, which tries case after case and says after each what became of it.

use std::io::{self, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Mutex;

use crate::campaign::bench::Bench;
use crate::campaign::case::{Fault, Verdict};
use crate::campaign::source::Source;
use crate::campaign::{MEMORY, Program};

/// The words of the last panic.
static SAID: Mutex<String> = Mutex::new(String::new());

/// Tries the cases `first, first + stride, ..`, one line of JSON to stdout each.
///
/// # Errors
/// If the campaign itself fails: the disk is full, say.
pub fn work(program: Program, source: &Source, first: u64, stride: u64) -> io::Result<()> {
    #[cfg(unix)]
    rlimit::setrlimit(rlimit::Resource::AS, MEMORY, MEMORY)?;
    // Panics are kept, not printed.
    std::panic::set_hook(Box::new(|info| {
        if let Ok(mut said) = SAID.lock() {
            *said = info.to_string().replace('\n', " ");
        }
    }));
    let bench = Bench::new(program)?;
    let mut out = io::stdout().lock();
    for number in (first..source.count()).step_by(stride.max(1) as usize) {
        let (kind, files) = source.case(number, &bench)?;
        let verdict = catch_unwind(AssertUnwindSafe(|| kind.judge(&files, &bench))).unwrap_or_else(|_| {
            let said = SAID.lock().map(|said| said.clone()).unwrap_or_default();
            Ok(Verdict::Fault(Fault::Panic, said))
        });
        writeln!(out, "{}", serde_json::to_string(&verdict?)?)?;
        out.flush()?;
    }
    Ok(())
}
