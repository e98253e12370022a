// The tree: kinematics, mass matrix, bias forces and factor, as nerd_core::dynamics. The host (program.rs, tables.rs)
// defines sizes and tables: NL links, NV velocities, NQ coordinates, NJ joints, DOFS and COORDS of the root. Per link:
// PARENT (or -1), DOF, JOINT (index of its coordinate), SLIDES, RATIO and OFFSET (mimic joints), PLACE, TURN, AXIS,
// MASS, COM, BODY, ARMATURE. `MASS(t)` is a constant table, or in a family may be the tree's own (own.rs).

#define LOWER(i, j) ((i) * ((i) + 1) / 2 + (j))
constexpr int SIZE = NV * (NV + 1) / 2;
constexpr int KEPT = ALONG && HELD && !MATRIX ? 1 : SIZE;   // no matrix where only solves along the tree are used
constexpr int HERE = UNROLLED ? SIZE : 1;        // entries that an unrolled walk keeps in registers

struct Tree {
    double q[NQ];
    real qd[NV];         // local: (w, p_dot) of a floating root
    M3 rotation[NL];
    V3 position[NL];     // from the origin
    V3 centre;           // point whose position q holds (link axes): link's origin, or centre of mass (spin.cuh)
    Motion axis[NL];
    Motion velocity[NL];
    real tau[NV];        // bias forces
    real mass[KEPT];
    real factor[KEPT];   // diagonal inverted
    int lost;
#if OWNED
    real own[OWNED];     // tables that differ in a family (own.rs)
#endif
};

// Copies a robot's own parameters from its record.
FN void know(Tree& t, const double* scene) {
#if OWNED
    for (int k = 0; k < OWNED; k++) t.own[k] = (real)scene[SHARED + k];
#endif
}

FN V3 unit(int k) { return v3(k == 0, k == 1, k == 2); }
FN Motion rootward(int k) { return k < 3 ? motion(unit(k), v3(0, 0, 0)) : motion(v3(0, 0, 0), unit(k - 3)); }

// Entry of the rotation matrix of link i's joint at sine s and cosine c. TURN has the factors of 1, s and c, many of
// them zero.
FN real turned(int entry, int i, real s, real c) {
    const real *own = TURN + 27 * i + entry;
    return own[0] + (own[9] != 0 ? own[9] * s : 0) + (own[18] != 0 ? own[18] * c : 0);
}

// Poses and axes of the links: t.q => t.rotation, t.position, t.axis.
BIG void kinematics(Tree& t) {
    M3 base;
    if (DOFS) base = matrix(read4(t.q + 3));
    else for (int k = 0; k < 9; k++) base.m[k] = BASE[k];
    if (DOFS) { t.rotation[0] = base; t.position[0] = CENTRED ? base * t.centre * -1 : v3(0, 0, 0); }
    for_up<DOFS ? 1 : 0, NL>([&](auto i) {
        const int p = PARENT[i];
        const M3 parent = p < 0 ? base : t.rotation[p];
        V3 position = (p < 0 ? v3(0, 0, 0) : t.position[p]) + parent * read3(PLACE + 3 * i);
        const real value = (real)(t.q[COORDS + JOINT[i]] * RATIO[i] + OFFSET[i]);
        real s = 0, c = 1;
        if (!SLIDES[i]) sine_cosine(value, s, c);
        M3 own;
        for (int k = 0; k < 9; k++) own.m[k] = turned(k, i, s, c);
        const M3 rotation = parent * own;
        const V3 axis = rotation * read3(AXIS + 3 * i);
        if (SLIDES[i]) {
            position = position + axis * value;
            t.axis[i] = motion(v3(0, 0, 0), axis * RATIO[i]);
        } else {
            t.axis[i] = motion(axis, cross(position, axis)) * RATIO[i];
        }
        t.rotation[i] = rotation;
        t.position[i] = position;
    });
}

FN Motion root(const real* qd) { return motion(v3(qd[0], qd[1], qd[2]), v3(qd[3], qd[4], qd[5])); }

// Twists of the links: qd => twist.
FN void twists(const Tree& t, const real* qd, Motion* twist) {
    for_up<0, NL>([&](auto i) {
        if (DOFS && i == 0) {
            twist[0] = root(qd);
            return;
        }
        const int p = PARENT[i];
        const Motion own = t.axis[i] * qd[DOF[i]];
        twist[i] = p < 0 ? own : twist[p < 0 ? 0 : p] + own;
    });
}

