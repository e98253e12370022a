// Touches of a substep (contacts, joints beyond limits, dry friction) and drives, found as in articulated/find.rs. The
// law of friction is that of touch.rs, stick.rs and turning.rs; press.cuh applies it. NP points (locus.cuh), NC
// colliders. Per joint: DAMPING, DRY, LIMIT (ends, stiffness, damping), TOP (velocity), SPRING, SLACK.

constexpr int SCENE = SHARED + OWN;          // numbers of a scene's record
constexpr int DRIVES = DRIVEN ? NJ : 0;
constexpr int PAIRS = NP * NC;
constexpr int MOST = PAIRS + PRESSED + 1;            // most touches; PRESSED: those at joints
constexpr int WEIGHTS = PAIRS + 2 * NJ + DRIVES + 1;
constexpr int DRIVEN_AT = PAIRS + 2 * NJ;            // first weight of the drives

struct Touch {
    int index;
    int link;             // of a contact; -1: of a joint
    int dof;              // of a joint
    V3 x;                 // contact position (from the root), or the joint's column
    V3 start, turn;       // of a contact: velocity at the substep's start, its rate at zero qdd (touch.rs)
    V3 normal, velocity, force;
    V3 slip_offset, slip_offset_start;   // of a contact: slip with zero drag force, now and at the start (touch.rs)
    real gap, stiffness, damping, friction_damping, friction, release, drag;   // damping: the one in use
    real approach;        // of a contact: damping while approaching (touch.rs)
    real theta[3];
#if TURNS
    V3 spin;              // of a contact: angular velocity of its link
    real torsion, rolling, about, turning;    // coefficients (m); drags about the normal and across it
    real gyration;                            // squared radius of gyration of the link (m^2)
    V3 turn_offset, turn_offset_start, torque; // turn without torque, now and at the start; torque (turning.rs)
#endif
    bool spring, drive, parted;   // a joint's limit or drive; a drive; a contact that would pull and no longer acts
};

// Drives of all joints, as a structure of arrays: memory loads for neighbouring joints overlap.
constexpr int PULLS = DRIVES + 1;
struct Drives {
    double target[PULLS];
    real kp[PULLS], kd[PULLS], speed[PULLS], effort[PULLS];
    real theta[2][PULLS];
    // Torque at unchanged velocity, and its decrease per change of velocity; at a bound, that bound and 0.
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
    int touches, points;  // contacts come first
    double tau[NJ + 1];   // a local copy, which the threads of a warp read side by side
    Drives drives;
    real weight[WEIGHTS]; // inverse effective masses w, computed once a frame; negative: unknown
    real slide[PAIRS + 1];         // of contacts: w across the normal
    V3 force_before[PAIRS + 1];    // of contacts: force (N) and torque (N m) of the substep before
#if TURNS
    V3 torque_before[PAIRS + 1];
#endif
    bool plain;           // whether the substep's mass matrix is factorised and `alone` known
    real alone[NJ + 1];   // w of joints: accelerations under a unit torque
    real damping_used[NJ + 1], damper[NJ + 1], spring[NJ + 1], pull[NJ + 1];    // damping, thetas, torque of the spring
    bool mean_theta;            // whether contacts and limits have theta 1/2 (springs 1/4) for any h
    bool may_gain_energy;        // whether something happened in the frame that may add energy
    bool creeps;              // whether a sticking contact creeps after the last solve
    bool touched;             // whether a point touched in the frame
    real velocity_factor;            // factor on velocities at the frame's end (articulated/energy.rs)
    double work, effort;  // of the drives in the frame; sum of its absolute values (J)
    double before[WHIPS ? NQ : 1];
    Along along;
    Wrench external[FOLDS ? NL : 1];      // forces between links
    real rate[NV], middle[NV], right[NV], qdd[NV];
    // `twice`: whether the substep had two stages. Its first: rate, whether a single solve, idle touches (if driven).
    real guess[NV];
    bool twice, once, early[DRIVEN ? MOST + DRIVES : 1];
};

