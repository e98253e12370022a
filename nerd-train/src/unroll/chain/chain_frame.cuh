// Kernels of an update: chains are `[H + 1][n][CHAIN]`, all else of a rollout `[n]`.

#ifdef __CUDACC_RTC__
FN void load(const double* from, double* to, int n) { EACH(i, n) to[i] = from[i]; SYNC; }
FN void store(const double* from, double* to, int n) { SYNC; EACH(i, n) to[i] = from[i]; }

// Recorded states as chains, a thread each.
KERNEL unroll_truths(const double* states, double* truths, long long count) {
    const long long i = (long long)blockIdx.x * blockDim.x + threadIdx.x;
    if (i < count) rods(states + i * STATE, truths + i * CHAIN);
}

// Where the last update ended, or on the truth.
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

// The gradient of frame k's loss joined by the upstream ones of so many later frames; then the frame is evaluated once more.
KERNEL unroll_behind(WORLD, const double* chains, int k, int later, double weight, double* behinds, double* losses, float* tokens, double* touches) {
    __shared__ double chain[CHAIN], other[CHAIN], slope[CHAIN], ends[6 * RODS], true_ends[6 * RODS];
    MOTIONS(blockIdx.x)
    const double* at = chains + ((long long)k * gridDim.x + blockIdx.x) * CHAIN;
    double* behind = behinds + (long long)blockIdx.x * CHAIN;
    EACH(i, CHAIN) slope[i] = 0;
    load(at + (long long)gridDim.x * CHAIN, chain, CHAIN);
    truth(r, m, k + 1, other);
    const double total = loss(chain, other, ends, true_ends, k + 1, weight, slope);
    EACH(one, 1) losses[blockIdx.x] = (later ? losses[blockIdx.x] : 0) + total;
    if (later) {
        load(behind, other, CHAIN);
        join(other, later, slope);
    }
    store(slope, behind, CHAIN);
    load(at, chain, CHAIN);
    led(r, m, k, chain, other);
    look(r, m, chain, other, ends, tokens + (long long)blockIdx.x * RODS * LDX, touches + (long long)blockIdx.x * 4 * RODS);
}

KERNEL unroll_said(const double* chains, int k, const float* said, const double* behinds, float* by_said) {
    __shared__ double chain[CHAIN], behind[CHAIN];
    load(chains + ((long long)k * gridDim.x + blockIdx.x) * CHAIN, chain, CHAIN);
    load(behinds + (long long)blockIdx.x * CHAIN, behind, CHAIN);
    const long long row = (long long)blockIdx.x * RODS * OUTPUTS;
    said_back(chain, said + row, behind, by_said + row);
}

KERNEL unroll_back(WORLD, const double* chains, int k, const float* said, const double* touches, const float* by_tokens, double* behinds) {
    __shared__ double chain[CHAIN], behind[CHAIN], slope[CHAIN], ends[6 * RODS], glided[GRIPPER];
    MOTIONS(blockIdx.x)
    const long long env = blockIdx.x;
    load(chains + ((long long)k * gridDim.x + env) * CHAIN, chain, CHAIN);
    load(behinds + env * CHAIN, behind, CHAIN);
    led(r, m, k, chain, glided);
    nodes(chain, ends);
    frame_back(chain, glided, said + env * RODS * OUTPUTS, touches + env * 4 * RODS, by_tokens + env * RODS * INPUTS, behind, ends, slope);
    store(slope, behinds + env * CHAIN, CHAIN);
}

KERNEL unroll_end(WORLD, const double* chains, int through, int* nears) {
    __shared__ double chain[CHAIN], wanted[CHAIN], ends[6 * RODS], true_ends[6 * RODS];
    const Motions m = {truths, torques, scenes, frames};
    load(chains + ((long long)through * gridDim.x + blockIdx.x) * CHAIN, chain, CHAIN);
    truth(rollouts[blockIdx.x], m, through, wanted);
    const int so = near(chain, wanted, ends, true_ends);
    EACH(one, 1) nears[blockIdx.x] = so;
}
#else
// From standard input n rollouts, motions and their frames, and which frame it is; rollouts, recorded states, torques, scenes; outputs,
// and gradients by tokens and by later chains. To standard output chains before and after, tokens, by rollout the loss and whether it is near;
// gradients of the loss joined by the upstream ones, by outputs, and by chains before.
int main() {
    const auto head = read_all<int>(4);
    const int n = head[0], motions = head[1], frames = head[2], k = head[3];
    const auto rollouts = read_all<double>(7 * n), states = read_all<double>((long long)motions * (frames + 1) * STATE);
    const auto torques = read_all<double>((long long)motions * frames * 6), scenes = read_all<double>(motions * SCENE);
    const auto said = read_all<float>(n * RODS * OUTPUTS), by_tokens = read_all<float>(n * RODS * INPUTS);
    const auto behinds = read_all<double>(n * CHAIN);
    std::vector<double> slopes(n * CHAIN), truths(motions * (frames + 1) * CHAIN), before(n * CHAIN), after(n * CHAIN), wanted(CHAIN), out(2 * n);
    std::vector<double> fronts(n * CHAIN), glided(GRIPPER), ends(6 * RODS), others(6 * RODS), touches(4 * RODS);
    std::vector<float> tokens(n * RODS * LDX), by_said(n * RODS * OUTPUTS);
    for (int i = 0; i < motions * (frames + 1); i++) rods(states.data() + i * STATE, truths.data() + i * CHAIN);
    const Motions m = {truths.data(), torques.data(), scenes.data(), frames};
    for (int i = 0; i < n; i++) {
        const Rollout r = *(const Rollout*)(rollouts.data() + 7 * i);
        double *chain = before.data() + i * CHAIN, *next = after.data() + i * CHAIN, *slope = slopes.data() + i * CHAIN;
        const float* numbers = said.data() + i * RODS * OUTPUTS;
        truth(r, m, k, chain);
        led(r, m, k, chain, glided.data());
        look(r, m, chain, glided.data(), ends.data(), tokens.data() + i * RODS * LDX, touches.data());
        advance(chain, glided.data(), numbers, next);
        truth(r, m, k + 1, wanted.data());
        out[2 * i] = loss(next, wanted.data(), ends.data(), others.data(), k + 1, 0.7, slope);
        join(behinds.data() + i * CHAIN, 1 + i, slope);
        out[2 * i + 1] = near(next, wanted.data(), ends.data(), others.data());
        said_back(chain, numbers, slope, by_said.data() + i * RODS * OUTPUTS);
        nodes(chain, ends.data());
        const float* row = by_tokens.data() + i * RODS * INPUTS;
        frame_back(chain, glided.data(), numbers, touches.data(), row, slope, ends.data(), fronts.data() + i * CHAIN);
    }
    write_all(before), write_all(after), write_all(tokens), write_all(out), write_all(slopes), write_all(by_said), write_all(fronts);
}
#endif
