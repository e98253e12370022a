// Kernels of the fused CUDA engine, compiled at run time with the network's shape as constants:
// E embedding, H heads, T tokens in a window, B tokens that a token sees, G heads in one attention block, IN inputs, LDX
// padded inputs, OUT outputs, HID hidden width of the head, ROTARY whether positions are rotary (or else a table). All arrays are f32 and row-major. Every sum has a fixed order (no
// float atomics), so equal inputs give equal bits.

typedef unsigned long long u64;

constexpr int D = E / H;                 // width of one head
constexpr int GW = G * D;                // columns of one attention block
constexpr int RS = 3 * GW + 4;           // shared row of q|k|v; the 4 extra floats keep rows in different banks
constexpr int GS = GW + 4;               // shared row of an output gradient
constexpr int PAIRS = (E / 2 + 31) / 32; // float2 of one token per lane
constexpr int HPL = (HID + 31) / 32;     // hidden units of the head per lane

// Mirror of `Scalars` in trainer.rs.
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

// ---------------------------------------------------------------- windows

__device__ u64 mix(u64 x) {
    x += 0x9e3779b97f4a7c15ull;
    x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ull;
    x = (x ^ (x >> 27)) * 0x94d049bb133111ebull;
    return x ^ (x >> 31);
}

// One block per row of the batch. Takes window numbers[row], or draws it where there are no numbers, and copies its tokens to
// u [rows][T][LDX] (zero padded) and y [rows][T][OUT].
extern "C" __global__ void gather(const float* x, const float* y, float* u, float* target, const Scalars* s, u64 seed,
                                  u64 windows, u64 per, u64 frames, const u64* numbers, u64 first) {
    const u64 row = blockIdx.x;
    const u64 w = numbers ? numbers[row] : mix(mix(mix(seed) ^ s->step) ^ (first + row)) % windows;
    const u64 token = w / per * frames + w % per;
    for (int i = threadIdx.x; i < T * LDX; i += blockDim.x) {
        int k = i / LDX, c = i % LDX;
        u[row * (T * LDX) + i] = c < IN ? x[(token + k) * IN + c] : 0.0f;
    }
    for (int i = threadIdx.x; i < T * OUT; i += blockDim.x) target[row * (T * OUT) + i] = y[token * OUT + i];
}

// out[w] = x[w T + last[w]]
extern "C" __global__ void select_rows(const float* x, const unsigned* last, float* out) {
    const float* src = x + ((u64)blockIdx.x * T + last[blockIdx.x]) * E;
    for (int i = threadIdx.x; i < E; i += blockDim.x) out[(u64)blockIdx.x * E + i] = src[i];
}

// ---------------------------------------------------------------- layer norm

// The weight of a LayerNorm is folded into the rows of the matrix that follows: W'[i][j] = w[i] W[i][j].
// Table rows: offset of W, offset of w, offset of W', columns. Grid (E, matrices).
extern "C" __global__ void fold(const float* flat, float* folded, const int4* table) {
    const int4 t = table[blockIdx.y];
    const float w = flat[t.y + blockIdx.x];
    const float* src = flat + t.x + (u64)blockIdx.x * t.w;
    float* dst = folded + t.z + (u64)blockIdx.x * t.w;
    for (int j = threadIdx.x; j < t.w; j += blockDim.x) dst[j] = w * src[j];
}

// From dW' (in place of dW) to dW[i][j] = w[i] dW'[i][j] and dw[i] = sum_j dW'[i][j] W[i][j].
extern "C" __global__ void unfold(const float* flat, float* grad, const int4* table) {
    __shared__ float part[32];
    const int4 t = table[blockIdx.y];
    const float w = flat[t.y + blockIdx.x];
    const u64 at = t.x + (u64)blockIdx.x * t.w;
    float sum = 0.0f;
    for (int j = threadIdx.x; j < t.w; j += blockDim.x) {
        float g = grad[at + j];
        sum += g * flat[at + j];
        grad[at + j] = w * g;
    }
    sum = warp_sum(sum);
    if (threadIdx.x % 32 == 0) part[threadIdx.x / 32] = sum;
    __syncthreads();
    if (threadIdx.x == 0) {
        float total = 0.0f;
        for (int i = 0; i < blockDim.x / 32; i++) total += part[i];
        grad[t.y + blockIdx.x] = total;
    }
}

