// Before and after the network, as features.rs and frame.rs have it: contacts and the token of a frame; then the state that lies a
// prediction from the state before. Sizes and tables come from the host: INPUTS of a token, LDX numbers from one to the next, SITUATED,
// MOVING, FRAME_TIME, NEAR, TRAPEZOID, SEEN (threshold of a contact point), WAVES (sines and cosines of a joint at the end of a token), MEAN and SCALE of a token, SHIFT and STRETCH of a prediction.

constexpr int STATE = NQ + NV;

struct Event { V3 p0, normal, p1; real distance; };

// The nearest place of the scene to every contact point; from the root.
FN void look(const Work& w, Event* events) {
    for (int p = 0; p < NP; p++) {
        Event& e = events[p];
        e.distance = infinite();
        e.p0 = middle(w.tree, p);
        for (int c = 0; c < w.surfaces; c++) {
            V3 normal, nearest;
            const real d = meets(w.tree, w.surface[c], p, normal, nearest);
            if (!(d < e.distance)) continue;
            e.distance = d; e.normal = normal; e.p1 = nearest;
        }
    }
}

// How near a gap is, as features.rs has it; and the gap, now or a frame ahead at this speed.
FN double nearness(double gap) { return gap / sqrt(gap * gap + NEAR * NEAR); }
FN double gap(const Event& e, int p, V3 speed, int ahead) {
    return e.distance - RADIUS[p] + (ahead ? FRAME_TIME * dot(e.normal, speed) : 0);
}

FN V3 column(const M3& a, int k) { return v3(a.m[k], a.m[3 + k], a.m[6 + k]); }

// Writes a token, number by number, normalised.
struct Writer { float* out; int k; };
FN void put(Writer& w, double x) {
    w.out[w.k] = (float)(((real)(float)x - MEAN[w.k]) / SCALE[w.k]);
    w.k++;
}
FN void put(Writer& w, V3 v) { put(w, v.x); put(w, v.y); put(w, v.z); }

// The token of a frame.
BIG void tell(const double* state, const double* tau, const double* scene, float* token) {
    Work w;
    Tree& t = w.tree;
    Event events[NP + 1];
    take(t, state);
    t.shift = v3(0, 0, 0);
    M3 r = {{1, 0, 0, 0, 1, 0, 0, 0, 1}};
    V3 o = v3(0, 0, 0);
    if (SITUATED) {
        kinematics(t);
        survey(w, scene);
        look(w, events);
        // B, at the floating base or the first moving link.
        r = t.rotation[0];
        o = t.position[0];
    }
    Writer out = {token, 0};
    if (DOFS) {
        for (int k = 0; k < 6; k++) put(out, 0.0);
        put(out, 1.0);
    }
    for (int i = 0; i < NJ; i++) {
        const double q = state[COORDS + i];
        put(out, WAVES[i] == 1 ? sin(q) : SITUATED && WRAPS[i] ? wrapped(q) : q);
    }
    if (DOFS) {
        put(out, back(r, v3(t.qd[0], t.qd[1], t.qd[2])));
        put(out, back(r, v3(t.qd[3], t.qd[4], t.qd[5])));
    }
    for (int i = 0; i < NJ; i++) put(out, state[NQ + DOFS + i]);
    const V3 none = v3(0, 0, 0);
    for (int p = 0; p < NP; p++) put(out, events[p].distance < SEEN[p] ? back(r, events[p].normal) : none);
    for (int p = 0; p < NP; p++) put(out, events[p].distance < SEEN[p] ? back(r, events[p].p1 - o) : none);
    for (int p = 0; p < NP; p++) put(out, events[p].distance < SEEN[p] ? events[p].distance : (real)0);

    if (MOVING && NP) {
        V3 speed[NP + 1];
        velocities(t, t.qd);
        for (int p = 0; p < NP; p++) {
            const bool seen = events[p].distance < SEEN[p];
            if (seen) speed[p] = at(t.velocity[POINT_LINK[p]], facing(t, p, events[p].normal, true));
            put(out, seen ? back(r, speed[p]) : none);
        }
        for (int ahead = 0; ahead < 2; ahead++) {
            for (int p = 0; p < NP; p++) put(out, events[p].distance < SEEN[p] ? nearness(gap(events[p], p, speed[p], ahead)) : 1.0);
        }
    }
    for (int i = 0; i < NJ; i++) put(out, tau[i]);
    if (SITUATED) {
        const V3 g = v3((real)scene[0], (real)scene[1], (real)scene[2]);
        const real length = norm(g);
        put(out, back(r, g * (1 / (length > 0 ? length : 1))));
        for (int i = 1; MOVING && i < NL; i++) {
            const M3& m = t.rotation[i];
            put(out, back(r, column(m, 0)));
            put(out, back(r, column(m, 1)));
        }
    }
    for (int i = 0; i < NJ; i++) {
        if (WAVES[i] == 2) put(out, sin(state[COORDS + i]));
        if (WAVES[i]) put(out, cos(state[COORDS + i]));
    }
    for (int k = INPUTS; k < LDX; k++) token[k] = 0;
}

