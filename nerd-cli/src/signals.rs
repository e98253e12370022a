//! Handles SIGINT and SIGTERM. A run with checkpoints ends with a checkpoint; any other command ends at once. A second
//! signal ends any command at once.

use nerd_train::stop;

/// Installs the handlers, once.
#[cfg(unix)]
pub fn heed() {
    static ONCE: std::sync::Once = std::sync::Once::new();
    ONCE.call_once(listen);
}

#[cfg(unix)]
fn listen() {
    use signal_hook::consts::{SIGINT, SIGTERM};
    // Leaves the default handlers in place if no thread can be started.
    let _ = std::thread::Builder::new().spawn(|| {
        let Ok(mut signals) = signal_hook::iterator::Signals::new([SIGINT, SIGTERM]) else { return };
        for signal in signals.forever() {
            let first = stop::asked().is_none();
            if !stop::ask(signal) || !first {
                tell!("{}: ended; files are whole or not there, and the same command makes what is left", name(signal));
                std::process::exit(128 + signal);
            }
            tell!("{}: ending with a checkpoint; once more, and it ends at once", name(signal));
        }
    });
}

#[cfg(not(unix))]
pub fn heed() {}

/// Returns the exit code of a command that ended well: 0, or the signal's code if a signal stopped it.
pub fn ended() -> u8 {
    let Some(signal) = stop::asked() else { return 0 };
    tell!("{}: stopped with a checkpoint; the same command goes on from it", name(signal));
    code(signal)
}

/// Returns the exit code of a process that a signal ended.
pub fn code(signal: i32) -> u8 {
    128 + signal as u8
}

fn name(signal: i32) -> &'static str {
    if signal == 15 { "SIGTERM" } else { "SIGINT" }
}
