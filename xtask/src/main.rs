//! The program; the library is also what `python -m nerd` calls.

use std::process::ExitCode;

fn main() -> ExitCode {
    xtask::call(std::env::args_os()).into()
}
