// Adjoint of a substep's solves, by the implicit function theorem, and of its inverse effective masses w (weights), as
// articulated/gradients/stage.rs and inv_mass.rs.

// A drive as a touch of its joint.
FN Touch driven(const Work& w, int i) {
    const Drives& d = w.drives;
    Touch t;
    t.index = DRIVEN_AT + i; t.link = -1; t.dof = DOFS + i; t.x = t.normal = v3(1, 0, 0);
    t.stiffness = d.kp[i]; t.damping = d.kd[i]; t.theta[0] = d.theta[0][i]; t.theta[1] = d.theta[1][i];
    t.gap = (real)(w.tree.q[COORDS + i] - d.target[i]); t.velocity = v3(w.tree.qd[DOFS + i] - d.speed[i], 0, 0);
    t.spring = t.drive = true;
    return t;
}

// Calls f(touch, number) for limits, dry friction and drives.
template <class F> FN void at_joints(const Work& w, const F& f) {
    for (int n = w.points; n < w.touches; n++) f(w.touch[n], n);
    for (int i = 0; i < DRIVES; i++) f(driven(w, i), w.touches + i);
}

// Adjoint of a contact's force under the virtual motion. Returns the gradient w.r.t. the root's w x v.
BIG V3 solve_adjoint(Work& w, Back& b, const Touch& touch, const Law& law, real h, bool first, bool again) {
    const int i = touch.link;
    const V3 x = touch.x, n = touch.normal, middle = x + n * RADIUS[touch.index / w.surfaces];
    const Motion twist = w.tree.velocity[i], own = b.virtuals[i];
#if TURNS
    // The torque depends on the normal force and on all inputs of that force.
    TurnLaw turn;
    const bool turning = turns(touch);
    V3 by_force = at(own, x) + b.held[touch.index], by_torque = own.ang + b.held_torque[touch.index];
    real by_press = 0;
    if (turning) {
        turn_law(touch, b.quickened[i].ang * h, h, first, again,
                 material(w, touch.index / w.surfaces, touch.index % w.surfaces), law, turn);
        by_press = dot(turn.by_press, by_torque);
        const V3 by_held = back(turn.by_held, by_torque) * (again ? HELD_FACTOR : 1);
        b.holds_torque[touch.index] = b.holds_torque[touch.index] + by_held;
        if (!first) by_force = by_force + n * by_press;
    }
#else
    const V3 by_force = at(own, x) + b.held[touch.index];
#endif
    b.holds[touch.index] = b.holds[touch.index] + back(law.by_held, by_force) * (again ? HELD_FACTOR : 1);
    V3 by_velocity = back(law.by_velocity, by_force), by_gap = n * dot(law.by_gap, by_force);
#if TURNS
    if (turning) {
        by_velocity = by_velocity + n * (turn.by_vn * by_press);
        by_gap = by_gap + n * (turn.by_gap * by_press);
        b.by_virtual[i].ang = b.by_virtual[i].ang + turn.torque;
        b.by_quickened[i].ang = b.by_quickened[i].ang + back(turn.by_change, by_torque) * h;
        b.starts[i].ang = b.starts[i].ang + back(turn.by_spin, by_torque);
    }
#endif
    const V3 by_change = back(law.by_change, by_force) * h, by_bend = back(law.by_bend, by_force);
    const V3 by_moves = cross(by_bend, twist.ang);
    real by_across = dot(law.by_across, by_force);
#if TURNS
    if (turning) by_across += dot(turn.by_across, by_torque);
#endif
    b.weight[touch.index] += dot(law.by_weight, by_force) - by_across;
    b.across[touch.index] += by_across;
    b.way = b.way + by_gap;
    b.by_virtual[i] = b.by_virtual[i] + force_at(law.force, x);
    b.by_quickened[i] = b.by_quickened[i] + force_at(by_change, x);
    b.by_acceleration[i] = b.by_acceleration[i] + force_at(by_bend, x);
    b.by_velocity[i] = b.by_velocity[i] + force_at(by_moves, middle);
    b.by_velocity[i].ang = b.by_velocity[i].ang + cross(at(twist, middle), by_bend);
    b.starts[i] = b.starts[i] + force_at(by_velocity, x);
    const V3 by_place = by_gap + cross(law.force, own.ang) + cross(by_change, b.quickened[i].ang)
                        + cross(by_velocity, b.start[i].ang) + cross(by_bend, b.acceleration[i].ang)
                        + cross(by_moves, twist.ang);
    b.loads[i] = b.loads[i] + force_at(by_place, middle);
    return by_change - by_bend;
}

