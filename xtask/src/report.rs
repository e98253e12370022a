//! `cargo xtask report`: writes all results as one HTML file.

use nerd_cli::{options::FRAMES, out};
use nerd_lab::page::{MOTIONS, page};
use nerd_train::progress::bar;

use crate::prelude::*;

#[derive(clap::Args)]
pub struct ReportArgs {
    /// HTML file to write
    #[arg(long, value_name = "FILE", default_value = "out/report.html")]
    pub out: PathBuf,
    /// Frames of each replay
    #[arg(long, default_value_t = 240, value_parser = value::<usize>(Whole(FRAMES)))]
    pub frames: usize,
}

pub fn run(args: ReportArgs) -> Result<()> {
    out::page(&args.out)?;
    let bar = bar("motions", MOTIONS as u64);
    page(args.frames, &results(), &args.out, &bar)?;
    bar.finish();
    say!("written to {}", args.out.display());
    Ok(())
}
