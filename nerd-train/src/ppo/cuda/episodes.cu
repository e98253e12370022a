// Around a step whose learner is beside this library: actions in, observations out. Its numbers have 32 bits.

// Actions within their bounds, NaN as it is; no time has run out yet.
extern "C" __global__ void offer(const float* asked, float* actions, unsigned* cuts, int actions_all, int n) {
    const int i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i < actions_all) actions[i] = asked[i] < -1.0f ? -1.0f : asked[i] > 1.0f ? 1.0f : asked[i];
    if (i < n) cuts[i] = 0;
}

// What is seen, and what was reached: the same, but where time ran out what was seen then.
extern "C" __global__ void show(const double* rows, const double* cut, const double* rewards, const unsigned char* ends, float* observations,
                                float* reached, float* reward, unsigned char* terminated, unsigned char* truncated, int all, int width) {
    const int i = blockIdx.x * blockDim.x + threadIdx.x, env = i / width;
    if (i >= all) return;
    observations[i] = (float)rows[i];
    reached[i] = (float)(ends[env] == 2 ? cut[i] : rows[i]);
    if (i % width) return;
    reward[env] = (float)rewards[env];
    terminated[env] = ends[env] == 1;
    truncated[env] = ends[env] == 2;
}
