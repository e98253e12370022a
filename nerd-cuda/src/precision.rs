//! Arithmetic of matrix products.

/// Arithmetic of matrix products. Storage and sums are f32.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Precision {
    /// f32 throughout.
    F32,
    /// Operands in f16 (10-bit mantissa) where a fused kernel evaluates the network and the network's large matrices
    /// fit in f16. Operands are f32 elsewhere.
    F16,
    /// Operands rounded to TF32 (10-bit mantissa) on tensor cores.
    #[default]
    Tf32,
}
