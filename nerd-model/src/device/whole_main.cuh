// A pass of all windows, WINDOWS of them per block.

extern "C" __global__ void __launch_bounds__(32 * WARPS)
    whole_pass(const float* w, const float* tokens, float* out, int n) {
    extern __shared__ __align__(16) float s[];
    const long long first = (long long)blockIdx.x * WINDOWS;
    const int here = n - first < WINDOWS ? n - first : WINDOWS;
    pass(w, tokens + first * T * INPUTS, out + first * T * OUTPUTS, s, here * T);
}
