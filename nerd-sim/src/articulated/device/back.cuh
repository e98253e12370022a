// Gradients of a frame, as articulated/gradients: steps the frame and records start and result of each substep. Then
// runs the adjoint from the last substep to the first.

// Records the substeps of a frame.
struct Keeper {
    Back& b;
    static constexpr int most = STEPS;
    void begin(bool implicit, int steps) const {
        b.implicit = implicit;
        b.steps = steps;
        for (int k = 0; k < WEIGHTS; k++) b.since[k] = -1;
        for (int k = 0; k < PAIRS; k++) b.held[k] = v3(0, 0, 0);
#if TURNS
        for (int k = 0; k < PAIRS; k++) b.held_torque[k] = v3(0, 0, 0);
#endif
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
        for (int n = 0; n < w.points && n < HOLDS; n++) kept.held[n] = w.touch[n].slip_offset;
#if TURNS
        for (int n = 0; n < w.points && n < HOLDS; n++) kept.turn_offset[n] = w.touch[n].turn_offset;
#endif
        if (number) return;
        b.twice = w.twice;
        b.once = w.once;
        for (int k = 0; k < NV; k++) b.guess[k] = w.twice ? w.guess[k] : 0;
        for (int k = 0; k < IDLE; k++) b.early[k] = 0;
        for (int n = 0; DRIVEN && w.twice && n < w.touches + DRIVES; n++)
            b.early[n / 32] |= (unsigned)w.early[n] << n % 32;
    }
};

// Adjoint of an implicit substep: contacts and weights w are computed again, rates come from the record. Returns 0 or a
// fault.
BIG int substep_back(Work& w, Back& b, int number, const double* scene, real h) {
    Tree& t = w.tree;
    const Kept& kept = b.kept[number];
    for (int k = 0; k < NQ; k++) t.q[k] = kept.q[k];
    for (int k = 0; k < NV; k++) t.qd[k] = kept.qd[k];
    kinematics(t);
    see(w, scene);
    if (!find(w, h)) return LOST;
    const auto held = [&](int n) { return n < HOLDS ? kept.held[n] : v3(0, 0, 0); };
    for (int n = 0; n < w.points; n++) {
        const int index = w.touch[n].index;
        const real stick = STICK_DRAG / (h * most(w.slide[index], MIN_INV_MASS));
        w.force_before[index] = number ? held(n) * stick : v3(0, 0, 0);
#if TURNS
        const real turn_stick = TURN_STICK_DRAG * stick * w.touch[n].gyration;
        w.torque_before[index] = number && n < HOLDS ? kept.turn_offset[n] * turn_stick : v3(0, 0, 0);
#endif
    }
    if (!set_thetas(w, h)) return LOST;
    for (int n = 0; n < w.points; n++) w.touch[n].slip_offset = held(n);
#if TURNS
    for (int n = 0; n < w.points; n++) w.touch[n].turn_offset = n < HOLDS ? kept.turn_offset[n] : v3(0, 0, 0);
#endif
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
    for (int k = 0; k < NV; k++)
        w.middle[k] = kept.qd[k] + (real)0.5 * h * (spinning && k < 3 ? kept.rate[k] : before[k]);
    // Passes the gradient of a held force to the stage before, unless its point has a contact in this substep.
    const auto begin_holds = [&]() {
        for (int k = 0; k < PAIRS; k++) b.holds[k] = b.held[k];
        for (int n = 0; n < w.points; n++) b.holds[w.touch[n].index] = v3(0, 0, 0);
#if TURNS
        for (int k = 0; k < PAIRS; k++) b.holds_torque[k] = b.held_torque[k];
        for (int n = 0; n < w.points; n++) b.holds_torque[w.touch[n].index] = v3(0, 0, 0);
#endif
    };
    const auto end_holds = [&]() {
        for (int k = 0; k < PAIRS; k++) b.held[k] = b.holds[k];
#if TURNS
        for (int k = 0; k < PAIRS; k++) b.held_torque[k] = b.holds_torque[k];
#endif
    };
    const bool again = number == 0 && b.twice;
    begin_holds();
    if (spinning) spun_back(w, b, kept, h, again);
    else stage_adjoint(w, b, kept, kept.rate, kept.idle, h, false, again);
    end_holds();
    if (number == 0 && b.twice) {
        // The first stage starts at rate 0; its rate gives the middle of the second.
        for (int k = 0; k < NV; k++) w.middle[k] = kept.qd[k];
        for (int n = 0; n < w.points; n++) w.touch[n].slip_offset = v3(0, 0, 0);
#if TURNS
        for (int n = 0; n < w.points; n++) w.touch[n].turn_offset = v3(0, 0, 0);
#endif
        begin_holds();
        stage_adjoint(w, b, kept, b.guess, b.early, h, b.once, false);
        end_holds();
    }
    inv_mass_adjoint(w, b, number, h);
    twists_back(t, kept.qd, b.starts, b.loads, b.speed);
    // `gather` adds the root's load to b.pose. Only the load's moment belongs there: moving the root changes only
    // contact gaps, and b.way is the gradient through these.
    const V3 way = DOFS ? read3(b.pose + 3) + b.way : v3(0, 0, 0);
    gather(t, b.loads, b.pose);
    if (DOFS) write3(b.pose + 3, way);
    drift_back(b, kept.qd, (real)0.5 * h);
    return 0;
}

