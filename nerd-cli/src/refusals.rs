//! Prints errors in one line. The exit code is 2 for a command line that cannot be read, 1 for any other failure.

use itertools::Itertools;

/// Prints an error in one line, and returns the exit code `code`.
pub fn end(words: &str, code: u8) -> u8 {
    tell!("error: {words}");
    code
}

/// Returns clap's message without the usage that follows it.
pub fn usage(error: &clap::Error) -> String {
    let text = error.to_string();
    let mut words = text
        .lines()
        .take_while(|l| !l.starts_with("Usage:") && !l.starts_with("For more"))
        .flat_map(str::split_whitespace);
    words.join(" ").trim_start_matches("error: ").into()
}

/// Returns an error's text with those of its causes that the text does not contain already. The middle of a long text,
/// such as a quoted file, is omitted.
pub fn failure(error: &anyhow::Error) -> String {
    const MOST: usize = 2000;
    let words = error
        .chain()
        .map(ToString::to_string)
        .reduce(|all, cause| if all.contains(&cause) { all } else { all + ": " + &cause });
    let words = words.unwrap_or_default().replace('\n', " ");
    let n = words.chars().count();
    if n <= MOST {
        return words;
    }
    let start = words.chars().take(MOST - 500);
    let end = words.chars().skip(n - 500);
    start.chain(" [..] ".chars()).chain(end).collect()
}