// Whether a contact has separated or, for numbers after the touches, a drive is at its bound.
FN bool idle(const Work& w, int n) { return n < w.touches ? w.touch[n].parted : held(w.drives, n - w.touches); }

// Observer of a frame's substeps that does nothing; back.cuh has one that records them.
struct Nobody {
    static constexpr int most = 1 << 30;   // most substeps of a frame
    void begin(bool, int) const {}
    void begins(const Work&, int) const {}
    void ends(const Work&, int, real) const {}
};

FN double stands(const Work& w, int k) { return DOFS ? w.tree.q[k] : STAND[k]; }

// Surfaces relative to the root's position.
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

// Sets torques and drives of a frame. SERVO: drives are PD laws KP, KD within TORQUE_LIMIT, with targets that give
// `tau` at the start (drive.rs).
#if SERVO
FN void ask(Work& w, const double* state, const double* tau, const double* scene, const double*) {
    for (int i = 0; i < NJ; i++) {
        const double kp = KP(scene)[i], kd = KD(scene)[i], q = state[COORDS + i], qd = state[NQ + DOFS + i];
        w.tau[i] = kp > 0 || kd > 0 ? 0 : tau[i];
        w.drives.kp[i] = (real)kp; w.drives.kd[i] = (real)kd; w.drives.effort[i] = (real)TORQUE_LIMIT[i];
        w.drives.target[i] = kp > 0 ? q + (tau[i] + kd * qd) / kp : 0;
        w.drives.speed[i] = kp > 0 || !(kd > 0) ? 0 : (real)(qd + tau[i] / kd);
    }
}

// Adjoint of servos: gradients w.r.t. targets and speeds => by_tau, and by_state (added to).
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
        w.drives.kp[i] = (real)d[0]; w.drives.kd[i] = (real)d[1]; w.drives.speed[i] = (real)d[3];
        w.drives.effort[i] = (real)d[4];
    }
}
#endif

// Gravity and surfaces of a substep.
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
// Whether a point and a surface ever meet; margin of their contact (m).
FN bool may(const Work& w, int point, int c) { return !PAIRED || material(w, point, c)[0] >= 0; }
FN real margin(const Work& w, int point, int c) { return (real)material(w, point, c)[6]; }

// Gap in a substep's middle, half its change => part of the substep with a negative gap, mean gap there. False if none.
FN bool inside(real& gap, real half, real& part) {
    const real low = gap - size(half), high = gap + size(half);
    if (!(low < 0)) return false;
    part = 1;
    if (high > 0) { part = low / (low - high); gap = (real)0.5 * low; }
    return true;
}

FN Touch& next(Work& w) {
    Touch& t = w.touch[w.touches++];
    t.spring = t.drive = t.parted = false;
    t.friction_damping = t.friction = t.release = t.drag = t.approach = 0;
    t.force = t.turn = t.slip_offset = t.slip_offset_start = v3(0, 0, 0);
#if TURNS
    t.torsion = t.rolling = t.about = t.turning = t.gyration = 0;
    t.turn_offset = t.turn_offset_start = t.torque = v3(0, 0, 0);
#endif
    return t;
}

#if TURNS
// Squared radius of gyration of a link (m^2), as turning.rs.
FN real gyration(const Tree& t, int link) {
    const real* a = BODY(t) + 9 * link;
    const real x = a[4] * a[8] - a[5] * a[7], y = a[0] * a[8] - a[2] * a[6], z = a[0] * a[4] - a[1] * a[3];
    const real det = a[0] * x - a[1] * (a[3] * a[8] - a[5] * a[6]) + a[2] * (a[3] * a[7] - a[4] * a[6]);
    const real square = 3 * det / (MASS(t)[link] * (x + y + z));
    return square > MIN_GYRATION ? square : MIN_GYRATION;
}
#endif

FN real falls(const Work& w, real h) { return h * h * norm(w.gravity); }

