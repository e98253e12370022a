//! Checks mutated MJCFs with MuJoCo's compiler: a file that MuJoCo refuses must be refused here too.

use std::process::{Command, Stdio};

use super::Kind;
use crate::prelude::*;

/// Most MJCF files that one Python process compiles.
const TOGETHER: usize = 500;
const ASK: &str = "
import sys, mujoco
mujoco.set_mju_user_warning(lambda text: None)
for k, name in enumerate(sys.stdin.read().split()):
    try:
        mujoco.MjModel.from_xml_path(name)
        print(k, 'ok', flush=True)
    except Exception as e:
        print(k, 'no', str(e).replace(chr(10), ' '), flush=True)
";

/// Returns those of the case `numbers` whose MJCF MuJoCo refuses, each with MuJoCo's reason.
pub fn refused(python: &Path, seed: u64, numbers: &[u64]) -> Result<Vec<(u64, String)>> {
    let mut found = Vec::new();
    let mut at = 0;
    let bar = bar("compiled by MuJoCo", numbers.len() as u64);
    while at < numbers.len() {
        let some = &numbers[at..(at + TOGETHER).min(numbers.len())];
        let folder = tempfile::tempdir()?;
        let mut names = String::new();
        for number in some {
            let path = folder.path().join(format!("{number}.xml"));
            std::fs::write(&path, &Kind::Mjcf.make(seed, *number)?[0].1)?;
            names += &format!("{}\n", path.display());
        }
        let list = folder.path().join("list");
        std::fs::write(&list, names)?;
        let asked =
            Command::new(python).args(["-c", ASK]).stdin(std::fs::File::open(&list)?).stderr(Stdio::null()).output();
        let asked = asked.with_context(|| format!("--mujoco {}", python.display()))?;
        let answers = String::from_utf8_lossy(&asked.stdout);
        let answers = answers.lines().collect_vec();
        for (number, answer) in some.iter().zip(&answers) {
            if let Some((_, why)) = answer.split_once(" no ") {
                found.push((*number, format!("MuJoCo refuses it, and it was accepted: {why:.200}")));
            }
        }
        if answers.is_empty() && !asked.status.success() && at == 0 {
            bail!("--mujoco {}: this Python has no MuJoCo", python.display());
        }
        // Skips the file on which the Python process crashed.
        at += if answers.len() < some.len() { answers.len() + 1 } else { some.len() };
        bar.set(at as u64);
    }
    bar.finish();
    Ok(found)
}
