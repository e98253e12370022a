// The computation around a chain's network in 64 bits, as in chain/*.rs: rods, contacts and tokens of a state, then the
// next state. The host defines the constants (device.rs): INPUTS and LDX, the width and stride of tokens; FRAME, the
// frame time (s); HOME, STIFFNESS and PULSE of the gripper; STRETCH of outputs; WRAPS of coordinates.

#ifndef __CUDACC_RTC__
using std::tanh; using std::hypot; using std::atan2; using std::copysign;
#endif

constexpr int HALF = 6 + 2 * RODS, STATE = 2 * HALF;
constexpr int GRIPPER = 12;                       // position, velocity, angles, rates
constexpr int CHAIN = GRIPPER + 6 * RODS;         // the gripper, directions of rods, their rates

// Axes of a link and its angular velocity (rad/s), in world axes.
struct Axes { V3 c[3]; V3 w; };

// Rotates the axes by `angle` (rad) about body axis k, at `rate` (rad/s).
FN void turn(Axes& a, int k, double angle, double rate) {
    a.w = a.w + a.c[k] * rate;
    const double s = sin(angle), c = cos(angle);
    const int i = (k + 1) % 3, j = (k + 2) % 3;
    const V3 x = a.c[i], y = a.c[j];
    a.c[i] = x * c + y * s;
    a.c[j] = y * c - x * s;
}

FN Axes axes(const double* gripper) {
    Axes a = {{v3(1, 0, 0), v3(0, 1, 0), v3(0, 0, 1)}, v3(0, 0, 0)};
    turn(a, 2, gripper[6], gripper[9]);
    turn(a, 1, gripper[7], gripper[10]);
    turn(a, 0, gripper[8], gripper[11]);
    return a;
}

// Direction t of the gripper's x axis (world, unit length), and its rate (1/s).
FN void points(const double* gripper, V3& t, V3& rate) {
    const double sy = sin(gripper[6]), cy = cos(gripper[6]), sp = sin(gripper[7]), cp = cos(gripper[7]);
    t = v3(cy * cp, sy * cp, -sp);
    rate = v3(-sy * cp, cy * cp, 0) * gripper[9] + v3(-cy * sp, -sy * sp, -cp) * gripper[10];
}

// The gripper's motion in a frame under its drives alone.
FN void glide(const double* gripper, const double* tau, double* next) {
    for (int k = 0; k < 6; k++) {
        const int x = k < 3 ? k : k + 3, v = x + 3;
        const double goal = tau[k] / STIFFNESS[k] + (k < 3 ? HOME[k] : 0.0), w = PULSE[k];
        const double e = gripper[x] - goal, fade = exp(-w * FRAME), pull = gripper[v] + w * e;
        next[x] = goal + (e + pull * FRAME) * fade;
        next[v] = (gripper[v] - w * pull * FRAME) * fade;
    }
}

FN void write3(double* p, V3 v) { p[0] = v.x; p[1] = v.y; p[2] = v.z; }
FN float* put(float* out, V3 v) { out[0] = (float)v.x; out[1] = (float)v.y; out[2] = (float)v.z; return out + 3; }
FN float* put(float* out, double x) { *out = (float)x; return out + 1; }

// Converts a state to rods: the gripper, directions and their rates.
BIG void rods(const double* state, double* chain) {
    const double *q = state, *qd = state + HALF;
    for (int k = 0; k < 3; k++) {
        chain[k] = HOME[k] + q[k];
        chain[3 + k] = qd[k];
        chain[6 + k] = q[3 + k];
        chain[9 + k] = qd[3 + k];
    }
    Axes a = axes(chain);
    for (int k = 0; k < RODS; k++) {
        turn(a, 2, q[6 + 2 * k], qd[6 + 2 * k]);
        turn(a, 1, q[7 + 2 * k], qd[7 + 2 * k]);
        write3(chain + GRIPPER + 3 * k, a.c[0]);
        write3(chain + GRIPPER + 3 * (RODS + k), cross(a.w, a.c[0]));
    }
}

// The gripper's motion under its drives alone, in the units of tokens.
struct Ahead { V3 change, velocity, swing, direction; };

FN Ahead ahead(const double* gripper, const double* glided) {
    V3 before, swing, direction, swung;
    points(gripper, before, swing);
    points(glided, direction, swung);
    const V3 velocity = read3(glided + 3);
    Ahead a = {(velocity - read3(gripper + 3)) * QUICK, velocity, (swung - swing) * 0.5, direction};
    return a;
}

// Normal and gap (m) of the surface nearest to a position. Beyond REACH the normal is 0 and the gap is REACH. Returns
// 0, or LOST if a distance is NaN.
FN int touch(const Surface* surface, int surfaces, V3 place, V3& normal, double& gap) {
    double nearest = infinite();
    normal = v3(0, 0, 0);
    for (int c = 0; c < surfaces; c++) {
        V3 n, at;
        const double d = distance(surface[c], place, n, at);
        if (!(d == d)) return LOST;
        if (d < nearest) { nearest = d; normal = n; }
    }
    gap = nearest - RADIUS;
    if (gap >= REACH) { gap = REACH; normal = v3(0, 0, 0); }
    return 0;
}

