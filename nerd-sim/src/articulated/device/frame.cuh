// One frame of one environment. SUBSTEPS and CONTACT_SUBSTEPS are settings. WATCHED: no frame may gain energy. HELD: a
// joint has dry friction or a spring, or links may touch each other.

// Velocity of a floating root: (w, v) about the world's origin => (w, p_dot), or back (sign -1).
FN void about(const double* p, double* qd, double sign) {
    if (!DOFS) return;
    qd[3] += sign * (qd[1] * p[2] - qd[2] * p[1]);
    qd[4] += sign * (qd[2] * p[0] - qd[0] * p[2]);
    qd[5] += sign * (qd[0] * p[1] - qd[1] * p[0]);
}

// State => tree, in local velocities.
FN void take(Tree& t, const double* state) {
    double qd[NV];
    for (int k = 0; k < NV; k++) qd[k] = state[NQ + k];
    about(state, qd, 1);
    for (int k = 0; k < NQ; k++) t.q[k] = state[k];
    for (int k = 0; k < NV; k++) t.qd[k] = (real)qd[k];
    t.centre = v3(0, 0, 0);
}

// Tree => state, if finite. Returns 0 or GONE.
FN int give(const Tree& t, double* state) {
    double qd[NV];
    for (int k = 0; k < NV; k++) qd[k] = t.qd[k];
    about(t.q, qd, -1);
    for (int k = 0; k < NQ; k++) if (!(t.q[k] - t.q[k] == 0)) return GONE;
    for (int k = 0; k < NV; k++) if (!(qd[k] - qd[k] == 0)) return GONE;
    for (int k = 0; k < NQ; k++) state[k] = t.q[k];
    for (int k = 0; k < NV; k++) state[NQ + k] = qd[k];
    return 0;
}

FN void wrap(double* state) {
    for (int i = 0; i < NJ; i++)
        if (WRAPS[i]) state[COORDS + i] = wrapped(state[COORDS + i]);
}

constexpr int MOST_SUBSTEPS = SUBSTEPS > CONTACT_SUBSTEPS ? SUBSTEPS : CONTACT_SUBSTEPS;

// Tries a frame with `finer` times the substeps; the tree holds `state`. Returns 0 or a fault.
template <class K>
BIG int attempt(Work& w, const double* state, const double* tau, const double* scene, double* forces, int finer,
                const K& keeper) {
    if (forces) for (int k = 0; k < 3 * NP; k++) forces[k] = 0;
    const bool touching = NP > 0 && NC > 0 && scene[3] != 0;
    w.may_gain_energy = w.touched = w.creeps = false;
    w.work = w.effort = 0;
    if (HELD || DRIVEN || touching) return implicit(w, scene, forces, CONTACT_SUBSTEPS * finer, keeper);
    for (int k = DOFS; k < NV; k++)
        w.may_gain_energy = w.may_gain_energy
                            || size(w.tree.qd[k]) * (real)(FRAME / (SUBSTEPS * finer)) > FAST_TURN_RK4;
    Explicit e;
    e.looked = false;
    e.soft = -1;
    for (int i = 0; i < NJ; i++) e.weight[i] = -1;
    const int more =
        DOFS ? turned(norm(read3(w.tree.qd)) * (real)(FRAME / (SUBSTEPS * finer)), K::most / (SUBSTEPS * finer)) : 1;
    w.may_gain_energy = w.may_gain_energy || more > 1;
    const int done = runge_kutta(w, e, scene, tau, SUBSTEPS * finer * more, keeper);
    if (done != STIFF) return done;
    take(w.tree, state);
    return implicit(w, scene, forces, MOST_SUBSTEPS * finer, keeper);
}

