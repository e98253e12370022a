// Layer norm of rows of NORM columns (even), one warp per row.

constexpr int PAIRS = (NORM / 2 + 31) / 32; // float2 of a row per lane

// xhat = (x - mean) / sqrt(var + eps), after x += bias + table[position] in place; either may be null.
extern "C" __global__ void norm_forward(float* x, const float* bias, const float* table, float* xhat, float* rstd,
                                        int tokens) {
    const int token = (blockIdx.x * blockDim.x + threadIdx.x) / 32, lane = threadIdx.x % 32;
    if (token >= tokens) return;
    float2* row = (float2*)(x + (u64)token * NORM);
    float2 v[PAIRS];
    float sum = 0.0f;
#pragma unroll
    for (int p = 0; p < PAIRS; p++) {
        int c = lane + 32 * p;
        v[p] = make_float2(0.0f, 0.0f);
        if (c < NORM / 2) {
            v[p] = row[c];
            if (bias || table) {
                const float* b = bias + 2 * c;
                const float* k = table + token % T * NORM + 2 * c;
                v[p].x += (bias ? b[0] : 0.0f) + (table ? k[0] : 0.0f);
                v[p].y += (bias ? b[1] : 0.0f) + (table ? k[1] : 0.0f);
                row[c] = v[p];
            }
        }
        sum += v[p].x + v[p].y;
    }
    const float mean = warp_sum(sum) * (1.0f / NORM);
    float square = 0.0f;
#pragma unroll
    for (int p = 0; p < PAIRS; p++) {
        if (lane + 32 * p < NORM / 2) {
            v[p].x -= mean;
            v[p].y -= mean;
            square += v[p].x * v[p].x + v[p].y * v[p].y;
        }
    }
    const float r = 1.0f / sqrtf(warp_sum(square) * (1.0f / NORM) + 1e-5f);
    float2* out = (float2*)(xhat + (u64)token * NORM);
#pragma unroll
    for (int p = 0; p < PAIRS; p++) {
        int c = lane + 32 * p;
        if (c < NORM / 2) out[c] = make_float2(v[p].x * r, v[p].y * r);
    }
    if (lane == 0) rstd[token] = r;
}

// to = from + rstd (g - mean(g) - xhat mean(g xhat)); `from` may be null (zero).
extern "C" __global__ void norm_backward(const float* g, const float* xhat, const float* rstd, const float* from,
                                         float* to, int tokens) {
    const int token = (blockIdx.x * blockDim.x + threadIdx.x) / 32, lane = threadIdx.x % 32;
    if (token >= tokens) return;
    const u64 at = (u64)token * NORM;
    float2 a[PAIRS], b[PAIRS];
    float sum = 0.0f, dot = 0.0f;
#pragma unroll
    for (int p = 0; p < PAIRS; p++) {
        int c = lane + 32 * p;
        a[p] = b[p] = make_float2(0.0f, 0.0f);
        if (c < NORM / 2) {
            a[p] = ((const float2*)(g + at))[c];
            b[p] = ((const float2*)(xhat + at))[c];
        }
        sum += a[p].x + a[p].y;
        dot += a[p].x * b[p].x + a[p].y * b[p].y;
    }
    sum = warp_sum(sum) * (1.0f / NORM);
    dot = warp_sum(dot) * (1.0f / NORM);
    const float r = rstd[token];
#pragma unroll
    for (int p = 0; p < PAIRS; p++) {
        int c = lane + 32 * p;
        if (c >= NORM / 2) continue;
        float2 v = from ? ((const float2*)(from + at))[c] : make_float2(0.0f, 0.0f);
        v.x += r * (a[p].x - sum - b[p].x * dot);
        v.y += r * (a[p].y - sum - b[p].y * dot);
        ((float2*)(to + at))[c] = v;
    }
}
