// Adjoint of the sweeps along the tree, as nerd_core's dynamics/adjoint.rs, and a thread's record of a frame.

// Most substeps of a frame that are recorded; a frame is refined no further.
constexpr int STEPS = 8 * MOST_SUBSTEPS;

FN Wrench operator-(Wrench a, Wrench b) { return wrench(a.ang - b.ang, a.lin - b.lin); }
FN Wrench operator*(Wrench a, real k) { return wrench(a.ang * k, a.lin * k); }
FN Wrench cross(Motion m, Wrench f) { return wrench(cross(m.ang, f.ang) + cross(m.lin, f.lin), cross(m.ang, f.lin)); }
FN Wrench force_at(V3 f, V3 x) { return wrench(cross(x, f), f); }

constexpr int IDLE = (MOST + DRIVES) / 32 + 1;   // words of a mask with a bit per touch and drive

// A recorded substep: q in its middle (Runge-Kutta: at its start), local qd at its start, rate found. Then idle
// touches, slip and turn offsets of contacts (touch.cuh).
constexpr int HOLDS = (PAIRS < 2 * NP ? PAIRS : 2 * NP) + 1;    // most contacts with recorded offsets; others take 0
struct Kept {
    double q[NQ];
    real qd[NV], rate[NV];
    unsigned idle[IDLE];
    V3 held[HOLDS], turn_offset[TURNS ? HOLDS : 1];
};

struct Back {
    bool implicit;                         // whether substeps were implicit
    int steps;
    Kept kept[STEPS];
    int since[WEIGHTS];                 // substep that found a weight
    // Whether the first substep had two stages. Of its first: whether it was a single solve, rate, idle touches.
    bool twice, once;
    real guess[NV];
    unsigned early[IDLE];
    // Gradients, as gradients/row.rs.
    real pose[NV], speed[NV], rate[NV], torque[NJ + 1], weight[WEIGHTS], across[PAIRS + 1], damping_used[NJ + 1],
        share[NJ + 1], drives[PULLS][2];
    Wrench loads[NL], starts[NL];
    V3 way;
    // Gradients w.r.t. contact forces and torques at a stage's end (held) and start (holds).
    V3 held[PAIRS + 1], holds[PAIRS + 1];
#if TURNS
    V3 held_torque[PAIRS + 1], holds_torque[PAIRS + 1];
#endif
    // Motions of links, and gradients w.r.t. them.
    Motion start[NL], acceleration[NL], virtuals[NL], quickened[NL];
    Wrench by_virtual[NL], by_quickened[NL], by_velocity[NL], by_acceleration[NL];
    real own[NV], qdd[NV], by_middle[NV];
};

FN void add(real* out, Wrench w) {
    out[0] += w.ang.x; out[1] += w.ang.y; out[2] += w.ang.z;
    out[3] += w.lin.x; out[4] += w.lin.y; out[5] += w.lin.z;
}

// J^T of link wrenches: `by` => added to `out`, unless null; each wrench becomes the sum over its subtree.
BIG void gather(const Tree& t, Wrench* by, real* out) {
    Wrench sum[NL];
    for_up<0, NL>([&](auto i) { sum[i] = by[i]; });
    backward<0, NL>([&](auto i) {
        by[i] = sum[i];
        if (DOFS && i == 0) {
            if (out) add(out, sum[0]);
            return;
        }
        const int p = PARENT[i];
        if (out) out[DOF[i]] += dot(t.axis[i], sum[i]);
        if (p >= 0) sum[p < 0 ? 0 : p] = sum[p < 0 ? 0 : p] + sum[i];
    });
}

// Adjoint of `twists`: gradients `by` w.r.t. twists => w.r.t. rates (added to `out`) and displacements (to `loads`).
FN void twists_back(const Tree& t, const real* rates, Wrench* by, Wrench* loads, real* out) {
    gather(t, by, out);
    for_up<DOFS ? 1 : 0, NL>([&](auto i) { loads[i] = loads[i] + cross(t.axis[i], by[i] * rates[DOF[i]]); });
}

