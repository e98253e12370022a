// Activations y = f(x + bias) and their gradients, four numbers per thread; arrays are padded to whole float4. The bias
// may be null. BIASED is false if no activation of the program has a bias.

__device__ __forceinline__ float phi(float x) { return 0.5f + 0.5f * erff(x * 0.70710678118654752f); }

// y = f(x + bias, y)
template <class F>
__device__ __forceinline__ void apply(const float* x, const float* bias, float4* y, int width, u64 quads, F f) {
    const u64 i = (u64)blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= quads) return;
    float4 v = ((const float4*)x)[i];
    if (BIASED && bias) {
        const int c = i * 4 % width;
        v.x += bias[c];
        v.y += bias[(c + 1) % width];
        v.z += bias[(c + 2) % width];
        v.w += bias[(c + 3) % width];
    }
    const float4 d = y[i];
    y[i] = make_float4(f(v.x, d.x), f(v.y, d.y), f(v.z, d.z), f(v.w, d.w));
}

extern "C" __global__ void gelu_forward(const float* x, const float* bias, float4* y, int width, u64 quads) {
    apply(x, bias, y, width, quads, [](float x, float) { return x * phi(x); });
}

extern "C" __global__ void gelu_backward(const float* x, const float* bias, float4* g, int width, u64 quads) {
    apply(x, bias, g, width, quads,
          [](float x, float d) { return d * (phi(x) + x * 0.39894228040143268f * expf(-0.5f * x * x)); });
}

extern "C" __global__ void relu_forward(const float* x, const float* bias, float4* y, int width, u64 quads) {
    // Keeps NaN, where fmaxf would return 0.
    apply(x, bias, y, width, quads, [](float x, float) { return x < 0.0f ? 0.0f : x; });
}

extern "C" __global__ void relu_backward(const float* x, const float* bias, float4* g, int width, u64 quads) {
    apply(x, bias, g, width, quads, [](float x, float d) { return x <= 0.0f ? 0.0f : d; });
}

extern "C" __global__ void tanh_forward(const float* x, const float* bias, float4* y, int width, u64 quads) {
    apply(x, bias, y, width, quads, [](float x, float) { return tanhf(x); });
}

extern "C" __global__ void tanh_backward(const float* x, const float* bias, float4* g, int width, u64 quads) {
    apply(x, bias, g, width, quads, [](float x, float d) {
        const float y = tanhf(x);
        return d * (1.0f - y * y);
    });
}

extern "C" __global__ void elu_forward(const float* x, const float* bias, float4* y, int width, u64 quads) {
    apply(x, bias, y, width, quads, [](float x, float) { return x < 0.0f ? expm1f(x) : x; });
}

extern "C" __global__ void elu_backward(const float* x, const float* bias, float4* g, int width, u64 quads) {
    apply(x, bias, g, width, quads, [](float x, float d) { return x < 0.0f ? d * expf(x) : d; });
}
