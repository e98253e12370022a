//! Arithmetic of products.

/// Arithmetic of products; everything is stored and summed in f32.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Precision {
    /// f32 throughout.
    F32,
    /// Operands rounded to f16 (10-bit mantissa) where one fused kernel evaluates the network and f16 holds its large matrices; f32
    /// elsewhere.
    F16,
    /// Operands rounded to TF32 (10-bit mantissa) on tensor cores, f32 sums.
    #[default]
    Tf32,
}