// xhat = (x - mean) / sqrt(var + eps) per token, one warp each. With `bias`, first x += bias + position[k]
// (rotary positions have no table).
extern "C" __global__ void norm_forward(float* x, const float* bias, const float* position, float* xhat, float* rstd,
                                        int tokens) {
    const int token = (blockIdx.x * blockDim.x + threadIdx.x) / 32, lane = threadIdx.x % 32;
    if (token >= tokens) return;
    float2* row = (float2*)(x + (u64)token * E);
    float2 v[PAIRS];
    float sum = 0.0f;
#pragma unroll
    for (int p = 0; p < PAIRS; p++) {
        int c = lane + 32 * p;
        v[p] = make_float2(0.0f, 0.0f);
        if (c < E / 2) {
            v[p] = row[c];
            if (bias) {
                float2 b = ((const float2*)bias)[c], k = make_float2(0.0f, 0.0f);
                if (position) k = ((const float2*)(position + (token % T) * E))[c];
                v[p].x += b.x + k.x;
                v[p].y += b.y + k.y;
                row[c] = v[p];
            }
        }
        sum += v[p].x + v[p].y;
    }
    const float mean = warp_sum(sum) * (1.0f / E);
    float square = 0.0f;
#pragma unroll
    for (int p = 0; p < PAIRS; p++) {
        if (lane + 32 * p < E / 2) {
            v[p].x -= mean;
            v[p].y -= mean;
            square += v[p].x * v[p].x + v[p].y * v[p].y;
        }
    }
    const float r = 1.0f / sqrtf(warp_sum(square) * (1.0f / E) + 1e-5f);
    float2* out = (float2*)(xhat + (u64)token * E);
#pragma unroll
    for (int p = 0; p < PAIRS; p++) {
        int c = lane + 32 * p;
        if (c < E / 2) out[c] = make_float2(v[p].x * r, v[p].y * r);
    }
    if (lane == 0) rstd[token] = r;
}

// to = from + rstd (g - mean(g) - xhat mean(g xhat)); `from` may be null (zero).
extern "C" __global__ void norm_backward(const float* g, const float* xhat, const float* rstd, const float* from,
                                         float* to, int tokens) {
    const int token = (blockIdx.x * blockDim.x + threadIdx.x) / 32, lane = threadIdx.x % 32;
    if (token >= tokens) return;
    const u64 at = (u64)token * E;
    float2 a[PAIRS], b[PAIRS];
    float sum = 0.0f, dot = 0.0f;
#pragma unroll
    for (int p = 0; p < PAIRS; p++) {
        int c = lane + 32 * p;
        a[p] = b[p] = make_float2(0.0f, 0.0f);
        if (c < E / 2) {
            a[p] = ((const float2*)(g + at))[c];
            b[p] = ((const float2*)(xhat + at))[c];
        }
        sum += a[p].x + a[p].y;
        dot += a[p].x * b[p].x + a[p].y * b[p].y;
    }
    sum = warp_sum(sum) * (1.0f / E);
    dot = warp_sum(dot) * (1.0f / E);
    const float r = rstd[token];
#pragma unroll
    for (int p = 0; p < PAIRS; p++) {
        int c = lane + 32 * p;
        if (c >= E / 2) continue;
        float2 v = from ? ((const float2*)(from + at))[c] : make_float2(0.0f, 0.0f);
        v.x += r * (a[p].x - sum - b[p].x * dot);
        v.y += r * (a[p].y - sum - b[p].y * dot);
        ((float2*)(to + at))[c] = v;
    }
}

// ---------------------------------------------------------------- attention

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

