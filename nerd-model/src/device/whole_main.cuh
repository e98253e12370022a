// A pass of all windows: on a device a block WINDOWS of them, elsewhere a program that reads weights and tokens and writes outputs.

#ifdef __CUDACC_RTC__
extern "C" __global__ void __launch_bounds__(32 * WARPS) whole_pass(const float* w, const float* tokens, float* out, int n) {
    extern __shared__ __align__(16) float s[];
    const long long first = (long long)blockIdx.x * WINDOWS;
    const int here = n - first < WINDOWS ? n - first : WINDOWS;
    pass(w, tokens + first * T * INPUTS, out + first * T * OUTPUTS, s, here * T);
}
#else
int main() {
    int head[2];
    if (std::fread(head, 4, 2, stdin) != 2) return 1;
    const int n = head[0];
    // Unwritten memory is NaN.
    std::vector<float> w(head[1]), tokens(n * T * INPUTS), out(n * T * OUTPUTS), s(FLOATS, NAN);
    size_t got = std::fread(w.data(), 4, w.size(), stdin) + std::fread(tokens.data(), 4, tokens.size(), stdin);
    for (int first = 0; first < n; first += WINDOWS) {
        const int here = n - first < WINDOWS ? n - first : WINDOWS;
        pass(w.data(), tokens.data() + first * T * INPUTS, out.data() + first * T * OUTPUTS, s.data(), here * T);
    }
    std::fwrite(out.data(), 4, out.size(), stdout);
    return got != w.size() + tokens.size();
}
#endif
