//! A card for each robot and each task: what moves, how far it errs, how the error grows.

use std::path::Path;

use nerd_sim::truth::Truth;

use super::PageConfig;
use super::html::{Section, from, motion, table};
use crate::error::Result;
use crate::report::Table;
use crate::report::artifact::Head;
use crate::report::motions::{self, Cause};
use crate::report::replay::escape;
use nerd_train::progress::Bar;
use nerd_train::shipped::{model, root};

/// Robots that are shown, each with what moves it.
pub const CARDS: [(&str, Cause); 7] = [
    ("cartpole", Cause::Release("free")),
    ("pendulum", Cause::Release("ground1")),
    ("cube", Cause::Release("ground")),
    ("franka", Cause::Policy("franka-reach-neural-0")),
    ("ant", Cause::Release("ground")),
    ("anymal", Cause::Release("ground")),
    ("lead-pegs", Cause::Data),
];

/// Tasks whose first shipped policy is shown.
pub const TASKS: [&str; 8] =
    ["cartpole-swingup", "franka-reach", "franka-reach-torque", "ant-run", "ant-spin", "ant-spin-track", "anymal-forward", "anymal-side"];

/// The robots.
pub fn cards(config: &PageConfig, results: &Path, bar: &Bar) -> Result<Section> {
    let mut section = Section::new(
        "Robots",
        "Each robot from a start that its model never saw: NeRD solid, the truth it learned as a ghost behind it. Where only one is seen, \
         they agree. The cable is moved at random, as in its data, by torques that are not in them.",
    );
    for (k, (robot, cause)) in CARDS.into_iter().enumerate() {
        let replay = motions::shipped(robot, cause, config.frames)?;
        bar.set(k as u64 + 1);
        section.body += &format!("<div class=card><h3>{robot}</h3>{}", motion(&replay));
        let driven = cause == Cause::Data;
        let result = if driven { format!("motions-{robot}") } else { "passive".into() };
        if let Ok(head) = Head::read(results, &result) {
            let of = head.tables.iter().find(|t| t.name == result).map(|t| if driven { t.clone() } else { only(t, robot) });
            section.body += &of.filter(|t| !t.rows.is_empty()).map(|t| table(&t) + &from(&result, &head.provenance)).unwrap_or_default();
        }
        section.body += &picture(results, &result, "Speed and accuracy");
        section.body += &picture(results, &format!("horizon-{robot}"), "How the error grows");
        section.body += "</div>";
    }
    section.body = format!("<div class=cards>{}</div>", section.body);
    Ok(section)
}

/// The tasks.
pub fn policies(config: &PageConfig, results: &Path, bar: &Bar) -> Result<Section> {
    let mut section = Section::new(
        "Policies",
        "Policies that learned in NeRD alone, playing in NeRD (solid) and in the truth (ghost) from one start. Two that act on what they see \
         part in time, and should earn the same.",
    );
    if let Ok(head) = Head::read(results, "policies") {
        section.body += &head.tables.iter().map(table).collect::<String>();
        section.body += &from("policies", &head.provenance);
    }
    section.body += &picture(results, "policies", "Learning curves");
    let mut cards = String::new();
    for (k, task) in TASKS.into_iter().enumerate() {
        let Some(policy) = first(task) else { continue };
        let robot = nerd_tasks::named(task)?.robot();
        let replay = motions::policy(&root().join("models/policies").join(&policy), &model(Truth::default(), robot), config.steps, 1)?;
        bar.set((super::CARDS.len() + k) as u64 + 1);
        cards += &format!("<div class=card><h3>{task}: {policy}</h3>{}</div>", motion(&replay));
    }
    section.body += &format!("<div class=cards>{cards}</div>");
    Ok(section)
}

/// The first shipped policy of a task that learned in NeRD.
fn first(task: &str) -> Option<String> {
    let there = std::fs::read_dir(root().join("models/policies")).ok()?;
    let names = there.flatten().map(|entry| entry.file_name().to_string_lossy().into_owned());
    names.filter(|name| name.strip_prefix(task).is_some_and(|rest| rest.starts_with("-neural-"))).min()
}

/// Rows of one robot.
fn only(table: &Table, robot: &str) -> Table {
    let mine = |row: &&Vec<String>| row.first().is_some_and(|cell| cell.split_whitespace().next() == Some(robot));
    Table { rows: table.rows.iter().filter(mine).cloned().collect(), ..table.clone() }
}

/// A committed picture, if it is there.
pub fn picture(results: &Path, stem: &str, title: &str) -> String {
    match std::fs::read_to_string(results.join(format!("{stem}.svg"))) {
        Ok(svg) => format!("<details><summary>{}</summary><div class=picture>{svg}</div></details>", escape(title)),
        Err(_) => String::new(),
    }
}
