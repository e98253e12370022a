//! One of several parts of a data set, for machines that share the work: made at once, in any order, and again.

use std::fmt;
use std::str::FromStr;

/// One of several parts; the shards of a data set go to them in turn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Part {
    number: usize,
    of: usize,
}

impl Part {
    /// All of it.
    pub const WHOLE: Self = Self { number: 1, of: 1 };
    /// Most parts.
    pub const MOST: usize = 1_000_000;

    /// Whether it is all of it.
    pub fn whole(self) -> bool {
        self.of == 1
    }

    /// Whether shard `k`, counted from 0, is in it.
    pub fn holds(self, k: usize) -> bool {
        k % self.of == self.number - 1
    }
}

impl FromStr for Part {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers = text.split_once('/').and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
        let part = numbers.filter(|(i, n)| (1..=Self::MOST).contains(n) && (1..=*n).contains(i));
        part.map(|(number, of)| Self { number, of }).ok_or_else(|| format!("i/n is needed, from 1/n to n/n with n up to {}", Self::MOST))
    }
}

impl fmt::Display for Part {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.number, self.of)
    }
}
