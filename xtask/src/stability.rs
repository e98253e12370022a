//! `cargo xtask stability`: where each method holds, bends and breaks. Failures are the point.

use nerd_lab::experiments::stability::Stability;

use crate::{options::DEVICES, out::conduct, prelude::*};

#[derive(clap::Args, Clone, Debug)]
pub struct StabilityArgs {
    /// Rows whose name contains one of these words, comma-separated [default: all]
    #[arg(long, value_delimiter = ',')]
    pub rows: Vec<String>,
    /// The articulated solver on a GPU beside the CPU's, in place of all methods, written as stability-device
    #[arg(long, value_parser = word::<Device>(DEVICES))]
    pub device: Option<Device>,
    /// Folder of results [default: results]
    #[arg(long, value_name = "FOLDER")]
    pub out: Option<PathBuf>,
}

pub fn run(args: StabilityArgs) -> Result<()> {
    let out = args.out.unwrap_or_else(nerd_train::shipped::results);
    if args.device == Some(Device::Cuda) {
        #[cfg(feature = "cuda")]
        return conduct(&Stability::on_device(&args.rows)?, &out).map(drop);
        #[cfg(not(feature = "cuda"))]
        anyhow::bail!("--device cuda needs a build with `--features cuda`");
    }
    conduct(&Stability::new(&args.rows)?, &out).map(drop)
}
