// Kernels of SHAC's backward pass beside task, solver and networks, as in shac/back.rs.

// Computes for each environment the weights of its rewards, the index of each step's bootstrap row, and its part of J.
// The index is -1 for a step without a bootstrap row; rows are ordered as in `reached`. Writes the gradient of -J with
// respect to the outputs of V' on bootstrap rows.
extern "C" __global__ void shac_ahead(const double* rewards, const unsigned char* ends, const double* values,
                                      const double* units, double* shares, int* asked, float* by, double* earned,
                                      unsigned* without, int n, int horizon, int slots, int a, int outputs,
                                      double gamma, double scale) {
    const u64 env = INDEX;
    if (env >= n) return;
    for (int slot = 0; slot <= slots; slot++)
        for (int k = 0; k < outputs; k++) by[((u64)slot * n + env) * outputs + k] = 0;
    double share = 1, sum = 0;
    for (int t = 0, cut = 0; t < horizon; t++) {
        const u64 i = (u64)t * n + env;
        const bool last = t + 1 == horizon && !ends[i];
        shares[i] = share;
        sum += share * rewards[i];
        asked[i] = -1;
        if (last || ends[i] == 2) {
            const u64 row = (u64)(last ? 0 : ++cut) * n + env;
            asked[i] = (int)row;
            by[row * outputs + a] = (float)(-gamma * share * scale * units[1]);
            sum += gamma * share * values[last ? i + n : (u64)(horizon + 1) * n + i];
        }
        share = ends[i] ? 1 : gamma * share;
    }
    earned[env] = scale * sum;
    without[env] = 0;
}

// Moves the target critic's weights towards those of the critic, w; keeps the share `kept` of the old ones.
extern "C" __global__ void shac_follow(float* target_critic, const float* w, float kept, u64 n) {
    const u64 i = INDEX;
    if (i < n) target_critic[i] = kept * target_critic[i] + (1.0f - kept) * w[i];
}