// Writes the token of a rod.
FN void token(float* out, V3 along, V3 rate, V3 velocity, V3 normal, double gap, const Ahead& ahead) {
    const double speed = dot(velocity, normal);
    out = put(put(put(put(out, along), rate * 0.1), velocity * 0.5), normal);
    out = put(put(put(out, 20.0 * gap), copysign(exp(-size(gap) / RADIUS), gap)), tanh(4.0 * gap / RADIUS));
    out = put(put(out, 0.5 * speed), tanh((gap + speed * FRAME) / (0.75 * RADIUS)));
    out = put(out, gap < REACH ? 1.0 : 0.0);
    out = put(put(put(put(out, ahead.change), ahead.velocity), ahead.swing), ahead.direction);
    for (int i = INPUTS; i < LDX; i++) out = put(out, 0.0);
}

// Writes the rods' tokens `[rod][LDX]`, and to `memo` the chain for `apply`. Returns 0 or a fault code.
BIG int tell(const double* state, const double* tau, const double* scene, double* memo, float* tokens) {
    Surface surface[NC + 1];
    int surfaces = 0;
    const double origin[3] = {0, 0, 0};
    for (int c = 0; c < NC && (int)scene[3 + COLLIDER * c]; c++)
        read(surface[surfaces++], scene + 3 + COLLIDER * c, origin);
    double glided[GRIPPER];
    rods(state, memo);
    glide(memo, tau, glided);
    const Ahead before = ahead(memo, glided);
    V3 node = read3(memo), velocity = read3(memo + 3);
    for (int k = 0; k < RODS; k++) {
        const V3 along = read3(memo + GRIPPER + 3 * k), rate = read3(memo + GRIPPER + 3 * (RODS + k));
        node = node + along * LENGTH;
        velocity = velocity + rate * LENGTH;
        V3 normal;
        double gap;
        if (touch(surface, surfaces, node, normal, gap)) return LOST;
        token(tokens + (long long)k * LDX, along, rate, velocity, normal, gap, before);
    }
    for (int k = 0; k < GRIPPER; k++) memo[k] = glided[k];
    return 0;
}

FN V3 said3(const float* said, int first) {
    return v3(said[first] * STRETCH[first], said[first + 1] * STRETCH[first + 1], said[first + 2] * STRETCH[first + 2]);
}

// New direction of a rod before normalisation, and its new rate u (1/s): the old ones with the outputs added.
FN V3 said(const double* chain, int k, const float* row, V3& u) {
    const V3 rate = read3(chain + GRIPPER + 3 * (RODS + k));
    u = rate + said3(row, 0);
    return read3(chain + GRIPPER + 3 * k) + (rate + u) * (0.5 * FRAME) + said3(row, 3);
}

// Replaces `state` by the next state, from the outputs `[rod][OUTPUTS]`. Returns 0, or GONE if a number is not finite.
BIG int apply(double* state, const double* memo, const float* numbers) {
    double gripper[GRIPPER], next[STATE];
    for (int k = 0; k < GRIPPER; k++) gripper[k] = memo[k] + numbers[6 + k] * STRETCH[6 + k];
    double *q = next, *qd = next + HALF;
    for (int k = 0; k < 3; k++) {
        q[k] = gripper[k] - HOME[k];
        qd[k] = gripper[3 + k];
        q[3 + k] = gripper[6 + k];
        qd[3 + k] = gripper[9 + k];
    }
    Axes a = axes(gripper);
    for (int k = 0; k < RODS; k++) {
        const float* row = numbers + k * OUTPUTS;
        V3 u;
        const V3 raw = said(memo, k, row, u);
        const V3 t = raw * (1 / norm(raw));
        const V3 own = v3(dot(a.c[0], t), dot(a.c[1], t), dot(a.c[2], t));
        const V3 r = u - t * dot(t, u) - cross(a.w, t);
        const double level = hypot(own.x, own.y), length = hypot(level, own.z), c = level / length, s = -own.z / length;
        const int first = 6 + 2 * k, second = first + 1;
        q[first] = atan2(own.y, own.x);
        q[second] = atan2(-own.z, level);
        turn(a, 2, q[first], 0);
        qd[first] = dot(r, a.c[1]) / c;
        qd[second] = -dot(r, a.c[2] * c + a.c[0] * s);
        a.w = a.w + a.c[2] * qd[first];
        turn(a, 1, q[second], qd[second]);
    }
    for (int k = 0; k < STATE; k++) if (!(next[k] - next[k] == 0)) return GONE;
    for (int k = 0; k < HALF; k++) state[k] = WRAPS[k] ? wrapped(next[k]) : next[k];
    for (int k = HALF; k < STATE; k++) state[k] = next[k];
    return 0;
}
