// Slopes of the sweeps along the tree, as nerd_core's dynamics/adjoint.rs, where they are explained, and what a thread keeps for them.

constexpr int STEPS = 8 * CONTACT_SUBSTEPS;   // substeps that are kept at most: a frame that its energy asks to be finer has no slopes here

FN Wrench operator-(Wrench a, Wrench b) { return wrench(a.ang - b.ang, a.lin - b.lin); }
FN Wrench operator*(Wrench a, real k) { return wrench(a.ang * k, a.lin * k); }
FN Wrench cross(Motion m, Wrench f) { return wrench(cross(m.ang, f.ang) + cross(m.lin, f.lin), cross(m.ang, f.lin)); }
FN Wrench force_at(V3 f, V3 x) { return wrench(cross(x, f), f); }

// A substep: its pose in the middle, local velocities at its start, the rate of the one before.
struct Kept { double q[NQ]; real qd[NV], rate[NV]; };

struct Back {
    Kept kept[STEPS];
    int since[WEIGHTS];                 // the substep that found a weight
    // Gradients, as those of slopes/row.rs.
    real pose[NV], speed[NV], rate[NV], torque[NJ + 1], weight[WEIGHTS], braked[NJ + 1], share[NJ + 1];
    Wrench loads[NL], starts[NL];
    V3 way;
    // Motions of links, and gradients by them.
    Motion start[NL], acceleration[NL], virtuals[NL], quickened[NL];
    Wrench by_virtual[NL], by_quickened[NL], by_velocity[NL], by_acceleration[NL];
    real matrix[NV * NV], own[NV], qdd[NV], by_middle[NV];
};

FN void add(real* out, Wrench w) {
    out[0] += w.ang.x; out[1] += w.ang.y; out[2] += w.ang.z;
    out[3] += w.lin.x; out[4] += w.lin.y; out[5] += w.lin.z;
}

// What wrenches on links do along each DoF is added to `out`, if there is one; each becomes that of its subtree.
BIG void gather(const Tree& t, Wrench* by, real* out) {
    for (int i = NL - 1; i >= 0; i--) {
        if (DOFS && i == 0) {
            if (out) add(out, by[0]);
            continue;
        }
        if (out) out[DOF[i]] += dot(t.axis[i], by[i]);
        if (PARENT[i] >= 0) by[PARENT[i]] = by[PARENT[i]] + by[i];
    }
}

// `twists` back.
BIG void twists_back(const Tree& t, const real* rates, Wrench* by, Wrench* loads, real* out) {
    gather(t, by, out);
    for (int i = DOFS ? 1 : 0; i < NL; i++) loads[i] = loads[i] + cross(t.axis[i], by[i] * rates[DOF[i]]);
}

// Accelerations of links at zero qdd, once `velocities` has their twists.
BIG void accelerations(const Tree& t, const real* qd, V3 gravity, Motion* out) {
    for (int i = 0; i < NL; i++) {
        const Motion above = PARENT[i] < 0 ? motion(v3(0, 0, 0), gravity * (real)-1) : out[PARENT[i] < 0 ? 0 : PARENT[i]];
        out[i] = DOFS && i == 0 ? above : above + cross(t.velocity[i], t.axis[i] * qd[DOF[i]]);
    }
}

// Begins with `-virtual . RNEA(q, qd, qdd)` at virtual rates b.own.
BIG void adjoint_begin(const Tree& t, Back& b) {
    twists(t, b.own, b.virtuals);
    for (int i = 0; i < NL; i++) {
        const Inertia inertia = body(t, i);
        const Motion v = t.velocity[i], l = b.virtuals[i], a = b.acceleration[i] + b.quickened[i], y = cross(v, l);
        const Wrench of_a = inertia * a, of_v = inertia * v, of_l = inertia * l, of_y = inertia * y;
        b.by_virtual[i] = (of_a + cross(v, of_v)) * (real)-1;
        b.by_quickened[i] = b.by_acceleration[i] = of_l * (real)-1;
        b.by_velocity[i] = cross(l, of_v) + of_y;
        b.loads[i] = b.loads[i] + cross(l, of_a) + cross(a, of_l) - cross(y, of_v) - cross(v, of_y);
    }
}

// Ends: adds gradients by the twists' rates `qd` to `out`, and by displacements to b.loads.
BIG void adjoint_end(const Tree& t, Back& b, const real* qd, real* out) {
    twists_back(t, b.own, b.by_virtual, b.loads, 0);
    twists_back(t, b.qdd, b.by_quickened, b.loads, 0);
    for (int i = NL - 1; i >= (DOFS ? 1 : 0); i--) {
        const Wrench by = b.by_acceleration[i], by_own = cross(t.velocity[i], by) * (real)-1;
        const Motion axis = t.axis[i];
        const real rate = qd[DOF[i]];
        b.by_velocity[i] = b.by_velocity[i] + cross(axis * rate, by);
        out[DOF[i]] += dot(axis, by_own);
        b.loads[i] = b.loads[i] + cross(axis, by_own * rate);
        if (PARENT[i] >= 0) b.by_acceleration[PARENT[i]] = b.by_acceleration[PARENT[i]] + by;
    }
    twists_back(t, qd, b.by_velocity, b.loads, out);
}

// x of the matrix, with pivots by rows, in its place; what has no solution gives no numbers.
BIG void eliminate(real* m, real* x) {
    for (int k = 0; k < NV; k++) {
        int pivot = k;
        for (int i = k + 1; i < NV; i++) if (size(m[i * NV + k]) > size(m[pivot * NV + k])) pivot = i;
        if (pivot != k) {
            for (int j = k; j < NV; j++) { const real y = m[k * NV + j]; m[k * NV + j] = m[pivot * NV + j]; m[pivot * NV + j] = y; }
            const real y = x[k]; x[k] = x[pivot]; x[pivot] = y;
        }
        const real inverse = 1 / m[k * NV + k];
        for (int i = k + 1; i < NV; i++) {
            const real factor = m[i * NV + k] * inverse;
            if (factor == 0) continue;
            for (int j = k + 1; j < NV; j++) m[i * NV + j] -= factor * m[k * NV + j];
            x[i] -= factor * x[k];
        }
    }
    for (int k = NV - 1; k >= 0; k--) {
        for (int j = k + 1; j < NV; j++) x[k] -= m[k * NV + j] * x[j];
        x[k] /= m[k * NV + k];
    }
}