// Row r of q|k|v of this block's heads, between global [tokens][3 E] and shared [T][RS].
__device__ __forceinline__ void load_qkv(float* s, const float* qkv, u64 base, int column) {
    for (int i = threadIdx.x; i < T * 3 * (GW / 4); i += blockDim.x) {
        int row = i / (3 * GW / 4), c = i % (3 * GW / 4), part = c / (GW / 4), at = c % (GW / 4) * 4;
        *(float4*)(s + row * RS + part * GW + at) = *(const float4*)(qkv + (base + row) * (3 * E) + part * E + column + at);
    }
}

// Query i meets its keys in the order n = 0 .. B - 1: the window's from its start, or the band's from the newest back. Key n
// exists if n <= i.
__device__ __forceinline__ int key(int i, int n) { return ROTARY ? i - n : n; }

// Turns columns c and c + D / 2 of a row by the angles of place i, forwards (sign 1) or back (-1). turns [T][D / 2].
__device__ __forceinline__ void turn_row(float* r, const float2* turns, int i, float sign) {
#pragma unroll
    for (int c = 0; c < D / 2; c++) {
        const float2 t = turns[i * (D / 2) + c];
        const float a = r[c], b = r[c + D / 2];
        r[c] = a * t.x - sign * b * t.y;
        r[c + D / 2] = sign * a * t.y + b * t.x;
    }
}

// Turns query and key i of this thread's head by their place.
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
        store_row(s + i * RS + head * D, acc);  // the thread's own q, read by nobody else
    }
    __syncthreads();
    for (int k = threadIdx.x; k < T * (GW / 4); k += blockDim.x) {
        int row = k / (GW / 4), at = k % (GW / 4) * 4;
        *(float4*)(out + (base + row) * E + column + at) = *(const float4*)(s + row * RS + at);
    }
}

// dqkv from qkv and the gradient of the attention's output; the probabilities are computed again.
// ds_ij = p_ij (g_i . v_j - sum_j p_ij g_i . v_j) / sqrt(D); dq_i = ds_ij k_j; dk_j = ds_ij q_i; dv_j = p_ij g_i.
extern "C" __global__ void attention_backward(const float* qkv, const float* gradient, float* dqkv, const float2* turns) {
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
            // Query k sees this thread's key i as its key number `at`.
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
        *(float4*)(dqkv + (base + row) * (3 * E) + part * E + column + at) = *(const float4*)(s + row * RS + part * GW + at);
    }
}

// One new token of every environment against the last B keys and values of each. Environment r has taken[r] tokens behind it; its
// key and value go to slot taken % B of ring [env][B][2 E]. Turning a query by the distance to a key is turning both by their
// places, so keys are kept unturned. One warp a row and head, D <= 32; turns [B][D / 2].
extern "C" __global__ void attention_stream(const float* qkv, float* ring, const unsigned* taken, float* out, const float2* turns,
                                            int rows) {
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

// ---------------------------------------------------------------- GELU

__device__ __forceinline__ float phi(float x) { return 0.5f + 0.5f * erff(x * 0.70710678118654752f); }
__device__ __forceinline__ float gelu(float x) { return x * phi(x); }
__device__ __forceinline__ float dgelu(float x) { return phi(x) + x * 0.39894228040143268f * expf(-0.5f * x * x); }

extern "C" __global__ void gelu_forward(const float4* a, float4* g, u64 quads) {
    const u64 i = (u64)blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= quads) return;
    float4 v = a[i];
    g[i] = make_float4(gelu(v.x), gelu(v.y), gelu(v.z), gelu(v.w));
}

// g *= gelu'(a)
extern "C" __global__ void gelu_backward(const float4* a, float4* g, u64 quads) {
    const u64 i = (u64)blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= quads) return;
    float4 v = a[i], d = g[i];
    g[i] = make_float4(d.x * dgelu(v.x), d.y * dgelu(v.y), d.z * dgelu(v.z), d.w * dgelu(v.w));
}

// ---------------------------------------------------------------- head

// max(x, 0), of what is no number that: fmaxf would take 0.
__device__ __forceinline__ float relu(float x) { return x < 0.0f ? 0.0f : x; }

