// What touches in a substep: points on surfaces, joints beyond limits, dry friction; and drives. As articulated/touches.rs.
// NP points (locus.cuh); NC colliders at most; per joint DAMPING, DRY, LIMIT (lower, upper, stiffness, damping),
// TOP, SPRING and SLACK (stiffness, and where it pulls to).

constexpr int SCENE = SHARED + OWN;          // numbers of a scene's record
constexpr int DRIVES = DRIVEN ? NJ : 0;
constexpr int PAIRS = NP * NC;
constexpr int MOST = PAIRS + PRESSED + 1;            // PRESSED: dry friction, both ends of a range
constexpr int WEIGHTS = PAIRS + 2 * NJ + DRIVES + 1;
constexpr int DRIVEN_AT = PAIRS + 2 * NJ;            // where those of the drives begin

struct Touch {
    int index;
    int link;             // of a point; -1: of a joint
    int dof;              // of a joint
    V3 x;                 // where, or the joint's column
    V3 start, turn;       // of a point: its velocity at the start, and what that changes by without accelerations (touch.rs)
    V3 normal, velocity, force;
    real gap, stiffness, damping, friction_damping, friction, release, across;
    real ahead[3];
#if TURNS
    V3 spin;              // of a point: how its link turns
    real torsion, rolling, about, turning;    // what resists that (m), and drags about the normal and across it
#endif
    bool sticky, bounded, parted;
};

// Drives of all joints, each number of all of them together: they act in every substep, and a thread that fetches the next joint's number with this
// one's waits once for both.
constexpr int PULLS = DRIVES + 1;
struct Drives {
    double target[PULLS];
    real kp[PULLS], kd[PULLS], speed[PULLS], effort[PULLS];
    real ahead[2][PULLS];
    // The torque without accelerations, and what a change of velocity by h takes off it, until it is beyond a bound and held there.
    real torque[PULLS], resists[PULLS], low[PULLS], high[PULLS];
    unsigned held[PULLS / 32 + 1];
};
FN bool held(const Drives& d, int i) { return d.held[i / 32] >> i % 32 & 1; }

struct Work {
    Tree tree;
    Surface surface[NC + 1];
    int surfaces;
#if PAIRED
    const double* pairs;
#endif
    V3 gravity;
    Touch touch[MOST];
    int touches, points;  // the points' come first
    double tau[NJ + 1];   // as asked for, but here those of a warp's environments lie side by side
    Drives drives;
    real weight[WEIGHTS]; // w, found once a frame; negative: not yet
    bool plain;           // whether the substep's mass matrix is factorised, and
    real alone[NJ + 1];   // accelerations of joints under a unit torque are found
    real braked[NJ + 1], damper[NJ + 1], spring[NJ + 1], pull[NJ + 1];    // as articulated/touches.rs
    bool even;            // whether contacts and limits take the means over a substep
    bool eventful;        // whether something was met in the frame that may give energy
    double work, effort;  // of the drives in the frame, and its size either way
    double before[WHIPS ? NQ : 1];
    Along along;
    Wrench external[FOLDS ? NL : 1];      // what links do to each other
    real rate[NV], middle[NV], right[NV], qdd[NV];
    // Of the substep's first solves, where a second middle was found: whether it was one solve, its rate, and which touches were idle (with drives; else none).
    real guess[NV];
    bool twice, once, early[DRIVEN ? MOST + DRIVES : 1];
};

// Whether a touch does nothing, or a drive, which come after the touches, what does not change.
FN bool idle(const Work& w, int n) { return n < w.touches ? w.touch[n].parted : held(w.drives, n - w.touches); }

// Whom a frame tells of its substeps: nobody, or who goes back over them (back.cuh).
struct Nobody {
    static constexpr int most = 1 << 30;   // substeps of a frame that it can be told of
    void begin(bool, int) const {}
    void begins(const Work&, int) const {}
    void ends(const Work&, int, real) const {}
};

FN double stands(const Work& w, int k) { return DOFS ? w.tree.q[k] : STAND[k]; }

// The scene from where the root stands now.
FN void survey(Work& w, const double* scene) {
    const double o[3] = {stands(w, 0), stands(w, 1), stands(w, 2)};
    w.surfaces = 0;
#if PAIRED
    w.pairs = scene + PAIRS_AT;
#endif
    for (int c = 0; c < NC; c++) {
        const double* s = scene + 3 + COLLIDER * c;
        if (!(int)s[0]) break;
        Surface& u = w.surface[w.surfaces++];
        read(u, s, o);
    }
}

