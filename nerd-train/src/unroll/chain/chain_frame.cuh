// Kernels of an update. States of the n chains are `[H + 1][n][CHAIN]` in an update of H frames; all other data of
// rollouts are `[n]`.

FN void load(const double* from, double* to, int n) { EACH(i, n) to[i] = from[i]; SYNC; }
FN void store(const double* from, double* to, int n) { SYNC; EACH(i, n) to[i] = from[i]; }

// Converts recorded states to chains, a thread each.
KERNEL unroll_truths(const double* states, double* truths, long long count) {
    const long long i = (long long)blockIdx.x * blockDim.x + threadIdx.x;
    if (i < count) rods(states + i * STATE, truths + i * CHAIN);
}

// Starts rollouts from the end of the last update, or from the truth.
KERNEL unroll_begin(WORLD, double* chains, int through) {
    __shared__ double chain[CHAIN];
    MOTIONS(blockIdx.x)
    const long long n = gridDim.x;
    if (r.anew != 0) truth(r, m, 0, chain);
    else load(chains + (through * n + blockIdx.x) * CHAIN, chain, CHAIN);
    store(chain, chains + blockIdx.x * CHAIN, CHAIN);
}

KERNEL unroll_look(WORLD, const double* chains, int k, float* tokens) {
    __shared__ double chain[CHAIN], glided[GRIPPER], ends[6 * RODS];
    MOTIONS(blockIdx.x)
    load(chains + ((long long)k * gridDim.x + blockIdx.x) * CHAIN, chain, CHAIN);
    led(r, m, k, chain, glided);
    look(r, m, chain, glided, ends, tokens + (long long)blockIdx.x * RODS * LDX, 0);
}

KERNEL unroll_advance(WORLD, double* chains, int k, const float* said) {
    __shared__ double chain[CHAIN], after[CHAIN], glided[GRIPPER];
    MOTIONS(blockIdx.x)
    double* at = chains + ((long long)k * gridDim.x + blockIdx.x) * CHAIN;
    load(at, chain, CHAIN);
    led(r, m, k, chain, glided);
    advance(chain, glided, said + (long long)blockIdx.x * RODS * OUTPUTS, after);
    store(after, at + (long long)gridDim.x * CHAIN, CHAIN);
}

// Adds the upstream gradient of `later` later frames to the gradient of frame k's loss. Then observes the state before
// the frame again.
KERNEL unroll_behind(WORLD, const double* chains, int k, int later, double weight, double* behinds, double* losses,
                     float* tokens, double* touches) {
    __shared__ double chain[CHAIN], other[CHAIN], gradient[CHAIN], ends[6 * RODS], true_ends[6 * RODS];
    MOTIONS(blockIdx.x)
    const double* at = chains + ((long long)k * gridDim.x + blockIdx.x) * CHAIN;
    double* behind = behinds + (long long)blockIdx.x * CHAIN;
    EACH(i, CHAIN) gradient[i] = 0;
    load(at + (long long)gridDim.x * CHAIN, chain, CHAIN);
    truth(r, m, k + 1, other);
    const double total = loss(chain, other, ends, true_ends, k + 1, weight, gradient);
    EACH(one, 1) losses[blockIdx.x] = (later ? losses[blockIdx.x] : 0) + total;
    if (later) {
        load(behind, other, CHAIN);
        join(other, later, gradient);
    }
    store(gradient, behind, CHAIN);
    load(at, chain, CHAIN);
    led(r, m, k, chain, other);
    look(r, m, chain, other, ends, tokens + (long long)blockIdx.x * RODS * LDX,
         touches + (long long)blockIdx.x * 4 * RODS);
}

KERNEL unroll_said(const double* chains, int k, const float* said, const double* behinds, float* by_said) {
    __shared__ double chain[CHAIN], behind[CHAIN];
    load(chains + ((long long)k * gridDim.x + blockIdx.x) * CHAIN, chain, CHAIN);
    load(behinds + (long long)blockIdx.x * CHAIN, behind, CHAIN);
    const long long row = (long long)blockIdx.x * RODS * OUTPUTS;
    said_back(chain, said + row, behind, by_said + row);
}

KERNEL unroll_back(WORLD, const double* chains, int k, const float* said, const double* touches, const float* by_tokens,
                   double* behinds) {
    __shared__ double chain[CHAIN], behind[CHAIN], gradient[CHAIN], ends[6 * RODS], glided[GRIPPER];
    MOTIONS(blockIdx.x)
    const long long env = blockIdx.x;
    load(chains + ((long long)k * gridDim.x + env) * CHAIN, chain, CHAIN);
    load(behinds + env * CHAIN, behind, CHAIN);
    led(r, m, k, chain, glided);
    nodes(chain, ends);
    frame_back(chain, glided, said + env * RODS * OUTPUTS, touches + env * 4 * RODS, by_tokens + env * RODS * INPUTS,
               behind, ends, gradient);
    store(gradient, behinds + env * CHAIN, CHAIN);
}

KERNEL unroll_end(WORLD, const double* chains, int through, int* nears) {
    __shared__ double chain[CHAIN], wanted[CHAIN], ends[6 * RODS], true_ends[6 * RODS];
    const Motions m = {truths, torques, scenes, frames};
    load(chains + ((long long)through * gridDim.x + blockIdx.x) * CHAIN, chain, CHAIN);
    truth(rollouts[blockIdx.x], m, through, wanted);
    const int so = near(chain, wanted, ends, true_ends);
    EACH(one, 1) nears[blockIdx.x] = so;
}
