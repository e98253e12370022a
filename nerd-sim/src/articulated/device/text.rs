//! CUDA text with numbers from the host.

use std::fmt::Display;

/// A text with sizes and tables from the host.
#[derive(Default)]
pub struct Text(pub String);

impl Text {
    /// Defines macros for constants.
    pub fn define<T: Display>(&mut self, all: impl IntoIterator<Item = (&'static str, T)>) {
        all.into_iter().for_each(|(name, value)| self.0 += &format!("#define {name} {value}\n"));
    }

    /// Defines a constant array; an empty one gets a zero, since C++ has no empty arrays.
    pub fn table(&mut self, kind: &str, name: &str, numbers: impl IntoIterator<Item = f64>) {
        let mut entries: Vec<String> = numbers.into_iter().map(|x| format!("({kind}){}", number(x))).collect();
        entries.resize(entries.len().max(1), "0".into());
        self.0 += &format!("TABLE {kind} {name}[] = {{{}}};\n", entries.join(", "));
    }
}

/// Formats a number, limited to +-1e38 so that infinity fits into an f32.
pub fn number(x: f64) -> String {
    format!("{:e}", x.clamp(-1e38, 1e38))
}