// What a frame is asked for: torques and drives, or servos of a law KP, KD within BOUND by their torques as it begins, as drive.rs.
#if SERVO
FN void ask(Work& w, const double* state, const double* tau, const double* scene, const double*) {
    for (int i = 0; i < NJ; i++) {
        const double kp = KP(scene)[i], kd = KD(scene)[i], q = state[COORDS + i], qd = state[NQ + DOFS + i];
        w.tau[i] = kp > 0 || kd > 0 ? 0 : tau[i];
        w.drives.kp[i] = (real)kp; w.drives.kd[i] = (real)kd; w.drives.effort[i] = (real)BOUND[i];
        w.drives.target[i] = kp > 0 ? q + (tau[i] + kd * qd) / kp : 0;
        w.drives.speed[i] = kp > 0 || !(kd > 0) ? 0 : (real)(qd + tau[i] / kd);
    }
}

// Gradients by the torques and the state from those by targets and speeds.
FN void servos_back(const double* scene, const real (*by)[2], double* by_state, double* by_tau) {
    for (int i = 0; i < NJ; i++) {
        const double kp = KP(scene)[i], kd = KD(scene)[i];
        if (kp > 0) {
            by_tau[i] = by[i][0] / kp;
            by_state[DOFS + i] += by[i][0];
            by_state[NV + DOFS + i] += by[i][0] * kd / kp;
        } else if (kd > 0) {
            by_tau[i] = by[i][1] / kd;
            by_state[NV + DOFS + i] += by[i][1];
        }
    }
}
#else
FN void ask(Work& w, const double*, const double* tau, const double*, const double* drives) {
    for (int i = 0; i < NJ; i++) w.tau[i] = tau[i];
    for (int i = 0; i < DRIVES; i++) {
        const double* d = drives + 5 * i;
        w.drives.target[i] = d[2];
        w.drives.kp[i] = (real)d[0]; w.drives.kd[i] = (real)d[1]; w.drives.speed[i] = (real)d[3]; w.drives.effort[i] = (real)d[4];
    }
}
#endif

// What a substep meets.
FN void see(Work& w, const double* scene) {
    w.gravity = v3((real)scene[0], (real)scene[1], (real)scene[2]);
    survey(w, scene);
}

// The material of a point on a surface.
#if PAIRED
FN const double* material(const Work& w, int point, int c) { return w.pairs + MATERIAL * (point * NC + c); }
#else
FN const real* material(const Work& w, int, int c) { return w.surface[c].material; }
#endif
// Whether they ever meet, and how far apart their forces begin.
FN bool may(const Work& w, int point, int c) { return !PAIRED || material(w, point, c)[0] >= 0; }
FN real margin(const Work& w, int point, int c) { return (real)material(w, point, c)[6]; }

// Of a gap in the middle of a substep and its change to the end: the part of the substep in which it is negative, and its mean there.
FN bool inside(real& gap, real half, real& part) {
    const real low = gap - size(half), high = gap + size(half);
    if (!(low < 0)) return false;
    part = 1;
    if (high > 0) { part = low / (low - high); gap = (real)0.5 * low; }
    return true;
}

FN Touch& next(Work& w) {
    Touch& t = w.touch[w.touches++];
    t.sticky = t.bounded = t.parted = false;
    t.friction_damping = t.friction = t.release = t.across = 0;
    t.force = t.turn = v3(0, 0, 0);
#if TURNS
    t.torsion = t.rolling = t.about = t.turning = 0;
#endif
    return t;
}

FN real falls(const Work& w, real h) { return h * h * norm(w.gravity); }

FN void press(Work& w, int point, int c, V3 n, V3 nearest, real h) {
    if (!may(w, point, c)) return;
    const int link = POINT_LINK[point];
    const V3 x = facing(w.tree, point, n, true) - n * RADIUS[point];
    const V3 velocity = at(w.tree.velocity[link], x);
    real gap = dot(n, x - nearest) - margin(w, point, c), part;
    const real half = (real)0.5 * h * dot(n, velocity);
    if (!inside(gap, half, part)) {
        // A point that falls by this distance may land within the substep although it would not at its present velocity.
        w.eventful = w.eventful || gap - size(half) < falls(w, h);
        return;
    }
    w.eventful = w.eventful || (LOCI && LOCUS[point]);
    Touch& t = next(w);
    const auto* m = material(w, point, c);
    t.index = point * w.surfaces + c; t.link = link; t.x = x; t.normal = n; t.start = t.velocity = velocity; t.gap = gap;
    t.stiffness = part * (real)m[0]; t.damping = part * (real)m[1]; t.friction_damping = part * (real)m[2]; t.friction = (real)m[3]; t.release = (real)m[7];
#if TURNS
    t.spin = w.tree.velocity[link].ang; t.torsion = (real)m[4]; t.rolling = (real)m[5];
#endif
}

