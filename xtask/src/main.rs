//! The program; `python -m nerd` calls the same library.

use std::process::ExitCode;

fn main() -> ExitCode {
    xtask::call(std::env::args_os()).into()
}
