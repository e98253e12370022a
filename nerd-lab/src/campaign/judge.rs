//! A case is used as its command line says, by the program in a process and a folder of its own, under limits of memory and time; how that
//! ends is looked at, and what it leaves.

use std::io::{Read, Seek};
use std::process::{Command, ExitStatus, Stdio};

use super::files::{Files, NOT_FINITE, below, scratch, whole, write};
use crate::prelude::*;

/// What a case may take.
const TIME: Duration = Duration::from_secs(10);
/// Address space of its process (KiB).
const MEMORY: u64 = 4 << 20;
/// Longest message (bytes): it has to be readable.
const WORDS: usize = 10_000;
/// Exit codes of what is used, and of what is refused.
const USED: i32 = 0;
const REFUSED: i32 = 2;

/// Files, and the command line that uses them, after some that prepare.
pub struct Case {
    pub files: Files,
    pub before: Vec<String>,
    pub line: String,
}

impl Case {
    /// The files that its lines name: by their folder, or by their name without its ending.
    fn named(&self) -> Files {
        let words: Vec<&str> = self.before.iter().chain([&self.line]).flat_map(|line| line.split_whitespace()).collect();
        let stem = |name: &str| name.rsplit_once('.').map_or(name.to_string(), |(stem, _)| stem.to_string());
        let named = |name: &str| {
            words.iter().any(|word| name.strip_prefix(word).is_some_and(|rest| rest.starts_with('/')) || stem(word) == stem(name))
        };
        self.files.iter().filter(|(name, _)| named(name)).map(|(name, bytes)| (name.clone(), bytes.clone())).collect()
    }

    pub fn value(&self, option: &str) -> Option<&str> {
        self.line.split(' ').skip_while(|word| *word != option).nth(1)
    }
}

/// What became of a case: its column, and words.
pub struct Verdict(pub Outcome, pub String);

/// Whatever comes behind `Accepted` must not happen.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Outcome {
    Refused,
    Accepted,
    Panic,
    /// The process died of a signal.
    Abort,
    Memory,
    Time,
    /// A number that is not finite came out.
    NotFinite,
    /// A refusal left files or had no words, or a result is not whole.
    Untidy,
}

impl Outcome {
    pub const NAMES: [&str; 8] = ["refused", "accepted", "panics", "aborts", "over memory", "over time", "not finite", "untidy"];

    pub fn name(self) -> &'static str {
        Self::NAMES[self as usize]
    }
}

pub fn judge(program: &Path, case: &Case) -> Result<Verdict> {
    let folder = scratch()?;
    let here = folder.path();
    write(here, &case.named())?;
    std::fs::write(here.join("there"), "x")?;
    #[cfg(unix)]
    std::os::unix::fs::symlink("/dev/null", here.join("null"))?;
    case.before.iter().try_for_each(|line| prepare(program, here, line))?;
    let had = below(here)?;
    let (ended, said) = call(program, here, &case.line)?;
    let left: Vec<PathBuf> = below(here)?.into_iter().filter(|path| !had.contains(path)).collect();
    let kept = std::fs::read(here.join("there")).is_ok_and(|text| text == b"x") && here.join("null").is_symlink();
    let words = said.lines().last().unwrap_or_default().to_string();
    let (outcome, words) = match ended.map(|status| status.code()) {
        None => (Outcome::Time, words),
        Some(None) if said.contains("memory allocation of") => (Outcome::Memory, said),
        Some(None) => (Outcome::Abort, said),
        Some(Some(USED)) => match left.iter().try_for_each(|path| whole(path)) {
            Ok(()) => (Outcome::Accepted, String::new()),
            Err(words) => (if words.contains(NOT_FINITE) { Outcome::NotFinite } else { Outcome::Untidy }, words),
        },
        Some(Some(REFUSED)) if words.is_empty() || words.len() > WORDS => (Outcome::Untidy, format!("a refusal of {} bytes", words.len())),
        Some(Some(REFUSED)) if !left.is_empty() || case.before.is_empty() && here.join("out").exists() => {
            (Outcome::Untidy, format!("a refusal left {left:?}: {words}"))
        }
        Some(Some(REFUSED)) if !kept => (Outcome::Untidy, format!("a refusal replaced a file: {words}")),
        Some(Some(REFUSED)) => (Outcome::Refused, words),
        Some(Some(_)) => (Outcome::Panic, said),
    };
    Ok(Verdict(outcome, words.trim().replace('\n', " ")))
}

/// Calls the program in a folder: how that ended, unless it was too late, and what was said of it.
fn call(program: &Path, folder: &Path, line: &str) -> Result<(Option<ExitStatus>, String)> {
    let words = line.split_whitespace().map(|word| if word == "''" { "" } else { word });
    let (mut errors, mut said) = (tempfile::tempfile()?, Vec::new());
    let mut command = Command::new("sh");
    command.args(["-c", &format!("ulimit -v {MEMORY}; exec \"$@\""), "sh"]).arg(program).args(words).current_dir(folder);
    command.envs([("NERD_COMMIT", "campaign"), ("RAYON_NUM_THREADS", "1")]);
    let mut child = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(errors.try_clone()?).spawn()?;
    let started = Instant::now();
    let mut ended = child.try_wait()?;
    while ended.is_none() && started.elapsed() < TIME {
        std::thread::sleep(Duration::from_millis(1));
        ended = child.try_wait()?;
    }
    if ended.is_none() {
        child.kill()?;
        child.wait()?;
    }
    errors.rewind()?;
    errors.read_to_end(&mut said)?;
    Ok((ended, String::from_utf8_lossy(&said).into()))
}

/// A line that must succeed: the program's; `rm FILE`; `cut FILE`, which takes a file's second half away; `stamp FOLDER`, which makes a
/// model's hash fit, since loading refuses any other change first.
fn prepare(program: &Path, here: &Path, line: &str) -> Result<()> {
    match line.split_once(' ') {
        Some(("rm", file)) => std::fs::remove_file(here.join(file))?,
        Some(("cut", file)) => {
            let bytes = std::fs::read(here.join(file))?;
            std::fs::write(here.join(file), &bytes[..bytes.len() / 2])?;
        }
        Some(("stamp", folder)) => {
            let (system, folder) = (System::named("pendulum")?, here.join(folder));
            if let Ok(mut model) = Model::read(&folder, &system, None) {
                model.stamp(&system);
                std::fs::write(folder.join("config.json"), serde_json::to_string(&model.config)?)?;
            }
        }
        _ => match call(program, here, line)? {
            (Some(status), _) if status.success() => {}
            (_, said) => bail!("`{line}` failed: {said}"),
        },
    }
    Ok(())
}
