// Runge-Kutta substeps without contact, as articulated/explicit.rs. Tests find joints too stiff for such substeps, as
// articulated/stiff.rs, which explains the bounds. LEAST: least inertia of each joint (kg m^2 or kg); DAMPED: sum of 2
// d / LEAST (1/s) for joint dampings d.

constexpr int STIFF = -2;               // not a fault: the frame needs implicit substeps

struct Acting { int joint; real s; };

struct Explicit {
    bool looked;
    int soft;                           // whether all limits together are soft enough; -1: not tested
    real weight[NJ + 1];                // w of joints; negative: unknown
    real vector[NJ + 1], column[NV];
    Acting acting[NJ + 1], others[NJ + 1];
    double start[NQ];
    real speed[NV];
    double rates[4][NQ + NV];
};

FN real stiffness(int i, real h) { return h * (2 * LIMIT[4 * i + 3] + h * LIMIT[4 * i + 2]); }

// Spectral radius of S^1/2 M^-1 S^1/2 over n joints, by power iteration.
BIG real radius(const Tree& t, Explicit& e, const Acting* joints, int n) {
    for (int k = 0; k < n; k++) {
        const real x = (real)0.618034 * k;
        e.vector[k] = (real)0.1 + (x - (int)x);
    }
    real length = 0;
    for (int power = 0; power < POWER_STEPS; power++) {
        length = 0;
        for (int k = 0; k < n; k++) length += e.vector[k] * e.vector[k];
        length = sqrt(length);
        for (int k = 0; k < NV; k++) e.column[k] = 0;
        for (int k = 0; k < n; k++) e.column[DOFS + joints[k].joint] = sqrt(joints[k].s) * e.vector[k] / length;
        solve(t, e.column);
        length = 0;
        for (int k = 0; k < n; k++) {
            e.vector[k] = sqrt(joints[k].s) * e.column[DOFS + joints[k].joint];
            length += e.vector[k] * e.vector[k];
        }
        length = sqrt(length);
    }
    return length;
}

// Whether joint dampers are too stiff for a substep h; tested once a frame.
BIG bool dampers(const Tree& t, Explicit& e, real h) {
    if (e.looked || h * DAMPED(t)[0] <= MAX_RADIUS) return false;
    e.looked = true;
    int n = 0;
    for (int i = 0; i < NJ; i++)
        if (DAMPING(t)[i] > 0) { e.others[n].joint = i; e.others[n++].s = 2 * h * DAMPING(t)[i]; }
    return radius(t, e, e.others, n) > MAX_RADIUS;
}

// Whether the n active limits are too stiff for a substep h; cheap bounds first.
BIG bool limits(const Tree& t, Explicit& e, int n, real h, real bound) {
    if (!n) return false;
    real sum = 0;
    for (int k = 0; k < n; k++) sum += e.acting[k].s / LEAST(t)[e.acting[k].joint];
    if (e.soft == 1 || sum <= bound) return false;
    real trace = 0;
    for (int k = 0; k < n; k++) {
        const int i = e.acting[k].joint;
        if (e.weight[i] < 0) {
            for (int c = 0; c < NV; c++) e.column[c] = 0;
            e.column[DOFS + i] = 1;
            solve(t, e.column);
            e.weight[i] = e.column[DOFS + i];
        }
        trace += e.acting[k].s * e.weight[i];
    }
    if (trace <= bound) return false;
    if (e.soft < 0) {
        int all = 0;
        for (int i = 0; i < NJ; i++)
            if (LIMITED[i]) { e.others[all].joint = i; e.others[all++].s = stiffness(i, h); }
        e.soft = radius(t, e, e.others, all) <= bound;
    }
    return !e.soft && radius(t, e, e.acting, n) > bound;
}

