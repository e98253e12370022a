// Kernels of a frame: the first writes tokens, the second applies predictions.

// Writes tokens of `n` environments, LANES threads each; failed ones are skipped. `held` says whether one set of
// torques serves all frames.
extern "C" __global__ void neural_tell(const double* states, const double* torques, const double* scenes,
                                       const int* scene_of, float* tokens, const int* faults, const unsigned* done,
                                       int n, const int* held) {
    const int thread = blockIdx.x * blockDim.x + threadIdx.x, env = thread / LANES;
    if (env >= n || faults[env]) return;
    const double* tau = torques + ((long long)(*held ? 0 : done[env]) * n + env) * NJ;
    tell(states + (long long)env * STATE, tau, scenes + (long long)scene_of[env] * SCENE, tokens + (long long)env * LDX,
         thread % LANES, LANES);
}

extern "C" __global__ void neural_apply(double* states, const float* predictions, unsigned* taken, int* faults,
                                        unsigned* done, int n) {
    const int env = blockIdx.x * blockDim.x + threadIdx.x;
    if (env >= n || faults[env]) return;
    faults[env] = apply(states + (long long)env * STATE, predictions + (long long)env * STATE);
    if (faults[env]) return;
    taken[env]++;
    done[env]++;
}
