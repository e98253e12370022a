//! `cargo xtask policy export`: writes a policy as ONNX, with a contract, for other simulators and for robots.

use nerd_train::ppo::folder;

use crate::prelude::*;

#[derive(clap::Args)]
pub struct ExportArgs {
    /// Folder of the policy
    #[arg(long)]
    pub policy: PathBuf,
    /// ONNX file to write. The contract is written beside it, with the extension json
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
}

impl ExportArgs {
    pub fn run(&self) -> Result<()> {
        let (config, policy) = folder::load(&self.policy)?;
        let contract = nerd_train::onnx::export(&policy, &*nerd_tasks::named(&config.task)?, &self.out)?;
        let seen = contract.observation.len();
        let acted = contract.action.len();
        let onnx = self.out.display();
        let beside = self.out.with_extension("json");
        let rate = contract.rate;
        say!(
            "{onnx}: {seen} numbers to {acted}, {rate:.4} a second, opset {}; what they are: {}",
            contract.opset,
            beside.display()
        );
        contract.unknown().iter().for_each(|line| tell!("{line}"));
        Ok(())
    }
}
