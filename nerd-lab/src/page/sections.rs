//! Sections of the report page, as HTML.

use std::path::Path;

use nerd_suite::{Cell, Line};
use nerd_train::replay::{Replay, escape};

use super::html::{Section, card, folded, from, picture, result, table};
use crate::experiments::stability::StabilityMap;
use crate::report::manifest::{Entry, Manifest};
use nerd_cli::experiments::passive::Rows;
use nerd_cli::report::{Artifact, digits, or_dash};

pub fn scorecard(results: &Path) -> Section {
    Section::new(
        "Scorecard",
        "Motion of every model beside the truth that it learned and what its base alone does, with the paper's figures where the truth is the paper's; and the gaps of \
         policies whose seeds no model has met. Smaller errors are better, and gaps nearer to 0.",
        &(result(results, "passive", &["summary", "verdict"]) + &result(results, "fresh", &["summary"])),
    )
}

pub fn robots(results: &Path, names: &[&str], replays: &[Replay]) -> Section {
    let passive = Artifact::read(results, "passive").and_then(|found| found.parse::<Rows>());
    let one = |(name, replay): (&&str, &Replay)| {
        let growth = passive.as_ref().ok().and_then(|rows| rows.growth(name)).and_then(|figure| figure.svg().ok());
        let growth = growth.unwrap_or_default() + &picture(results, &format!("motions-{name}/figure.svg"));
        let growth = if growth.is_empty() {
            growth
        } else {
            folded("How far it errs", &format!("<div class=picture>{growth}</div>"))
        };
        card(name, replay, &growth)
    };
    Section::new(
        "Robots",
        "Each robot from a start that its model never saw: NeRD solid, the truth it learned as a ghost behind it. Where only one is seen, \
         they agree. The cable is moved at random, as in its data, by torques that are not in them.",
        &format!("<div class=cards>{}</div>", names.iter().zip(replays).map(one).collect::<String>()),
    )
}

/// Shows the speed-accuracy chart of each result named `chart-*`.
pub fn charts(manifest: &Manifest, results: &Path) -> Section {
    let chart = |name: &str| format!("<div class=card>{}</div>", picture(results, &format!("{name}/figure.svg")));
    let names = manifest.artefact.iter().map(|entry| entry.name.as_str()).filter(|name| name.starts_with("chart-"));
    Section::new(
        "Speed and accuracy",
        "Each point is a solver at one setting. Lower and further left is better; points on the grey staircase are beaten by none in both. \
         Errors are distances from a converged motion.",
        &format!("<div class=charts>{}</div>", names.map(chart).collect::<String>()),
    )
}

/// Shows the stability maps: a row has its results, and as a tooltip its question and reason.
pub fn stability(manifest: &Manifest, results: &Path) -> Section {
    let map = |name: &str, about: &str| {
        let found = Artifact::read(results, name).ok()?;
        let StabilityMap { methods, rows } = found.parse().ok()?;
        let methods: String = methods.iter().map(|name| format!("<th>{}</th>", escape(name))).collect();
        let rows: String = rows.iter().map(row).collect();
        let map = format!(
            "<table class='sorts map'><thead><tr><th>row</th><th>limit</th>{methods}</tr></thead><tbody>{rows}</tbody></table>"
        );
        Some(folded(&escape(about), &format!("<div class=wide>{map}</div>{}", from(name, &found.provenance))))
    };
    let entries = manifest.artefact.iter().filter(|entry| entry.name.starts_with("stability"));
    let maps: String = entries.filter_map(|entry| map(&entry.name, &entry.about)).collect();
    Section::new(
        "Stability",
        "Scenes with known answers; point at a row, and it says what is asked and why. Green is within the limit, yellow within ten times, red \
         beyond, or the solver gave up. Limits come from equations and other people's tests.",
        &maps.replacen("<details>", "<details open>", 1),
    )
}

fn row(line: &Line) -> String {
    let cell = |c: &Cell| {
        let lost = if c.lost.is_some() { " lost" } else { "" };
        format!("<td class={}>{}{lost}</td>", c.verdict, or_dash(c.figure.map(digits)))
    };
    let cells: String = line.cells.iter().map(cell).collect();
    let why = escape(&format!("{}. {} {}", line.asked(), line.why, line.source));
    format!("<tr title=\"{why}\"><td>{}</td><td>{}</td>{cells}</tr>", escape(&line.row), digits(line.limit))
}

/// Shows the result `fresh` and a replay of one policy of each task.
pub fn policies(results: &Path, tasks: &[&str], replays: &[Replay]) -> Section {
    let cards: String = tasks.iter().zip(replays).map(|(task, replay)| card(task, replay, "")).collect();
    let each = folded("Every seed", &result(results, "fresh", &["fresh", "policies"]));
    Section::new(
        "Policies",
        "Policies that learned in NeRD alone, playing in NeRD (solid) and in the truth (ghost) from one start. Two that act on what they see \
         part in time, and should earn the same.",
        &format!("<div class=cards>{cards}</div>{each}"),
    )
}

/// Shows every result with its tables, status and provenance.
pub fn everything(manifest: &Manifest, results: &Path) -> Section {
    let one = |entry: &Entry| {
        let status = entry.status(results);
        let found = Artifact::read(results, &entry.name);
        let tables: String = found.iter().flat_map(|found| &found.tables).map(table).collect();
        let origin: String = found.iter().map(|found| from(&entry.name, &found.provenance)).collect();
        let colour = if status.holds() { "better" } else { "worse" };
        let [name, about, status] = [&entry.name, &entry.about, &status.to_string()].map(|text| escape(text));
        folded(&format!("<b>{name}</b>: {about} <span class={colour}>({status})</span>"), &(tables + &origin))
    };
    let all: String = manifest.artefact.iter().map(one).collect();
    Section::new("All results", "Every result that the repository keeps, with the command that makes it.", &all)
}