// Prediction of one token by one warp: h = relu(z + b1) (kept per lane), d[o] = h W2 + b2.
__device__ __forceinline__ void head_token(const float* z, const float* b1, const float (*w)[OUT], const float* b2, float* h,
                                           float* d, int lane) {
#pragma unroll
    for (int a = 0; a < HPL; a++) {
        int j = lane + 32 * a;
        h[a] = j < HID ? relu(z[j] + b1[j]) : 0.0f;
    }
#pragma unroll
    for (int o = 0; o < OUT; o++) {
        float sum = 0.0f;
#pragma unroll
        for (int a = 0; a < HPL; a++) sum += h[a] * w[a][o];
        d[o] = warp_sum(sum) + b2[o];
    }
}

__device__ __forceinline__ void head_weights(float (*w)[OUT], const float* w2, int lane) {
#pragma unroll
    for (int a = 0; a < HPL; a++)
#pragma unroll
        for (int o = 0; o < OUT; o++) w[a][o] = lane + 32 * a < HID ? w2[(lane + 32 * a) * OUT + o] : 0.0f;
}

extern "C" __global__ void head_predict(const float* z, const float* b1, const float* w2, const float* b2, float* out,
                                        int tokens) {
    const int token = (blockIdx.x * blockDim.x + threadIdx.x) / 32, lane = threadIdx.x % 32;
    if (token >= tokens) return;
    float w[HPL][OUT], h[HPL], d[OUT];
    head_weights(w, w2, lane);
    head_token(z + (u64)token * HID, b1, w, b2, h, d, lane);
#pragma unroll
    for (int o = 0; o < OUT; o++)
        if (lane == o % 32) out[(u64)token * OUT + o] = d[o];
}

