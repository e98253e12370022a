//! The stability suite: scenes with known answers for any solver. It shows where a solver is right, where it degrades and where it fails.
//!
//! A [`Row`] is a scene with a measured figure and a limit; limits come from equations or from published tests, never from our own build. A
//! figure up to the limit is a pass, up to ten times the limit degraded. Beyond, or after an error of the solver, it is a failure; the
//! figure is then taken from the motion before the error.
//!
//! Your own solver:
//!
//! ```
//! use nerd_sim::instruments::Hold; // yours in its place
//! use nerd_sim::suite::{Method, Suite, Verdict};
//! let mine = Method::new("mine", |_system| Box::new(Hold));
//! let lines = Suite::new().only(&["free fall"])?.run(&[mine], |_done| ());
//! for line in &lines {
//!     println!("{}, {}: {}, limit {}", line.row, line.asked(), line.cells[0], line.limit);
//! }
//! assert_eq!(lines[0].cells[0].verdict, Verdict::Fail, "what stays where it is does not fall");
//! # Ok::<(), nerd_sim::suite::Error>(())
//! ```

use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;

pub mod bodies;
mod row;
mod rows;
mod trial;

pub use row::{Cell, Line, Row, Verdict};
pub use trial::{Error, Method, rise};

/// Rows to be run.
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
    /// All rows.
    pub fn new() -> Self {
        Self { rows: rows::all().collect() }
    }

    /// The rows that have one of `words` in their names; all of them without words. A word that matches no row is refused.
    pub fn only(mut self, words: &[impl AsRef<str>]) -> Result<Self, Error> {
        let has = |row: &Row, word: &str| row.name.contains(word);
        if let Some(word) = words.iter().map(AsRef::as_ref).find(|word| !self.rows.iter().any(|row| has(row, word))) {
            let names: Vec<String> = self.rows.iter().map(|row| format!("`{}`", row.name)).collect();
            return Err(Error::Row(word.into(), names.join(", ")));
        }
        self.rows.retain(|row| words.is_empty() || words.iter().any(|word| has(row, word.as_ref())));
        Ok(self)
    }

    /// The rows, in the order of tables.
    pub fn rows(&self) -> &[&'static Row] {
        &self.rows
    }

    /// Runs every row with every method, on all cores. `progress` receives how many of the rows times methods are done.
    pub fn run(&self, methods: &[Method], progress: impl Fn(usize) + Sync) -> Vec<Line> {
        let done = AtomicUsize::new(0);
        let measure = |row: &Row, method: &Method| {
            let cell = row.cell(method);
            progress(done.fetch_add(1, Ordering::Relaxed) + 1);
            cell
        };
        let line = |row: &&'static Row| row.line(methods.par_iter().map(|m| measure(row, m)).collect());
        self.rows.par_iter().map(line).collect()
    }
}
