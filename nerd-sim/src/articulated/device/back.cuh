// The way back over a frame, as articulated/slopes, where it is explained: the frame is stepped with what its substeps began with and found kept, and
// from the last to the first each is gone back over.

// Keeps them.
struct Keeper {
    Back& b;
    static constexpr int most = STEPS;
    void begin(bool ahead, int steps) const {
        b.ahead = ahead;
        b.steps = steps;
        for (int k = 0; k < WEIGHTS; k++) b.since[k] = -1;
    }
    void begins(const Work& w, int number) const {
        Kept& kept = b.kept[number];
        for (int k = 0; k < NQ; k++) kept.q[k] = w.tree.q[k];
        for (int k = 0; k < NV; k++) kept.qd[k] = w.tree.qd[k];
    }
    void ends(const Work& w, int number, real h) const {
        Kept& kept = b.kept[number];
        for (int k = 0; k < NV; k++) kept.rate[k] = w.rate[k];
        for (int k = 0; k < IDLE; k++) kept.idle[k] = 0;
        for (int n = 0; n < w.touches + DRIVES; n++) {
            const int index = n < w.touches ? w.touch[n].index : DRIVEN_AT + n - w.touches;
            if (b.since[index] < 0) b.since[index] = number;
            kept.idle[n / 32] |= (unsigned)idle(w, n) << n % 32;
        }
        if (number) return;
        b.twice = w.twice;
        b.once = w.once;
        for (int k = 0; k < NV; k++) b.guess[k] = w.twice ? w.guess[k] : 0;
        for (int k = 0; k < IDLE; k++) b.early[k] = 0;
        for (int n = 0; DRIVEN && w.twice && n < w.touches + DRIVES; n++) b.early[n / 32] |= (unsigned)w.early[n] << n % 32;
    }
};

// Back over an implicit substep, of which what was solved is found again but for its rates; 0, or a fault.
BIG int substep_back(Work& w, Back& b, int number, const double* scene, real h) {
    Tree& t = w.tree;
    const Kept& kept = b.kept[number];
    for (int k = 0; k < NQ; k++) t.q[k] = kept.q[k];
    for (int k = 0; k < NV; k++) t.qd[k] = kept.qd[k];
    kinematics(t);
    see(w, scene);
    if (!find(w, h) || !weigh(w, h)) return LOST;
    crba(t);
    share(w, h);
    real end[NV];
    for (int k = 0; k < NV; k++) end[k] = kept.qd[k] + h * kept.rate[k];
    drift_back(b, end, (real)0.5 * h);
    for (int k = 0; k < NV; k++) b.rate[k] += h * b.speed[k];
    unload(b.loads);
    unload(b.starts);
    b.way = v3(0, 0, 0);
    twists(t, kept.qd, b.start);
    const real* before = number ? b.kept[number - 1].rate : b.guess;
    const bool spinning = spins(kept.qd, h);
    for (int k = 0; k < NV; k++) w.middle[k] = kept.qd[k] + (real)0.5 * h * (spinning && k < 3 ? kept.rate[k] : before[k]);
    if (spinning) spun_back(w, b, kept, h);
    else stage_back(w, b, kept, kept.rate, kept.idle, h, false);
    if (number == 0 && b.twice) {
        // The first solve of a frame knew no rate, and gave that of the next one's middle.
        for (int k = 0; k < NV; k++) w.middle[k] = kept.qd[k];
        stage_back(w, b, kept, b.guess, b.early, h, b.once);
    }
    weights_back(w, b, number, h);
    twists_back(t, kept.qd, b.starts, b.loads, b.speed);
    // Of a root's load the moment alone is a slope of what it carries; its way changes gaps.
    const V3 way = DOFS ? read3(b.pose + 3) + b.way : v3(0, 0, 0);
    gather(t, b.loads, b.pose);
    if (DOFS) write3(b.pose + 3, way);
    drift_back(b, kept.qd, (real)0.5 * h);
    return 0;
}

static_assert(sizeof(Work) + sizeof(Explicit) + sizeof(Back) < 500000, "the robot is too large for a thread of a GPU, which has 512 KiB; go back over its frames on the CPU");

// Steps to `next` and goes back from a gradient by it; 0, or why not.
BIG int frame_back(const double* state, const double* tau, const double* scene, const double* drives, const double* by_next, double* next,
                   double* by_state, double* by_tau) {
    Work w;
    Back b;
    know(w.tree, scene);
    take(w.tree, state);
    int fault = moved(w, state, tau, scene, drives, 0, Keeper{b});
    if (!fault) fault = give(w.tree, next);
    if (fault) return fault;
    wrap(next);
    begin(b, next, by_next);
    const real h = (real)(FRAME / b.steps);
    const bool ahead = HELD || DRIVEN || b.ahead;
    if (ahead) centre_back(w.tree, b, next, -1);
    w.tree.centre = CENTRED && ahead ? read3(COM(w.tree)) : v3(0, 0, 0);
    for (int number = b.steps - 1; number >= 0; number--) {
        const int fault = ahead ? substep_back(w, b, number, scene, h) : flight_back(w, b, b.kept[number], tau, h);
        if (fault) return fault;
    }
    if (ahead) centre_back(w.tree, b, state, 1);
    end(b, state, by_state);
    for (int i = 0; i < NJ; i++) by_tau[i] = b.torque[i];
#if SERVO
    servos_back(scene, b.drives, by_state, by_tau);
#endif
    return 0;
}

// `rows` gradients of each environment, a thread each: zeros where its frame is a fault. The first of them writes the state after the frame and the
// fault, if they have a place.
extern "C" __global__ void slopes(const double* states, const double* torques, const double* scenes, const int* scene_of, const double* drives,
                                  const double* by_next, double* nexts, double* by_states, double* by_torques, int* faults, int n, int rows) {
    const int env = blockIdx.x * blockDim.x + threadIdx.x;
    if (env >= n) return;
    const long long at = (long long)env * rows + blockIdx.y;
    double next[NQ + NV], *by_state = by_states + at * 2 * NV, *by_tau = by_torques + at * NJ;
    const int fault = frame_back(states + (long long)env * (NQ + NV), torques + (long long)env * NJ, scenes + (long long)scene_of[env] * SCENE,
                                 drives + (long long)env * 5 * DRIVES, by_next + at * 2 * NV, next, by_state, by_tau);
    for (int k = 0; k < 2 * NV && fault; k++) by_state[k] = 0;
    for (int k = 0; k < NJ && fault; k++) by_tau[k] = 0;
    if (blockIdx.y || !nexts) return;
    faults[env] = fault;
    for (int k = 0; k < NQ + NV && !fault; k++) nexts[(long long)env * (NQ + NV) + k] = next[k];
}