// Factor (a power of two) on the substeps with which the frame from `state` to the tree's state gains no energy. Sets
// w.velocity_factor, the factor on velocities that removes the gain.
BIG int refine(Work& w, const double* state, const double* scene, int substeps, int finest) {
    Tree& t = w.tree;
    double q[NQ], work = w.work, effort = w.effort, mass = 0;
    real qd[NV];
    for (int k = 0; k < NQ; k++) q[k] = t.q[k];
    for (int k = 0; k < NV; k++) qd[k] = t.qd[k];
    const Energy after = energy(w, scene);
    take(t, state);
    const Energy before = energy(w, scene);
    for (int i = 0; i < NJ; i++) {
        const double done = w.tau[i] * (q[COORDS + i] - t.q[COORDS + i]);
        work += done;
        effort += done < 0 ? -done : done;
    }
    for (int k = 0; k < NQ; k++) t.q[k] = q[k];
    for (int k = 0; k < NV; k++) t.qd[k] = qd[k];
    for (int i = 0; i < NL; i++) mass += MASS(t)[i];
    const double fallen = 0.5 * mass * FRAME * FRAME * dot(w.gravity, w.gravity);
    // Kinetic and spring energy (J) at the frame's end without a gain.
    const double expected = before.kinetic_and_springs + work - (after.potential - before.potential),
                 gain = after.kinetic_and_springs - expected;
    const double scale = before.kinetic_and_springs > expected ? before.kinetic_and_springs : expected;
    double allowed = (NP > 0 && NC > 0 && scene[3] != 0 || FOLDS ? GAIN_TOLERANCE : GAIN_TOLERANCE_FREE) * scale
                     + WORK_TOLERANCE * effort + FALL_TOLERANCE * fallen;
    const double over = gain <= allowed ? 0 : gain - allowed;
    w.velocity_factor = over < after.kinetic && over < scale ? (real)sqrt(1 - over / after.kinetic) : over == 0;
    int times = 1;
    for (; !(gain <= allowed && gain - gain == 0) && times * substeps < finest; times *= 2) allowed *= 4;
    return times;
}

// Factor on the substeps of a frame in which a robot at rest creeps; 1 for any other frame.
FN int times_at_rest(const Work& w, int substeps) {
    bool rests = w.creeps && substeps < SUBSTEPS_AT_REST;
    for (int k = 0; k < NV; k++) rests = rests && (k >= 3 && k < DOFS || size(w.tree.qd[k]) < AT_REST);
    return rests ? (SUBSTEPS_AT_REST + substeps - 1) / substeps : 1;
}

// Steps the tree, which holds `state`, with more substeps while the frame gains energy. Returns 0, LOST, or 1 + the DoF
// where the mass matrix is not positive definite.
template <class K>
BIG int moved(Work& w, const double* state, const double* tau, const double* scene, const double* drives,
              double* forces, const K& keeper) {
    bool may_gain_energy = false, terrain = false;
    ask(w, state, tau, scene, drives);
    w.mean_theta = false;
    for (int finer = 1;;) {
        const int done = attempt(w, state, tau, scene, forces, finer, keeper), substeps = MOST_SUBSTEPS * finer;
        bool lost = done != 0;
        for (int k = 0; k < NV; k++) lost = lost || !(w.tree.qd[k] - w.tree.qd[k] == 0);
        // Distances jump between faces of a shape and between cells of a height field, so such a frame may gain energy.
        for (int c = 0; NP > 0 && scene[3] != 0 && c < w.surfaces; c++) {
            terrain = terrain || w.surface[c].kind == 4;
            may_gain_energy = may_gain_energy || w.surface[c].kind != 1;
        }
        const int finest = terrain && w.touched ? MAX_REFINED_TERRAIN : MAX_REFINED;
        w.velocity_factor = 1;
        if (!WATCHED || lost && substeps >= MAX_REFINED || 2 * substeps > K::most && substeps < finest) return done;
        may_gain_energy = may_gain_energy || w.may_gain_energy;
        int times = lost ? 2 : may_gain_energy ? refine(w, state, scene, substeps, finest) : 1;
        w.mean_theta = w.mean_theta || times > 1;
        if (times == 1) times = times_at_rest(w, CONTACT_SUBSTEPS * finer);
        while (times * substeps > K::most) times /= 2;
        if (times == 1) {
            // With a factor of 0 the frame ends at rest in its first pose.
            if (w.velocity_factor == 0) { take(w.tree, state); keeper.begin(true, 0); }
            for (int k = 0; k < NV; k++) w.tree.qd[k] *= w.velocity_factor;
            return done;
        }
        finer *= times;
        take(w.tree, state);
    }
}

static_assert(sizeof(Work) + sizeof(Explicit) < 500000,
              "the robot is too large for a thread of a GPU, which has 512 KiB; step it on the CPU");

// Steps `state` by one frame. Returns 0 or a fault.
BIG int frame(double* state, const double* tau, const double* scene, const double* drives, double* forces) {
    Work w;
    know(w.tree, scene);
    take(w.tree, state);
    int done = moved(w, state, tau, scene, drives, forces, Nobody());
    if (!done) done = give(w.tree, state);
    if (!done) wrap(state);
    return done;
}
