// Kernels of a frame of chains, one thread per environment.

// Writes tokens of `n` environments; failed ones are skipped. `held` says whether one set of torques serves all frames.
extern "C" __global__ void chain_tell(const double* states, const double* torques, const double* scenes,
                                      const int* scene_of, double* memos, float* tokens, int* faults,
                                      const unsigned* done, int n, const int* held) {
    const int env = blockIdx.x * blockDim.x + threadIdx.x;
    if (env >= n || faults[env]) return;
    const double* tau = torques + ((long long)(*held ? 0 : done[env]) * n + env) * HALF;
    faults[env] = tell(states + (long long)env * STATE, tau, scenes + (long long)scene_of[env] * (3 + COLLIDER * NC),
                       memos + (long long)env * CHAIN, tokens + (long long)env * RODS * LDX);
}

extern "C" __global__ void chain_apply(double* states, const double* memos, const float* said, int* faults,
                                       unsigned* done, int n) {
    const int env = blockIdx.x * blockDim.x + threadIdx.x;
    if (env >= n || faults[env]) return;
    faults[env] =
        apply(states + (long long)env * STATE, memos + (long long)env * CHAIN, said + (long long)env * RODS * OUTPUTS);
    if (!faults[env]) done[env]++;
}
