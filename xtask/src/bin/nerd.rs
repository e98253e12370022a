//! The program under the name `nerd`, for `cargo install --path xtask --bin nerd`.

use std::process::ExitCode;

fn main() -> ExitCode {
    xtask::call(std::env::args_os()).into()
}
