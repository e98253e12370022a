// The computation around the network, as in features.rs and frame.rs: contacts and the token of a frame, then the next
// state from a prediction. The host defines the constants (device/mod.rs): INPUTS and LDX, the width and stride of
// tokens; SEEN, the threshold of a contact point; WAVES, how many sines and cosines of a joint end a token; MEAN, SCALE
// and RATE (1 / SCALE) of tokens; SHIFT and STRETCH of predictions.

constexpr int STATE = NQ + NV;

struct Event { V3 p0, normal, p1; real distance; };

// Finds the scene's point nearest to contact point p, relative to the root.
FN Event look(const Work& w, int p) {
    Event e;
    e.distance = infinite();
    e.p0 = middle(w.tree, p);
    for (int c = 0; c < w.surfaces; c++) {
        if (!may(w, p, c)) continue;
        V3 normal, nearest;
        const real d = meets(w.tree, w.surface[c], p, normal, nearest);
        if (!(d < e.distance)) continue;
        e.distance = d; e.normal = normal; e.p1 = nearest;
    }
    return e;
}

// Nearness of a gap, as in features.rs. Then the gap (m) of contact point p, now or one frame later at the velocity
// `speed`.
FN real nearness(real gap) { return gap / sqrt(gap * gap + (real)(NEAR * NEAR)); }
FN real gap(const Event& e, int p, V3 speed, int ahead) {
    return e.distance - RADIUS[p] + (ahead ? (real)FRAME_TIME * dot(e.normal, speed) : 0);
}

FN V3 column(const M3& a, int k) { return v3(a.m[k], a.m[3 + k], a.m[6 + k]); }

// Writes number k of a token, normalised.
FN void put(float* token, int k, double x) { token[k] = (float)(((real)(float)x - MEAN[k]) * RATE[k]); }
FN void put(float* token, int k, V3 v) { put(token, k, v.x); put(token, k + 1, v.y); put(token, k + 2, v.z); }

// Offsets in a token: normals, scene points, distances, velocities and nearness of contact points, torques and gravity,
// axes of links, sines and cosines.
constexpr int NORMALS = STATE, PLACES = NORMALS + 3 * NP, DEPTHS = PLACES + 3 * NP, SPEEDS = DEPTHS + NP;
constexpr int NEARS = SPEEDS + 3 * NP, TORQUES = MOVING ? NEARS + 2 * NP : SPEEDS;
constexpr int AXES = TORQUES + NJ + (SITUATED ? 3 : 0), ENDS = AXES + (SITUATED && MOVING ? 6 * (NL - 1) : 0);

// Writes the token of a frame. The `lanes` threads share contact points and links; the first thread writes the rest.
BIG void tell(const double* state, const double* tau, const double* scene, float* token, int lane = 0, int lanes = 1) {
    Work w;
    Tree& t = w.tree;
    take(t, state);
    M3 r = {{1, 0, 0, 0, 1, 0, 0, 0, 1}};
    V3 o = v3(0, 0, 0);
    if (SITUATED) {
        kinematics(t);
        survey(w, scene);
        // Frame B: at the floating base or the first moving link.
        r = t.rotation[0];
        o = t.position[0];
    }
    if (MOVING && NP) velocities(t, t.qd);
    for (int p = lane; p < NP; p += lanes) {
        const Event e = look(w, p);
        const V3 none = v3(0, 0, 0);
        const bool seen = e.distance < SEEN[p];
        put(token, NORMALS + 3 * p, seen ? back(r, e.normal) : none);
        put(token, PLACES + 3 * p, seen ? back(r, e.p1 - o) : none);
        put(token, DEPTHS + p, seen ? e.distance : (real)0);
        if (!MOVING) continue;
        const V3 speed = seen ? at(t.velocity[POINT_LINK[p]], facing(t, p, e.normal, true)) : none;
        put(token, SPEEDS + 3 * p, back(r, speed));
        for (int ahead = 0; ahead < 2; ahead++)
            put(token, NEARS + ahead * NP + p, seen ? nearness(gap(e, p, speed, ahead)) : (real)1);
    }
    for (int i = 1 + lane; SITUATED && MOVING && i < NL; i += lanes)
        for (int k = 0; k < 2; k++) put(token, AXES + 6 * (i - 1) + 3 * k, back(r, column(t.rotation[i], k)));
    if (lane) return;
    for (int k = 0; DOFS && k < 7; k++) put(token, k, k == 6);
    const int joints = DOFS ? 7 : 0, speeds = joints + NJ + (DOFS ? 6 : 0);
    for (int i = 0; i < NJ; i++) {
        const double q = state[COORDS + i];
        put(token, joints + i, WAVES[i] == 1 ? sin(q) : SITUATED && WRAPS[i] ? wrapped(q) : q);
        put(token, speeds + i, state[NQ + DOFS + i]);
        put(token, TORQUES + i, tau[i]);
    }
    if (DOFS) {
        put(token, joints + NJ, back(r, v3(t.qd[0], t.qd[1], t.qd[2])));
        put(token, joints + NJ + 3, back(r, v3(t.qd[3], t.qd[4], t.qd[5])));
    }
    if (SITUATED) {
        const V3 g = v3((real)scene[0], (real)scene[1], (real)scene[2]);
        const real length = norm(g);
        put(token, TORQUES + NJ, back(r, g * (1 / (length > 0 ? length : 1))));
    }
    int k = ENDS;
    for (int i = 0; i < NJ; i++) {
        if (WAVES[i] == 2) put(token, k++, sin(state[COORDS + i]));
        if (WAVES[i]) put(token, k++, cos(state[COORDS + i]));
    }
    for (; k < LDX; k++) token[k] = 0;
}

FN void exponential(V3 u, double* q) {
    const double angle = norm(u), s = angle > 1e-8 ? sin(0.5 * angle) / angle : 0.5;
    put3(q, u * (real)s);
    q[3] = cos(0.5 * angle);
}

// Rotation vector (rad) and translation (m) of the root over a frame, in body axes. They are at the mean of the
// velocities before and after the frame.
FN void carried(const double* state, const double* change, V3& turn, V3& way) {
    V3 a, b;
    own_velocity(state, a, b);
    turn = (a + v3(change[NQ], change[NQ + 1], change[NQ + 2]) * (real)0.5) * (real)TRAPEZOID;
    way = (b + v3(change[NQ + 3], change[NQ + 4], change[NQ + 5]) * (real)0.5) * (real)TRAPEZOID;
}

// Converts a prediction to the change of the state, as in trapezoid.rs.
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

// Applies a prediction to `state`. Returns 0, or GONE if a number is not finite.
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
        // The velocity (w, v) about the world's origin, from the root's axes before the frame.
        double w[3], v[3];
        rotate(s, change + NQ, 1, w);
        rotate(s, change + NQ + 3, 1, v);
        const double cross[3] = {state[1] * w[2] - state[2] * w[1], state[2] * w[0] - state[0] * w[2],
                                 state[0] * w[1] - state[1] * w[0]};
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