// Adjoint of a stage's solves at w.middle. `rate`: their result; `idle`: mask of idle touches; `first`: with the drags
// of the substep's start. b.rate => gradients in b, and b.rate for the stage before.
BIG void stage_adjoint(Work& w, Back& b, const Kept& kept, const real* rate, const unsigned* idle, real h, bool first,
                       bool again) {
    Tree& t = w.tree;
    velocities(t, w.middle);
    accelerations(t, w.middle, w.gravity, b.acceleration);
    V3 turned = v3(0, 0, 0);
    for (int k = 0; k < NV; k++) { b.qdd[k] = rate[k]; b.by_middle[k] = 0; }
    if (DOFS) {
        turned = cross(read3(w.middle), read3(w.middle + 3));
        write3(b.qdd + 3, read3(rate + 3) - turned);
    }
    twists(t, b.qdd, b.quickened);
    const auto idles = [&](int n) { return idle[n / 32] >> n % 32 & 1; };
    const auto law = [&](Touch& touch, Law& law) {
        bend(w, touch, turned, h);
        const V3 change = at(b.quickened[touch.link], touch.x) * h;
        contact_law(touch, change, w.weight[touch.index], h, first, again, w.mean_theta,
                    material(w, touch.index / w.surfaces, touch.index % w.surfaces), law);
    };
    Law found;
    real low[SIZE], up[SIZE], own[NV];
    entries([&](int k) { low[k] = up[k] = t.mass[k]; });
    for (int k = 0; k < NV; k++) own[k] = 0;
    at_joints(w, [&](const Touch& touch, int n) {
        if (!idles(n))
            own[touch.dof] -=
                h * joint_law(touch, h * b.qdd[touch.dof], w.weight[touch.index], h, first, w.mean_theta).by_change;
    });
    for_up<0, NV>([&](auto k) { low[LOWER(k, k)] += own[k]; });
    points(w, [&](Touch& touch, auto link) {
        if (idles(&touch - w.touch)) return;
        law(touch, found);
        V3 a[NV];
        columns(t, link, touch.x, a);
        upward(last_dof(link), [&](auto i) {
            const V3 along = back(found.by_change, a[i]) * h, other = found.by_change * a[i] * h;
            low[LOWER(i, i)] -= dot(along, a[i]);
            above(i, [&](auto j) {
                up[LOWER(i, j)] -= dot(along, a[j]);
                low[LOWER(i, j)] -= dot(other, a[j]);
            });
        });
#if TURNS
        if (!turns(touch)) return;
        TurnLaw turn;
        V3 s[NV];
        turn_law(touch, b.quickened[touch.link].ang * h, h, first, again,
                 material(w, touch.index / w.surfaces, touch.index % w.surfaces), found, turn);
        spins(t, link, s);
        const V3 press = first ? v3(0, 0, 0) : back(found.by_change, touch.normal) * h;
        upward(last_dof(link), [&](auto i) {
            const V3 along = back(turn.by_change, s[i]) * h, other = turn.by_change * s[i] * h;
            const real own = dot(turn.by_press, s[i]), pressed = dot(press, a[i]);
            low[LOWER(i, i)] -= dot(along, s[i]) + own * pressed;
            above(i, [&](auto j) {
                up[LOWER(i, j)] -= dot(along, s[j]) + own * dot(press, a[j]);
                low[LOWER(i, j)] -= dot(other, s[j]) + dot(turn.by_press, s[j]) * pressed;
            });
        });
#endif
    });
    for_up<0, NV>([&](auto k) { own[k] = b.rate[k]; });
    points(w, [&](Touch& touch, auto link) {
        // Gradient through the contact force that the next stage starts from.
        if (idles(&touch - w.touch)) return;
        law(touch, found);
        V3 held = b.held[touch.index], a[NV];
#if TURNS
        if (turns(touch)) {
            TurnLaw turn;
            const V3 held_torque = b.held_torque[touch.index];
            turn_law(touch, b.quickened[touch.link].ang * h, h, first, again,
                     material(w, touch.index / w.surfaces, touch.index % w.surfaces), found, turn);
            if (!first) held = held + touch.normal * dot(turn.by_press, held_torque);
            const V3 later = back(turn.by_change, held_torque) * h;
            spins(t, link, a);
            upward(last_dof(link), [&](auto i) { own[i] += dot(a[i], later); });
        }
#endif
        const V3 later = back(found.by_change, held) * h;
        columns(t, link, touch.x, a);
        upward(last_dof(link), [&](auto i) { own[i] += dot(a[i], later); });
    });
    eliminate(low, up, own);
    for_up<0, NV>([&](auto k) { b.own[k] = own[k]; });
    V3 by_turn = DOFS ? read3(b.rate + 3) : v3(0, 0, 0);
    adjoint_begin(t, b, w.gravity);
    for (int i = 0; i < NJ; i++) {
        const real own = b.own[DOFS + i];
        b.torque[i] += own;
        b.pose[DOFS + i] -= SPRING[i] * own;
        b.speed[DOFS + i] -= w.damping_used[i] * own;
        b.damping_used[i] -= kept.qd[DOFS + i] * own;
        b.share[i] -= b.qdd[DOFS + i] * own;
    }
    for (int n = 0; n < w.points; n++) {
        if (idles(n)) continue;
        law(w.touch[n], found);
        by_turn = by_turn + solve_adjoint(w, b, w.touch[n], found, h, first, again);
    }
    for (int k = 0; k < PAIRS; k++) b.held[k] = v3(0, 0, 0);
#if TURNS
    for (int k = 0; k < PAIRS; k++) b.held_torque[k] = v3(0, 0, 0);
#endif
    at_joints(w, [&](const Touch& touch, int n) {
        if (idles(n)) return;
        const JointLaw joint = joint_law(touch, h * b.qdd[touch.dof], w.weight[touch.index], h, first, w.mean_theta);
        const real own = b.own[touch.dof];
        b.pose[touch.dof] += joint.by_gap * own;
        b.speed[touch.dof] += joint.by_rate * own;
        b.weight[touch.index] += joint.by_weight * own;
        if (SERVO && n >= w.touches) {
            b.drives[n - w.touches][0] -= joint.by_gap * own;
            b.drives[n - w.touches][1] -= joint.by_rate * own;
        }
    });
    adjoint_end(t, b, w.middle, b.by_middle);
    if (DOFS) {
        const V3 spin = read3(w.middle), v = read3(w.middle + 3);
        write3(b.by_middle, read3(b.by_middle) + cross(v, by_turn));
        write3(b.by_middle + 3, read3(b.by_middle + 3) + cross(by_turn, spin));
    }
    for (int k = 0; k < NV; k++) {
        b.speed[k] += b.by_middle[k];
        b.rate[k] = (real)0.5 * h * b.by_middle[k];
    }
}

