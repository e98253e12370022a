//! `cargo xtask stability`: where each method stays right, where it bends and where it breaks.
//!
//! Rows are scenes with known answers, columns are solvers at certain settings. A cell holds a measured figure; the row has
//! a limit from an equation or from somebody's tests, never one taken from our own build. Up to the limit is a pass, up to
//! ten times the limit degraded, beyond it, or with an error of the solver (the figure is then that of the motion before), a
//! failure. Failures are the point.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use rayon::prelude::*;
use serde::Serialize;

mod contact;
mod flight;
mod heat;
mod joints;
mod learned;
mod method;
mod robots;
mod row;
mod trial;
pub mod worlds;

use method::{METHODS, Method};
use row::{Cell, Row, Verdict, rows};
use trial::{Fault, Trial};

use crate::flags::unused;
use crate::provenance::Provenance;
use crate::table::{digits, markdown};

/// Show where methods fail.
#[derive(clap::Args, Clone, Debug)]
pub struct StabilityArgs {
    /// Rows whose name contains one of these words, comma-separated [default: all]
    #[arg(long, value_delimiter = ',')]
    pub rows: Vec<String>,
    /// Break every method on purpose, to see the rows that can tell go red; nothing is written
    #[arg(long, value_enum)]
    pub fault: Option<Fault>,
    /// Model folders, comma-separated: asks of learned models, in their place, written as stability-FOLDER.*
    #[arg(long, value_delimiter = ',')]
    pub model: Vec<PathBuf>,
    /// Folder for stability.json, .md, .svg and .png [default: results]
    #[arg(long)]
    pub out: Option<PathBuf>,
}

/// A row as it is written.
#[derive(Serialize)]
struct Line {
    row: &'static str,
    figure: &'static str,
    source: &'static str,
    limit: f64,
    cells: Vec<Cell>,
}

/// Runs the verb.
pub fn run(args: StabilityArgs) -> Result<()> {
    if args.fault.is_some() {
        unused(&[("--out", args.out.is_some())], "beside --fault, under which nothing is written")?;
        unused(&[("--model", !args.model.is_empty())], "beside --fault, which breaks the analytic methods")?;
    }
    let out = args.out.unwrap_or_else(|| "results".into());
    if !args.model.is_empty() {
        for (folder, (title, columns, lines)) in args.model.iter().zip(learned::tables(&args.model, &args.rows)?) {
            let name = folder.file_name().map_or_else(|| "model".into(), |n| n.to_string_lossy());
            println!("{title}\n");
            write(&out.join(format!("stability-{name}")), &format!("Where it holds: {title}"), &columns, &lines)?;
        }
        return Ok(());
    }
    known(&args.rows, &rows().map(|r| r.name).collect::<Vec<_>>())?;
    let chosen: Vec<&Row> = rows().filter(|r| args.rows.is_empty() || args.rows.iter().any(|w| r.name.contains(w.as_str()))).collect();
    let bar = crate::common::bar("cells", (chosen.len() * METHODS.len()) as u64);
    let done = std::sync::atomic::AtomicUsize::new(0);
    let measure = |row: &Row, method: &Method| {
        let cell = row.cell(&Trial::new(method, args.fault));
        bar.set(done.fetch_add(1, std::sync::atomic::Ordering::Relaxed) as u64 + 1);
        cell
    };
    let lines: Vec<Line> = chosen
        .par_iter()
        .map(|row| Line {
            row: row.name,
            figure: row.figure,
            source: row.source,
            limit: row.limit,
            cells: METHODS.par_iter().map(|m| measure(row, m)).collect(),
        })
        .collect();
    bar.finish();
    let names: Vec<String> = METHODS.iter().map(|m| m.name.to_string()).collect();
    if let Some(fault) = args.fault {
        println!("{}", table(&names, &lines));
        let named = chosen.iter().filter(|r| r.reddens.contains(&fault)).map(|r| r.name).collect::<Vec<_>>();
        println!("rows that {fault:?} must turn red: {}", named.join(", "));
        return Ok(());
    }
    write(&out.join("stability"), "Where methods fail: figure of each row, coloured by figure / limit", &names, &lines)
}