// Link accelerations at zero qdd: twists of `velocities`, gravity => out.
BIG void accelerations(const Tree& t, const real* qd, V3 gravity, Motion* out) {
    Motion own[NL];
    const Motion base = motion(v3(0, 0, 0), gravity * (real)-1);
    for_up<0, NL>([&](auto i) {
        const int p = PARENT[i];
        const Motion above = p < 0 ? base : own[p < 0 ? 0 : p];
        out[i] = own[i] = DOFS && i == 0 ? above : above + cross(t.velocity[i], t.axis[i] * qd[DOF[i]]);
    });
}

// Begins the adjoint of `-u . RNEA(q, qd, qdd)` with virtual rates u = b.own => gradients w.r.t. link motions.
BIG void adjoint_begin(const Tree& t, Back& b, V3 gravity) {
    twists(t, b.own, b.virtuals);
    for_up<0, NL>([&](auto i) {
        const Inertia inertia = body(t, i);
        const Motion v = t.velocity[i], l = b.virtuals[i], a = b.acceleration[i] + b.quickened[i], y = cross(v, l);
        const Wrench of_a = inertia * a, of_v = inertia * v, of_l = inertia * l, of_y = inertia * y;
        b.by_virtual[i] = (of_a + cross(v, of_v)) * (real)-1;
        b.by_quickened[i] = b.by_acceleration[i] = of_l * (real)-1;
        b.by_velocity[i] = cross(l, of_v) + of_y;
        b.loads[i] = b.loads[i] + cross(l, of_a) + cross(a, of_l) - cross(y, of_v) - cross(v, of_y);
#if LIFTS
        const V3 weight = gravity * LIFT(t)[4 * i], x = lifted(t, i), turned = cross(l.ang, weight);
        b.by_virtual[i] = b.by_virtual[i] - wrench(cross(x, weight), weight);
        b.loads[i] = b.loads[i] + wrench(cross(x, turned), turned);
#endif
        if (FREED && i == 0) {
            b.by_virtual[0] = b.by_virtual[0] - drag(t, v);
            b.by_velocity[0] = b.by_velocity[0] - drag(t, l);
            const V3 x = t.position[0];
            b.loads[0] = b.loads[0]
                         - force_at((cross(at(v, x), l.ang) + cross(at(l, x), v.ang)) * (real)ROOT_DAMPING, x);
        }
    });
}

// Ends that adjoint => gradients w.r.t. the twists' rates `qd` (added to `out`), displacements (added to b.loads).
BIG void adjoint_end(const Tree& t, Back& b, const real* qd, real* out) {
    twists_back(t, b.own, b.by_virtual, b.loads, 0);
    twists_back(t, b.qdd, b.by_quickened, b.loads, 0);
    gather(t, b.by_acceleration, 0);
    for_up<DOFS ? 1 : 0, NL>([&](auto i) {
        const Wrench by = b.by_acceleration[i], by_own = cross(t.velocity[i], by) * (real)-1;
        const Motion axis = t.axis[i];
        const real rate = qd[DOF[i]];
        b.by_velocity[i] = b.by_velocity[i] + cross(axis * rate, by);
        out[DOF[i]] += dot(axis, by_own);
        b.loads[i] = b.loads[i] + cross(axis, by_own * rate);
    });
    twists_back(t, qd, b.by_velocity, b.loads, out);
}

// Solves A x = b in place for an asymmetric A with the tree's zeros. For j above i, `low` has the entries A_ij and the
// diagonal, `up` the entries A_ji. Eliminates from leaves to root, so no zero is filled. A singular A gives no finite
// numbers.
FN void eliminate(real* low, real* up, real* x) {
    backward<0, NV>([&](auto k) {
        const real inverse = 1 / low[LOWER(k, k)];
        low[LOWER(k, k)] = inverse;
        above(k, [&](auto i) {
            const real right = up[LOWER(k, i)] * inverse, left = low[LOWER(k, i)] * inverse;
            x[i] -= right * x[k];
            low[LOWER(i, i)] -= right * low[LOWER(k, i)];
            above(i, [&](auto j) {
                low[LOWER(i, j)] -= right * low[LOWER(k, j)];
                up[LOWER(i, j)] -= left * up[LOWER(k, j)];
            });
        });
    });
    for_up<0, NV>([&](auto k) {
        above(k, [&](auto j) { x[k] -= low[LOWER(k, j)] * x[j]; });
        x[k] *= low[LOWER(k, k)];
    });
}
