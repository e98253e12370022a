// The solver alone: a kernel over environments, with a loop over frames.

// Advances `n` environments by `frames` frames, under one set of torques (`held`) or one per frame. After a fault an
// environment keeps its state; `done` counts its completed frames. `asked`: commanded torques in a family's actuator
// model.
extern "C" __global__ void advance(double* states, const double* torques, const double* scenes, const int* scene_of,
                                   const double* drives, double* forces, int* faults, int* done, int n, int frames,
                                   int held
#if RIGGED
                                   , double* asked, unsigned* known
#endif
) {
    const int env = blockIdx.x * blockDim.x + threadIdx.x;
    if (env >= n) return;
    double* state = states + (long long)env * (NQ + NV);
    int fault = 0, f = 0;
    for (; f < frames; f++) {
        const double* tau = torques + ((long long)(held ? 0 : f) * n + env) * NJ;
        const double *scene = scenes + (long long)scene_of[env] * SCENE, *own = drives + (long long)env * 5 * DRIVES;
        double* press = forces ? forces + (long long)env * 3 * NP : 0;
#if RIGGED
        fault = rigged(state, tau, scene, own, press, asked + (long long)env * LATEST * NJ, known + env);
#else
        fault = frame(state, tau, scene, own, press);
#endif
        if (fault) break;
    }
    faults[env] = fault;
    done[env] = f;
}
