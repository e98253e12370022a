//! Returns panics as errors instead of printing them on standard error.

use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};

/// Runs `of` without printing its panics, whose text would break a progress bar.
pub fn silent<T>(of: impl FnOnce() -> T) -> T {
    let hook = take_hook();
    set_hook(Box::new(|_| ()));
    let done = of();
    set_hook(hook);
    done
}

/// Runs `of`; a panic becomes an error with the panic's message.
pub fn caught<T>(of: impl FnOnce() -> T) -> Result<T, String> {
    catch_unwind(AssertUnwindSafe(of)).map_err(|panic| {
        let said = panic.downcast_ref::<&str>().map(ToString::to_string);
        said.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_default()
    })
}
