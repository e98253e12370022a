//! `cargo xtask gif`: the moving picture of README, all robots, the truth beside NeRD.

use std::path::PathBuf;

use anyhow::Result;
use nerd_lab::report::film;
use nerd_lab::report::motions::{self, Cause};
use nerd_train::shipped::results;

/// Draw the moving picture.
#[derive(clap::Args, Clone, Debug)]
pub struct GifArgs {
    /// FILE to write [default: results/robots.gif]
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
}

/// What is shown, and what moves it.
const CELLS: [(&str, Cause); 7] = [
    ("pendulum", Cause::Release("ground1")),
    ("cube", Cause::Release("ground")),
    ("lead-pegs", Cause::Data),
    ("cartpole", Cause::Policy("cartpole-swingup-neural-0")),
    ("franka", Cause::Policy("franka-reach-neural-0")),
    ("ant", Cause::Policy("ant-run-neural-0")),
    ("anymal", Cause::Policy("anymal-forward-neural-0")),
];
const SECONDS: f64 = 4.0;

/// Runs the verb.
pub fn run(args: GifArgs) -> Result<()> {
    let path = args.out.unwrap_or_else(|| results().join("robots.gif"));
    let replays = CELLS.map(|(robot, cause)| motions::shipped(robot, cause, 300)).into_iter().collect::<Result<Vec<_>, _>>()?;
    film::gif(&replays, SECONDS, &path)?;
    println!("written to {}", path.display());
    Ok(())
}