// Forward dynamics, w.qdd = M^-1 (tau + limits - damping - bias). Returns 0, a fault or STIFF.
BIG int accelerate(Work& w, Explicit& e, const double* tau, real h, real bound) {
    Tree& t = w.tree;
    crba(t);
    if (!refill(t)) return 1 + t.lost;
    if (dampers(t, e, h)) return STIFF;
    bias(t, t.qd, w.gravity, 0);
    for (int k = 0; k < NV; k++) w.qdd[k] = -t.tau[k];
    int n = 0;
    for (int i = 0; i < NJ; i++) {
        const real* l = LIMIT + 4 * i;
        const real x = (real)t.q[COORDS + i], v = t.qd[DOFS + i];
        const real end = LIMITED[i] ? most(l[0], least(l[1], x)) : x;
        const real force = end == x ? 0 : l[2] * (end - x) - l[3] * v;
        if (force != 0) { e.acting[n].joint = i; e.acting[n++].s = stiffness(i, h); }
        w.qdd[DOFS + i] += (real)tau[i] + force - DAMPING(t)[i] * v;
    }
    if (limits(t, e, n, h, bound)) return STIFF;
    solve(t, w.qdd);
    return 0;
}

// Sets the tree to a stage's state, from (q, qd) at the substep's start and the rate of the stage before.
FN void stand(Tree& t, const Explicit& e, int stage, const double* q, const double* qd, real h) {
    const double at = stage == 0 ? 0 : stage == 3 ? h : 0.5 * h;
    const double* rate = e.rates[stage ? stage - 1 : 0];
    for (int k = 0; k < NQ; k++) t.q[k] = stage ? q[k] + at * rate[k] : q[k];
    for (int k = 0; k < NV; k++) t.qd[k] = (real)(stage ? qd[k] + at * rate[NQ + k] : qd[k]);
}

// Rates of the four stages => e.rates; the tree ends at the last stage. Returns 0, a fault or STIFF.
BIG int stages(Work& w, Explicit& e, const double* tau, const double* q, const double* qd, real h, real bound) {
    Tree& t = w.tree;
    for (int stage = 0; stage < 4; stage++) {
        stand(t, e, stage, q, qd, h);
        kinematics(t);
        const int state = accelerate(w, e, tau, h, bound);
        if (state) return state;
        double* r = e.rates[stage];
        for (int i = 0; i < NJ; i++) r[COORDS + i] = t.qd[DOFS + i];
        for (int k = 0; k < NV; k++) r[NQ + k] = w.qdd[k];
        if (!DOFS) continue;
        const V3 a = v3(t.qd[0], t.qd[1], t.qd[2]), v = v3(t.qd[3], t.qd[4], t.qd[5]), c = cross(a, v);
        r[0] = v.x; r[1] = v.y; r[2] = v.z;
        // (w, 0) Q / 2, with Q not normalised.
        const double x = t.q[3], y = t.q[4], z = t.q[5], s = t.q[6];
        r[3] = 0.5 * (a.x * s + a.y * z - a.z * y);
        r[4] = 0.5 * (-a.x * z + a.y * s + a.z * x);
        r[5] = 0.5 * (a.x * y - a.y * x + a.z * s);
        r[6] = 0.5 * (-a.x * x - a.y * y - a.z * z);
        r[NQ + 3] += c.x; r[NQ + 4] += c.y; r[NQ + 5] += c.z;
    }
    return 0;
}

// Change of number k of the state over a substep.
FN double grown(const Explicit& e, int k, real h) {
    return h / 6.0 * (e.rates[0][k] + 2 * e.rates[1][k] + 2 * e.rates[2][k] + e.rates[3][k]);
}

template <class K>
BIG int runge_kutta(Work& w, Explicit& e, const double* scene, const double* tau, int substeps, const K& keeper) {
    Tree& t = w.tree;
    const real h = (real)(FRAME / substeps);
    keeper.begin(false, substeps);
    see(w, scene);
    for (int substep = 0; substep < substeps; substep++) {
        keeper.begins(w, substep);
        double q[NQ], qd[NV];
        for (int k = 0; k < NQ; k++) q[k] = t.q[k];
        for (int k = 0; k < NV; k++) qd[k] = t.qd[k];
        const int state = stages(w, e, tau, q, qd, h, MAX_RADIUS_RK4);
        if (state) return state;
        for (int k = 0; k < NQ; k++) t.q[k] = q[k] + grown(e, k, h);
        for (int k = 0; k < NV; k++) t.qd[k] = (real)(qd[k] + grown(e, NQ + k, h));
        if (DOFS) {
            double n = sqrt(t.q[3] * t.q[3] + t.q[4] * t.q[4] + t.q[5] * t.q[5] + t.q[6] * t.q[6]);
            for (int k = 3; k < 7; k++) t.q[k] /= n;
        }
    }
    return 0;
}