static_assert(sizeof(Work) + sizeof(Explicit) + sizeof(Back) < 500000,
              "the robot is too large for a thread of a GPU, which has 512 KiB; go back over its frames on the CPU");

// Steps a frame and applies its adjoint: grad_next => next, by_state, by_tau. Returns 0 or a fault.
BIG int frame_back(const double* state, const double* tau, const double* scene, const double* drives,
                   const double* grad_next, double* next, double* by_state, double* by_tau) {
    Work w;
    Back b;
    know(w.tree, scene);
    take(w.tree, state);
    int fault = moved(w, state, tau, scene, drives, 0, Keeper{b});
    if (!fault) fault = give(w.tree, next);
    if (fault) return fault;
    wrap(next);
    begin(b, next, grad_next);
    // The factor on velocities that removes gained energy counts as constant.
    for (int k = 0; k < NV; k++) b.speed[k] *= w.velocity_factor;
    const real h = (real)(FRAME / b.steps);
    const bool implicit = HELD || DRIVEN || b.implicit;
    if (implicit) centre_back(w.tree, b, next, -1);
    w.tree.centre = CENTRED && implicit ? read3(COM(w.tree)) : v3(0, 0, 0);
    for (int number = b.steps - 1; number >= 0; number--) {
        const int fault = implicit ? substep_back(w, b, number, scene, h) : flight_back(w, b, b.kept[number], tau, h);
        if (fault) return fault;
    }
    if (implicit) centre_back(w.tree, b, state, 1);
    end(b, state, by_state);
    for (int i = 0; i < NJ; i++) by_tau[i] = b.torque[i];
#if SERVO
    servos_back(scene, b.drives, by_state, by_tau);
#endif
    return 0;
}

// Vector-Jacobian products of `rows` gradients of each environment, one thread each; zeros where its frame fails. The
// thread of row 0 writes next state and fault, unless `nexts` is null.
extern "C" __global__ void gradients(const double* states, const double* torques, const double* scenes,
                                     const int* scene_of, const double* drives, const double* grad_next, double* nexts,
                                     double* by_states, double* by_torques, int* faults, int n, int rows) {
    const int env = blockIdx.x * blockDim.x + threadIdx.x;
    if (env >= n) return;
    const long long at = (long long)env * rows + blockIdx.y;
    double next[NQ + NV], *by_state = by_states + at * 2 * NV, *by_tau = by_torques + at * NJ;
    const int fault = frame_back(states + (long long)env * (NQ + NV), torques + (long long)env * NJ,
                                 scenes + (long long)scene_of[env] * SCENE, drives + (long long)env * 5 * DRIVES,
                                 grad_next + at * 2 * NV, next, by_state, by_tau);
    for (int k = 0; k < 2 * NV && fault; k++) by_state[k] = 0;
    for (int k = 0; k < NJ && fault; k++) by_tau[k] = 0;
    if (blockIdx.y || !nexts) return;
    faults[env] = fault;
    for (int k = 0; k < NQ + NV && !fault; k++) nexts[(long long)env * (NQ + NV) + k] = next[k];
}
