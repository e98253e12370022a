//! What is done to good input: one to four changes, each somewhere at random, most of them where they mean something.

use rand::{Rng, RngExt};

/// Numbers that programs stumble over; `''` is nothing.
pub const ODD: &str = "nan inf -inf 1e308 -1e308 1e999 -0 0 1e-308 5e-324 -1 1 2 0.5 -0.5 64 1e6 1e9 1e12 1000000 4294967296 \
                       9223372036854775807 18446744073709551615 18446744073709551616 -9223372036854775809 1/1/1 ''";

/// One of a list.
pub fn one<T: Copy>(rng: &mut impl Rng, of: &[T]) -> T {
    of[rng.random_range(0..of.len())]
}

/// One word of a text; `''` is nothing.
pub fn pick<'a>(rng: &mut impl Rng, words: &'a str) -> &'a str {
    let word = one(rng, &words.split_whitespace().collect::<Vec<_>>());
    if word == "''" { "" } else { word }
}

/// One line of a text.
pub fn pick_line<'a>(rng: &mut impl Rng, lines: &'a str) -> &'a str {
    one(rng, &lines.lines().collect::<Vec<_>>())
}

/// How many changes: one to four, mostly one.
pub fn times(rng: &mut impl Rng) -> usize {
    one(rng, &[1, 1, 1, 1, 2, 2, 3, 4])
}

/// A change of any text: of its numbers, its lines, or its bytes.
pub fn anything(rng: &mut impl Rng, text: &mut Vec<u8>) {
    match rng.random_range(0..10) {
        0..5 => number(rng, text),
        5..8 => lines(rng, text),
        8 => words(rng, text),
        _ => bytes(rng, text),
    }
}

/// Another number in place of one.
fn number(rng: &mut impl Rng, text: &mut Vec<u8>) {
    let found = spans(text, |b| b.is_ascii_digit() || matches!(b, b'.' | b'-' | b'+' | b'e' | b'E'));
    let found: Vec<_> = found.into_iter().filter(|s| text[s.clone()].iter().any(u8::is_ascii_digit)).collect();
    if found.is_empty() {
        return;
    }
    let span = found[rng.random_range(0..found.len())].clone();
    let old = std::str::from_utf8(&text[span.clone()]).ok().and_then(|t| t.parse::<f64>().ok()).unwrap_or(1.0);
    let new = match rng.random_range(0..9) {
        0 => (-old).to_string(),
        1 => (old * 10f64.powi(rng.random_range(-6..7))).to_string(),
        2 => (old + rng.random_range(-2.0..2.0)).to_string(),
        3 => rng.random_range(0..20).to_string(),
        4 => (old * rng.random_range(0.5..2.0)).to_string(),
        _ => pick(rng, ODD).to_string(),
    };
    text.splice(span, new.into_bytes());
}

/// Two words change places, or one is there twice, or gone.
fn words(rng: &mut impl Rng, text: &mut Vec<u8>) {
    let found = spans(text, |b| b.is_ascii_alphanumeric() || b == b'_');
    if found.len() < 2 {
        return;
    }
    let (a, b) = (rng.random_range(0..found.len()), rng.random_range(0..found.len()));
    let (a, b) = (found[a.min(b)].clone(), found[a.max(b)].clone());
    let (first, second) = (text[a.clone()].to_vec(), text[b.clone()].to_vec());
    match rng.random_range(0..4) {
        0 => drop(text.splice(b, first)),
        1 => drop(text.splice(b, [])),
        2 => drop(text.splice(b, [second.clone(), second].concat())),
        _ if a == b => {}
        _ => {
            text.splice(b, first);
            text.splice(a, second);
        }
    }
}

/// Lines change places, come twice, go, or end early; the text may end early, too.
fn lines(rng: &mut impl Rng, text: &mut Vec<u8>) {
    let mut all: Vec<Vec<u8>> = text.split(|b| *b == b'\n').map(<[u8]>::to_vec).collect();
    let (a, b) = (rng.random_range(0..all.len()), rng.random_range(0..all.len()));
    match rng.random_range(0..6) {
        0 => all.insert(b, all[a].clone()),
        1 => drop(all.remove(a)),
        2 => all.swap(a, b),
        3 => all.truncate(a.max(1)),
        4 => {
            let end = rng.random_range(0..=all[a].len());
            all[a].truncate(end);
        }
        _ => {
            // A few lines together, a link or a joint, say.
            let end = (a + rng.random_range(1..8)).min(all.len());
            let block = all[a..end].to_vec();
            all.splice(b..b, block);
        }
    }
    *text = all.join(&b'\n');
}

/// Bytes turn, go, or come.
pub fn bytes(rng: &mut impl Rng, text: &mut Vec<u8>) {
    if text.is_empty() {
        return;
    }
    let at = rng.random_range(0..text.len());
    match rng.random_range(0..5) {
        0 => text[at] ^= 1 << rng.random_range(0..8),
        1 => text[at] = rng.random(),
        2 => drop(text.remove(at)),
        3 => text.insert(at, one(rng, b"\"<>=,[}\n\0\xff-")),
        _ => text.truncate(at),
    }
}

/// Longest runs of such bytes.
fn spans(text: &[u8], belongs: impl Fn(u8) -> bool) -> Vec<std::ops::Range<usize>> {
    let mut found: Vec<std::ops::Range<usize>> = Vec::new();
    for i in (0..text.len()).filter(|i| belongs(text[*i])) {
        match found.last_mut().filter(|s| s.end == i) {
            Some(span) => span.end = i + 1,
            None => found.push(i..i + 1),
        }
    }
    found
}
