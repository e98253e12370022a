//! `cargo xtask report`: one HTML file with everything, for a browser.

use std::path::PathBuf;

use anyhow::Result;
use nerd_lab::report::page::{PageConfig, motions, page};
use nerd_train::shipped::results;

use crate::common::bar;
use crate::numbers::{FRAMES, count};

/// Write the page.
#[derive(clap::Args, Clone, Debug)]
pub struct ReportArgs {
    /// FILE to write
    #[arg(long, value_name = "FILE", default_value = "out/report.html")]
    pub out: PathBuf,
    /// Frames of each replay
    #[arg(long, default_value_t = PageConfig::default().frames, value_parser = count::<usize>(FRAMES))]
    pub frames: usize,
}

/// Runs the verb.
pub fn run(args: ReportArgs) -> Result<()> {
    let config = PageConfig { frames: args.frames, steps: args.frames };
    let bar = bar("motions", motions() as u64);
    page(&config, &results(), &args.out, &bar)?;
    bar.finish();
    println!("written to {}", args.out.display());
    Ok(())
}
