// One frame of one environment. SUBSTEPS and CONTACT_SUBSTEPS are the solver's settings; WATCHED: no frame may give
// energy; HELD tells of a joint with dry friction or a spring, or of links that may touch each other.

// A floating root's velocity (w, v) about the world's origin to (w, p_dot), or back.
FN void about(const double* p, double* qd, double sign) {
    if (!DOFS) return;
    qd[3] += sign * (qd[1] * p[2] - qd[2] * p[1]);
    qd[4] += sign * (qd[2] * p[0] - qd[0] * p[2]);
    qd[5] += sign * (qd[0] * p[1] - qd[1] * p[0]);
}

FN void take(Tree& t, const double* state) {
    double qd[NV];
    for (int k = 0; k < NV; k++) qd[k] = state[NQ + k];
    about(state, qd, 1);
    for (int k = 0; k < NQ; k++) t.q[k] = state[k];
    for (int k = 0; k < NV; k++) t.qd[k] = (real)qd[k];
    t.centre = v3(0, 0, 0);
}

// Writes the tree's state, if it is one; 0 or GONE.
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

// One try of a frame from `state`, which the tree has been given, with `finer` times the substeps; 0, or why not.
template <class K>
BIG int attempt(Work& w, const double* state, const double* tau, const double* scene, double* forces, int finer, const K& keeper) {
    if (forces) for (int k = 0; k < 3 * NP; k++) forces[k] = 0;
    const bool touching = NP > 0 && NC > 0 && scene[3] != 0;
    w.eventful = false;
    w.even = finer > 1;
    w.work = w.effort = 0;
    if (HELD || DRIVEN || touching) return implicit(w, scene, forces, CONTACT_SUBSTEPS * finer, keeper);
    for (int k = DOFS; k < NV; k++) w.eventful = w.eventful || size(w.tree.qd[k]) * (real)(FRAME / (SUBSTEPS * finer)) > WHIRL_RK4;
    Explicit e;
    e.looked = false;
    e.soft = -1;
    for (int i = 0; i < NJ; i++) e.weight[i] = -1;
    const int more = DOFS ? turned(norm(read3(w.tree.qd)) * (real)(FRAME / (SUBSTEPS * finer)), K::most / (SUBSTEPS * finer)) : 1;
    const int done = runge_kutta(w, e, scene, tau, SUBSTEPS * finer * more, keeper);
    if (done != STIFF) return done;
    take(w.tree, state);
    return implicit(w, scene, forces, MOST_SUBSTEPS * finer, keeper);
}

// Times as many substeps that the frame from `state` to where the tree is, in so many of them, needs to give no energy.
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
    const double gain = after.lively - before.lively + (after.high - before.high) - work;
    const double lively = before.lively > after.lively ? before.lively : after.lively;
    double allowed = SHARE * lively + LABOUR * effort + FALL * fallen;
    int times = 1;
    for (; !(gain <= allowed) && times * substeps < finest; times *= 2) allowed *= 4;
    return times;
}

// Moves the tree from `state`, which it has been given; 0, or why not: 1 + the DoF at which the mass matrix is none, LOST. A frame that gives
// energy is stepped anew with more substeps.
template <class K>
BIG int moved(Work& w, const double* state, const double* tau, const double* scene, const double* drives, double* forces, const K& keeper) {
    bool eventful = false, terrain = false;
    ask(w, state, tau, scene, drives);
    for (int finer = 1;;) {
        const int done = attempt(w, state, tau, scene, forces, finer, keeper), substeps = MOST_SUBSTEPS * finer;
        for (int c = 0; FIELDS && c < w.surfaces; c++) terrain = terrain || w.surface[c].kind == 4;
        const int finest = terrain ? ROUGHEST : FINEST;
        if (!WATCHED || substeps >= (done ? FINEST : finest) || 2 * substeps > K::most) return done;
        eventful = eventful || w.eventful;
        int times = done ? 2 : eventful ? refine(w, state, scene, substeps, finest) : 1;
        while (times * substeps > K::most) times /= 2;
        if (times == 1) return 0;
        finer *= times;
        take(w.tree, state);
    }
}

static_assert(sizeof(Work) + sizeof(Explicit) < 500000, "the robot is too large for a thread of a GPU, which has 512 KiB; step it on the CPU");

// Advances `state`; 0, or why not.
BIG int frame(double* state, const double* tau, const double* scene, const double* drives, double* forces) {
    Work w;
    know(w.tree, scene);
    take(w.tree, state);
    int done = moved(w, state, tau, scene, drives, forces, Nobody());
    if (!done) done = give(w.tree, state);
    if (!done) wrap(state);
    return done;
}
