//! A case is used as its command line says, in a folder of its own, and what it leaves is looked at.

use super::files::{Files, NOT_FINITE, below, whole, write};
use crate::prelude::*;

/// The program, called with the words of a command line; an error in words.
pub type Call = fn(&[&str]) -> Result<(), String>;

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
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Verdict(pub Outcome, pub String);

/// Whatever comes behind `Accepted` must not happen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
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

/// Longest message (bytes): it has to be readable.
const WORDS: usize = 10_000;
/// Uses a case in the folder that this process is in, which it empties.
pub fn judge(case: &Case, call: Call) -> Result<Verdict> {
    let here = std::env::current_dir()?;
    for entry in std::fs::read_dir(&here)? {
        let path = entry?.path();
        if path.is_dir() { std::fs::remove_dir_all(path)? } else { std::fs::remove_file(path)? }
    }
    write(&here, &case.named())?;
    std::fs::write("there", "x")?;
    #[cfg(unix)]
    std::os::unix::fs::symlink("/dev/null", "null")?;
    case.before.iter().try_for_each(|line| prepare(line, call))?;
    let had = below(&here)?;
    let words: Vec<&str> = case.line.split_whitespace().map(|word| if word == "''" { "" } else { word }).collect();
    let ended = call(&words);
    let left: Vec<PathBuf> = below(&here)?.into_iter().filter(|path| !had.contains(path)).collect();
    let kept = std::fs::read("there").is_ok_and(|text| text == b"x") && Path::new("null").is_symlink();
    let (outcome, words) = match ended {
        Ok(()) => match left.iter().try_for_each(|path| whole(path)) {
            Ok(()) => (Outcome::Accepted, String::new()),
            Err(words) => (if words.contains(NOT_FINITE) { Outcome::NotFinite } else { Outcome::Untidy }, words),
        },
        Err(words) if words.is_empty() || words.len() > WORDS => (Outcome::Untidy, format!("a refusal of {} bytes", words.len())),
        Err(words) if !left.is_empty() || case.before.is_empty() && Path::new("out").exists() => {
            (Outcome::Untidy, format!("a refusal left {left:?}: {words}"))
        }
        Err(words) if !kept => (Outcome::Untidy, format!("a refusal replaced a file: {words}")),
        Err(words) => (Outcome::Refused, words),
    };
    Ok(Verdict(outcome, words))
}

/// A line that must succeed: the program's; `rm FILE`; `cut FILE`, which takes a file's second half away; `stamp FOLDER`, which makes a
/// model's hash fit, since loading refuses any other change first.
fn prepare(line: &str, call: Call) -> Result<()> {
    match line.split_once(' ') {
        Some(("rm", file)) => std::fs::remove_file(file)?,
        Some(("cut", file)) => {
            let bytes = std::fs::read(file)?;
            std::fs::write(file, &bytes[..bytes.len() / 2])?;
        }
        Some(("stamp", folder)) => {
            let (system, folder) = (System::named("pendulum")?, Path::new(folder));
            if let Ok(mut model) = Model::read(folder, &system, None) {
                model.stamp(&system);
                std::fs::write(folder.join("config.json"), serde_json::to_string(&model.config)?)?;
            }
        }
        _ => call(&line.split(' ').collect::<Vec<_>>()).map_err(|words| anyhow::anyhow!("`{line}` failed: {words}"))?,
    }
    Ok(())
}
