//! The program.

use std::process::ExitCode;

fn main() -> ExitCode {
    xtask::call(std::env::args_os()).into()
}
