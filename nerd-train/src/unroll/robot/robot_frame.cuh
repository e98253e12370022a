// Kernels of an update: states are `[H + 1][n][STATE]`, torques of motions `[NJ]`, all else of a rollout `[n]`; gradients by states have 2 NV of STATE numbers.

FN const double* truth(const Rollout& r, const Motions& m, int k) {
    return m.truths + ((long long)r.motion * (m.frames + 1) + (long long)r.frame + k) * STATE;
}
FN const double* scene(const Rollout& r, const Motions& m) { return m.scenes + (long long)r.motion * SCENE; }

// The token of a state in frame k.
FN void token(const Rollout& r, const Motions& m, int k, const double* state, float* out) {
    tell(state, m.torques + ((long long)r.motion * m.frames + (long long)r.frame + k) * NJ, scene(r, m), out);
}

#define EACH                                                                   \
    const long long env = (long long)blockIdx.x * blockDim.x + threadIdx.x;    \
    if (env >= ROLLOUTS) return;

KERNEL unroll_truths(const double* states, double* truths, long long count) {
    const long long i = (long long)blockIdx.x * blockDim.x + threadIdx.x;
    if (i < count) for (int k = 0; k < STATE; k++) truths[i * STATE + k] = states[i * STATE + k];
}

// On the truth.
KERNEL unroll_begin(WORLD, double* states, int through) {
    EACH MOTIONS(env)
    const double* from = truth(r, m, 0);
    for (int k = 0; k < STATE; k++) states[env * STATE + k] = from[k];
}

KERNEL unroll_look(WORLD, const double* states, int k, float* tokens) {
    EACH MOTIONS(env)
    token(r, m, k, states + ((long long)k * ROLLOUTS + env) * STATE, tokens + env * LDX);
}

KERNEL unroll_advance(WORLD, double* states, int k, const float* said) {
    EACH
    double* at = states + ((long long)k * ROLLOUTS + env) * STATE;
    advance(at, said + env * STATE, at + (long long)ROLLOUTS * STATE);
}

// The gradient of frame k's loss joined by the upstream ones of so many later frames; then the frame is seen once more.
KERNEL unroll_behind(WORLD, const double* states, int k, int later, double weight, double* behinds, double* losses, float* tokens, double*) {
    EACH MOTIONS(env)
    const double* at = states + ((long long)k * ROLLOUTS + env) * STATE;
    double slope[2 * NV], *behind = behinds + env * STATE;
    const double total = loss(at + (long long)ROLLOUTS * STATE, truth(r, m, k + 1), k + 1, weight, slope);
    losses[env] = (later ? losses[env] : 0) + total;
    if (later) join(behind, later, slope);
    for (int i = 0; i < 2 * NV; i++) behind[i] = slope[i];
    token(r, m, k, at, tokens + env * LDX);
}

KERNEL unroll_said(const double* states, int k, const float* said, const double* behinds, float* by_said) {
    EACH
    said_back(states + ((long long)k * ROLLOUTS + env) * STATE, said + env * STATE, behinds + env * STATE, by_said + env * STATE);
}

KERNEL unroll_back(WORLD, const double* states, int k, const float* said, const double*, const float* by_tokens, double* behinds) {
    EACH MOTIONS(env)
    double slope[2 * NV], *behind = behinds + env * STATE;
    frame_back(states + ((long long)k * ROLLOUTS + env) * STATE, scene(r, m), said + env * STATE, by_tokens + env * INPUTS, behind, slope);
    for (int i = 0; i < 2 * NV; i++) behind[i] = slope[i];
}
