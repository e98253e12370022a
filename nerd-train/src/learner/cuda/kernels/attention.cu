// E columns of queries, H heads of D columns, at most B keys per query, G heads per block. ROTARY: banded attention
// with rotary positions.

constexpr int D = E / H;
constexpr int GW = G * D;      // columns of one block
constexpr int RS = 3 * GW + 4; // shared row of q|k|v; the 4 extra floats keep rows in different banks
constexpr int GS = GW + 4;     // shared row of an output gradient

__device__ __forceinline__ void load_row(float* r, const float* s) {
#pragma unroll
    for (int c = 0; c < D; c += 4) *(float4*)(r + c) = *(const float4*)(s + c);
}

__device__ __forceinline__ void store_row(float* s, const float* r) {
#pragma unroll
    for (int c = 0; c < D; c += 4) *(float4*)(s + c) = *(const float4*)(r + c);
}

__device__ __forceinline__ float dot_row(const float* r, const float* s) {
    float sum = 0.0f;
#pragma unroll
    for (int c = 0; c < D; c += 4) {
        float4 v = *(const float4*)(s + c);
        sum += r[c] * v.x + r[c + 1] * v.y + r[c + 2] * v.z + r[c + 3] * v.w;
    }
    return sum;
}

__device__ __forceinline__ void add_row(float* r, float k, const float* s) {
#pragma unroll
    for (int c = 0; c < D; c += 4) {
        float4 v = *(const float4*)(s + c);
        r[c] += k * v.x;
        r[c + 1] += k * v.y;
        r[c + 2] += k * v.z;
        r[c + 3] += k * v.w;
    }
}

// Copies rows of q|k|v of this block's heads from global [tokens][3 E] to shared [T][RS].
__device__ __forceinline__ void load_qkv(float* s, const float* qkv, u64 base, int column) {
    for (int i = threadIdx.x; i < T * 3 * (GW / 4); i += blockDim.x) {
        int row = i / (3 * GW / 4), c = i % (3 * GW / 4), part = c / (GW / 4), at = c % (GW / 4) * 4;
        *(float4*)(s + row * RS + part * GW + at) =
            *(const float4*)(qkv + (base + row) * (3 * E) + part * E + column + at);
    }
}

// Row of key number n = 0 .. B - 1 of query i: counted from the start of the window, or in banded attention back from
// the query. Key n exists if n <= i.
__device__ __forceinline__ int key(int i, int n) { return ROTARY ? i - n : n; }

// Rotates columns c and c + D / 2 of a row by the angles of position i, forwards (sign 1) or back (-1). turns is
// [T][D / 2].
__device__ __forceinline__ void turn_row(float* r, const float2* turns, int i, float sign) {
#pragma unroll
    for (int c = 0; c < D / 2; c++) {
        const float2 t = turns[i * (D / 2) + c];
        const float a = r[c], b = r[c + D / 2];
        r[c] = a * t.x - sign * b * t.y;
        r[c + D / 2] = sign * a * t.y + b * t.x;
    }
}

// Rotates query and key i of this thread's head by their position.
__device__ __forceinline__ void turn_shared(float* s, const float2* turns, int head, int i) {
    if (!ROTARY) return;
    if (head < G) {
        turn_row(s + i * RS + head * D, turns, i, 1.0f);
        turn_row(s + i * RS + GW + head * D, turns, i, 1.0f);
    }
    __syncthreads();
}

// p[n] = softmax_n(q . k_n / sqrt(D)); zero for keys that do not exist.
__device__ __forceinline__ void softmax_row(float* p, const float* q, const float* s, int head, int i) {
    float top = -3.4e38f;
#pragma unroll
    for (int n = 0; n < B; n++) {
        p[n] = -3.4e38f;
        if (n <= i) p[n] = dot_row(q, s + key(i, n) * RS + GW + head * D) * rsqrtf((float)D);
        top = fmaxf(top, p[n]);
    }
    float sum = 0.0f;
#pragma unroll
    for (int n = 0; n < B; n++) {
        p[n] = n <= i ? expf(p[n] - top) : 0.0f;
        sum += p[n];
    }
    const float inverse = 1.0f / sum;
#pragma unroll
    for (int n = 0; n < B; n++) p[n] *= inverse;
}

// Grid (windows, H / G); thread (head, query). out [tokens][E].
extern "C" __global__ void attention_forward(const float* qkv, float* out, const float2* turns) {
    extern __shared__ float4 shared[];
    float* s = (float*)shared;
    const u64 base = (u64)blockIdx.x * T;
    const int column = blockIdx.y * GW, head = threadIdx.x / T, i = threadIdx.x % T;
    load_qkv(s, qkv, base, column);
    __syncthreads();
    turn_shared(s, turns, head, i);
    if (head < G) {
        __align__(16) float q[D];
        __align__(16) float acc[D];
        float p[B];
        load_row(q, s + i * RS + head * D);
        softmax_row(p, q, s, head, i);
#pragma unroll
        for (int c = 0; c < D; c++) acc[c] = 0.0f;
#pragma unroll
        for (int n = 0; n < B; n++)
            if (n <= i) add_row(acc, p[n], s + key(i, n) * RS + 2 * GW + head * D);
        store_row(s + i * RS + head * D, acc);  // overwrites q of this thread, which no other thread reads
    }
    __syncthreads();
    for (int k = threadIdx.x; k < T * (GW / 4); k += blockDim.x) {
        int row = k / (GW / 4), at = k % (GW / 4) * 4;
        *(float4*)(out + (base + row) * E + column + at) = *(const float4*)(s + row * RS + at);
    }
}

