//! Products of row-major matrices by faer, on the calling thread.

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};

/// A row-major slice as a matrix.
pub fn matrix(x: &[f32], rows: usize, columns: usize) -> MatRef<'_, f32> {
    MatRef::from_row_major_slice(x, rows, columns)
}

/// `out = a b` or `out += a b`, row-major.
pub fn product(out: &mut [f32], accum: Accum, a: MatRef<'_, f32>, b: MatRef<'_, f32>) {
    matmul(MatMut::from_row_major_slice_mut(out, a.nrows(), b.ncols()), accum, a, b, 1.0f32, Par::Seq);
    release();
}

/// faer's assembly kernels leave the upper halves of the vector registers in use, and then every scalar instruction after them
/// waits for those halves: a rollout took three times, an update five times as long.
fn release() {
    #[cfg(target_arch = "x86_64")]
    if let Some(simd) = pulp::x86::V3::try_new() {
        simd.avx._mm256_zeroupper();
    }
}
