// out[row] = [x[row - apart] x[row] x[row + apart]], zero beyond the ends of a window. One thread per entry.

extern "C" __global__ void neighbours_forward(const float* x, float* out, int width, int apart, u64 count) {
    const u64 i = (u64)blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= count) return;
    const u64 row = i / (3 * width);
    const int c = i % (3 * width), other = (int)(row % T) + (c / width - 1) * apart;
    out[i] = other >= 0 && other < T ? x[(row - row % T + other) * width + c % width] : 0.0f;
}

extern "C" __global__ void neighbours_backward(const float* g, float* dx, int width, int apart, u64 count) {
    const u64 i = (u64)blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= count) return;
    const u64 row = i / width;
    const int k = row % T, c = i % width;
    float sum = 0.0f;
    for (int part = 0; part < 3; part++) {
        const int other = k - (part - 1) * apart;
        if (other >= 0 && other < T) sum += g[((row - k + other) * 3 + part) * width + c];
    }
    dx[i] = sum;
}