// Gradient dqkv from qkv and the gradient g of the attention's output; computes the probabilities p again.
// ds_ij = p_ij (g_i . v_j - sum_j p_ij g_i . v_j) / sqrt(D); dq_i = ds_ij k_j; dk_j = ds_ij q_i; dv_j = p_ij g_i.
extern "C" __global__ void attention_backward(const float* qkv, const float* gradient, float* dqkv,
                                              const float2* turns) {
    extern __shared__ float4 shared[];
    float* s = (float*)shared;
    float* g = s + T * RS;
    float* ps = g + T * GS;        // [G][T][B]
    float* ds = ps + G * T * B;    // [G][T][B]
    const u64 base = (u64)blockIdx.x * T;
    const int column = blockIdx.y * GW, head = threadIdx.x / T, i = threadIdx.x % T;
    load_qkv(s, qkv, base, column);
    for (int k = threadIdx.x; k < T * (GW / 4); k += blockDim.x) {
        int row = k / (GW / 4), at = k % (GW / 4) * 4;
        *(float4*)(g + row * GS + at) = *(const float4*)(gradient + (base + row) * E + column + at);
    }
    __syncthreads();
    turn_shared(s, turns, head, i);
    __align__(16) float dq[D];
    __align__(16) float dk[D];
    __align__(16) float dv[D];
#pragma unroll
    for (int c = 0; c < D; c++) dq[c] = dk[c] = dv[c] = 0.0f;
    if (head < G) {
        __align__(16) float r[D];
        float p[B], d[B];
        load_row(r, s + i * RS + head * D);
        softmax_row(p, r, s, head, i);
        load_row(r, g + i * GS + head * D);
        float mean = 0.0f;
#pragma unroll
        for (int n = 0; n < B; n++) {
            d[n] = 0.0f;
            if (n <= i) d[n] = dot_row(r, s + key(i, n) * RS + 2 * GW + head * D);
            mean += p[n] * d[n];
        }
        float* pr = ps + (head * T + i) * B;
        float* dr = ds + (head * T + i) * B;
#pragma unroll
        for (int n = 0; n < B; n++) {
            float v = p[n] * (d[n] - mean) * rsqrtf((float)D);
            pr[n] = p[n];
            dr[n] = v;
            if (n <= i) add_row(dq, v, s + key(i, n) * RS + GW + head * D);
        }
    }
    __syncthreads();
    if (head < G) {
#pragma unroll
        for (int n = 0; n < B; n++) {
            // Entry `at` has the probability of this thread's key i for query k.
            const int k = ROTARY ? i + n : n, at = (head * T + k) * B + (ROTARY ? n : i);
            if (ROTARY ? k < T : k >= i) {
                add_row(dk, ds[at], s + k * RS + head * D);
                add_row(dv, ps[at], g + k * GS + head * D);
            }
        }
    }
    __syncthreads();
    if (head < G) {
        if (ROTARY) {
            turn_row(dq, turns, i, -1.0f);
            turn_row(dk, turns, i, -1.0f);
        }
        store_row(s + i * RS + head * D, dq);
        store_row(s + i * RS + GW + head * D, dk);
        store_row(s + i * RS + 2 * GW + head * D, dv);
    }
    __syncthreads();
    for (int k = threadIdx.x; k < T * 3 * (GW / 4); k += blockDim.x) {
        int row = k / (3 * GW / 4), c = k % (3 * GW / 4), part = c / (GW / 4), at = c % (GW / 4) * 4;
        *(float4*)(dqkv + (base + row) * (3 * E) + part * E + column + at) =
            *(const float4*)(s + row * RS + part * GW + at);
    }
}

// Attention of one new token per environment over the last B keys and values. Environment r has taken[r] earlier
// tokens; the new key and value go to slot taken % B of ring [env][B][2 E]. Only the query is rotated, by the distance
// to each key, so keys are stored unrotated. One warp per row and head, D <= 32; turns [B][D / 2].
extern "C" __global__ void attention_stream(const float* qkv, float* ring, const unsigned* taken, float* out,
                                            const float2* turns, int rows) {
    const int warp = (blockIdx.x * blockDim.x + threadIdx.x) / 32, lane = threadIdx.x % 32;
    const int row = warp / H, head = warp % H;
    if (row >= rows) return;
    const bool in = lane < D;
    const int c = in ? lane : 0, pair = c % (D / 2);
    const unsigned now = taken[row];
    const float* token = qkv + (u64)row * (3 * E) + head * D + c;
    float* past = ring + (u64)row * (B * 2 * E) + head * D + c;
    const float q = in ? token[0] : 0.0f;
    const float partner = __shfl_sync(0xffffffffu, q, c < D / 2 ? c + D / 2 : c - D / 2);
    if (in) {
        past[now % B * (2 * E)] = token[E];
        past[now % B * (2 * E) + E] = token[2 * E];
    }
    float p[B], top = -3.4e38f, sum = 0.0f, mixed = 0.0f;
#pragma unroll
    for (int n = 0; n < B; n++) {
        p[n] = -3.4e38f;
        if (n > now) continue;
        const float2 t = turns[n * (D / 2) + pair];
        const float turned = q * t.x + (c < D / 2 ? -partner : partner) * t.y;
        p[n] = warp_sum(in ? turned * past[(now - n) % B * (2 * E)] : 0.0f) * rsqrtf((float)D);
        top = fmaxf(top, p[n]);
    }
#pragma unroll
    for (int n = 0; n < B; n++) {
        if (n > now) continue;
        p[n] = expf(p[n] - top);
        sum += p[n];
        if (in) mixed += p[n] * past[(now - n) % B * (2 * E) + E];
    }
    if (in) out[(u64)row * E + head * D + c] = mixed / sum;
}
