#![doc = include_str!("../README.md")]

use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;

pub mod bodies;
mod figures;
mod row;
mod rows;
mod trial;

pub use row::{Cell, Line, Row, Verdict};
pub use trial::{Error, Method, rise};

/// The stability suite: the rows to run.
#[derive(Clone, Debug)]
pub struct Suite {
    rows: Vec<&'static Row>,
}

impl Default for Suite {
    fn default() -> Self {
        Self::new()
    }
}

impl Suite {
    /// Makes a suite of all rows.
    pub fn new() -> Self {
        Self { rows: rows::all().collect() }
    }

    /// Keeps the rows whose names contain one of `words`; keeps all if there are no words. A word that matches no row
    /// is refused.
    pub fn only(mut self, words: &[impl AsRef<str>]) -> Result<Self, Error> {
        let has = |row: &Row, word: &str| row.name.contains(word);
        if let Some(word) = words.iter().map(AsRef::as_ref).find(|word| !self.rows.iter().any(|row| has(row, word))) {
            let names: Vec<String> = self.rows.iter().map(|row| format!("`{}`", row.name)).collect();
            return Err(Error::Row(word.into(), names.join(", ")));
        }
        self.rows.retain(|row| words.is_empty() || words.iter().any(|word| has(row, word.as_ref())));
        Ok(self)
    }

    /// Returns the rows of the suite, in the order of tables.
    pub fn rows(&self) -> &[&'static Row] {
        &self.rows
    }

    /// Runs every row with every method, on all cores. `progress` receives the number of finished cells (rows x
    /// methods).
    pub fn run(&self, methods: &[Method], progress: impl Fn(usize) + Sync) -> Vec<Line> {
        let done = AtomicUsize::new(0);
        let count = |_: &Cell| progress(done.fetch_add(1, Ordering::Relaxed) + 1);
        let cells = |row: &Row| methods.par_iter().map(|method| row.cell(method)).inspect(count).collect();
        self.rows.par_iter().map(|row| row.line(cells(row))).collect()
    }
}
