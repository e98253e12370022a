// The solver by itself: a loop over environments, and over frames.

#ifdef __CUDACC_RTC__
// `frames` frames in a row of `n` environments, under torques held or one set a frame. Where one fails, the environment stands still, and
// `done` frames went well.
extern "C" __global__ void advance(double* states, const double* torques, const double* scenes, const int* scene_of, const double* drives,
                                   double* forces, int* faults, int* done, int n, int frames, int held) {
    const int env = blockIdx.x * blockDim.x + threadIdx.x;
    if (env >= n) return;
    double* state = states + (long long)env * (NQ + NV);
    int fault = 0, f = 0;
    for (; f < frames; f++) {
        const double* tau = torques + ((long long)(held ? 0 : f) * n + env) * NJ;
        fault = frame(state, tau, scenes + (long long)scene_of[env] * SCENE, drives + (long long)env * 5 * DRIVES,
                      forces ? forces + (long long)env * 3 * NP : 0);
        if (fault) break;
    }
    faults[env] = fault;
    done[env] = f;
}
#else
#include <cstdio>
// The same from standard input to standard output: n, frames, scenes; states, torques, scenes, scene of each, drives.
int main() {
    int head[3];
    if (std::fread(head, 4, 3, stdin) != 3) return 1;
    const int n = head[0], frames = head[1], scenes = head[2];
    double *states = new double[n * (NQ + NV) + 1], *torques = new double[n * NJ + 1], *scene = new double[scenes * SCENE];
    double *drives = new double[n * 5 * NJ + 1], *forces = new double[n * 3 * NP + 1];
    int* of = new int[n];
    size_t got = std::fread(states, 8, n * (NQ + NV), stdin) + std::fread(torques, 8, n * NJ, stdin) + std::fread(scene, 8, scenes * SCENE, stdin);
    got += std::fread(of, 4, n, stdin);
    if (DRIVEN) got += std::fread(drives, 8, n * 5 * NJ, stdin);
    for (int env = 0; env < n; env++) {
        int fault = 0;
        for (int f = 0; f < frames && !fault; f++)
            fault = frame(states + env * (NQ + NV), torques + env * NJ, scene + of[env] * SCENE, drives + env * 5 * NJ, forces + env * 3 * NP);
        of[env] = fault;
    }
    std::fwrite(states, 8, n * (NQ + NV), stdout);
    std::fwrite(of, 4, n, stdout);
    std::fwrite(forces, 8, n * 3 * NP, stdout);
    const size_t wanted = (size_t)n * (NQ + NV) + n * NJ + scenes * SCENE + n + (DRIVEN ? n * 5 * NJ : 0);
    return got != wanted;
}
#endif
