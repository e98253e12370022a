// One frame of one environment. SUBSTEPS, CONTACT_SUBSTEPS, RK4, IMPLICIT, RENEW, HUBER are the solver's settings; HELD tells of a
// joint with dry friction or a spring, or of links that may touch each other.

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

// Moves the tree from `state`, which it has been given; 0, or why not: 1 + the DoF at which the mass matrix is none, LOST.
BIG int moved(Work& w, const double* state, const double* tau, const double* scene, const double* drives, double* forces) {
    if (forces) for (int k = 0; k < 3 * NP; k++) forces[k] = 0;
    const bool touching = NP > 0 && (FACED || (NC > 0 && scene[3] != 0));
    if (HELD || DRIVEN || (touching && IMPLICIT)) return implicit(w, scene, tau, drives, forces, CONTACT_SUBSTEPS);
    Explicit e;
    e.looked = false;
    e.soft = -1;
    for (int i = 0; i < NJ; i++) e.weight[i] = -1;
    const int done = !touching && RK4 ? runge_kutta(w, e, scene, tau, SUBSTEPS)
                                      : euler(w, e, scene, tau, forces, touching, touching ? CONTACT_SUBSTEPS : SUBSTEPS);
    if (done != STIFF) return done;
    take(w.tree, state);
    if (forces) for (int k = 0; k < 3 * NP; k++) forces[k] = 0;
    return implicit(w, scene, tau, drives, forces, SUBSTEPS > CONTACT_SUBSTEPS ? SUBSTEPS : CONTACT_SUBSTEPS);
}

static_assert(sizeof(Work) + sizeof(Explicit) < 500000, "the robot is too large for a thread of a GPU, which has 512 KiB; step it on the CPU");

// Advances `state`; 0, or why not.
BIG int frame(double* state, const double* tau, const double* scene, const double* drives, double* forces) {
    Work w;
    take(w.tree, state);
    int done = moved(w, state, tau, scene, drives, forces);
    if (!done) done = give(w.tree, state);
    if (!done) wrap(state);
    return done;
}