// Adds the contact of a point with surface c, if inside it in some part of the substep.
FN void add_contact(Work& w, int point, int c, V3 n, V3 nearest, real h) {
    if (!may(w, point, c)) return;
    const int link = POINT_LINK[point];
    const V3 x = facing(w.tree, point, n, true) - n * RADIUS[point];
    const V3 velocity = at(w.tree.velocity[link], x);
    real gap = dot(n, x - nearest) - margin(w, point, c), part;
    const real half = (real)0.5 * h * dot(n, velocity);
    if (!inside(gap, half, part)) {
        // Gravity may land a point this near within the substep, although its present velocity would not.
        w.may_gain_energy = w.may_gain_energy || gap - size(half) < falls(w, h);
        return;
    }
    w.may_gain_energy = w.may_gain_energy || (LOCI && LOCUS[point]);
    Touch& t = next(w);
    const auto* m = material(w, point, c);
    t.index = point * w.surfaces + c; t.link = link; t.x = x; t.normal = n;
    t.start = t.velocity = velocity; t.gap = gap;
    t.stiffness = part * (real)m[0]; t.damping = t.approach = part * (real)m[1];
    t.friction = (real)m[3]; t.release = (real)m[7];
#if TURNS
    t.spin = w.tree.velocity[link].ang; t.torsion = (real)m[4]; t.rolling = (real)m[5];
    if (t.torsion > 0 || t.rolling > 0) t.gyration = gyration(w.tree, link);
#endif
}

// Points per word of a mask of points.
constexpr int WORD = 32, WORDS = NP / WORD + 1;

// Mask of the points that may be beyond a plane in some part of the substep. The test is cheap, as most points are far
// away. A NaN distance counts as near. A height field is taken as the plane at its highest place. `steep` scales its
// distances, since a ball touches inclined ground beside its lowest point.
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
    for_up<0, NP, UNROLLED && NP <= 64>([&](auto point) {
        if (!may(w, point, 0)) return;
        const int link = POINT_LINK[point];
        const real radius = RADIUS[point] + margin(w, point, 0) + fall;
        if (LOCI && LOCUS[point]) {
            // If every place of the locus stays above the plane, its vertices need no test.
            const V3 m = middle(t, point);
            const real speed = norm(at(t.velocity[link], m)) + norm(t.velocity[link].ang) * REACH[point];
            const real d = dot(n, m) - plane.offset - steep * (REACH[point] + radius);
            if (d > steep * (real)0.5 * h * speed + (real)1e-4 * (1 + size(d) + size(plane.offset))) return;
            if (field) { mask[point / WORD] |= 1u << point % WORD; return; }
        }
        const V3 p = facing(t, point, n, true);
        const V3 v = at(t.velocity[link], p);
        const real d = dot(n, p) - plane.offset, way = h * (field ? norm(v) : (real)0.5 * dot(n, v));
        // With room for rounding; `add_contact` decides.
        if (!(d - steep * (radius + size(way)) > (real)1e-4 * (1 + size(d) + size(plane.offset))))
            mask[point / WORD] |= 1u << point % WORD;
    });
}

// Adds the contacts of a point that may touch. False if a distance is NaN.
FN bool meet(Work& w, int point, real h) {
    const Tree& tr = w.tree;
    V3 n, nearest;
    if (w.surfaces == 1) {
        const real d = meets(tr, w.surface[0], point, n, nearest);
        if (!(d == d)) return false;
        add_contact(w, point, 0, n, nearest, h);
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
        // A surface does not act where a nearer collider covers it.
        bool covered = false;
        for (int o = 0; o < w.surfaces && d[c] > 0 && !covered; o++) {
            const bool nearer = d[o] < reach && (d[o] < d[c] || (d[o] == d[c] && o < c));
            V3 m, place;
            covered = nearer && distance(w.surface[o], nearest, m, place) < (real)1e-6;
        }
        if (!covered) add_contact(w, point, c, n, nearest, h);
    }
    return true;
}

// All touches of a substep, from the pose in its middle. False if a distance is NaN.
BIG bool find(Work& w, real h) {
    Tree& tr = w.tree;
    velocities(tr, tr.qd);
    w.touches = 0;
    for_up<0, NJ>(
        [&](auto i) { w.pull[i] = SPRING[i] == 0 ? 0 : SPRING[i] * (real)((double)SLACK[i] - tr.q[COORDS + i]); });
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
        // Dry friction is a contact with friction coefficient 1, pressed with the largest dry friction.
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
            t.spring = true;
            t.gap = gap; t.start = t.velocity = v3(v, 0, 0);
        }
    }
    return true;
}