// Velocity of the root in its own axes.
FN void own_velocity(const double* state, V3& a, V3& b) {
    const M3 r = matrix(read4(state + 3));
    const double *w = state + NQ, *o = state;
    const V3 v = v3((real)(w[3] - (o[1] * w[2] - o[2] * w[1])), (real)(w[4] - (o[2] * w[0] - o[0] * w[2])), (real)(w[5] - (o[0] * w[1] - o[1] * w[0])));
    a = back(r, v3((real)w[0], (real)w[1], (real)w[2]));
    b = back(r, v);
}

FN void add3(double* to, V3 v) { to[0] += v.x; to[1] += v.y; to[2] += v.z; }
FN void put3(double* to, V3 v) { to[0] = v.x; to[1] = v.y; to[2] = v.z; }

// a b, neither of unit length.
FN void product(const double* a, const double* b, double* out) {
    for (int k = 0; k < 3; k++) {
        const int i = (k + 1) % 3, j = (k + 2) % 3;
        out[k] = a[3] * b[k] + a[k] * b[3] + a[i] * b[j] - a[j] * b[i];
    }
    out[3] = a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2];
}

FN void exponential(V3 u, double* q) {
    const double angle = norm(u), s = angle > 1e-8 ? sin(0.5 * angle) / angle : 0.5;
    put3(q, u * (real)s);
    q[3] = cos(0.5 * angle);
}

// Turn and way of the root at the mean of the velocities before and after, in its own axes.
FN void carried(const double* state, const double* change, V3& turn, V3& way) {
    V3 a, b;
    own_velocity(state, a, b);
    turn = (a + v3(change[NQ], change[NQ + 1], change[NQ + 2]) * (real)0.5) * (real)TRAPEZOID;
    way = (b + v3(change[NQ + 3], change[NQ + 4], change[NQ + 5]) * (real)0.5) * (real)TRAPEZOID;
}

// From a prediction to the change of the state, as trapezoid.rs.
FN void trapezoid(const double* state, double* change) {
    if (TRAPEZOID == 0) return;
    for (int i = 0; i < NJ; i++) change[COORDS + i] += TRAPEZOID * (state[NQ + DOFS + i] + 0.5 * change[NQ + DOFS + i]);
    if (!DOFS) return;
    V3 u, way;
    double e[4], turned[4];
    carried(state, change, u, way);
    exponential(u, e);
    product(e, change + 3, turned);
    add3(change, way);
    for (int k = 0; k < 4; k++) change[3 + k] = turned[k];
}

// The state that lies a prediction from `state`, in its place; 0 or GONE.
BIG int apply(double* state, const float* prediction) {
    double change[STATE], next[STATE];
    for (int k = 0; k < STATE; k++) change[k] = (double)prediction[k] * STRETCH[k] + SHIFT[k];
    trapezoid(state, change);
    for (int k = 0; k < STATE; k++) next[k] = state[k] + change[k];
    if (DOFS) {
        double s[4], by[3], n = 0;
        for (int k = 0; k < 4; k++) n += state[3 + k] * state[3 + k];
        for (int k = 0; k < 4; k++) s[k] = state[3 + k] / sqrt(n);
        rotate(s, change, 1, by);
        for (int k = 0; k < 3; k++) next[k] = state[k] + by[k];
        multiply(s, change + 3, next + 3);
        // The velocity (w, v) about the world's origin, in axes that stand where the root stood.
        double w[3], v[3];
        rotate(s, change + NQ, 1, w);
        rotate(s, change + NQ + 3, 1, v);
        const double cross[3] = {state[1] * w[2] - state[2] * w[1], state[2] * w[0] - state[0] * w[2], state[0] * w[1] - state[1] * w[0]};
        for (int k = 0; k < 3; k++) {
            next[NQ + k] = state[NQ + k] + w[k];
            next[NQ + 3 + k] = state[NQ + 3 + k] + cross[k] + v[k];
        }
    }
    for (int k = 0; k < STATE; k++) if (!(next[k] - next[k] == 0)) return GONE;
    wrap(next);
    for (int k = 0; k < STATE; k++) state[k] = next[k];
    return 0;
}
