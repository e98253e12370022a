//! `cargo xtask completions bash`: completions of the shell, for the program by its own name, `xtask`.

use std::io::Write;

use anyhow::{Context, Result};
use clap_complete::{Shell, generate};

/// How they are used.
const USE: &str = "\
Complete a command called `xtask`: install it (cargo install --path xtask), or call it so (alias xtask='cargo xtask'; zsh
needs setopt complete_aliases). Then:
  bash  cargo xtask completions bash > ~/.local/share/bash-completion/completions/xtask
  zsh   cargo xtask completions zsh > FOLDER/_xtask, a folder of $fpath
  fish  cargo xtask completions fish > ~/.config/fish/completions/xtask.fish";

/// Print completions for a shell.
#[derive(clap::Args, Clone, Debug)]
#[command(after_help = USE)]
pub struct CompletionsArgs {
    /// Which shell
    #[arg(value_enum)]
    pub shell: Shell,
}

/// Runs the verb.
pub fn run(args: CompletionsArgs) -> Result<()> {
    let mut script = Vec::new();
    generate(args.shell, &mut crate::program().bin_name("xtask"), "xtask", &mut script);
    match std::io::stdout().lock().write_all(&script) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => Err(error).context("standard output"),
        _ => Ok(()),
    }
}