// `stage_adjoint` where the angular velocity of w.middle depends on the stage's own rate: repeated until no gradient
// w.r.t. that rate is left.
BIG void spun_back(Work& w, Back& b, const Kept& kept, real h, bool again) {
    stage_adjoint(w, b, kept, kept.rate, kept.idle, h, false, again);
    const Spin whole = spin(w.tree);
    const V3 middle = read3(w.middle);
    V3 off = read3(b.rate);
    const real least = (sizeof(real) == 8 ? (real)1e-13 : (real)1e-6) * norm(off);
    real sum[NV];
    for (int k = 0; k < NV; k++) sum[k] = b.rate[k];
    for (int solve = 0; solve < SPIN_PASSES; solve++) {
        const V3 more = whole.inertia * settle(whole, middle, h, off, true);
        for (int k = 0; k < NV; k++) b.rate[k] = 0;
        write3(b.rate, more);
        stage_adjoint(w, b, kept, kept.rate, kept.idle, h, false, again);
        for (int k = 0; k < NV; k++) sum[k] += b.rate[k];
        off = off + read3(b.rate) - more;
        if (norm(off) <= least) break;
    }
    for (int k = 0; k < NV; k++) b.rate[k] = k < 3 ? 0 : sum[k];
}

// Adjoint of a weight w = y^T M^-1 y of a contact or joint: dw = 2 z . dy - z . dM z. b.own: z = M^-1 y.
BIG void push_back(const Tree& t, Back& b, const Touch* touch, V3 along, int point, real by) {
    twists(t, b.own, b.virtuals);
    for_up<0, NL>([&](auto i) {
        b.by_virtual[i] = (body(t, i) * b.virtuals[i]) * (-2 * by);
        b.loads[i] = b.loads[i] - cross(b.virtuals[i], b.by_virtual[i]);
    });
    if (touch) {
        const int i = touch->link;
        const V3 n = along * (2 * by);
        b.by_virtual[i] = b.by_virtual[i] + force_at(n, touch->x);
        b.loads[i] = b.loads[i] + force_at(cross(n, b.virtuals[i].ang), touch->x + touch->normal * RADIUS[point]);
    }
    twists_back(t, b.own, b.by_virtual, b.loads, 0);
}

