//! The end of a failed command: one line, exit code 2.

/// Says it; the exit code.
pub fn end(words: &str) -> u8 {
    tell!("error: {words}");
    2
}

/// clap's message without its usage.
pub fn usage(error: &clap::Error) -> String {
    let text = error.to_string();
    let words = text.lines().take_while(|l| !l.starts_with("Usage:") && !l.starts_with("For more")).flat_map(str::split_whitespace);
    words.collect::<Vec<_>>().join(" ").trim_start_matches("error: ").into()
}

/// An error and its causes; many errors already name theirs. It may quote a whole file, whose middle is left out.
pub fn failure(error: &anyhow::Error) -> String {
    const MOST: usize = 2000;
    let words = error.chain().map(ToString::to_string).reduce(|all, cause| if all.contains(&cause) { all } else { all + ": " + &cause });
    let words = words.unwrap_or_default().replace('\n', " ");
    let n = words.chars().count();
    if n <= MOST {
        return words;
    }
    let (start, end) = (words.chars().take(MOST - 500), words.chars().skip(n - 500));
    start.chain(" [..] ".chars()).chain(end).collect()
}
