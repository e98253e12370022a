// Starts of episodes and the robot's own controller, as system/start.rs and control.rs. Tables of the root: ranges
// PLACES, ANG_VEL, VELOCITY, TILTS, orientation POSE. Of the joints: ranges STARTS_Q and STARTS_QD, MINUS (joint to
// subtract, or -1), KP, KD, GAIN, DEFAULT_Q (default pose). A start keeps contact point p at least APART[p] (m)
// away from the scene APART_FROM.

// State of a stream of random numbers in [0, 1).
struct Draws { unsigned long long key[4], stream, block; unsigned words[16]; int at; };
FN Draws draws(const unsigned long long* key, unsigned long long stream) {
    Draws d;
    for (int k = 0; k < 4; k++) d.key[k] = key[k];
    d.stream = stream;
    d.block = 0;
    d.at = 16;
    return d;
}
BIG double one(Draws& d) {
    if (d.at == 16) {
        chacha8(d.key, d.block++, d.stream, d.words);
        d.at = 0;
    }
    d.at += 2;
    return unit(d.words + d.at - 2);
}

// a + b x, each operation rounded, as on the CPU.
FN double along(double a, double b, double x) {
#ifdef __CUDACC_RTC__
    return __dadd_rn(a, __dmul_rn(b, x));
#else
    return a + b * x;
#endif
}
FN double between(Draws& d, const double* range) { return along(range[0], range[1] - range[0], one(d)); }

BIG void draw_root(Draws& d, double* state) {
    double *p = state, w[3], v[3], n[3], length = 0, turn[4], spin[3], speed[3];
    for (int k = 0; k < 3; k++) p[k] = between(d, PLACES + 2 * k);
    for (int k = 0; k < 3; k++) w[k] = between(d, ANG_VEL + 2 * k);
    for (int k = 0; k < 3; k++) v[k] = between(d, VELOCITY + 2 * k);
    while (!(length > 1e-6)) {
        for (int k = 0; k < 3; k++) n[k] = along(-1, 2, one(d));
        length = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    }
    const double half = between(d, TILTS) / 2;
    for (int k = 0; k < 3; k++) turn[k] = n[k] / length * sin(half);
    turn[3] = cos(half);
    multiply(POSE, turn, state + 3);
    rotate(state + 3, w, 1, spin);
    rotate(state + 3, v, 1, speed);
    for (int k = 0; k < 3; k++) {
        const int i = (k + 1) % 3, j = (k + 2) % 3;
        state[NQ + k] = spin[k];
        state[NQ + 3 + k] = speed[k] + (p[i] * spin[j] - p[j] * spin[i]);
    }
}

BIG void draw_start(Draws& d, double* state) {
    if (DOFS) draw_root(d, state);
    for (int i = 0; i < NJ; i++) {
        state[COORDS + i] = between(d, STARTS_Q + 2 * i);
        if (MINUS[i] >= 0) state[COORDS + i] -= state[COORDS + MINUS[i]];
    }
    for (int i = 0; i < NJ; i++) state[NQ + DOFS + i] = between(d, STARTS_QD + 2 * i);
    wrap(state);
}

// Distance (m) of a contact point from the nearest collider of the scene.
FN real nearest(const Work& w, int point) {
    real least = infinite();
    for (int c = 0; c < w.surfaces; c++) {
        V3 normal, place;
        if (!may(w, point, c)) continue;
        const real d = meets(w.tree, w.surface[c], point, normal, place);
        if (d < least) least = d;
    }
    return least;
}

// Kinematics of a state, and surfaces relative to its root.
BIG void settle(Work& w, const double* state, const double* scene) {
    take(w.tree, state);
    kinematics(w.tree);
    survey(w, scene);
}

// Draws starts until one is clear of the scene, MAX_DRAWS at most.
BIG void start(Draws& d, double* state) {
    for (int k = 0; k < MAX_DRAWS; k++) {
        draw_start(d, state);
        if (!CLEARS) return;
        Work w;
        settle(w, state, APART_FROM);
        bool clear = true;
        for (int p = 0; p < NP; p++) clear = clear && nearest(w, p) >= APART[p];
        if (clear) return;
    }
}

#if FIELDS
// Least height (m) of the contact points: along `up` from the root (low), and above the uneven ground (above).
FN void lowest(Work& w, const double* state, const double* scene, V3 up, real& low, real& above) {
    settle(w, state, scene);
    const int ground = (int)((terrain(scene) - scene) / COLLIDER);
    low = above = infinite();
    for (int p = 0; p < NP; p++) {
        V3 normal, nearest;
        const V3 place = facing(w.tree, p, up, true);
        const real d = distance(w.surface[ground], place, normal, nearest) - RADIUS[p];
        low = least(low, dot(up, place) - RADIUS[p]);
        above = least(above, d / dot(normal, up));
    }
}

