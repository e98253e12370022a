//! A command line is run, and what it leaves is looked at.

use std::fs::File;
use std::io;
use std::path::Path;
use std::process::{Command, ExitStatus};
use std::time::{Duration, Instant};

use super::FILE;
use super::good::files as good_files;
use crate::campaign::bench::Bench;
use crate::campaign::case::{Fault, Files, Judged, Verdict, fault, text};
use crate::campaign::files::{NOT_FINITE, below, whole};
use crate::campaign::{SECONDS, calm};

/// Longest refusal (bytes): somebody is to read it.
const WORDS: usize = 10_000;

/// Runs it. Of several lines the last is judged; those before it prepare, with `rm FILE` and `cut FILE` among them, which takes
/// a file's second half away.
pub fn judge(files: &Files, bench: &Bench) -> io::Result<Judged> {
    let text = match text(files, FILE) {
        Ok(text) => text.trim(),
        Err(refused) => return Ok(Err(refused)),
    };
    let good = bench.path("good");
    if !good.exists() {
        good_files(bench, &good)?;
    }
    let folder = bench.empty("line")?;
    std::fs::write(folder.join("there"), "x")?;
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink(&good, folder.join("f"))?;
        std::os::unix::fs::symlink("/dev/null", folder.join("null"))?;
    }
    let (before, line) = text.rsplit_once('\n').unwrap_or(("", text));
    before.lines().try_for_each(|line| prepare(line, &folder, bench))?;
    let had = below(&folder)?;
    let (end, words) = run(line, &folder, bench)?;
    let left: Vec<_> = below(&folder)?.into_iter().filter(|p| !had.contains(p)).collect();
    let kept = std::fs::read(folder.join("there"))? == b"x" && folder.join("null").is_symlink();
    let panic = words.lines().skip_while(|line| !line.contains("panicked at")).take(2).collect::<Vec<_>>().join(" ");
    let last = words.lines().last().unwrap_or_default().to_string();
    let untidy = |words: String| fault(Fault::Untidy, words);
    Ok(match end.map(|status| status.code()) {
        None => fault(Fault::Time, last),
        Some(None) if words.contains("memory allocation of") => fault(Fault::Memory, last),
        Some(None) => fault(Fault::Abort, last),
        Some(_) if !panic.is_empty() => fault(Fault::Panic, panic),
        Some(Some(0)) => left.iter().try_for_each(|p| whole(p)).or_else(|words| {
            let what = if words.contains(NOT_FINITE) { Fault::NotFinite } else { Fault::Untidy };
            fault(what, words)
        }),
        Some(Some(2)) if last.len() > WORDS => untidy(format!("a refusal of {} bytes", last.len())),
        Some(Some(2)) if last.is_empty() => untidy("a refusal without a word".into()),
        Some(Some(2)) if !left.is_empty() || before.is_empty() && folder.join("out").exists() => {
            untidy(format!("a refusal left {left:?}: {last}"))
        }
        Some(Some(2)) if !kept => untidy(format!("a refusal replaced a file: {last}")),
        Some(Some(2)) => Err(Verdict::Refused(last)),
        Some(Some(code)) => fault(Fault::Abort, format!("exit code {code}: {last}")),
    })
}

/// Runs a line that must succeed.
pub fn prepare(line: &str, folder: &Path, bench: &Bench) -> io::Result<()> {
    match line.split_once(' ') {
        Some(("rm", file)) => std::fs::remove_file(folder.join(file)),
        Some(("cut", file)) => {
            let path = folder.join(file);
            let bytes = std::fs::read(&path)?;
            std::fs::write(path, &bytes[..bytes.len() / 2])
        }
        _ => match run(line, folder, bench)? {
            (Some(status), _) if status.success() => Ok(()),
            (_, words) => Err(io::Error::other(format!("`{line}` failed: {words}"))),
        },
    }
}

/// Runs a line in a folder: how it ended, if it did in time, and what it said.
fn run(line: &str, folder: &Path, bench: &Bench) -> io::Result<(Option<ExitStatus>, String)> {
    let said = bench.path("said.txt");
    let mut command = Command::new(&bench.program.path);
    command.args(line.split_whitespace().map(|w| if w == "''" { "" } else { w })).current_dir(folder);
    let mut child = calm(&mut command).stderr(File::create(&said)?).spawn()?;
    let started = Instant::now();
    let status = loop {
        match child.try_wait()? {
            None if started.elapsed() > Duration::from_secs(SECONDS) => {
                child.kill()?;
                child.wait()?;
                break None;
            }
            None => std::thread::sleep(Duration::from_millis(1)),
            status => break status,
        }
    };
    Ok((status, String::from_utf8_lossy(&std::fs::read(&said)?).trim().to_string()))
}
