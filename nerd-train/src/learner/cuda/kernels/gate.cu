// y = gelu(a) b of rows [a b] with `half` numbers each, and its gradient. Four numbers per thread; `half` is a multiple
// of 4.

__device__ __forceinline__ float share(float x) { return 0.5f + 0.5f * erff(x * 0.70710678118654752f); }

// Index in x of the number a for entry i of y; the number b lies `half` entries after a.
__device__ __forceinline__ u64 first(u64 i, int half) { return i / half * 2 * half + i % half; }

extern "C" __global__ void gate_forward(const float* x, float4* y, int half, u64 quads) {
    const u64 i = (u64)blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= quads) return;
    const float* from = x + first(4 * i, half);
    const float4 a = *(const float4*)from, b = *(const float4*)(from + half);
    y[i] = make_float4(a.x * share(a.x) * b.x, a.y * share(a.y) * b.y, a.z * share(a.z) * b.z, a.w * share(a.w) * b.w);
}

extern "C" __global__ void gate_backward(const float* x, const float4* dy, float* dx, int half, u64 quads) {
    const u64 i = (u64)blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= quads) return;
    const u64 at = first(4 * i, half);
    const float4 a = *(const float4*)(x + at), b = *(const float4*)(x + at + half), d = dy[i];
    auto gradient = [](float a) { return share(a) + a * 0.39894228040143268f * expf(-0.5f * a * a); };
    *(float4*)(dx + at) = make_float4(d.x * b.x * gradient(a.x), d.y * b.y * gradient(a.y), d.z * b.z * gradient(a.z),
                                      d.w * b.w * gradient(a.w));
    *(float4*)(dx + at + half) =
        make_float4(d.x * a.x * share(a.x), d.y * a.y * share(a.y), d.z * a.z * share(a.z), d.w * a.w * share(a.w));
}
