// Adds a frame's gradient `of_frame` `[n]` to the sum `all` `[n]`; if `first`, the sum starts from 0.
extern "C" __global__ void unroll_add(const float* of_frame, float* all, int n, int first) {
    const int i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i < n) all[i] = (first ? 0.0f : all[i]) + of_frame[i];
}

// Sum of all losses, in order; one block of 256 threads.
extern "C" __global__ void unroll_total(const double* losses, int n, float* total) {
    __shared__ double part[256];
    double sum = 0;
    for (int i = threadIdx.x; i < n; i += blockDim.x) sum += losses[i];
    part[threadIdx.x] = sum;
    __syncthreads();
    if (threadIdx.x) return;
    for (int i = 1; i < 256; i++) sum += part[i];
    *total = (float)sum;
}
