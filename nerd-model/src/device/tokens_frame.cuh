// Kernels of a frame.

#ifdef __CUDACC_RTC__
// Tokens of `n` environments, LANES threads each; one that failed before is skipped. Torques are held, or one set a frame.
extern "C" __global__ void neural_tell(const double* states, const double* torques, const double* scenes, const int* scene_of, float* tokens,
                                       const int* faults, const unsigned* done, int n, const int* held) {
    const int thread = blockIdx.x * blockDim.x + threadIdx.x, env = thread / LANES;
    if (env >= n || faults[env]) return;
    const double* tau = torques + ((long long)(*held ? 0 : done[env]) * n + env) * NJ;
    tell(states + (long long)env * STATE, tau, scenes + (long long)scene_of[env] * SCENE, tokens + (long long)env * LDX, thread % LANES,
         LANES);
}

extern "C" __global__ void neural_apply(double* states, const float* predictions, unsigned* taken, int* faults, unsigned* done, int n) {
    const int env = blockIdx.x * blockDim.x + threadIdx.x;
    if (env >= n || faults[env]) return;
    faults[env] = apply(states + (long long)env * STATE, predictions + (long long)env * STATE);
    if (faults[env]) return;
    taken[env]++;
    done[env]++;
}
#else
#include <cstdio>
// From standard input, n and scenes; states, torques, scenes, scene of each, predictions; to standard output, faults, tokens, states.
int main() {
    int head[2];
    if (std::fread(head, 4, 2, stdin) != 2) return 1;
    const int n = head[0], scenes = head[1];
    double *states = new double[n * STATE], *torques = new double[n * NJ + 1], *scene = new double[scenes * SCENE];
    float *predictions = new float[n * STATE], *tokens = new float[n * LDX];
    int* of = new int[n];
    size_t got = std::fread(states, 8, n * STATE, stdin) + std::fread(torques, 8, n * NJ, stdin) + std::fread(scene, 8, scenes * SCENE, stdin);
    got += std::fread(of, 4, n, stdin) + std::fread(predictions, 4, n * STATE, stdin);
    for (int env = 0; env < n; env++) {
        for (int lane = 0; lane < LANES; lane++)
            tell(states + env * STATE, torques + env * NJ, scene + of[env] * SCENE, tokens + env * LDX, lane, LANES);
        of[env] = apply(states + env * STATE, predictions + env * STATE);
    }
    std::fwrite(of, 4, n, stdout);
    std::fwrite(tokens, 4, n * LDX, stdout);
    std::fwrite(states, 8, n * STATE, stdout);
    return got != (size_t)n * (2 * STATE + NJ + 1) + scenes * SCENE;
}
#endif
