// A frame of chains, as a solver makes it.

#ifdef __CUDACC_RTC__
// Tokens of `n` environments; one that failed before is skipped. Torques are held, or one set a frame.
extern "C" __global__ void chain_tell(const double* states, const double* torques, const double* scenes, const int* scene_of, double* memos,
                                      float* tokens, int* faults, const unsigned* done, int n, const int* held) {
    const int env = blockIdx.x * blockDim.x + threadIdx.x;
    if (env >= n || faults[env]) return;
    const double* tau = torques + ((long long)(*held ? 0 : done[env]) * n + env) * HALF;
    faults[env] = tell(states + (long long)env * STATE, tau, scenes + (long long)scene_of[env] * (3 + COLLIDER * NC),
                       memos + (long long)env * CHAIN, tokens + (long long)env * RODS * LDX);
}

extern "C" __global__ void chain_apply(double* states, const double* memos, const float* said, int* faults, unsigned* done, int n) {
    const int env = blockIdx.x * blockDim.x + threadIdx.x;
    if (env >= n || faults[env]) return;
    faults[env] = apply(states + (long long)env * STATE, memos + (long long)env * CHAIN, said + (long long)env * RODS * OUTPUTS);
    if (!faults[env]) done[env]++;
}
#else
#include <cstdio>
// From standard input, n and scenes; states, torques, scenes, scene of each, outputs; to standard output, faults, tokens, states.
int main() {
    int head[2];
    if (std::fread(head, 4, 2, stdin) != 2) return 1;
    const int n = head[0], scenes = head[1], wide = 3 + COLLIDER * NC;
    double *states = new double[n * STATE], *torques = new double[n * HALF], *scene = new double[scenes * wide], *memo = new double[CHAIN];
    float *said = new float[n * RODS * OUTPUTS], *tokens = new float[n * RODS * LDX];
    int* of = new int[n];
    size_t got = std::fread(states, 8, n * STATE, stdin) + std::fread(torques, 8, n * HALF, stdin) + std::fread(scene, 8, scenes * wide, stdin);
    got += std::fread(of, 4, n, stdin) + std::fread(said, 4, n * RODS * OUTPUTS, stdin);
    for (int env = 0; env < n; env++) {
        int fault = tell(states + env * STATE, torques + env * HALF, scene + of[env] * wide, memo, tokens + env * RODS * LDX);
        if (!fault) fault = apply(states + env * STATE, memo, said + env * RODS * OUTPUTS);
        of[env] = fault;
    }
    std::fwrite(of, 4, n, stdout);
    std::fwrite(tokens, 4, n * RODS * LDX, stdout);
    std::fwrite(states, 8, n * STATE, stdout);
    return got != (size_t)n * (STATE + HALF + 1 + RODS * OUTPUTS) + scenes * wide;
}
#endif
