//! Runs a case's command line in its own process and folder, with limits of memory and time. Checks how the process
//! ends and which files it leaves.

use std::io::{Read, Seek};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use nerd_model::folder::Model;
use nerd_sim::prelude::System;

use super::files::{Files, below, scratch, whole, write};
use super::program;

const TIME: Duration = Duration::from_secs(10);
/// Address space of the process (KiB).
const MEMORY: u64 = 4 << 20;
/// Longest message (bytes): it has to be readable.
const WORDS: usize = 10_000;
/// Exit codes of an accepted and of a refused input.
const USED: i32 = 0;
/// A failure, and a command line that cannot be read.
const FAILED: i32 = 1;
const REFUSED: i32 = 2;

/// Files, the command line that uses them, and lines that prepare.
pub struct Case {
    pub files: Files,
    pub before: Vec<String>,
    pub line: String,
}

impl Case {
    /// The files that its lines name: by their folder, or by their name without its ending.
    fn named(&self) -> Files {
        let words: Vec<&str> =
            self.before.iter().chain([&self.line]).flat_map(|line| line.split_whitespace()).collect();
        let stem = |name: &str| name.rsplit_once('.').map_or(name.to_string(), |(stem, _)| stem.to_string());
        let named = |name: &str| {
            words.iter().any(|word| {
                name.strip_prefix(word).is_some_and(|rest| rest.starts_with('/')) || stem(word) == stem(name)
            })
        };
        self.files.iter().filter(|(name, _)| named(name)).map(|(name, bytes)| (name.clone(), bytes.clone())).collect()
    }

    pub fn value(&self, option: &str) -> Option<&str> {
        self.line.split(' ').skip_while(|word| *word != option).nth(1)
    }
}

#[derive(Debug)]
pub enum Outcome {
    Refused(String),
    Accepted,
    /// An outcome that must not happen.
    Fault(&'static str, String),
}

pub fn judge(case: &Case) -> Outcome {
    let folder = scratch();
    let here = folder.path();
    write(here, &case.named());
    std::fs::write(here.join("there"), "x").expect("written");
    #[cfg(unix)]
    std::os::unix::fs::symlink("/dev/null", here.join("null")).expect("linked");
    case.before.iter().for_each(|line| prepare(here, line));
    let had = below(here).expect("a folder");
    let (ended, said) = call(here, &case.line);
    let left: Vec<PathBuf> = below(here).expect("a folder").into_iter().filter(|path| !had.contains(path)).collect();
    let kept = std::fs::read(here.join("there")).is_ok_and(|text| text == b"x") && here.join("null").is_symlink();
    let words = said.lines().last().unwrap_or_default().trim().to_string();
    let fault = |what| Outcome::Fault(what, said.trim().replace('\n', " "));
    match ended.map(|status| status.code()) {
        None => fault("over time"),
        Some(None) if said.contains("memory allocation of") => fault("over memory"),
        Some(None) => fault("an abort"),
        Some(Some(USED)) => match left.iter().try_for_each(|path| whole(path)) {
            Ok(()) => Outcome::Accepted,
            Err(words) => Outcome::Fault("a file that is not whole", words),
        },
        Some(Some(FAILED | REFUSED)) if words.is_empty() || words.len() > WORDS => {
            fault("a refusal without words, or with too many")
        }
        Some(Some(FAILED | REFUSED)) if !left.is_empty() || case.before.is_empty() && here.join("out").exists() => {
            fault("a refusal left files")
        }
        Some(Some(FAILED | REFUSED)) if !kept => fault("a refusal replaced a file"),
        Some(Some(FAILED | REFUSED)) => Outcome::Refused(words),
        Some(Some(_)) => fault("a panic"),
    }
}

/// Runs the program in a folder: its exit status unless it was over time, and its standard error.
fn call(folder: &Path, line: &str) -> (Option<ExitStatus>, String) {
    let words = line.split_whitespace().map(|word| if word == "''" { "" } else { word });
    let (mut errors, mut said) = (tempfile::tempfile().expect("a file"), Vec::new());
    let mut command = Command::new("sh");
    command
        .args(["-c", &format!("ulimit -v {MEMORY}; exec \"$@\""), "sh"])
        .arg(program())
        .args(words)
        .current_dir(folder);
    command.envs([("NERD_COMMIT", "campaign"), ("RAYON_NUM_THREADS", "1")]);
    let mut child = command
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(errors.try_clone().expect("a file"))
        .spawn()
        .expect("started");
    let started = Instant::now();
    let mut ended = child.try_wait().expect("a state");
    while ended.is_none() && started.elapsed() < TIME {
        std::thread::sleep(Duration::from_millis(1));
        ended = child.try_wait().expect("a state");
    }
    if ended.is_none() {
        child.kill().expect("killed");
        child.wait().expect("ended");
    }
    errors.rewind().and_then(|()| errors.read_to_end(&mut said)).expect("what was said");
    (ended, String::from_utf8_lossy(&said).into())
}

/// Runs a line that must succeed: a command of the program, `rm FILE`, `cut FILE` or `stamp FOLDER`. `cut` removes a
/// file's second half. `stamp` makes a model's hash fit, since loading refuses any other change first.
fn prepare(here: &Path, line: &str) {
    match line.split_once(' ') {
        Some(("rm", file)) => std::fs::remove_file(here.join(file)).expect("removed"),
        Some(("cut", file)) => {
            let bytes = std::fs::read(here.join(file)).expect("read");
            std::fs::write(here.join(file), &bytes[..bytes.len() / 2]).expect("written");
        }
        Some(("stamp", folder)) => {
            let (system, folder) = (System::named("pendulum").expect("built in"), here.join(folder));
            if let Ok(mut model) = Model::read(&folder, &system, None) {
                (model.config.robot_sha256, model.config.model_sha256) = (system.robot_sha256(), model.sha256());
                std::fs::write(folder.join("config.json"), serde_json::to_string(&model.config).expect("JSON"))
                    .expect("written");
            }
        }
        _ => {
            let (ended, said) = call(here, line);
            assert!(ended.is_some_and(|status| status.success()), "`{line}` failed: {said}");
        }
    }
}
