// Explicit substeps: symplectic Euler, and Runge-Kutta where there is nothing to touch, as articulated/explicit.rs; and what is too
// stiff for them, as articulated/stiff.rs, where the bounds are explained. EASE of points, LEAST of joints, DAMPED of the robot.

constexpr int STIFF = -2;               // not a fault: the frame wants the implicit step

struct Acting { int joint; real s; };

struct Explicit {
    bool looked;
    int soft;                           // of all limits together: -1 not looked at, 0 no, 1 yes
    real weight[NJ + 1];                // negative: not yet
    Wrench external[NL];
    real vector[NJ + 1], column[NV];
    Acting acting[NJ + 1], others[NJ + 1];
    double start[NQ];
    real speed[NV];
    double rates[4][NQ + NV];
};

FN real stiffness(int i, real h) { return h * (2 * LIMIT[4 * i + 3] + h * LIMIT[4 * i + 2]); }

// Spectral radius of S^1/2 M^-1 S^1/2 of some joints, by power iteration.
BIG real radius(const Tree& t, Explicit& e, const Acting* joints, int n) {
    for (int k = 0; k < n; k++) {
        const real x = (real)0.618034 * k;
        e.vector[k] = (real)0.1 + (x - (int)x);
    }
    real length = 0;
    for (int power = 0; power < POWERS; power++) {
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

// Whether dampers are too stiff for a substep; looked at once a frame.
BIG bool dampers(const Tree& t, Explicit& e, real h) {
    if (e.looked || h * DAMPED(t)[0] <= MOST_EULER) return false;
    e.looked = true;
    int n = 0;
    for (int i = 0; i < NJ; i++)
        if (DAMPING(t)[i] > 0) { e.others[n].joint = i; e.others[n++].s = 2 * h * DAMPING(t)[i]; }
    return radius(t, e, e.others, n) > MOST_EULER;
}

// Whether the limits that act are.
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

// w.qdd = M^-1 (tau + limits - damping - bias). 0, a fault, or STIFF.
BIG int accelerate(Work& w, Explicit& e, const double* tau, bool renew, bool touching, real h, real bound) {
    Tree& t = w.tree;
    if (renew) {
        crba(t);
        if (!refill(t)) return 1 + t.lost;
    }
    if (dampers(t, e, h)) return STIFF;
    bias(t, t.qd, w.gravity, touching ? e.external : 0);
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

// Contact wrenches on links; 0, LOST or STIFF.
BIG int touch(Work& w, Explicit& e, real h, double* forces, int substeps) {
    Tree& t = w.tree;
    for (int i = 0; i < NL; i++) e.external[i] = wrench(v3(0, 0, 0), v3(0, 0, 0));
    bool moving = false;
    for (int point = 0; point < NP; point++) {
        const int link = POINT_LINK[point];
        V3 n, nearest;
        const real gap = meets(t, w.surface[0], point, n, nearest) - RADIUS[point];
        if (!(gap < 0)) {
            if (gap != gap) return LOST;
            continue;
        }
        if (!moving) velocities(t, t.qd);
        moving = true;
        const real* m = w.surface[0].material;
        if (h * m[2] * EASE(t)[point] > MOST_DRAG) return STIFF;
        const V3 x = facing(t, point, n, true) - n * RADIUS[point], v = at(t.velocity[link], x);
        const real vn = dot(n, v), normal = -(m[0] * gap + m[1] * least(vn, 0));
        const V3 slip = v - n * vn;
        const V3 f = n * normal - slip * drag(normal, norm(slip), m[2], m[3]);
        e.external[link] = e.external[link] + wrench(cross(x, f), f);
        if (forces) {
            double* sum = forces + 3 * point;
            sum[0] += f.x / substeps; sum[1] += f.y / substeps; sum[2] += f.z / substeps;
        }
    }
    return 0;
}

// The twist about an origin displaced by `by`.
FN void carry(Tree& t, V3 by) {
    const V3 moved = cross(v3(t.qd[0], t.qd[1], t.qd[2]), by);
    t.qd[3] += moved.x; t.qd[4] += moved.y; t.qd[5] += moved.z;
}

BIG int euler(Work& w, Explicit& e, const double* scene, const double* tau, double* forces, bool touching, int substeps) {
    Tree& t = w.tree;
    const real h = (real)(FRAME / substeps);
    // The origin stays where the root stood.
    double origin[3] = {0, 0, 0};
    if (DOFS) for (int k = 0; k < 3; k++) origin[k] = t.q[k];
    t.shift = v3(0, 0, 0);
    see(w, scene);
    for (int substep = 0; substep < substeps; substep++) {
        if (DOFS) t.shift = v3((real)(t.q[0] - origin[0]), (real)(t.q[1] - origin[1]), (real)(t.q[2] - origin[2]));
        kinematics(t);
        int state = touching ? touch(w, e, h, forces, substeps) : 0;
        if (!state) state = accelerate(w, e, tau, substep == 0 || RENEW, touching, h, MOST_EULER);
        if (state) return state;
        for (int k = 0; k < NV; k++) t.qd[k] += w.qdd[k] * h;
        for (int i = 0; i < NJ; i++) t.q[COORDS + i] += t.qd[DOFS + i] * h;
        if (DOFS) {
            const V3 a = v3(t.qd[0], t.qd[1], t.qd[2]), v = v3(t.qd[3], t.qd[4], t.qd[5]) + cross(a, t.shift);
            t.q[0] += v.x * h; t.q[1] += v.y * h; t.q[2] += v.z * h;
            const V3 half = a * ((real)0.5 * h);
            const Q4 r = read4(t.q + 3);
            double s[4] = {r.x + half.x * r.w + half.y * r.z - half.z * r.y, r.y - half.x * r.z + half.y * r.w + half.z * r.x,
                           r.z + half.x * r.y - half.y * r.x + half.z * r.w, r.w - half.x * r.x - half.y * r.y - half.z * r.z};
            const double n = sqrt(s[0] * s[0] + s[1] * s[1] + s[2] * s[2] + s[3] * s[3]);
            for (int k = 0; k < 4; k++) t.q[3 + k] = s[k] / n;
        }
    }
    // Back to the root.
    if (DOFS) carry(t, v3((real)(t.q[0] - origin[0]), (real)(t.q[1] - origin[1]), (real)(t.q[2] - origin[2])));
    return 0;
}

// The tree of a substep's stage, from (q, qd) at its beginning and the rate of the stage before.
FN void stand(Tree& t, const Explicit& e, int stage, const double* q, const double* qd, real h) {
    const double at = stage == 0 ? 0 : stage == 3 ? h : 0.5 * h;
    const double* rate = e.rates[stage ? stage - 1 : 0];
    for (int k = 0; k < NQ; k++) t.q[k] = stage ? q[k] + at * rate[k] : q[k];
    for (int k = 0; k < NV; k++) t.qd[k] = (real)(stage ? qd[k] + at * rate[NQ + k] : qd[k]);
}

// The rates of a substep's stages, at whose last the tree ends. 0, a fault, or STIFF.
BIG int stages(Work& w, Explicit& e, const double* tau, const double* q, const double* qd, real h, real bound) {
    Tree& t = w.tree;
    for (int stage = 0; stage < 4; stage++) {
        stand(t, e, stage, q, qd, h);
        kinematics(t);
        const int state = accelerate(w, e, tau, true, false, h, bound);
        if (state) return state;
        double* r = e.rates[stage];
        for (int i = 0; i < NJ; i++) r[COORDS + i] = t.qd[DOFS + i];
        for (int k = 0; k < NV; k++) r[NQ + k] = w.qdd[k];
        if (!DOFS) continue;
        const V3 a = v3(t.qd[0], t.qd[1], t.qd[2]), v = v3(t.qd[3], t.qd[4], t.qd[5]), c = cross(a, v);
        r[0] = v.x; r[1] = v.y; r[2] = v.z;
        // (w, 0) Q / 2, of a quaternion as it is.
        const double x = t.q[3], y = t.q[4], z = t.q[5], s = t.q[6];
        r[3] = 0.5 * (a.x * s + a.y * z - a.z * y);
        r[4] = 0.5 * (-a.x * z + a.y * s + a.z * x);
        r[5] = 0.5 * (a.x * y - a.y * x + a.z * s);
        r[6] = 0.5 * (-a.x * x - a.y * y - a.z * z);
        r[NQ + 3] += c.x; r[NQ + 4] += c.y; r[NQ + 5] += c.z;
    }
    return 0;
}

// What a number changes by over a substep.
FN double grown(const Explicit& e, int k, real h) {
    return h / 6.0 * (e.rates[0][k] + 2 * e.rates[1][k] + 2 * e.rates[2][k] + e.rates[3][k]);
}

template <class K> BIG int runge_kutta(Work& w, Explicit& e, const double* scene, const double* tau, int substeps, const K& keeper) {
    Tree& t = w.tree;
    const real h = (real)(FRAME / substeps);
    keeper.begin(false, substeps);
    t.shift = v3(0, 0, 0);
    see(w, scene);
    for (int substep = 0; substep < substeps; substep++) {
        keeper.begins(w, substep);
        double q[NQ], qd[NV];
        for (int k = 0; k < NQ; k++) q[k] = t.q[k];
        for (int k = 0; k < NV; k++) qd[k] = t.qd[k];
        const int state = stages(w, e, tau, q, qd, h, MOST_RK4);
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
