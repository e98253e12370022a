//! Replaces old names of verbs and options, which `renamed.txt` lists, before the command line is parsed.

use std::ffi::OsString;

use itertools::Itertools;

const TABLE: &str = include_str!("renamed.txt");

/// Rows of the table: verb, old name, new name.
fn rows() -> impl Iterator<Item = [&'static str; 3]> {
    TABLE.lines().filter(|line| !line.starts_with('#')).filter_map(|line| line.split(' ').collect_vec().try_into().ok())
}

/// Replaces old names in a command line. Returns the new line, and a note that names the replaced words, if there are
/// any.
pub fn replace(words: Vec<OsString>) -> (Vec<OsString>, Option<String>) {
    let mut line = words;
    let mut told = Vec::new();
    let mut verb = String::from(".");
    for at in verbs(&line) {
        let name = rows().find(|[of, old, _]| *of == verb && line[at] == *old);
        if let Some([_, old, new]) = name {
            line[at] = new.into();
            told.push(format!("`{old}` is `{new}`"));
        }
        let part = line[at].to_string_lossy();
        verb = if verb == "." { part.into_owned() } else { format!("{verb}/{part}") };
    }
    let mut at = 1;
    while at < line.len() && line[at] != "--" {
        // Reads the line anew after a replacement, which ends because no new name is an old one.
        at = option(&mut line, at, &verb).map_or(at + 1, |said| {
            told.push(said);
            1
        });
    }
    told.dedup();
    let note = (!told.is_empty()).then(|| format!("{}; old names are read for one version", told.join(", ")));
    (line, note)
}

/// Indices of the verb and of its subcommand in the command line.
fn verbs(line: &[OsString]) -> Vec<usize> {
    (1..line.len()).filter(|at| !line[*at].as_encoded_bytes().starts_with(b"-")).take(2).collect()
}

/// Replaces an old option at index `at`; returns a text that names the old and the new one.
fn option(line: &mut Vec<OsString>, at: usize, verb: &str) -> Option<String> {
    let word = line[at].to_str().filter(|word| word.starts_with("--"))?.to_string();
    let (name, value) = word.split_once('=').map_or((word.as_str(), None), |(name, value)| (name, Some(value)));
    let next = line.get(at + 1).and_then(|next| next.to_str());
    let own = |of: &str| verb == of || verb.strip_prefix(of).is_some_and(|rest| rest.starts_with('/'));
    let asked = |old: &str| match old.split_once('=') {
        Some((option, only)) => option == name && value.or(next) == Some(only),
        None => old == name,
    };
    let [_, old, new] = rows().find(|[of, old, _]| own(of) && asked(old))?;
    if old.contains('=') {
        line[at] = new.into();
        line.drain(at + 1..at + 1 + usize::from(value.is_none()));
        // Removes `--solver articulated`, which the new option includes.
        let engine = line
            .windows(2)
            .position(|pair| new.starts_with("--solver=") && pair[0] == "--solver" && pair[1] == "articulated");
        if let Some(at) = engine {
            line.drain(at..at + 2);
        }
    } else {
        line[at] = value.map_or(new.into(), |value| format!("{new}={value}")).into();
    }
    Some(format!("`{}` is `{}`", old.replace('=', " "), new.replacen('=', " ", 1)))
}

#[cfg(test)]
mod tests {
    use std::ffi::OsStr;

    use super::*;

    fn replaced(line: &str) -> (String, Option<String>) {
        let (words, note) = replace(line.split(' ').map(OsString::from).collect());
        (words.join(OsStr::new(" ")).into_string().expect("UTF-8"), note)
    }

    #[test]
    fn old_names_are_replaced_by_verb_and_told_in_one_line() {
        for (old, new) in [
            ("nerd policy evaluate --games=3 --fresh 1,2", "nerd policy evaluate --episodes=3 --fresh-seeds 1,2"),
            ("nerd --json policy carry --games 3", "nerd --json policy sim-to-sim --episodes 3"),
            (
                "nerd evaluate --robot ant --starts 2 --drive 1",
                "nerd evaluate --robot ant --trajectories 2 --torque-scale 1",
            ),
            (
                "nerd rollout --solver articulated --preset paper --frames 3",
                "nerd rollout --solver=articulated(method=paper) --frames 3",
            ),
            ("nerd urdf f --out --", "nerd check-robots f --out --"),
        ] {
            let (line, note) = replaced(old);
            assert_eq!(line, new);
            assert!(note.is_some_and(|note| note.lines().count() == 1), "{old}");
        }
        let new = "nerd rollout --robot ant --substeps 3 --preset nonsense";
        assert_eq!(replaced(new), (new.into(), None));
        let told = replaced("nerd policy evaluate --games 3").1.expect("a note");
        assert!(told.starts_with("`--games` is `--episodes`"), "{told}");
    }
}