// Points of a word of the mask of those that may touch.
constexpr int WORD = 32, WORDS = NP / WORD + 1;

// Which points may be beyond a plane in some part of the substep: for all of them together little work, and none for those that are far.
// A distance that is not a number may be anywhere. Of ground that is not flat, which may be beyond the plane of its highest place: a ball touches a
// slope before it comes down to it.
FN void near(const Work& w, real h, unsigned* mask) {
    const Tree& t = w.tree;
    const Surface& plane = w.surface[0];
    const V3 n = plane.normal;
    const real fall = falls(w, h);
#if FIELDS
    const bool field = plane.kind == 4;
    const real steep = field ? plane.steep : 1;
#else
    constexpr bool field = false;
    constexpr real steep = 1;
#endif
    onward<0, NP, UNROLLED && NP <= 64>([&](auto point) {
        if (!may(w, point, 0)) return;
        const int link = POINT_LINK[point];
        const real radius = RADIUS[point] + margin(w, point, 0) + fall;
        if (LOCI && LOCUS[point]) {
            // Wherever on its link it lies, it does not come down: its vertices need not be asked.
            const V3 m = middle(t, point);
            const real speed = norm(at(t.velocity[link], m)) + norm(t.velocity[link].ang) * REACH[point];
            const real d = dot(n, m) - plane.offset - steep * (REACH[point] + radius);
            if (d > steep * (real)0.5 * h * speed + (real)1e-4 * (1 + size(d) + size(plane.offset))) return;
            if (field) { mask[point / WORD] |= 1u << point % WORD; return; }
        }
        const V3 p = facing(t, point, n, true);
        const V3 v = at(t.velocity[link], p);
        const real d = dot(n, p) - plane.offset, way = h * (field ? norm(v) : (real)0.5 * dot(n, v));
        // With room for rounding; `press` decides.
        if (!(d - steep * (radius + size(way)) > (real)1e-4 * (1 + size(d) + size(plane.offset)))) mask[point / WORD] |= 1u << point % WORD;
    });
}

// What a point that may touch does; false if a distance is none.
FN bool meet(Work& w, int point, real h) {
    const Tree& tr = w.tree;
    V3 n, nearest;
    if (w.surfaces == 1) {
        const real d = meets(tr, w.surface[0], point, n, nearest);
        if (!(d == d)) return false;
        press(w, point, 0, n, nearest, h);
        return true;
    }
    const Motion& twist = tr.velocity[POINT_LINK[point]];
    real speed = norm(at(twist, middle(tr, point)));
    if (LOCI) speed += norm(twist.ang) * REACH[point];
    real d[NC + 1];
    for (int c = 0; c < w.surfaces; c++) {
        d[c] = may(w, point, c) ? meets(tr, w.surface[c], point, n, nearest) : infinite();
        if (!(d[c] == d[c])) return false;
    }
    for (int c = 0; c < w.surfaces; c++) {
        const real reach = RADIUS[point] + margin(w, point, c) + falls(w, h) + h * speed;
        if (!(d[c] < reach)) continue;
        meets(tr, w.surface[c], point, n, nearest);
        // A place of a surface that a nearer collider covers is no surface.
        bool covered = false;
        for (int o = 0; o < w.surfaces && d[c] > 0 && !covered; o++) {
            const bool nearer = d[o] < reach && (d[o] < d[c] || (d[o] == d[c] && o < c));
            V3 m, place;
            covered = nearer && distance(w.surface[o], nearest, m, place) < (real)1e-6;
        }
        if (!covered) press(w, point, c, n, nearest, h);
    }
    return true;
}

