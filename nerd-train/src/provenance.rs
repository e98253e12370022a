//! Provenance of a result.

use itertools::Itertools;
use std::process::Command;
use std::sync::LazyLock;

use chrono::Utc;
use serde::{Deserialize, Serialize};

/// Commit of the checkout, read once: edits during a long command do not change the recorded commit.
static COMMIT: LazyLock<String> = LazyLock::new(commit);

/// Commit, command, seed, machine and date of a result.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Provenance {
    /// Commit of the checkout, with `-dirty` at the end if tracked files differ; `unknown` outside git.
    pub commit: String,
    /// The command line; of absolute paths only the last part.
    pub command: String,
    /// Seed of the run.
    pub seed: u64,
    /// GPU if there is one, processor, cores.
    pub machine: String,
    /// Date of the result (UTC).
    pub date: String,
}

impl Provenance {
    /// Provenance of this process.
    pub fn now(seed: u64) -> Self {
        let args = std::env::args_os().skip(1).map(|word| without_folders(word.to_string_lossy().into())).join(" ");
        // Commands of the Python package have the module's name.
        let own = std::env::args_os()
            .next()
            .is_some_and(|word| std::path::Path::new(&word).file_stem().is_some_and(|name| name == "nerd"));
        let program = match own {
            _ if args.contains("-m nerd ") => "python",
            true => "nerd",
            false => "cargo xtask",
        };
        let commit = COMMIT.clone();
        let command = format!("{program} {args}");
        let date = Utc::now().date_naive().to_string();
        Self { commit, command, seed, machine: machine(), date }
    }

    /// Reads the commit; call this when a program starts.
    pub fn begin() {
        LazyLock::force(&COMMIT);
    }

    /// Whether tracked files differed from the commit.
    pub fn dirty(&self) -> bool {
        self.commit.ends_with("-dirty")
    }

    /// Whether commit and command are known, so that the run can be repeated.
    pub fn traceable(&self) -> bool {
        !self.commit.is_empty() && self.commit != "unknown" && !self.command.is_empty()
    }
}

impl std::fmt::Display for Provenance {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { command, seed, commit, machine, date } = self;
        write!(f, "`{command}`, seed {seed}, commit {commit}, {machine}, {date}")
    }
}

/// An argument of the command line. An absolute path is cut to its last part, since other machines have other folders.
fn without_folders(word: String) -> String {
    let last = |path: &str| std::path::Path::new(path).file_name().map(|name| name.to_string_lossy().into_owned());
    if word.starts_with('/') { last(&word).unwrap_or(word) } else { word }
}

/// Name of the machine: GPU if there is one, processor and number of cores.
pub fn machine() -> String {
    let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = text.lines().find_map(|l| l.strip_prefix("model name")).map(|l| l.trim_start_matches([' ', '\t', ':']));
    let cores = std::thread::available_parallelism().map_or(1, |n| n.get());
    let cpu = format!("{} ({cores} cores)", model.unwrap_or(std::env::consts::ARCH));
    match output("nvidia-smi", &["--query-gpu=name", "--format=csv,noheader"]) {
        Some(gpu) => format!("{}, {cpu}", gpu.lines().next().unwrap_or_default()),
        None => cpu,
    }
}

/// GPU memory (MiB) of a process, if known.
pub fn card_memory(process: u32) -> Option<f64> {
    let all = output("nvidia-smi", &["--query-compute-apps=pid,used_memory", "--format=csv,noheader,nounits"])?;
    let own = all.lines().filter_map(|line| line.split_once(',')).filter(|(id, _)| id.trim() == process.to_string());
    own.map(|(_, used)| used.trim().parse::<f64>().ok()).sum()
}

/// The commit of the checkout. `NERD_COMMIT` replaces it outside a checkout.
fn commit() -> String {
    if let Ok(commit) = std::env::var("NERD_COMMIT") {
        return commit;
    }
    let Some(hash) = output("git", &["rev-parse", "--short=12", "HEAD"]) else { return "unknown".into() };
    // Files that commands write are ignored: they do not change the code.
    let code = [".", ":!results", ":!models", ":!README.md", ":!docs", ":!*.md"];
    let changed = output("git", &[&["status", "--porcelain", "--untracked-files=no", "--"], &code[..]].concat());
    if changed.is_some_and(|c| !c.is_empty()) { format!("{hash}-dirty") } else { hash }
}

/// Standard output of a program; none if it cannot be run or fails.
fn output(program: &str, args: &[&str]) -> Option<String> {
    let output = Command::new(program).args(args).output().ok().filter(|o| o.status.success())?;
    Some(String::from_utf8_lossy(&output.stdout).trim().to_string())
}
