//! The program; the library is also what `python -m nerd` calls.

use std::process::ExitCode;

/// Read by NCCL.
const MULTICAST: &str = "NCCL_NVLS_ENABLE";

fn main() -> ExitCode {
    // Sums over several GPUs do not use NVLink's multicast, which not every machine has set up, unless the variable asks for it.
    if std::env::var_os(MULTICAST).is_none() {
        // SAFETY: no other thread runs yet.
        unsafe { std::env::set_var(MULTICAST, "0") };
    }
    xtask::call(std::env::args_os()).into()
}
