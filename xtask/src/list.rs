//! `cargo xtask list`: lists names that command lines may use, with the rows of the stability suite.

use nerd_cli::report::{Table, digits};
use nerd_cli::{out, verbs::list};
use nerd_suite::{Row, Suite};

use crate::prelude::*;

#[derive(clap::Subcommand)]
pub enum What {
    #[command(flatten)]
    Named(list::What),
    /// List the rows of the stability suite
    Rows,
}

pub fn run(what: What) -> Result<()> {
    match what {
        What::Named(what) => list::run(what),
        What::Rows => {
            out::table(&rows());
            Ok(())
        }
    }
}

fn rows() -> Table {
    let suite = Suite::new();
    let row = |row: &&Row| [row.name, row.figure, row.unit, &digits(row.limit), row.source, row.why].map(String::from);
    Table::new("rows", ["row", "figure", "unit", "limit", "source", "why"]).with(suite.rows().iter().map(row))
}
