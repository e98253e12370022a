// The tree: kinematics, mass matrix, bias and factor, as nerd_core::dynamics has them. Sizes and tables come from the host
// (program.rs): NL links, NV velocities, NQ coordinates, NJ joints, DOFS and COORDS of the root, and per link PARENT (-1), DOF,
// JOINT (index of its coordinate), SLIDES, RATIO and OFFSET of a joint that follows, PLACE, TURN, AXIS, MASS, COM, BODY, ARMATURE.

#define LOWER(i, j) ((i) * ((i) + 1) / 2 + (j))
constexpr int SIZE = NV * (NV + 1) / 2;
constexpr int KEPT = ALONG && HELD ? 1 : SIZE;   // no matrix where the tree is all that is ever asked

struct Tree {
    double q[NQ];
    real qd[NV];         // local: (w, p_dot) of a floating root
    M3 rotation[NL];
    V3 shift;            // of the root from the origin
    V3 position[NL];     // from the origin
    Motion axis[NL];
    Motion velocity[NL];
    real tau[NV];        // bias
    real mass[KEPT];
    real factor[KEPT];   // diagonal inverted
    real given[NV];      // diagonal of what was factorised
    int lost;
};

FN V3 unit(int k) { return v3(k == 0, k == 1, k == 2); }
FN Motion rootward(int k) { return k < 3 ? motion(unit(k), v3(0, 0, 0)) : motion(v3(0, 0, 0), unit(k - 3)); }

BIG void kinematics(Tree& t) {
    M3 base;
    if (DOFS) base = matrix(read4(t.q + 3));
    else for (int k = 0; k < 9; k++) base.m[k] = BASE[k];
    if (DOFS) { t.rotation[0] = base; t.position[0] = t.shift; }
    for (int i = DOFS ? 1 : 0; i < NL; i++) {
        const int p = PARENT[i];
        const M3 parent = p < 0 ? base : t.rotation[p];
        V3 position = (p < 0 ? v3(0, 0, 0) : t.position[p]) + parent * read3(PLACE + 3 * i);
        const real value = (real)(t.q[COORDS + JOINT[i]] * RATIO[i] + OFFSET[i]);
        real s = 0, c = 1;
        if (!SLIDES[i]) { s = sin(value); c = cos(value); }
        M3 own;
        for (int k = 0; k < 9; k++) own.m[k] = TURN[27 * i + k] + TURN[27 * i + 9 + k] * s + TURN[27 * i + 18 + k] * c;
        t.rotation[i] = parent * own;
        const V3 axis = t.rotation[i] * read3(AXIS + 3 * i);
        if (SLIDES[i]) {
            position = position + axis * value;
            t.axis[i] = motion(v3(0, 0, 0), axis * RATIO[i]);
        } else {
            t.axis[i] = motion(axis, cross(position, axis)) * RATIO[i];
        }
        t.position[i] = position;
    }
}

FN Motion root(const real* qd) { return motion(v3(qd[0], qd[1], qd[2]), v3(qd[3], qd[4], qd[5])); }

BIG void velocities(Tree& t, const real* qd) {
    for (int i = 0; i < NL; i++) {
        if (DOFS && i == 0) { t.velocity[0] = root(qd); continue; }
        const Motion own = t.axis[i] * qd[DOF[i]];
        t.velocity[i] = PARENT[i] < 0 ? own : t.velocity[PARENT[i]] + own;
    }
}

// Torques at zero acceleration into t.tau, those of wrenches from outside taken off; fills t.velocity.
BIG void bias(Tree& t, const real* qd, V3 gravity, const Wrench* external) {
    Motion acceleration[NL];
    Wrench force[NL];
    const Motion base = motion(v3(0, 0, 0), gravity * (real)-1);
    for (int i = 0; i < NL; i++) {
        if (DOFS && i == 0) {
            t.velocity[0] = root(qd);
            acceleration[0] = base;
        } else {
            const int p = PARENT[i];
            const Motion rate = t.axis[i] * qd[DOF[i]];
            const Motion v = p < 0 ? rate : t.velocity[p] + rate;
            acceleration[i] = (p < 0 ? base : acceleration[p]) + cross(v, rate);
            t.velocity[i] = v;
        }
        const Motion v = t.velocity[i], a = acceleration[i];
        const M3& r = t.rotation[i];
        M3 body;
        for (int k = 0; k < 9; k++) body.m[k] = BODY[9 * i + k];
        const V3 c = t.position[i] + r * read3(COM + 3 * i);
        const V3 f = (at(a, c) + cross(v.ang, at(v, c))) * MASS[i];
        const V3 w = back(r, v.ang), wd = back(r, a.ang);
        force[i] = wrench(r * (body * wd + cross(w, body * w)) + cross(c, f), f);
        if (external) force[i] = wrench(force[i].ang - external[i].ang, force[i].lin - external[i].lin);
    }
    for (int k = 0; k < NV; k++) t.tau[k] = 0;
    for (int i = NL - 1; i >= 0; i--) {
        if (DOFS && i == 0) {
            t.tau[0] = force[0].ang.x; t.tau[1] = force[0].ang.y; t.tau[2] = force[0].ang.z;
            t.tau[3] = force[0].lin.x; t.tau[4] = force[0].lin.y; t.tau[5] = force[0].lin.z;
        } else {
            t.tau[DOF[i]] += dot(t.axis[i], force[i]);
        }
        if (PARENT[i] >= 0) force[PARENT[i]] = force[PARENT[i]] + force[i];
    }
}