// All points and joints that are beyond their surface in some part of the substep in whose middle they are now; false if a distance
// is none.
BIG bool find(Work& w, real h) {
    Tree& tr = w.tree;
    velocities(tr, tr.qd);
    w.touches = 0;
    onward<0, NJ>([&](auto i) { w.pull[i] = SPRING[i] == 0 ? 0 : SPRING[i] * (real)((double)SLACK[i] - tr.q[COORDS + i]); });
    unsigned mask[WORDS];
    const bool flat = w.surfaces == 1 && (w.surface[0].kind == 1 || FIELDS && w.surface[0].kind == 4);
    for (int k = 0; k < WORDS; k++) mask[k] = flat ? 0 : ~0u;
    if (flat) near(w, h, mask);
    for (int k = 0; k < WORDS && w.surfaces > 0; k++) {
        unsigned left = mask[k];
        for (int point = k * WORD; left && point < NP; point++, left >>= 1)
            if (left & 1 && !meet(w, point, h)) return false;
    }
    w.points = w.touches;
    const int points = NP * w.surfaces;
    for (int i = 0; i < NJ; i++) {
        if (!(DRY(tr)[i] > 0)) continue;
        // Pressed with its friction at a coefficient of 1.
        Touch& t = next(w);
        t.index = points + NJ + i; t.link = -1; t.dof = DOFS + i; t.x = v3(0, 1, 0); t.normal = v3(1, 0, 0);
        t.stiffness = 1; t.damping = 0; t.friction_damping = DRY(tr)[i] / CREEP; t.friction = 1;
        t.gap = -DRY(tr)[i]; t.start = t.velocity = v3(0, tr.qd[DOFS + i], 0);
    }
    for (int i = 0; i < NJ; i++) {
        const real* limit = LIMIT + 4 * i;
        if (!(limit[2] > 0 || limit[3] > 0)) continue;
        for (int end = 0; end < 2; end++) {
            const real side = end ? -1 : 1;
            const real v = side * tr.qd[DOFS + i];
            real gap = side * (real)(tr.q[COORDS + i] - (double)limit[end]), part;
            if (!inside(gap, (real)0.5 * h * v, part)) continue;
            Touch& t = next(w);
            t.index = points + i; t.link = -1; t.dof = DOFS + i; t.x = v3(side, 0, 0); t.normal = v3(1, 0, 0);
            t.stiffness = part * limit[2]; t.damping = part * limit[3];
            t.sticky = true;
            t.gap = gap; t.start = t.velocity = v3(v, 0, 0);
        }
    }
    return true;
}

// The columns of a point's Jacobian: a[k] of each DoF from the link upward.
template <class I> FN void columns(const Tree& t, I link, V3 x, V3* a) {
    upward(last_dof(link), [&](auto k) { a[k] = v3(0, 0, 0); });
    lineage(link, [&](auto i) {
        if (DOFS && i == 0) {
            for (int k = 0; k < 6; k++) a[k] = k < 3 ? cross(unit(k), x) : unit(k - 3);
        } else {
            // Joints that follow one share its column.
            const int k = DOF[i];
            a[k] = a[k] + at(t.axis[i], x);
        }
    });
}

#if TURNS
// The columns of a link's turn likewise.
template <class I> FN void spins(const Tree& t, I link, V3* a) {
    upward(last_dof(link), [&](auto k) { a[k] = v3(0, 0, 0); });
    lineage(link, [&](auto i) {
        if (DOFS && i == 0) for (int k = 0; k < 3; k++) a[k] = unit(k);
        else a[DOF[i]] = a[DOF[i]] + t.axis[i].ang;
    });
}

// Of a point, whether torsional or rolling friction acts; their drags, at a normal force and a turn, and their torque.
FN bool turns(const Touch& t) { return t.torsion > 0 || t.rolling > 0; }
FN void turn_drags(const Touch& t, real normal, V3 spin, real& about, real& across) {
    const real rate = dot(t.normal, spin);
    about = t.torsion * normal / most(size(rate), CREEP);
    across = t.rolling * normal / most(norm(spin - t.normal * rate), CREEP);
}
FN V3 turn_torque(const Touch& t, V3 spin) { return t.normal * ((t.turning - t.about) * dot(t.normal, spin)) - spin * t.turning; }
#endif

// f(touch, link) for every point that touches.
template <class F> FN void points(Work& w, const F& f) {
    if constexpr (UNROLLED)
        onward<0, NL>([&](auto link) {
            if constexpr (pointed(link.n))
                for (int k = 0; k < w.points; k++) if (w.touch[k].link == link) f(w.touch[k], link);
        });
    else
        for (int k = 0; k < w.points; k++) f(w.touch[k], w.touch[k].link);
}

// Friction over slip.
FN real drag(real normal, real speed, real friction_damping, real friction) {
    const real limit = friction * normal;
    return friction_damping * speed <= limit ? friction_damping : limit / speed;
}
