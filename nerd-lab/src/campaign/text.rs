//! Edits valid text at random: numbers, words, runs of tokens, and bytes. Random generators in equal states give equal
//! edits.

pub use nerd_tasks::ChaCha8Rng as Dice;
use rand::RngExt;

/// Most tokens that one edit copies or removes.
const STRETCH: usize = 60;

pub struct Dictionary {
    words: Vec<String>,
    /// Whether only spaces end a word, as on a command line. If so, numbers are only replaced by dictionary words,
    /// never scaled.
    spaced: bool,
}

impl Dictionary {
    /// Words to insert into a robot's URDF.
    pub fn urdf() -> Self {
        Self::new(include_str!("words/urdf.txt"), false)
    }

    pub fn toml() -> Self {
        Self::new(include_str!("words/toml.txt"), false)
    }

    pub fn csv() -> Self {
        Self::new(include_str!("words/csv.txt"), false)
    }

    pub fn model() -> Self {
        Self::new(include_str!("words/model.txt"), false)
    }

    /// Reads a dictionary. The first line of `text` has words (`''` is the empty word); each other line is one entry.
    pub fn new(text: &str, spaced: bool) -> Self {
        let (words, lines) = text.split_once('\n').unwrap_or((text, ""));
        let words = words.split(' ').map(|word| if word == "''" { String::new() } else { repeated(word) });
        Self { words: words.chain(lines.lines().map(|line| format!("\n{}\n", repeated(line)))).collect(), spaced }
    }

    /// Edits a text up to four times, or not at all. One edit in 16 changes raw bytes instead of words.
    pub fn change(&self, dice: &mut Dice, bytes: &mut Vec<u8>) {
        for _ in 0..[0, 1, 1, 1, 1, 2, 2, 4][dice.random_range(0..8)] {
            match std::str::from_utf8(bytes) {
                Ok(text) if dice.random_range(0..16) > 0 => *bytes = self.changed(dice, self.split(text)).into_bytes(),
                _ => byte(dice, bytes),
            }
        }
    }

    fn split(&self, text: &str) -> Vec<String> {
        let inside = |c: char| if self.spaced { !c.is_whitespace() } else { c.is_alphanumeric() || "_.+-".contains(c) };
        let mut words: Vec<String> = Vec::new();
        for c in text.chars() {
            match words.last_mut() {
                Some(last) if inside(c) && last.ends_with(inside) => last.push(c),
                _ => words.push(c.into()),
            }
        }
        words
    }

    fn changed(&self, dice: &mut Dice, mut text: Vec<String>) -> String {
        let other = self.words[dice.random_range(0..self.words.len())].clone();
        if text.is_empty() {
            return other;
        }
        let [a, b] = [(); 2].map(|()| dice.random_range(0..text.len()));
        let stretch = a..(a + 1 + dice.random_range(0..STRETCH)).min(text.len());
        match dice.random_range(0..12) {
            0 => {
                let copy = text[stretch].to_vec();
                text.splice(b..b, copy);
            }
            1 => drop(text.drain(stretch)),
            2 => text.truncate(a),
            3 => text.insert(a, other),
            4 => text.swap(a, b),
            _ => {
                let own = |w: &&mut String| {
                    w.starts_with(|c: char| c.is_alphanumeric() || "-.".contains(c)) && !w.starts_with("--")
                };
                if let Some(word) = text[a..].iter_mut().find(own) {
                    *word = self.word(dice, word, &other);
                }
            }
        }
        text.concat()
    }

    fn word(&self, dice: &mut Dice, word: &str, other: &str) -> String {
        let u: f64 = dice.random();
        match (word.parse::<f64>(), dice.random_range(0..8)) {
            (Ok(x), 0..2) if !self.spaced => format!("{:?}", (0.5 + u) * x),
            (Ok(x), 2..4) if !self.spaced => format!("{:?}", 10f64.powf(12.0 * u - 6.0) * x),
            (Ok(x), 4) if !self.spaced => format!("{:?}", -x),
            (Ok(_), 5) if !self.spaced => format!("{:?}", f64::from_bits(dice.random())),
            _ => other.into(),
        }
    }
}

/// Changes, inserts or removes one byte at a random place, or truncates there.
pub fn byte(dice: &mut Dice, bytes: &mut Vec<u8>) {
    let at = dice.random_range(0..=bytes.len());
    let new = dice.random();
    match (dice.random_range(0..16), bytes.get_mut(at)) {
        (0, _) => bytes.truncate(at),
        (1..4, Some(_)) => drop(bytes.remove(at)),
        (4..8, Some(old)) => *old = new,
        (8..12, Some(old)) => *old ^= 1 << (new % 8),
        _ => bytes.insert(at, new),
    }
}

/// Expands `@(/1*200000)@` to 200000 repetitions of `/1`.
pub fn repeated(text: &str) -> String {
    let found = text.split_once("@(").and_then(|(before, rest)| {
        let (inside, after) = rest.split_once(")@")?;
        let (what, times) = inside.rsplit_once('*')?;
        Some([before, &what.repeat(times.parse().ok()?), after].concat())
    });
    found.unwrap_or_else(|| text.into())
}
