//! A command line is run, and what it leaves is looked at.

use std::fs::File;
use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Context, Result, ensure};

use super::super::bench::Bench;
use super::super::case::{Fault, Files, Verdict, text};
use super::super::child::{End, SECONDS, wait};
use super::super::files::{NOT_FINITE, below, whole};
use super::FILE;
use super::good::files as good_files;

/// Longest refusal (bytes): somebody is to read it.
const WORDS: usize = 10_000;

/// Runs it. Of several lines the last is judged; those before it prepare, with `rm FILE` and `cut FILE` among them, which takes
/// a file's second half away.
pub fn judge(files: &Files, bench: &Bench) -> Result<Verdict> {
    let Some(text) = text(files, FILE) else { return Ok(Verdict::Refused("not UTF-8".into())) };
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
    let said = bench.path("said.txt");
    let (before, line) = text.trim().rsplit_once('\n').unwrap_or(("", text));
    before.lines().try_for_each(|line| prepare(line, &folder, &said))?;
    let had = below(&folder)?;
    let end = run(line, &folder, &said)?;
    let words = String::from_utf8_lossy(&std::fs::read(&said)?).trim().to_string();
    let panic = words.lines().skip_while(|line| !line.contains("panicked at")).take(2).collect::<Vec<_>>().join(" ");
    let last = words.lines().last().unwrap_or_default().to_string();
    let fault = |what, words: &str| Ok(Verdict::Fault(what, words.into()));
    let left: Vec<_> = below(&folder)?.into_iter().filter(|p| !had.contains(p)).collect();
    let kept = std::fs::read(folder.join("there"))? == b"x" && folder.join("null").is_symlink();
    match end {
        End::Late => fault(Fault::Time, &last),
        End::Signal if words.contains("memory allocation of") => fault(Fault::Memory, &last),
        End::Signal => fault(Fault::Abort, &last),
        _ if !panic.is_empty() => fault(Fault::Panic, &panic),
        End::Code(0) => Ok(left.iter().find_map(|p| whole(p).err()).map_or(Verdict::Accepted, |words| {
            let fault = if words.contains(NOT_FINITE) { Fault::NotFinite } else { Fault::Untidy };
            Verdict::Fault(fault, words)
        })),
        End::Code(2) if last.len() > WORDS => fault(Fault::Untidy, &format!("a refusal of {} bytes", last.len())),
        End::Code(2) if last.is_empty() => fault(Fault::Untidy, "a refusal without a word"),
        End::Code(2) if !left.is_empty() || before.is_empty() && folder.join("out").exists() => {
            fault(Fault::Untidy, &format!("a refusal left {left:?}: {last}"))
        }
        End::Code(2) if !kept => fault(Fault::Untidy, &format!("a refusal replaced a file: {last}")),
        End::Code(2) => Ok(Verdict::Refused(last)),
        End::Code(code) => fault(Fault::Abort, &format!("exit code {code}: {last}")),
    }
}

/// Runs a line that must succeed.
pub fn prepare(line: &str, folder: &Path, said: &Path) -> Result<()> {
    match line.split_once(' ') {
        Some(("rm", file)) => std::fs::remove_file(folder.join(file)).with_context(|| line.to_string()),
        Some(("cut", file)) => {
            let path = folder.join(file);
            let bytes = std::fs::read(&path).with_context(|| line.to_string())?;
            Ok(std::fs::write(path, &bytes[..bytes.len() / 2])?)
        }
        _ => {
            let end = run(line, folder, said)?;
            ensure!(end == End::Code(0), "`{line}` failed: {}", std::fs::read_to_string(said)?);
            Ok(())
        }
    }
}

/// Runs a line in a folder, what it says going to a file.
fn run(line: &str, folder: &Path, said: &Path) -> Result<End> {
    let mut command = Command::new(std::env::current_exe()?);
    command.args(line.split_whitespace().map(|w| if w == "''" { "" } else { w })).current_dir(folder);
    // Its results are thrown away, so nobody needs to ask git where they come from.
    command.envs([("NERD_COMMIT", "campaign"), ("RAYON_NUM_THREADS", "1"), ("RUST_BACKTRACE", "0")]);
    wait(command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(File::create(said)?).spawn()?, SECONDS)
}
