// Adjoint of Runge-Kutta substeps, stage by stage, as articulated/gradients/explicit.rs. Gradients are w.r.t. the
// numbers of a state; its quaternion may have any length.

constexpr int NUMBERS = NQ + NV;

// Gradient w.r.t. a rotation => w.r.t. the quaternion's numbers.
FN void turned_back(const double* q, const real* by_turn, double* out) {
    const double turn[4] = {by_turn[0], by_turn[1], by_turn[2], 0},
                 scale = 2 / (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    product(turn, q, out);
    for (int k = 0; k < 4; k++) out[k] *= scale;
}

// Im(by q*) / 2, with q* the conjugate of q.
FN V3 half_turn(const double* by, const double* q) {
    const double conjugate[4] = {-q[0], -q[1], -q[2], q[3]};
    double out[4];
    product(by, conjugate, out);
    return three(out) * (real)0.5;
}

// Gradients of b => w.r.t. the numbers of a state with this quaternion; `from_numbers` is the inverse.
FN void to_numbers(const Back& b, const double* quaternion, double* by) {
    for (int i = 0; i < NJ; i++) by[COORDS + i] = b.pose[DOFS + i];
    for (int k = 0; k < NV; k++) by[NQ + k] = b.speed[k];
    if (!DOFS) return;
    for (int k = 0; k < 3; k++) by[k] = b.pose[3 + k];
    turned_back(quaternion, b.pose, by + 3);
}
FN void from_numbers(Back& b, const double* quaternion, const double* by) {
    for (int i = 0; i < NJ; i++) b.pose[DOFS + i] = (real)by[COORDS + i];
    for (int k = 0; k < NV; k++) b.speed[k] = (real)by[NQ + k];
    if (!DOFS) return;
    write3(b.pose, half_turn(by + 3, quaternion));
    write3(b.pose + 3, three(by));
}

// Adjoint of the time derivative of the tree's state, with kinematics, factor and bias known: by => out.
BIG void rate_back(Work& w, Back& b, const double* rate, const double* by, double* out) {
    Tree& t = w.tree;
    for (int k = 0; k < NV; k++) {
        b.own[k] = (real)by[NQ + k];
        b.qdd[k] = (real)rate[NQ + k];
        b.pose[k] = b.speed[k] = 0;
    }
    for (int i = 0; i < NJ; i++) b.speed[DOFS + i] = (real)by[COORDS + i];
    double spun[4];
    if (DOFS) {
        const V3 spin = read3(t.qd), v = read3(t.qd + 3), by_v = three(by + NQ + 3);
        write3(b.qdd + 3, read3(b.qdd + 3) - cross(spin, v));
        write3(b.speed, half_turn(by + 3, t.q + 3) + cross(v, by_v));
        write3(b.speed + 3, three(by) + cross(by_v, spin));
        const double turns[4] = {spin.x, spin.y, spin.z, 0};
        product(turns, by + 3, spun);
    }
    solve(t, b.own);
    unload(b.loads);
    accelerations(t, t.qd, w.gravity, b.acceleration);
    twists(t, b.qdd, b.quickened);
    adjoint_begin(t, b, w.gravity);
    adjoint_end(t, b, t.qd, b.speed);
    gather(t, b.loads, b.pose);
    // The rate does not depend on the root's position.
    if (DOFS) write3(b.pose + 3, v3(0, 0, 0));
    for (int i = 0; i < NJ; i++) {
        const real own = b.own[DOFS + i], x = (real)t.q[COORDS + i], *l = LIMIT + 4 * i;
        const bool beyond = LIMITED[i] && (x < l[0] || x > l[1]);
        b.torque[i] += own;
        b.speed[DOFS + i] -= (DAMPING(t)[i] + (beyond ? l[3] : 0)) * own;
        if (beyond) b.pose[DOFS + i] -= l[2] * own;
    }
    to_numbers(b, t.q + 3, out);
    for (int k = 0; DOFS && k < 4; k++) out[3 + k] -= 0.5 * spun[k];
}

// Adjoint of a substep; computes its rates again. Returns 0 or a fault.
BIG int flight_back(Work& w, Back& b, const Kept& kept, const double* tau, real h) {
    Tree& t = w.tree;
    Explicit e;
    e.looked = true;
    e.soft = 1;
    double qd[NV], end[4], by_state[NUMBERS], by_end[NUMBERS], by_trial[NUMBERS], by_rate[NUMBERS];
    for (int k = 0; k < NV; k++) qd[k] = kept.qd[k];
    const int fault = stages(w, e, tau, kept.q, qd, h, infinite());
    if (fault) return fault;
    for (int k = 0; DOFS && k < 4; k++) end[k] = kept.q[3 + k] + grown(e, 3 + k, h);
    to_numbers(b, end, by_end);
    for (int k = 0; k < NUMBERS; k++) { by_state[k] = by_end[k]; by_trial[k] = 0; }
    for (int stage = 3; stage >= 0; stage--) {
        // For the last stage the tree is already set.
        if (stage < 3) {
            stand(t, e, stage, kept.q, qd, h);
            kinematics(t);
            crba(t);
            if (!refill(t)) return 1 + t.lost;
            velocities(t, t.qd);
        }
        const double weight = stage % 3 ? 2 : 1, next = stage == 3 ? 0 : stage == 2 ? 1 : 0.5;
        for (int k = 0; k < NUMBERS; k++) by_rate[k] = h * (weight / 6 * by_end[k] + next * by_trial[k]);
        rate_back(w, b, e.rates[stage], by_rate, by_trial);
        for (int k = 0; k < NUMBERS; k++) by_state[k] += by_trial[k];
    }
    from_numbers(b, kept.q + 3, by_state);
    return 0;
}