FN Inertia body(const Tree& t, int i) {
    const M3& r = t.rotation[i];
    M3 own;
    for (int k = 0; k < 9; k++) own.m[k] = BODY[9 * i + k];
    const V3 c = t.position[i] + r * read3(COM + 3 * i);
    const real m = MASS[i], s = m * dot(c, c);
    const M3 a = r * own;
    Inertia b;
    b.mass = m;
    b.moment = c * m;
    const int row[6] = {0, 1, 2, 0, 0, 1}, col[6] = {0, 1, 2, 1, 2, 2};
    const real x[3] = {c.x, c.y, c.z};
    for (int k = 0; k < 6; k++) {
        const int i = row[k], j = col[k];
        b.i[k] = a.m[3 * i] * r.m[3 * j] + a.m[3 * i + 1] * r.m[3 * j + 1] + a.m[3 * i + 2] * r.m[3 * j + 2] - m * x[i] * x[j] + (i == j ? s : (real)0);
    }
    return b;
}

FN void enter(Tree& t, int i, int j, real value) {
    // On the diagonal, of a joint that follows one above it, both triangles meet.
    if (i == j) t.mass[LOWER(i, i)] += 2 * value;
    else t.mass[i > j ? LOWER(i, j) : LOWER(j, i)] += value;
}

BIG void crba(Tree& t) {
    Inertia composite[NL];
    for (int k = 0; k < SIZE; k++) t.mass[k] = 0;
    for (int i = 0; i < NL; i++) composite[i] = body(t, MASS_OF[i]);
    for (int j = NL - 1; j >= (DOFS ? 1 : 0); j--) {
        const Wrench momentum = composite[j] * t.axis[j];
        const int row = DOF[j];
        t.mass[LOWER(row, row)] += dot(t.axis[j], momentum) + ARMATURE[j];
        for (int i = PARENT[j]; i >= 0; i = PARENT[i]) {
            if (DOFS && i == 0) for (int k = 0; k < 6; k++) enter(t, row, k, dot(rootward(k), momentum));
            else enter(t, row, DOF[i], dot(t.axis[i], momentum));
        }
        if (PARENT[j] >= 0) add(composite[PARENT[j]], composite[j]);
    }
    if (DOFS)
        for (int k = 0; k < 6; k++) {
            const Wrench momentum = composite[0] * rootward(k);
            for (int l = k; l < 6; l++) t.mass[LOWER(l, k)] = dot(rootward(l), momentum);
        }
}

// L^T L in place of t.factor, whose entries are a mass matrix; false at t.lost where that is not positive definite.
BIG bool factorise(Tree& t) {
    real* l = t.factor;
    for (int k = 0; k < NV; k++) t.given[k] = l[LOWER(k, k)];
    for (int k = NV - 1; k >= 0; k--) {
        const real square = l[LOWER(k, k)];
        if (!(square > (real)1e-12 * t.given[k])) { t.lost = k; return false; }
        const real inverse = 1 / sqrt(square);
        l[LOWER(k, k)] = inverse;
        for (int i = ABOVE[k]; i >= 0; i = ABOVE[i]) l[LOWER(k, i)] *= inverse;
        for (int i = ABOVE[k]; i >= 0; i = ABOVE[i]) {
            const real own = l[LOWER(k, i)];
            for (int j = i; j >= 0; j = ABOVE[j]) l[LOWER(i, j)] -= own * l[LOWER(k, j)];
        }
    }
    return true;
}

BIG bool refill(Tree& t) {
    for (int k = 0; k < SIZE; k++) t.factor[k] = t.mass[k];
    return factorise(t);
}

BIG void solve(const Tree& t, real* x) {
    const real* l = t.factor;
    for (int i = NV - 1; i >= 0; i--) {
        x[i] *= l[LOWER(i, i)];
        for (int j = ABOVE[i]; j >= 0; j = ABOVE[j]) x[j] -= l[LOWER(i, j)] * x[i];
    }
    for (int i = 0; i < NV; i++) {
        for (int j = ABOVE[i]; j >= 0; j = ABOVE[j]) x[i] -= l[LOWER(i, j)] * x[j];
        x[i] *= l[LOWER(i, i)];
    }
}

// The pose after a time at local velocities.
FN void drift(Tree& t, real time) {
    for (int i = 0; i < NJ; i++) t.q[COORDS + i] += t.qd[DOFS + i] * time;
    if (DOFS) {
        for (int k = 0; k < 3; k++) t.q[k] += (double)(t.qd[3 + k] * time);
        turn(t.q + 3, v3(t.qd[0], t.qd[1], t.qd[2]) * time);
    }
}
