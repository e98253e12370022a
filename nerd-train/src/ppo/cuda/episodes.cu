// Conversion of actions and results for external learners, in f32.

// Clamps actions to [-1, 1], keeping NaN; resets the counts of truncated episodes.
extern "C" __global__ void offer(const float* asked, float* actions, unsigned* cuts, int actions_all, int n) {
    const int i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i < actions_all) actions[i] = asked[i] < -1.0f ? -1.0f : asked[i] > 1.0f ? 1.0f : asked[i];
    if (i < n) cuts[i] = 0;
}

// Converts results. `reached` is the final observation of a truncated episode, elsewhere the present observation.
extern "C" __global__ void show(const double* rows, const double* cut, const double* rewards, const unsigned char* ends,
                                float* observations, float* reached, float* reward, unsigned char* terminated,
                                unsigned char* truncated, int all, int width) {
    const int i = blockIdx.x * blockDim.x + threadIdx.x, env = i / width;
    if (i >= all) return;
    observations[i] = (float)rows[i];
    reached[i] = (float)(ends[env] == 2 ? cut[i] : rows[i]);
    if (i % width) return;
    reward[env] = (float)rewards[env];
    terminated[env] = ends[env] == 1;
    truncated[env] = ends[env] == 2;
}
