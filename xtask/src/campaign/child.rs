//! Processes under a limit of time and memory.

use std::process::{Child, ExitStatus};
use std::time::{Duration, Instant};

use anyhow::Result;

/// What a case may take.
pub const SECONDS: u64 = 10;
/// What may be added for a case of command lines, which has its own watch.
pub const SLACK: u64 = 20;
/// Address space of a process (bytes).
pub const MEMORY: u64 = 4 << 30;

/// How a process ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// By itself.
    Code(i32),
    /// By a signal that was not ours.
    Signal,
    /// By ours: it took too long.
    Late,
}

impl From<ExitStatus> for End {
    fn from(status: ExitStatus) -> Self {
        status.code().map_or(Self::Signal, Self::Code)
    }
}

/// Waits for a process, and kills it after so many seconds.
pub fn wait(mut child: Child, seconds: u64) -> Result<End> {
    let started = Instant::now();
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok(status.into());
        }
        if started.elapsed() > Duration::from_secs(seconds) {
            child.kill()?;
            child.wait()?;
            return Ok(End::Late);
        }
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// Holds this process, and those that it starts, to [`MEMORY`].
pub fn limit_memory() -> Result<()> {
    #[cfg(unix)]
    rlimit::setrlimit(rlimit::Resource::AS, MEMORY, MEMORY)?;
    Ok(())
}
