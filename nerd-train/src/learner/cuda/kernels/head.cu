// A hidden layer of HID units before its bias, z, to predictions: W2 relu(z + b1) + b2.

constexpr int HPL = (HID + 31) / 32; // hidden units per lane

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
