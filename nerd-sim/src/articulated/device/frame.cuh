// One frame of one environment, and the loop over them. SUBSTEPS, CONTACT_SUBSTEPS, RK4, IMPLICIT, RENEW, HUBER are the solver's
// settings; ANY_DRY tells of a joint with dry friction.

// Advances `state`; 0, or why not: 1 + the DoF at which the mass matrix is none, LOST, GONE.
BIG int frame(double* state, const double* tau, const double* scene, const double* drives, double* forces) {
    Work w;
    Tree& t = w.tree;
    for (int k = 0; k < NQ; k++) t.q[k] = state[k];
    double qd[NV];
    for (int k = 0; k < NV; k++) qd[k] = state[NQ + k];
    // (w, v) about the world's origin to (w, p_dot).
    if (DOFS) {
        const double *o = qd, *p = state;
        const double x = o[1] * p[2] - o[2] * p[1], y = o[2] * p[0] - o[0] * p[2], z = o[0] * p[1] - o[1] * p[0];
        qd[3] += x; qd[4] += y; qd[5] += z;
    }
    for (int k = 0; k < NV; k++) t.qd[k] = (real)qd[k];
    if (forces) for (int k = 0; k < 3 * NP; k++) forces[k] = 0;
    const bool touching = NP > 0 && NC > 0 && scene[3] != 0;
    int done = STIFF;
    if (!(ANY_DRY || DRIVEN || (touching && IMPLICIT))) {
        Explicit e;
        e.looked = false;
        e.soft = -1;
        for (int i = 0; i < NJ; i++) e.weight[i] = -1;
        if (!touching && RK4) done = runge_kutta(w, e, scene, tau, SUBSTEPS);
        else done = euler(w, e, scene, tau, forces, touching, touching ? CONTACT_SUBSTEPS : SUBSTEPS);
        if (done == STIFF) {
            for (int k = 0; k < NQ; k++) t.q[k] = state[k];
            for (int k = 0; k < NV; k++) t.qd[k] = (real)qd[k];
            if (forces) for (int k = 0; k < 3 * NP; k++) forces[k] = 0;
            done = implicit(w, scene, tau, drives, forces, SUBSTEPS > CONTACT_SUBSTEPS ? SUBSTEPS : CONTACT_SUBSTEPS);
        }
    } else {
        done = implicit(w, scene, tau, drives, forces, CONTACT_SUBSTEPS);
    }
    if (done) return done;
    for (int k = 0; k < NV; k++) qd[k] = t.qd[k];
    if (DOFS) {
        const double *o = qd, *p = t.q;
        const double x = o[1] * p[2] - o[2] * p[1], y = o[2] * p[0] - o[0] * p[2], z = o[0] * p[1] - o[1] * p[0];
        qd[3] -= x; qd[4] -= y; qd[5] -= z;
    }
    for (int k = 0; k < NQ; k++) if (!(t.q[k] - t.q[k] == 0)) return GONE;
    for (int k = 0; k < NV; k++) if (!(qd[k] - qd[k] == 0)) return GONE;
    for (int k = 0; k < NQ; k++) state[k] = t.q[k];
    for (int k = 0; k < NV; k++) state[NQ + k] = qd[k];
    for (int i = 0; i < NJ; i++) {
        // Endless angles are kept in [-pi, pi).
        const double pi = 3.14159265358979323846, x = state[COORDS + i];
        if (WRAPS[i] && !(-pi <= x && x < pi)) {
            double y = fmod(x, 2 * pi);
            if (y >= pi) y -= 2 * pi;
            else if (y < -pi) y += 2 * pi;
            state[COORDS + i] = y;
        }
    }
    return 0;
}

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