// Jacobian of a place x on a link: column a[k] of each DoF from the link upward.
template <class I> FN void columns(const Tree& t, I link, V3 x, V3* a) {
    upward(last_dof(link), [&](auto k) { a[k] = v3(0, 0, 0); });
    for_ancestors(link, [&](auto i) {
        if (DOFS && i == 0) {
            for (int k = 0; k < 6; k++) a[k] = k < 3 ? cross(unit(k), x) : unit(k - 3);
        } else {
            // Mimic joints share their leader's column.
            const int k = DOF[i];
            a[k] = a[k] + at(t.axis[i], x);
        }
    });
}

#if TURNS
// Jacobian of a link's angular velocity, by columns as above.
template <class I> FN void spins(const Tree& t, I link, V3* a) {
    upward(last_dof(link), [&](auto k) { a[k] = v3(0, 0, 0); });
    for_ancestors(link, [&](auto i) {
        if (DOFS && i == 0) for (int k = 0; k < 3; k++) a[k] = unit(k);
        else a[DOF[i]] = a[DOF[i]] + t.axis[i].ang;
    });
}

// Whether a contact has torsional or rolling friction; torque against an angular velocity.
FN bool turns(const Touch& t) { return t.torsion > 0 || t.rolling > 0; }
FN V3 turn_torque(const Touch& t, V3 spin) {
    return t.normal * ((t.turning - t.about) * dot(t.normal, spin)) - spin * t.turning;
}
#endif

// Calls f(touch, link) for every contact.
template <class F> FN void points(Work& w, const F& f) {
    if constexpr (UNROLLED)
        for_up<0, NL>([&](auto link) {
            if constexpr (pointed(link.n))
                for (int k = 0; k < w.points; k++) if (w.touch[k].link == link) f(w.touch[k], link);
        });
    else
        for (int k = 0; k < w.points; k++) f(w.touch[k], w.touch[k].link);
}

// Sets t.slip_offset so that at zero slip the sticking drag gives the tangential part of `force`.
FN void hold(Touch& t, V3 force) {
    t.slip_offset = t.friction_damping > 0 ? (force - t.normal * dot(t.normal, force)) * (1 / t.friction_damping)
                                           : v3(0, 0, 0);
}

// Friction force over slip (N s/m), by Coulomb's law.
FN real drag(real normal, real speed, real friction_damping, real friction) {
    const real limit = friction * normal;
    return friction_damping * speed <= limit ? friction_damping : limit / speed;
}

// Drag; with a breakaway slip if the drag `before` exceeds `inertia` and its force the friction cone (stick.rs).
FN real breaking(real normal, real speed, real before, real friction_damping, real friction, real inertia) {
    const real over = speed * before - friction * normal;
    return drag(normal, over > 0 && before > inertia ? speed + BREAKAWAY * over / inertia : speed, friction_damping,
                friction);
}

#if TURNS
// For torques: sticking drag; the same, but 0 if `arm` is 0 m; `hold`; drags at a slip, with breakaway if `leaps`.
FN real sticks(const Touch& t) { return TURN_STICK_DRAG * t.gyration * t.friction_damping; }
FN real stick(const Touch& t, real arm) { return arm > 0 ? sticks(t) : 0; }
FN void wind(Touch& t, V3 torque) {
    if (turns(t)) t.turn_offset = torque * (1 / sticks(t));
}
FN void turn_drags(const Touch& t, real normal, V3 slip, bool leaps, real& about, real& across) {
    const real rate = dot(t.normal, slip), inertia = leaps ? TURN_INERTIA * sticks(t) * (1 / STICK_DRAG) : infinite();
    about = breaking(normal, size(rate), t.about, stick(t, t.torsion), t.torsion, inertia);
    across = breaking(normal, norm(slip - t.normal * rate), t.turning, stick(t, t.rolling), t.rolling, inertia);
}
#endif
