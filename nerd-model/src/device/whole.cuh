// Steps of a program in a block's shared memory: a block computes a few windows of T tokens, ROWS rows in all. whole.rs
// writes the calls; matrix products are in whole_f32.cuh and whole_f16.cuh.

#ifdef __CUDACC_RTC__
#define FN static __device__ __forceinline__
#define EACH(k, n) for (int k = threadIdx.x; k < (n); k += blockDim.x)
#define SYNC __syncthreads()
#else
#include <cmath>
#include <cstdio>
#include <cstring>
#include <vector>
#define FN static inline
#define EACH(k, n) for (int k = 0; k < (n); k++)
#define SYNC
#endif

FN float same(float x) { return x; }

// 2^x.
FN float power(float x) {
#ifdef __CUDACC_RTC__
    float y;
    asm("ex2.approx.ftz.f32 %0, %1;" : "=f"(y) : "f"(x));
    return y;
#else
    return std::exp2(x);
#endif
}

// x (1 + erf(x / sqrt 2)) / 2 within 1e-6: the normal tail beyond |x| is 2 to the power of a polynomial.
FN float gelu(float x) {
    const float y = fabsf(x);
    const float log =
        -1.0000377f
        + y * (-1.1507878f + y * (-0.45999244f + y * (-0.051827382f + y * (0.0070845573f - y * 0.00047330931f))));
    return fmaxf(x, 0) - y * power(log);
}

// Converts a number to an operand of a matrix product.
FN float factor(float x);

// y = (x - mean) / sqrt(variance + 1e-5), as operands of products; eight threads per row.
template <int WIDE, int L> FN void norm(const float* x, float* y) {
#ifdef __CUDACC_RTC__
    constexpr int LANES = 8;
    const int lane = threadIdx.x % LANES, own = threadIdx.x / LANES, step = blockDim.x / LANES;
    auto sum = [](float part) {
#pragma unroll
        for (int k = LANES / 2; k; k /= 2) part += __shfl_xor_sync(~0u, part, k);
        return part;
    };
#else
    constexpr int LANES = 1;
    const int lane = 0, own = 0, step = 1;
    auto sum = [](float all) { return all; };
#endif
    // Threads beyond the last row repeat it without writing, since all lanes of a warp must shuffle.
    for (int first = 0; first < ROWS; first += step) {
        const bool has = first + own < ROWS;
        const int row = (has ? first + own : ROWS - 1) * L;
        float part = 0;
        for (int c = lane; c < WIDE; c += LANES) part += x[row + c];
        const float mean = sum(part) / WIDE;
        part = 0;
        for (int c = lane; c < WIDE; c += LANES) part += (x[row + c] - mean) * (x[row + c] - mean);
        const float scale = 1 / sqrtf(sum(part) / WIDE + 1e-5f);
        for (int c = lane; has && c < WIDE; c += LANES) y[row + c] = factor((x[row + c] - mean) * scale);
    }
    SYNC;
}

// x += P[k], with k the position of a row's token in its window.
template <int WIDE, int L> FN void place(const float* table, float* x) {
    EACH(i, ROWS * WIDE) x[i / WIDE * L + i % WIDE] += table[i % (T * WIDE)];
    SYNC;
}