// Squared error and all that follows from it. z becomes the gradient of z; a row of `partial` per block holds the
// sums over its tokens of db1 [HID], dW2 [HID][OUT], db2 [OUT], squared error [1]. gain = 2 / (tokens OUT); the gradient is
// that of the pseudo-Huber loss with bend = 1 / delta^2, of the squares where bend is 0.
extern "C" __global__ void head_loss(float* z, const float* b1, const float* w2, const float* b2, const float* y,
                                     float* partial, int tokens, float gain, float bend) {
    __shared__ float acc[HID + HID * OUT + OUT + 1];
    const int lane = threadIdx.x % 32, warp = threadIdx.x / 32, warps = blockDim.x / 32;
    float w[HPL][OUT], gw[HPL][OUT], gb1[HPL], gb2[OUT], loss = 0.0f;
    head_weights(w, w2, lane);
#pragma unroll
    for (int o = 0; o < OUT; o++) {
        gb2[o] = 0.0f;
#pragma unroll
        for (int a = 0; a < HPL; a++) gw[a][o] = gb1[a] = 0.0f;
    }
    for (int t = blockIdx.x * warps + warp; t < tokens; t += gridDim.x * warps) {
        float h[HPL], d[OUT];
        head_token(z + (u64)t * HID, b1, w, b2, h, d, lane);
#pragma unroll
        for (int o = 0; o < OUT; o++) {
            d[o] -= y[(u64)t * OUT + o];
            loss += d[o] * d[o];
            d[o] *= gain * rsqrtf(1.0f + bend * d[o] * d[o]);
            gb2[o] += d[o];
        }
#pragma unroll
        for (int a = 0; a < HPL; a++) {
            float g = 0.0f;
#pragma unroll
            for (int o = 0; o < OUT; o++) {
                g += d[o] * w[a][o];
                gw[a][o] += h[a] * d[o];
            }
            g = h[a] <= 0.0f ? 0.0f : g;
            gb1[a] += g;
            if (lane + 32 * a < HID) z[(u64)t * HID + lane + 32 * a] = g;
        }
    }
    for (int i = threadIdx.x; i < HID + HID * OUT + OUT + 1; i += blockDim.x) acc[i] = 0.0f;
    for (int turn = 0; turn < warps; turn++) {
        __syncthreads();
        if (warp != turn) continue;
#pragma unroll
        for (int a = 0; a < HPL; a++) {
            int j = lane + 32 * a;
            if (j >= HID) continue;
            acc[j] += gb1[a];
#pragma unroll
            for (int o = 0; o < OUT; o++) acc[HID + j * OUT + o] += gw[a][o];
        }
        if (lane == 0) {
#pragma unroll
            for (int o = 0; o < OUT; o++) acc[HID + HID * OUT + o] += gb2[o];
            acc[HID + HID * OUT + OUT] += loss;
        }
    }
    __syncthreads();
    for (int i = threadIdx.x; i < HID + HID * OUT + OUT + 1; i += blockDim.x)
        partial[blockIdx.x * (HID + HID * OUT + OUT + 1) + i] = acc[i];
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

// partial[chunk][T E]: sums of dx over the windows chunk, chunk + chunks, ... Grid (ceil(T E / 128), chunks).
extern "C" __global__ void position_partial(const float* dx, int windows, float* partial) {
    const int c = blockIdx.x * blockDim.x + threadIdx.x;
    if (c >= T * E) return;
    float sum = 0.0f;
    for (int w = blockIdx.y; w < windows; w += gridDim.y) sum += dx[(u64)w * (T * E) + c];
    partial[blockIdx.y * (T * E) + c] = sum;
}

// total += *loss (f64)
extern "C" __global__ void add_loss(const float* loss, double* total) { *total += *loss; }

// ---------------------------------------------------------------- optimiser

extern "C" __global__ void square_partial(const float* g, u64 n, float* partial) {
    __shared__ float part[32];
    float sum = 0.0f;
    for (u64 i = (u64)blockIdx.x * blockDim.x + threadIdx.x; i < n; i += (u64)gridDim.x * blockDim.x) sum += g[i] * g[i];
    sum = warp_sum(sum);
    if (threadIdx.x % 32 == 0) part[threadIdx.x / 32] = sum;
    __syncthreads();
    if (threadIdx.x < 32) {
        sum = warp_sum(threadIdx.x < blockDim.x / 32 ? part[threadIdx.x] : 0.0f);
        if (threadIdx.x == 0) partial[blockIdx.x] = sum;
    }
}

// One block of 256: norm, clip factor, bias corrections, decay of the average, progress; counts the update.
extern "C" __global__ void finish(const float* partial, int count, const float* squares, float mean, float clip,
                                  double average, Scalars* s) {
    __shared__ double part[256];
    double sum = 0.0;
    for (int i = threadIdx.x; i < count; i += 256) sum += partial[i];
    part[threadIdx.x] = sum;
    __syncthreads();
    for (int o = 128; o > 0; o /= 2) {
        if (threadIdx.x < o) part[threadIdx.x] += part[threadIdx.x + o];
        __syncthreads();
    }
    if (threadIdx.x) return;
    const double norm = sqrt(part[0]);
    const float loss = *squares * mean;
    if (s->bad_step == ~0ull && !(isfinite(loss) && isfinite(norm))) {
        s->bad_step = s->step;
        s->bad_loss = isfinite(loss) ? nanf("") : loss;
    }
    const double t = (double)(s->step + 1), k = (double)s->step;
    s->scale = (float)fmin(1.0, clip / (norm + 1e-6));
    s->rate = (float)(s->lr / (1.0 - pow(0.9, t)));
    s->root = (float)(1.0 / sqrt(1.0 - pow(0.999, t)));
    // See `blend` in learner/mod.rs for the sixteen.
    const double growing = (1.0 + k) / (10.0 + k);
    s->blend = (float)(growing < average ? 1.0 - growing : (s->step + 1) % 16 == 0 ? 1.0 - pow(average, 16.0) : 0.0);
    s->loss_sum += loss;
    s->norm_sum += norm;
    s->count += 1;
    s->step += 1;
}

// Whether entry i belongs to a hidden matrix of one of `layers` blocks that start at `first`: Muon's, not Adam's.
__device__ __forceinline__ bool is_hidden(u64 i, u64 first, int layers) {
    constexpr u64 attention = 4ull * E * E, block = 2 * E + 12ull * E * E;
    if (i < first || i >= first + layers * block) return false;
    const u64 o = (i - first) % block;
    return o >= E && (o < E + attention || o >= 2 * E + attention);
}

// Clip, Adam and the moving average. A run whose loss was not finite leaves the weights as they were.
extern "C" __global__ void adam(float* w, const float* g, float* m, float* v, float* a, const Scalars* s, u64 n,
                                u64 first, int hidden_layers) {
    const u64 i = (u64)blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= n || s->bad_step != ~0ull || is_hidden(i, first, hidden_layers)) return;
    const float d = g[i] * s->scale;
    const float mean = m[i] + 0.1f * (d - m[i]);
    const float second = 0.999f * v[i] + 0.001f * d * d;
    const float x = w[i] - s->rate * mean / (sqrtf(second) * s->root + 1e-8f);
    m[i] = mean;
    v[i] = second;
    w[i] = x;
    a[i] += s->blend * (x - a[i]);
}

