// y = f(x + bias), bias may be null. Arrays have room to whole float4.

__device__ __forceinline__ float phi(float x) { return 0.5f + 0.5f * erff(x * 0.70710678118654752f); }
__device__ __forceinline__ float gelu(float x) { return x * phi(x); }
__device__ __forceinline__ float dgelu(float x) { return phi(x) + x * 0.39894228040143268f * expf(-0.5f * x * x); }

__device__ __forceinline__ float4 biased(const float* x, const float* bias, u64 i, int width) {
    float4 v = ((const float4*)x)[i];
    if (bias) {
        const int c = i * 4 % width;
        v.x += bias[c];
        v.y += bias[(c + 1) % width];
        v.z += bias[(c + 2) % width];
        v.w += bias[(c + 3) % width];
    }
    return v;
}

extern "C" __global__ void gelu_forward(const float* x, const float* bias, float4* y, int width, u64 quads) {
    const u64 i = (u64)blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= quads) return;
    const float4 v = biased(x, bias, i, width);
    y[i] = make_float4(gelu(v.x), gelu(v.y), gelu(v.z), gelu(v.w));
}

// g *= gelu'(x + bias)
extern "C" __global__ void gelu_backward(const float* x, const float* bias, float4* g, int width, u64 quads) {
    const u64 i = (u64)blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= quads) return;
    const float4 v = biased(x, bias, i, width), d = g[i];
    g[i] = make_float4(d.x * dgelu(v.x), d.y * dgelu(v.y), d.z * dgelu(v.z), d.w * dgelu(v.w));
}

extern "C" __global__ void relu_forward(const float* x, const float* bias, float4* y, int width, u64 quads) {
    const u64 i = (u64)blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= quads) return;
    const float4 v = biased(x, bias, i, width);
    y[i] = make_float4(relu(v.x), relu(v.y), relu(v.z), relu(v.w));
}

// g = 0 where x + bias is not above 0
extern "C" __global__ void relu_backward(const float* x, const float* bias, float4* g, int width, u64 quads) {
    const u64 i = (u64)blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= quads) return;
    const float4 v = biased(x, bias, i, width), d = g[i];
    g[i] = make_float4(v.x <= 0.0f ? 0.0f : d.x, v.y <= 0.0f ? 0.0f : d.y, v.z <= 0.0f ? 0.0f : d.z, v.w <= 0.0f ? 0.0f : d.w);
}
