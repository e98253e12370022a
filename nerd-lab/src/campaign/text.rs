//! Changes of good text, by `mutatis`: of its numbers, its words, stretches of it, its bytes. The same seed makes the same changes.

use mutatis::{Candidates, Context, Generate, Mutate, Result, Session, mutators as m};

/// How often a word becomes one of the dictionary, beside the twelve numbers that `mutatis` has for a number.
const OFTEN: u32 = 6;
/// Longest stretch that is copied or goes, in words and what is between them.
const STRETCH: usize = 60;

pub struct Dictionary {
    words: Vec<String>,
    /// Whether words end only at spaces, as those of a command line do; their numbers then come from the dictionary alone.
    spaced: bool,
}

impl Dictionary {
    /// From words in the first line, `''` for none, and whole lines below it.
    pub fn new(text: &str, spaced: bool) -> Self {
        let (words, lines) = text.split_once('\n').unwrap_or((text, ""));
        let words = words.split(' ').map(|word| if word == "''" { String::new() } else { repeated(word) });
        Self { words: words.chain(lines.lines().map(|line| format!("\n{}\n", repeated(line)))).collect(), spaced }
    }

    /// Changes a text up to four times, or not at all; sometimes its bytes, whatever they mean.
    pub fn change(&self, session: &mut Session, bytes: &mut Vec<u8>) {
        let times = [0, 1, 1, 1, 1, 2, 2, 4][dice(session, 8)];
        match std::str::from_utf8(bytes) {
            Ok(text) if dice(session, 16) > 0 => {
                let mut words = self.split(text);
                (0..times).for_each(|_| session.mutate_with(&mut Text(self), &mut words).unwrap_or_default());
                *bytes = words.concat().into_bytes();
            }
            _ => (0..times).for_each(|_| session.mutate(bytes).unwrap_or_default()),
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
}

/// A number below a bound.
pub fn dice(session: &mut Session, below: usize) -> usize {
    session.generate::<u32>().map_or(0, |n| n as usize % below)
}

/// A stretch copied or gone, an early end, a word more; else what `mutatis` does with a list of words.
struct Text<'a>(&'a Dictionary);

impl Mutate<Vec<String>> for Text<'_> {
    fn mutate(&mut self, c: &mut Candidates, text: &mut Vec<String>) -> Result<()> {
        c.mutation_group(text.len() as u32, |ctx, k| {
            let [a, b, n] = [text.len(), text.len(), STRETCH].map(|below| ctx.rng().gen_index(below).unwrap_or(0));
            let stretch = a..(a + 1 + n).min(text.len());
            match k % 4 {
                0 => {
                    let copy = text[stretch].to_vec();
                    text.splice(b..b, copy);
                }
                1 => drop(text.drain(stretch)),
                2 => text.truncate(a),
                _ => text.insert(a, Word(self.0).generate(ctx)?),
            }
            Ok(())
        })?;
        m::vec(Word(self.0)).mutate(c, text)
    }
}

struct Word<'a>(&'a Dictionary);

impl Mutate<String> for Word<'_> {
    fn mutate(&mut self, c: &mut Candidates, word: &mut String) -> Result<()> {
        if !word.starts_with(|c: char| c.is_alphanumeric() || "-.".contains(c)) || word.starts_with("--") {
            return Ok(());
        }
        c.mutation_group(OFTEN, |ctx, _| {
            *word = self.generate(ctx)?;
            Ok(())
        })?;
        let Some(mut x) = word.parse::<f64>().ok().filter(|_| !self.0.spaced) else { return Ok(()) };
        c.mutation_group(2 * OFTEN, |ctx, k| {
            let u = ctx.rng().gen_f64();
            let new = [0.5 + u, -1.0, 10f64.powf(12.0 * u - 6.0)][k as usize % 3] * x;
            *word = format!("{new:?}");
            Ok(())
        })?;
        let changed = m::f64().mutate(c, &mut x);
        if changed.is_err() {
            *word = format!("{x:?}");
        }
        changed
    }
}

impl Generate<String> for Word<'_> {
    fn generate(&mut self, ctx: &mut Context) -> Result<String> {
        Ok(ctx.rng().choose(&self.0.words).cloned().unwrap_or_default())
    }
}

/// `@(/1*200000)@` stands for so many of them.
pub fn repeated(text: &str) -> String {
    let found = text.split_once("@(").and_then(|(before, rest)| {
        let (inside, after) = rest.split_once(")@")?;
        let (what, times) = inside.rsplit_once('*')?;
        Some([before, &what.repeat(times.parse().ok()?), after].concat())
    });
    found.unwrap_or_else(|| text.into())
}