// Where entry (r, c) of packed matrix k stands in the flat vector; rows of the table: offset, stride, transposed.
__device__ __forceinline__ u64 hidden_at(const int4* table, int k, int i, int columns) {
    const int4 t = table[k];
    const int r = i / columns, c = i % columns;
    return t.x + (t.z ? (u64)c * t.y + r : (u64)r * t.y + c);
}

// Momentum and its look-ahead, packed [matrix][rows][columns]. Grid (ceil(rows columns / 256), matrices).
extern "C" __global__ void muon_pack(const float* g, float* m, float* x, const int4* table, const Scalars* s, float beta,
                                     int rows, int columns) {
    const int i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= rows * columns) return;
    const u64 at = hidden_at(table, blockIdx.y, i, columns);
    const float d = g[at] * s->scale;
    const float mean = beta * m[at] + (1.0f - beta) * d;
    if (s->bad_step == ~0ull) m[at] = mean;
    x[(u64)blockIdx.y * rows * columns + i] = beta * mean + (1.0f - beta) * d;
}

// Divides each packed matrix of n entries by its Frobenius norm. One block of 1024 a matrix.
extern "C" __global__ void muon_unit(float* x, int n) {
    __shared__ float part[32];
    x += (u64)blockIdx.x * n;
    float sum = 0.0f;
    for (int i = threadIdx.x; i < n; i += blockDim.x) sum += x[i] * x[i];
    sum = warp_sum(sum);
    if (threadIdx.x % 32 == 0) part[threadIdx.x / 32] = sum;
    __syncthreads();
    if (threadIdx.x < 32) {
        sum = warp_sum(part[threadIdx.x]);
        if (threadIdx.x == 0) part[0] = sum;
    }
    __syncthreads();
    const float scale = 1.0f / (sqrtf(part[0]) + 1e-7f);
    for (int i = threadIdx.x; i < n; i += blockDim.x) x[i] *= scale;
}

// p = a 1 + b gram + c p. Grid (ceil(rows rows / 256), matrices).
extern "C" __global__ void muon_polynomial(const float* gram, float* p, float a, float b, float c, int rows) {
    const int i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= rows * rows) return;
    const u64 at = (u64)blockIdx.y * rows * rows + i;
    p[at] = (i / rows == i % rows ? a : 0.0f) + b * gram[at] + c * p[at];
}

// w -= lr gain x, and the moving average.
extern "C" __global__ void muon_apply(float* w, float* a, const float* x, const int4* table, const Scalars* s, float gain,
                                      int rows, int columns) {
    const int i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= rows * columns || s->bad_step != ~0ull) return;
    const u64 at = hidden_at(table, blockIdx.y, i, columns);
    const float y = w[at] - s->lr * gain * x[(u64)blockIdx.y * rows * columns + i];
    w[at] = y;
    a[at] += s->blend * (y - a[at]);
}