// Moves a start to a random place on uneven ground, as scene/terrain.rs.
BIG void strewn(Draws& d, double* state, const double* scene) {
    const double *f = terrain(scene), *g = grid(f);
    const V3 up = v3(f[3], f[6], f[9]);
    Work w;
    real low, above, none;
    lowest(w, state, scene, up, low, none);
    if (NP == 0) return;
    for (int k = 0; k < 3; k++) low += (k == 0 ? up.x : k == 1 ? up.y : up.z) * (state[k] - f[10 + k]);
    const double x = g[GRID_CELLS] * g[GRID_NODES] * one(d), y = g[GRID_CELLS + 1] * g[GRID_NODES + 1] * one(d);
    double by[3];
    for (int pass = 0; pass < 2; pass++) {
        for (int k = 0; k < 3; k++)
            by[k] = pass == 0 ? f[1 + 3 * k] * x + f[2 + 3 * k] * y : f[3 + 3 * k] * (low - above);
        for (int k = 0; k < 3; k++) {
            const int i = (k + 1) % 3, j = (k + 2) % 3;
            state[k] += by[k];
            state[NQ + 3 + k] += by[i] * state[NQ + j] - by[j] * state[NQ + i];
        }
        if (pass == 0) lowest(w, state, scene, up, none, above);
    }
}
#endif

// Factorises M + h (KD + h KP), for PD torques at the frame's end (STABLE_PD), without contact. False if not positive
// definite.
BIG bool stiffened(const double* state, const double* scene, Tree& t) {
    know(t, scene);
    take(t, state);
    kinematics(t);
    crba(t);
    for (int i = 0; i < NJ; i++) t.mass[LOWER(DOFS + i, DOFS + i)] += FRAME * (KD(scene)[i] + FRAME * KP(scene)[i]);
    return refill(t);
}

// Position errors and velocities of the joints: now or, with STABLE_PD, at the frame's end. Returns whether they are
// those at the frame's end.
BIG bool gaps(const double* state, const double* scene, const double* action, double* gap, double* speed, Tree& t) {
    for (int i = 0; i < NJ; i++) {
        const double q = state[COORDS + i], d = (RELATIVE ? q : DEFAULT_Q[i]) + ACTION_SCALE * action[i] - q;
        gap[i] = WRAPS[i] && !RELATIVE ? wrapped(d) : d;
        speed[i] = state[NQ + DOFS + i];
    }
    if (!STABLE_PD || !stiffened(state, scene, t)) return false;
    double qdd[NV];
    bias(t, t.qd, read3(scene), 0);
    for (int k = 0; k < NV; k++) qdd[k] = -t.tau[k];
    for (int i = 0; i < NJ; i++) qdd[DOFS + i] += KP(scene)[i] * (gap[i] - FRAME * speed[i]) - KD(scene)[i] * speed[i];
    solve(t, qdd);
    for (int i = 0; i < NJ; i++) {
        gap[i] -= FRAME * (speed[i] + FRAME * qdd[DOFS + i]);
        speed[i] += FRAME * qdd[DOFS + i];
    }
    return true;
}

// Torques of an action (each number within +-1): state, action => tau.
BIG void controlled(const double* state, const double* scene, const double* action, double* tau) {
    if (!CONTROLLED) {
        for (int i = 0; i < NJ; i++) tau[i] = GAIN[i] * action[i];
        return;
    }
    double gap[NJ + 1], speed[NJ + 1];
    Tree tree;
    gaps(state, scene, action, gap, speed, tree);
    for (int i = 0; i < NJ; i++) {
        const double t = KP(scene)[i] * gap[i] - KD(scene)[i] * speed[i];
        tau[i] = CLAMPED ? (t < -GAIN[i] ? -GAIN[i] : t > GAIN[i] ? GAIN[i] : t) : t;
    }
}

// Adjoint of `controlled`: gradient `by` w.r.t. tau => by_action, and by_state (added to).
BIG void controlled_back(const double* state, const double* scene, const double* action, const double* by,
                         double* by_action, double* by_state) {
    if (!CONTROLLED) {
        for (int i = 0; i < NJ; i++) by_action[i] = GAIN[i] * by[i];
        return;
    }
    double gap[NJ + 1], speed[NJ + 1], push[NV];
    Tree tree;
    const bool stable = gaps(state, scene, action, gap, speed, tree);
    for (int i = 0; i < NJ; i++) {
        const double t = KP(scene)[i] * gap[i] - KD(scene)[i] * speed[i],
                     g = !CLAMPED || fabs(t) <= GAIN[i] ? by[i] : 0;
        gap[i] = KP(scene)[i] * g;
        speed[i] = -KD(scene)[i] * g;
    }
    if (stable) {
        for (int k = 0; k < NV; k++) push[k] = k < DOFS ? 0 : FRAME * speed[k - DOFS] - FRAME * FRAME * gap[k - DOFS];
        solve(tree, push);
        for (int i = 0; i < NJ; i++) {
            speed[i] -= FRAME * gap[i] + (KD(scene)[i] + FRAME * KP(scene)[i]) * push[DOFS + i];
            gap[i] += KP(scene)[i] * push[DOFS + i];
        }
    }
    for (int i = 0; i < NJ; i++) {
        by_action[i] = ACTION_SCALE * gap[i];
        by_state[COORDS + i] -= RELATIVE ? 0 : gap[i];
        by_state[NQ + DOFS + i] += speed[i];
    }
}
