//! Compiles CUDA source to PTX at run time (NVRTC), with a cache per process.

use std::collections::HashMap;
use std::sync::{Arc, LazyLock, Mutex};

use cudarc::nvrtc::{self, CompileOptions, Ptx};

use crate::error::DeviceError;

/// PTX of `source` for a compute capability (major, minor). Each pair of source and capability is compiled once per
/// process.
pub(crate) fn compiled(source: &str, capability: (i32, i32)) -> Result<Ptx, DeviceError> {
    type Cache = Mutex<HashMap<((i32, i32), String), Arc<Mutex<Option<Ptx>>>>>;
    static CACHE: LazyLock<Cache> = LazyLock::new(Cache::default);
    let entry =
        CACHE.lock().unwrap_or_else(|lost| lost.into_inner()).entry((capability, source.into())).or_default().clone();
    // The lock is held during compilation, so that other threads with the same source wait for the result.
    let mut own = entry.lock().unwrap_or_else(|lost| lost.into_inner());
    if let Some(ptx) = &*own {
        return Ok(ptx.clone());
    }
    let architecture = format!("--gpu-architecture=compute_{}{}", capability.0, capability.1);
    // The option makes unmarked functions device code. Without it NVRTC 13.0 refuses lambdas as host code, and lambdas
    // cannot be marked `__device__`. NVRTC 13.5 accepts lambdas.
    let options = CompileOptions {
        options: vec![architecture, "--device-as-default-execution-space".into()],
        ..Default::default()
    };
    let ptx = nvrtc::compile_ptx_with_opts(source, options).map_err(|e| DeviceError(refusal(&format!("{e:?}"))))?;
    Ok(own.insert(ptx).clone())
}

/// The reason for a compilation failure: the text of a failed static assertion, or else the compiler's output.
fn refusal(output: &str) -> String {
    let asserted = output
        .split("static assertion failed with")
        .nth(1)
        .and_then(|rest| rest.split(['"', '\\']).find(|part| part.len() > 9));
    asserted.map_or_else(|| format!("kernels do not compile: {output}"), str::to_string)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_source_asserts_of_itself_is_all_that_is_told() {
        let output = r#"CompileError { nvrtc: NvrtcError(..), log: "default_program(7): error: static assertion failed with \"too large a robot\"\n" }"#;
        assert_eq!(refusal(output), "too large a robot");
        assert_eq!(refusal("syntax error"), "kernels do not compile: syntax error");
    }
}