// Adjoint of the weights w that this substep computed.
BIG void inv_mass_adjoint(Work& w, Back& b, int number, real h) {
    Tree& t = w.tree;
    bool factored = false;
    const auto factor = [&]() {
        if (!factored) { crba(t); refill(t); }
        factored = true;
        for (int k = 0; k < NV; k++) b.own[k] = 0;
    };
    for (int n = 0; n < w.points; n++) {
        const Touch& touch = w.touch[n];
        const real by_normal = b.weight[touch.index], by_axis = b.across[touch.index];
        if (by_normal == 0 && by_axis == 0 || b.since[touch.index] != number) continue;
        V3 a[NV];
        columns(t, touch.link, touch.x, a);
        // w along the normal, then along three axes: the sum over the axes, less w along the normal, is w across.
        for (int axis = -1; axis < 3; axis++) {
            const V3 along = axis < 0 ? touch.normal : unit(axis);
            factor();
            upward(last_dof(touch.link), [&](int k) { b.own[k] = dot(along, a[k]); });
            solve(t, b.own);
            push_back(t, b, &touch, along, touch.index / w.surfaces, axis < 0 ? by_normal : by_axis);
        }
    }
    at_joints(w, [&](const Touch& touch, int) {
        const real by = b.weight[touch.index];
        if (by == 0 || b.since[touch.index] != number) return;
        factor();
        b.own[touch.dof] = 1;
        solve(t, b.own);
        push_back(t, b, 0, v3(0, 0, 0), 0, by);
    });
    for (int i = 0; number == 0 && i < NJ; i++) {
        if (h * most(DAMPING(t)[i], h * SPRING[i]) <= LEAST(t)[i]) continue;
        factor();
        b.own[DOFS + i] = 1;
        solve(t, b.own);
        // Derivatives of damping and theta w.r.t. w, as Damped::gradients.
        const real inv_mass = b.own[DOFS + i], k = h * h * SPRING[i], damping_used = w.damping_used[i],
                   z = h * damping_used * inv_mass, e = expm1(-z);
        const real by_damping_used = k * inv_mass < MAX_SPRING_DAMPING && damping_used > DAMPING(t)[i] ? k * k / h : 0;
        const real gradient = z > 1 ? 1 / (z * z) - (1 + e) / (e * e) : 0,
                   by_spring = spring_theta(k * inv_mass) > MEAN_THETA ? (real)0.5 / (inv_mass * inv_mass) : 0;
        const real by_share = gradient * h * (damping_used + inv_mass * by_damping_used) * h * damping_used
                              + w.damper[i] * h * by_damping_used + by_spring;
        push_back(t, b, 0, v3(0, 0, 0), 0, by_damping_used * b.damping_used[i] + by_share * b.share[i]);
    }
}
