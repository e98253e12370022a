//! Matrix products by cuBLAS.

use cudarc::cublas::{self, sys as blas};

use crate::device::{Device, Lane};
use crate::{error::DeviceError, precision::Precision};

/// Whether an operand of a product is transposed.
#[derive(Clone, Copy)]
pub enum Op {
    /// The operand is used as stored.
    Plain,
    /// The operand is transposed.
    Transposed,
}

/// Shapes of a batch of equal products `c = op(a) op(b)`, with `c` of `m x n` and inner size `k`.
#[derive(Clone, Copy)]
pub struct Batch {
    /// Transposition of `a` and of `b`.
    pub ops: (Op, Op),
    /// Sizes `m` and `n` of `c`, and inner size `k`.
    pub size: (usize, usize, usize),
    /// Number of products.
    pub count: usize,
}

impl Device {
    /// Computes the column-major product `c = op(a) op(b) + beta c`, with `c` of `m x n` and inner size `k`. Operands
    /// are (address, leading dimension).
    #[allow(clippy::too_many_arguments)]
    pub fn product(
        &self,
        lane: Lane,
        ops: (Op, Op),
        (m, n, k): (usize, usize, usize),
        a: (u64, usize),
        b: (u64, usize),
        beta: f32,
        c: (u64, usize),
    ) -> Result<(), DeviceError> {
        let (alpha, f32_type) = (1.0f32, blas::cudaDataType::CUDA_R_32F);
        // SAFETY: the caller passes addresses of device memory of these sizes; `alpha` and `beta` live on the host, and
        // cuBLAS reads them before it returns.
        unsafe {
            cublas::result::gemm_ex(
                self.blas(lane)?,
                ops.0.blas(),
                ops.1.blas(),
                m as i32,
                n as i32,
                k as i32,
                (&raw const alpha).cast(),
                a.0 as *const _,
                f32_type,
                a.1 as i32,
                b.0 as *const _,
                f32_type,
                b.1 as i32,
                (&raw const beta).cast(),
                c.0 as *mut _,
                f32_type,
                c.1 as i32,
                self.compute(),
                blas::cublasGemmAlgo_t::CUBLAS_GEMM_DFALT,
            )
        }
        .map_err(|e| DeviceError(format!("matrix product {m} x {n} x {k}: {e:?}")))
    }

    /// Computes a batch of column-major products `c = op(a) op(b)`. Operands are (address, leading dimension, stride
    /// between matrices), the last two in values.
    pub fn products(
        &self,
        lane: Lane,
        batch: Batch,
        a: (u64, usize, usize),
        b: (u64, usize, usize),
        c: (u64, usize, usize),
    ) -> Result<(), DeviceError> {
        let (alpha, beta, f32_type) = (1.0f32, 0.0f32, blas::cudaDataType::CUDA_R_32F);
        let (m, n, k) = batch.size;
        // SAFETY: as in `product`, for every matrix of the batch at its stride.
        unsafe {
            blas::cublasGemmStridedBatchedEx(
                self.blas(lane)?,
                batch.ops.0.blas(),
                batch.ops.1.blas(),
                m as i32,
                n as i32,
                k as i32,
                (&raw const alpha).cast(),
                a.0 as *const _,
                f32_type,
                a.1 as i32,
                a.2 as i64,
                b.0 as *const _,
                f32_type,
                b.1 as i32,
                b.2 as i64,
                (&raw const beta).cast(),
                c.0 as *mut _,
                f32_type,
                c.1 as i32,
                c.2 as i64,
                batch.count as i32,
                self.compute(),
                blas::cublasGemmAlgo_t::CUBLAS_GEMM_DEFAULT,
            )
        }
        .result()
        .map_err(|e| DeviceError(format!("{} matrix products {m} x {n} x {k}: {e:?}", batch.count)))
    }

    fn compute(&self) -> blas::cublasComputeType_t {
        match self.precision {
            Precision::F32 | Precision::F16 => blas::cublasComputeType_t::CUBLAS_COMPUTE_32F,
            Precision::Tf32 => blas::cublasComputeType_t::CUBLAS_COMPUTE_32F_FAST_TF32,
        }
    }
}

impl Op {
    fn blas(self) -> blas::cublasOperation_t {
        match self {
            Op::Plain => blas::cublasOperation_t::CUBLAS_OP_N,
            Op::Transposed => blas::cublasOperation_t::CUBLAS_OP_T,
        }
    }
}