BIG void velocities(Tree& t, const real* qd) { twists(t, qd, t.velocity); }

// Position of a link's gravity-compensated mass; wrench of a free root's damping against a twist.
template <class I> FN V3 lifted(const Tree& t, I i) {
    return t.position[i] + t.rotation[i] * read3(LIFT(t) + 4 * i + 1);
}
FN Wrench drag(const Tree& t, const Motion& v) {
    const V3 f = at(v, t.position[0]) * (real)ROOT_DAMPING;
    return wrench(v.ang * (real)ROOT_DAMPING + cross(t.position[0], f), f);
}

// Bias forces by RNEA at zero qdd, less J^T external => t.tau; twists => t.velocity.
BIG void bias(Tree& t, const real* qd, V3 gravity, const Wrench* external) {
    Motion velocity[NL], acceleration[NL];
    Wrench force[NL];
    const Motion base = motion(v3(0, 0, 0), gravity * (real)-1);
    for_up<0, NL>([&](auto i) {
        if (DOFS && i == 0) {
            velocity[0] = root(qd);
            acceleration[0] = base;
        } else {
            const int p = PARENT[i];
            const Motion rate = t.axis[i] * qd[DOF[i]];
            velocity[i] = p < 0 ? rate : velocity[p < 0 ? 0 : p] + rate;
            acceleration[i] = (p < 0 ? base : acceleration[p < 0 ? 0 : p]) + cross(velocity[i], rate);
        }
        const Motion v = velocity[i], a = acceleration[i];
        t.velocity[i] = v;
        const M3 r = t.rotation[i];
        M3 body;
        for (int k = 0; k < 9; k++) body.m[k] = BODY(t)[9 * i + k];
        const V3 c = t.position[i] + r * read3(COM(t) + 3 * i);
        const V3 f = (at(a, c) + cross(v.ang, at(v, c))) * MASS(t)[i];
        const V3 w = back(r, v.ang), wd = back(r, a.ang);
        force[i] = wrench(r * (body * wd + cross(w, body * w)) + cross(c, f), f);
#if LIFTS
        const V3 weight = gravity * LIFT(t)[4 * i];
        force[i] = force[i] + wrench(cross(lifted(t, i), weight), weight);
#endif
        if (FREED && i == 0) force[0] = force[0] + drag(t, v);
        if (external) force[i] = wrench(force[i].ang - external[i].ang, force[i].lin - external[i].lin);
    });
    real tau[NV];
    for_up<0, NV>([&](auto k) { tau[k] = 0; });
    backward<0, NL>([&](auto i) {
        if (DOFS && i == 0) {
            tau[0] = force[0].ang.x; tau[1] = force[0].ang.y; tau[2] = force[0].ang.z;
            tau[3] = force[0].lin.x; tau[4] = force[0].lin.y; tau[5] = force[0].lin.z;
        } else {
            tau[DOF[i]] += dot(t.axis[i], force[i]);
        }
        const int p = PARENT[i];
        if (p >= 0) force[p < 0 ? 0 : p] = force[p < 0 ? 0 : p] + force[i];
    });
    for_up<0, NV>([&](auto k) { t.tau[k] = tau[k]; });
}

// Spatial inertia of link i about the origin.
FN Inertia body(const Tree& t, int i) {
    const M3& r = t.rotation[i];
    M3 own;
    for (int k = 0; k < 9; k++) own.m[k] = BODY(t)[9 * i + k];
    const V3 c = t.position[i] + r * read3(COM(t) + 3 * i);
    const real m = MASS(t)[i], s = m * dot(c, c);
    const M3 a = r * own;
    Inertia b;
    b.mass = m;
    b.moment = c * m;
    const int row[6] = {0, 1, 2, 0, 0, 1}, col[6] = {0, 1, 2, 1, 2, 2};
    const real x[3] = {c.x, c.y, c.z};
    for (int k = 0; k < 6; k++) {
        const int i = row[k], j = col[k];
        b.i[k] = a.m[3 * i] * r.m[3 * j] + a.m[3 * i + 1] * r.m[3 * j + 1] + a.m[3 * i + 2] * r.m[3 * j + 2]
                 - m * x[i] * x[j] + (i == j ? s : (real)0);
    }
    return b;
}

// Calls f with the index in a lower triangle of every entry that may be nonzero.
template <class F> FN void entries(const F& f) {
    for_up<0, NV>([&](auto i) { upward(i, [&](auto j) { f(LOWER(i, j)); }); });
}

