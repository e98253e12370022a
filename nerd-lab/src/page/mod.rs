//! The report page: all results of a folder, and motions rolled out while the page is written. The HTML file is
//! self-contained, so it can be sent and kept.

mod html;
mod motions;
mod sections;

use nerd_train::progress::Bar;

use crate::{prelude::*, report::Manifest};
use motions::Cause;
use nerd_train::replay::{self, Replay};

const PAGE: &str = include_str!("page.html");
const STYLE: &str = include_str!("page.css");
const SCRIPT: &str = include_str!("page.js");

const ROBOTS: [(&str, Cause); 6] = [
    ("pendulum", Cause::Release("ground1")),
    ("cube", Cause::Release("ground")),
    ("lead-pegs", Cause::Data),
    ("cartpole", Cause::Release("free")),
    ("ant", Cause::Release("ground")),
    ("anymal", Cause::Release("ground")),
];

const TASKS: [&str; 8] = [
    "cartpole-swingup",
    "franka-reach",
    "ant-run",
    "anymal-forward",
    "franka-reach-torque",
    "ant-spin",
    "ant-spin-track",
    "anymal-side",
];

/// Number of motions on the page, for a progress bar.
pub const MOTIONS: usize = ROBOTS.len() + TASKS.len();

/// Writes the report page of the folder `results` to `out`, with motions of `frames` frames. `bar` counts finished
/// motions up to [`MOTIONS`].
pub fn page(frames: usize, results: &Path, out: &Path, bar: &Bar) -> Result<()> {
    let manifest = Manifest::read(results)?;
    let asked = ROBOTS.into_iter().chain(TASKS.map(|task| (task, Cause::Policy(task))));
    let shown = asked.enumerate().map(|(k, (name, cause))| {
        bar.set(k as u64);
        motions::shipped(name, cause, frames)
    });
    let shown: Vec<Replay> = shown.collect::<Result<_>>()?;
    let (robots, tasks) = shown.split_at(ROBOTS.len());
    let sections = [
        sections::scorecard(results),
        sections::robots(results, &ROBOTS.map(|robot| robot.0), robots),
        sections::charts(&manifest, results),
        sections::stability(&manifest, results),
        sections::policies(results, &TASKS, tasks),
        sections::everything(&manifest, results),
    ];
    let links: String = sections.iter().map(|section| section.link.as_str()).collect();
    let body: String = sections.iter().map(|section| section.html.as_str()).collect();
    let script = format!("{}\n{SCRIPT}", replay::SCRIPT);
    let page =
        PAGE.replace("STYLE", STYLE).replace("NAVIGATION", &links).replace("SCRIPT", &script).replace("BODY", &body);
    write(out, page.as_bytes())
}
