// Kernels that every program needs. The source of a program, compiled at run time, joins the files of its operations.
// Constants at the start of the source are T tokens in a window, IN inputs, LDX padded inputs and OUT outputs. All
// arrays are f32 and row-major. Every sum has a fixed order (no float atomics), so equal inputs give equal bits.

typedef unsigned long long u64;

// Mirror of `Scalars` in learner/cuda/optimiser.rs.
struct Scalars {
    u64 step, bad_step, count;
    double loss_sum, norm_sum;
    float lr, bad_loss, scale, rate, root, blend;
};

__device__ __forceinline__ float warp_sum(float v) {
#pragma unroll
    for (int o = 16; o > 0; o /= 2) v += __shfl_xor_sync(0xffffffffu, v, o);
    return v;
}

// Sum over the threads of a block (at most 1024); valid in thread 0 only.
__device__ __forceinline__ float block_sum(float v) {
    __shared__ float part[32];
    v = warp_sum(v);
    if (threadIdx.x % 32 == 0) part[threadIdx.x / 32] = v;
    __syncthreads();
    if (threadIdx.x < 32) v = warp_sum(threadIdx.x < blockDim.x / 32 ? part[threadIdx.x] : 0.0f);
    return v;
}

// ---------------------------------------------------------------- windows

__device__ u64 mix(u64 x) {
    x += 0x9e3779b97f4a7c15ull;
    x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ull;
    x = (x ^ (x >> 27)) * 0x94d049bb133111ebull;
    return x ^ (x >> 31);
}

// One block per row of the batch. Copies the tokens of window numbers[row] to u [rows][T][LDX] (zero padded) and target
// [rows][T][OUT]. If numbers is null, the window is drawn by a hash of (seed, step, row).
extern "C" __global__ void gather(const float* x, const float* y, float* u, float* target, const Scalars* s, u64 seed,
                                  u64 windows, u64 per, u64 frames, const u64* numbers) {
    const u64 row = blockIdx.x;
    const u64 w = numbers ? numbers[row] : mix(mix(mix(seed) ^ s->step) ^ row) % windows;
    const u64 token = w / per * frames + w % per;
    for (int i = threadIdx.x; i < T * LDX; i += blockDim.x) {
        int k = i / LDX, c = i % LDX;
        u[row * (T * LDX) + i] = c < IN ? x[(token + k) * IN + c] : 0.0f;
    }
    for (int i = threadIdx.x; i < T * OUT; i += blockDim.x) target[row * (T * OUT) + i] = y[token * OUT + i];
}

// out[w] = x[w T + last[w]], rows of `width`.
extern "C" __global__ void select_rows(const float* x, const unsigned* last, float* out, int width) {
    const float* src = x + ((u64)blockIdx.x * T + last[blockIdx.x]) * width;
    for (int i = threadIdx.x; i < width; i += blockDim.x) out[(u64)blockIdx.x * width + i] = src[i];
}

// ---------------------------------------------------------------- linear

// Folds a scale into the rows of its matrix: W'[i][j] = w[i] W[i][j]. One block per row. A row of `table` has the
// offsets of the row of W, of w[i] and of the row of W', then the number of columns.
extern "C" __global__ void fold(const float* flat, float* folded, const int4* table) {
    const int4 t = table[blockIdx.x];
    const float w = flat[t.y];
    for (int j = threadIdx.x; j < t.w; j += blockDim.x) folded[t.z + j] = w * flat[t.x + j];
}

// From dW' (in place of dW): dW[i][j] = w[i] dW'[i][j] and dw[i] = sum_j dW'[i][j] W[i][j].
extern "C" __global__ void unfold(const float* flat, float* grad, const int4* table) {
    const int4 t = table[blockIdx.x];
    const float w = flat[t.y];
    float sum = 0.0f;
    for (int j = threadIdx.x; j < t.w; j += blockDim.x) {
        float g = grad[t.x + j];
        sum += g * flat[t.x + j];
        grad[t.x + j] = w * g;
    }
    sum = block_sum(sum);
    if (threadIdx.x == 0) grad[t.y] = sum;
}

// x[row][c] += bias[c] + table[row % T][c]; either may be null.
extern "C" __global__ void shift(float* x, const float* bias, const float* table, int width, u64 count) {
    const u64 i = (u64)blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= count) return;
    const u64 c = i % width;
    x[i] += (bias ? bias[c] : 0.0f) + (table ? table[i / width % T * width + c] : 0.0f);
}

// ---------------------------------------------------------------- sums

// out[c] = sum_r src[r][c], r < rows. Block (32, 8), grid ceil(width / 32).
extern "C" __global__ void column_sum(const float* src, int rows, int width, float* out) {
    __shared__ float part[8][33];
    const int c = blockIdx.x * 32 + threadIdx.x;
    float sum = 0.0f;
    if (c < width)
        for (int r = threadIdx.y; r < rows; r += 8) sum += src[(u64)r * width + c];
    part[threadIdx.y][threadIdx.x] = sum;
    __syncthreads();
    if (threadIdx.y == 0 && c < width) {
        for (int k = 1; k < 8; k++) sum += part[k][threadIdx.x];
        out[c] = sum;
    }
}

// partial[chunk][width]: sums of the rows chunk, chunk + chunks, ... Grid (ceil(width / 128), chunks).
extern "C" __global__ void row_partial(const float* x, int rows, int width, float* partial) {
    const int c = blockIdx.x * blockDim.x + threadIdx.x;
    if (c >= width) return;
    float sum = 0.0f;
    for (int r = blockIdx.y; r < rows; r += gridDim.y) sum += x[(u64)r * width + c];
    partial[(u64)blockIdx.y * width + c] = sum;
}

// Sum of squared errors by block; `target` becomes the gradient of the loss. gain = 2 / (tokens OUT).
// bend = 1 / delta^2 of the pseudo-Huber loss, or 0 for squares.
extern "C" __global__ void loss(const float* said, float* target, float* partial, u64 count, float gain, float bend) {
    float sum = 0.0f;
    for (u64 i = (u64)blockIdx.x * blockDim.x + threadIdx.x; i < count; i += (u64)gridDim.x * blockDim.x) {
        const float d = said[i] - target[i];
        sum += d * d;
        target[i] = gain * d * rsqrtf(1.0f + bend * d * d);
    }
    sum = block_sum(sum);
    if (threadIdx.x == 0) partial[blockIdx.x] = sum;
}

// total += *loss (f64)
extern "C" __global__ void add_loss(const float* loss, double* total) { *total += *loss; }
