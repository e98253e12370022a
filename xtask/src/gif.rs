//! `cargo xtask gif`: the moving picture of README, all six robots, the truth beside NeRD.

use std::path::PathBuf;

use anyhow::Result;
use nerd_sim::truth::Truth;
use nerd_train::report::{film, motions};
use nerd_train::shipped::{model, results, root};

/// Draw the moving picture.
#[derive(clap::Args, Clone, Debug)]
pub struct GifArgs {
    /// FILE to write [default: results/robots.gif]
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
}

/// Robots that are let go, and robots with the policy that moves them.
const PASSIVE: [(&str, &str); 2] = [("pendulum", "ground1"), ("cube", "ground")];
const MOVED: [(&str, &str); 4] = [
    ("cartpole", "cartpole-swingup-neural-0"),
    ("franka", "franka-reach-neural-0"),
    ("ant", "ant-run-neural-0"),
    ("anymal", "anymal-forward-neural-0"),
];
const SECONDS: f64 = 4.0;

/// Runs the verb.
pub fn run(args: GifArgs) -> Result<()> {
    let path = args.out.unwrap_or_else(|| results().join("robots.gif"));
    let mut replays = Vec::new();
    for (robot, scene) in PASSIVE {
        replays.push(motions::passive(robot, scene, &model(Truth::default(), robot), 300, 3)?);
    }
    for (robot, policy) in MOVED {
        replays.push(motions::policy(&root().join("models/policies").join(policy), &model(Truth::default(), robot), 300, 1)?);
    }
    film::gif(&replays, SECONDS, &path)?;
    println!("written to {}", path.display());
    Ok(())
}