FN void enter(real* mass, int i, int j, real value) {
    // A mimic joint below its leader shares the leader's DoF: the entries of both triangles fall on the diagonal.
    if (i == j) mass[LOWER(i, i)] += 2 * value;
    else mass[i > j ? LOWER(i, j) : LOWER(j, i)] += value;
}

// Mass matrix by CRBA => t.mass.
BIG void crba(Tree& t) {
    Inertia composite[NL];
    real here[HERE], *mass = UNROLLED ? here : t.mass;
    entries([&](int k) { mass[k] = 0; });
    for_up<0, NL>([&](auto i) { composite[i] = zero_inertia(); });
    backward<DOFS ? 1 : 0, NL>([&](auto j) {
        add(composite[j], body(t, MASS_OF[j]));
        const Wrench momentum = composite[j] * t.axis[j];
        const int row = DOF[j], p = PARENT[j];
        mass[LOWER(row, row)] += dot(t.axis[j], momentum) + ARMATURE(t)[j];
        forebears(j, [&](auto i) {
            if (DOFS && i == 0) for (int k = 0; k < 6; k++) enter(mass, row, k, dot(rootward(k), momentum));
            else enter(mass, row, DOF[i], dot(t.axis[i], momentum));
        });
        if (p >= 0) add(composite[p < 0 ? 0 : p], composite[j]);
    });
    if (DOFS) {
        add(composite[0], body(t, MASS_OF[0]));
        for (int k = 0; k < 6; k++) {
            const Wrench momentum = composite[0] * rootward(k);
            for (int l = k; l < 6; l++) mass[LOWER(l, k)] = dot(rootward(l), momentum);
        }
    }
    if (UNROLLED) entries([&](int k) { t.mass[k] = mass[k]; });
}

// M = L^T L, in place, with L's diagonal inverted. False, with the DoF in t.lost, if M is not positive definite.
FN bool factorise(Tree& t, real* l) {
    real given[NV];
    int lost = -1;
    for_up<0, NV>([&](auto k) { given[k] = l[LOWER(k, k)]; });
    backward<0, NV>([&](auto k) {
        const real square = l[LOWER(k, k)];
        // After a failure nothing uses the remaining values.
        if (!(square > (real)1e-12 * given[k]) && lost < 0) lost = k;
        const real inverse = inverse_root(square);
        l[LOWER(k, k)] = inverse;
        above(k, [&](auto i) { l[LOWER(k, i)] *= inverse; });
        above(k, [&](auto i) {
            const real own = l[LOWER(k, i)];
            upward(i, [&](auto j) { l[LOWER(i, j)] -= own * l[LOWER(k, j)]; });
        });
    });
    t.lost = lost;
    return lost < 0;
}

BIG bool refill(Tree& t) {
    real here[HERE], *l = UNROLLED ? here : t.factor;
    entries([&](int k) { l[k] = t.mass[k]; });
    const bool sound = factorise(t, l);
    if (UNROLLED) entries([&](int k) { t.factor[k] = l[k]; });
    return sound;
}

// L^-T x (half) and L^-1 x (rest), in place.
FN void half(const real* l, real* x) {
    backward<0, NV>([&](auto i) {
        x[i] *= l[LOWER(i, i)];
        above(i, [&](auto j) { x[j] -= l[LOWER(i, j)] * x[i]; });
    });
}
FN void rest(const real* l, real* x) {
    for_up<0, NV>([&](auto i) {
        above(i, [&](auto j) { x[i] -= l[LOWER(i, j)] * x[j]; });
        x[i] *= l[LOWER(i, i)];
    });
}

BIG void solve(const Tree& t, real* x) {
    real own[NV];
    for_up<0, NV>([&](auto k) { own[k] = x[k]; });
    half(t.factor, own);
    rest(t.factor, own);
    for_up<0, NV>([&](auto k) { x[k] = own[k]; });
}

// Advances the pose by `time` at local velocities t.qd.
FN void drift(Tree& t, real time) {
    for (int i = 0; i < NJ; i++) t.q[COORDS + i] += t.qd[DOFS + i] * time;
    if (DOFS) {
        for (int k = 0; k < 3; k++) t.q[k] += (double)(t.qd[3 + k] * time);
        turn(t.q + 3, v3(t.qd[0], t.qd[1], t.qd[2]) * time);
    }
}
