//! How a command ends that cannot be done: one line, exit code 2.

use std::process::ExitCode;

use clap::error::{ContextKind, ContextValue, ErrorKind};

/// Options that had other names once.
const RENAMED: [(&str, &str); 3] = [("--steps", "--frames"), ("--horizon", "--frames"), ("--preset", "--recipe")];

/// Says it, and ends.
pub fn end(words: &str) -> ExitCode {
    nerd_train::progress::last(format_args!("error: {words}"));
    ExitCode::from(2)
}

/// Ends where the command line says nothing that can be done. Who asks for help, or for nothing at all, sees the verbs.
pub fn unsaid(error: &clap::Error) -> ExitCode {
    if !error.use_stderr() || error.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand {
        error.exit();
    }
    end(&usage(error))
}

/// clap's message without its usage.
pub fn usage(error: &clap::Error) -> String {
    let given = |kind| match error.get(kind) {
        Some(ContextValue::String(text)) => text.as_str(),
        _ => "",
    };
    let option = given(ContextKind::InvalidArg);
    match error.kind() {
        ErrorKind::UnknownArgument => {
            if let Some((old, new)) = RENAMED.iter().find(|(old, _)| *old == option) {
                return format!("{old} is now called {new}");
            }
            if nerd_tasks::names().contains(&option) {
                return format!("`{option}`: a policy knows its task; leave it out");
            }
        }
        ErrorKind::InvalidValue if given(ContextKind::InvalidValue) == "flex" => return format!("{option}: flex is now called cpu"),
        _ => {}
    }
    let text = error.to_string();
    let words = text.lines().take_while(|l| !l.starts_with("Usage:") && !l.starts_with("For more")).flat_map(str::split_whitespace);
    words.collect::<Vec<_>>().join(" ").trim_start_matches("error: ").into()
}

/// An error and its causes; many errors already say theirs.
pub fn failure(error: &anyhow::Error) -> String {
    let said = error.chain().map(ToString::to_string).reduce(|all, cause| if all.contains(&cause) { all } else { all + ": " + &cause });
    brief(&said.unwrap_or_default().replace('\n', " "))
}

/// The words of an error without the middle of what nobody would read: it may quote a whole file.
fn brief(words: &str) -> String {
    const MOST: usize = 2000;
    let n = words.chars().count();
    if n <= MOST {
        return words.into();
    }
    let (start, end) = (words.chars().take(MOST - 500), words.chars().skip(n - 500));
    start.chain(" [..] ".chars()).chain(end).collect()
}