/// Refuses a word of --rows that no row has in its name.
fn known(words: &[String], names: &[&str]) -> Result<()> {
    match words.iter().find(|w| !names.iter().any(|name| name.contains(w.as_str()))) {
        Some(word) => bail!("--rows {word}: no row is called so; known are {}", names.join(", ")),
        None => Ok(()),
    }
}

/// Prints the table and writes `stem.json`, `.md`, `.svg` and `.png`.
fn write(stem: &Path, title: &str, columns: &[String], lines: &[Line]) -> Result<()> {
    let text = table(columns, lines);
    println!("{text}");
    let stamp = Provenance::now(0);
    let json = serde_json::json!({ "provenance": stamp, "methods": columns, "rows": lines });
    crate::files::write(&stem.with_extension("json"), (serde_json::to_string_pretty(&json)? + "\n").as_bytes())?;
    let from = format!("\n`{}`, commit {}, {}, {}\n", stamp.command, stamp.commit, stamp.machine, stamp.date);
    crate::files::write(&stem.with_extension("md"), (text + &from).as_bytes())?;
    Ok(heat::draw(title, columns, lines, stem)?)
}

/// The figures with a mark: nothing for a pass, `!` for degraded, `!!` for failed, `lost` where the solver gave up.
fn table(columns: &[String], lines: &[Line]) -> String {
    let mark = |c: &Cell| match c.verdict {
        _ if c.lost.is_some() => " lost",
        Verdict::Pass => "",
        Verdict::Degraded => " !",
        Verdict::Fail => " !!",
    };
    let cell = |c: &Cell| digits(c.figure) + mark(c);
    let rows = lines.iter().map(|l| {
        let start = [l.row.to_string(), l.figure.to_string(), digits(l.limit)];
        start.into_iter().chain(l.cells.iter().map(cell)).collect()
    });
    let header: Vec<&str> = ["row", "figure", "limit"].into_iter().chain(columns.iter().map(String::as_str)).collect();
    markdown(&header, &rows.collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use clap::ValueEnum;

    use super::method::CONVERGED;
    use super::*;

    fn converged() -> &'static Method {
        METHODS.iter().find(|m| m.name == CONVERGED).expect("a column")
    }

    /// Rows of known physics; those of drives at the edge are not, no method need pass them.
    fn known() -> Vec<&'static Row> {
        rows().filter(|r| !r.name.starts_with("ANYmal") || r.name == "ANYmal kp 85").collect()
    }

    #[test]
    fn the_converged_preset_passes_known_physics() {
        let failed: Vec<String> = known()
            .par_iter()
            .map(|row| (row, row.cell(&Trial::new(converged(), None))))
            .filter(|(_, cell)| cell.verdict != Verdict::Pass)
            .map(|(row, cell)| format!("{}: {:?}, limit {}", row.name, (cell.figure, cell.lost), row.limit))
            .collect();
        assert!(failed.is_empty(), "{}", failed.join("\n"));
    }

    /// Four substeps of 1/240 s do what takes the explicit step 1024: the point of the implicit one.
    #[test]
    fn four_implicit_substeps_pass_known_physics() {
        let method = METHODS.iter().find(|m| m.name == "implicit x4").expect("a column");
        // Convergence is asked of an accurate preset.
        let asked = known().into_par_iter().filter(|r| !r.name.contains("self-convergence"));
        let cells: Vec<(&Row, Cell)> = asked.map(|row| (row, row.cell(&Trial::new(method, None)))).collect();
        let failed: Vec<_> = cells.iter().filter(|(_, c)| c.verdict != Verdict::Pass).map(|(r, c)| (r.name, c.figure)).collect();
        assert!(failed.is_empty(), "{failed:?}");
    }

    /// A fault turns the rows red that name it, and leaves the others green.
    #[test]
    fn every_row_can_go_red() {
        let (method, asked) = (converged(), known());
        let pairs: Vec<(&Row, Fault)> = asked.iter().flat_map(|r| Fault::value_variants().iter().map(|f| (*r, *f))).collect();
        let wrong: Vec<String> = pairs
            .par_iter()
            .filter_map(|(row, fault)| {
                let cell = row.cell(&Trial::new(method, Some(*fault)));
                let red = cell.verdict != Verdict::Pass;
                (red != row.reddens.contains(fault)).then(|| format!("{} under {fault:?}: {:?}", row.name, (cell.figure, cell.lost)))
            })
            .collect();
        assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    }
}
