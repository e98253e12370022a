// Solves for accelerations under touches and drives, as articulated/kick.rs. Updates the touches' forces and drags, as
// `Contact::settle` of articulated/touch.rs.

FN real damper_theta(real h, real damping, real weight, bool mean_theta) {
    return mean_theta ? (real)0.5 : most(1 - 1 / (h * damping * weight), (real)0.5);
}

// Whether a contact parts at its damper's velocity vn + theta dn; vn: normal velocity at the start, dn: its change.
FN bool parts(const Touch& t, real vn, real dn, real h, real weight, bool mean_theta) {
    return vn + damper_theta(h, t.approach, weight, mean_theta) * dn >= 0;
}

// Takes the damping of approach or of parting, by `parts`. Returns whether the damping changed.
FN bool take_side(Touch& t, real vn, real dn, real h, real weight, bool mean_theta) {
    const real damping = parts(t, vn, dn, h, weight, mean_theta) ? t.stiffness * t.release : t.approach;
    const bool other = damping != t.damping;
    t.damping = damping;
    t.theta[1] = damper_theta(h, damping, weight, mean_theta);
    return other;
}

// A contact at its present drag: force (N); resistance along and across the normal, times h (kg).
struct Push { V3 force; real along, across; };

// h D a for a column a of the Jacobian.
FN V3 resisted(const Push& p, V3 n, V3 a) { return n * ((p.along - p.across) * dot(n, a)) + a * p.across; }

FN Push push(const Touch& t, real h) {
    const V3 n = t.normal;
    const V3 velocity = t.start;
    const real vn = dot(n, velocity);
    Push p = {n * -(t.stiffness * t.gap + t.damping * vn) - (velocity - n * vn - t.slip_offset) * t.drag,
              (t.theta[0] * h * t.stiffness + t.theta[1] * t.damping) * h, t.theta[2] * t.drag * h};
    p.force = p.force - resisted(p, n, t.turn);
    return p;
}

// Torque (N m or N) of a limit or of dry friction on its joint; its resistance times h (kg m^2 or kg). A limit acts
// along the touch's normal, dry friction across it.
struct Pull { real torque, resists; };
FN Pull pull(const Touch& t, real h) {
    if (!t.spring) { Pull p = {-t.start.y * t.drag, t.theta[2] * t.drag * h}; return p; }
    const real torque = -t.x.x * (t.stiffness * t.gap + t.damping * t.start.x);
    Pull p = {torque, (t.theta[0] * h * t.stiffness + t.theta[1] * t.damping) * h};
    return p;
}

// Accelerations under the contacts that have not separated, by the matrix => w.qdd. False if not positive definite.
BIG bool pressed(Work& w, real h) {
    Tree& tr = w.tree;
    real here[HERE], *l = UNROLLED ? here : tr.factor;
    real x[NV], stiff[NV];
    for_up<0, NV>([&](auto k) { w.qdd[k] = w.right[k]; stiff[k] = 0; });
    for_up<0, DRIVES>([&](auto i) {
        w.qdd[DOFS + i] += w.drives.torque[i];
        stiff[DOFS + i] = w.drives.resists[i] * h;
    });
    for (int k = w.points; k < w.touches; k++) {
        const Touch& t = w.touch[k];
        const Pull p = pull(t, h);
        w.qdd[t.dof] += p.torque;
        stiff[t.dof] += p.resists;
    }
    entries([&](int k) { l[k] = tr.mass[k]; });
    for_up<0, NV>([&](auto k) { x[k] = w.qdd[k]; l[LOWER(k, k)] += stiff[k]; });
    points(w, [&](const Touch& t, auto link) {
        if (t.parted) return;
        const Push p = push(t, h);
        V3 a[NV];
        columns(tr, link, t.x, a);
        upward(last_dof(link), [&](auto i) {
            x[i] += dot(a[i], p.force);
            const V3 d = resisted(p, t.normal, a[i]);
            upward(i, [&](auto j) { l[LOWER(i, j)] += dot(a[j], d); });
        });
#if TURNS
        if (!turns(t)) return;
        const V3 torque = turn_torque(t, t.spin - t.turn_offset);
        spins(tr, link, a);
        upward(last_dof(link), [&](auto i) {
            x[i] += dot(a[i], torque);
            const V3 d = turn_torque(t, a[i]) * -h;
            upward(i, [&](auto j) { l[LOWER(i, j)] += dot(a[j], d); });
        });
#endif
    });
    if (!factorise(tr, l)) return false;
    half(l, x);
    rest(l, x);
    for_up<0, NV>([&](auto k) { w.qdd[k] = x[k]; });
    return true;
}

// Accelerations as of `pressed`, but solved along the tree.
BIG bool pressed_along(Work& w, real h) {
    Tree& tr = w.tree;
    inertias(tr, w.along);
    for (int k = 0; k < NV; k++) w.qdd[k] = w.right[k];
    for (int i = 0; i < NJ; i++) w.along.joints[i] = w.along.dampers[i];
    for (int i = 0; i < DRIVES; i++) {
        w.qdd[DOFS + i] += w.drives.torque[i];
        w.along.joints[i] += w.drives.resists[i] * h;
    }
    for (int i = 0; i < NL; i++) for (int k = 0; k < 6; k++) w.along.force[i][k] = 0;
    for (int k = 0; k < w.points; k++) {
        const Touch& t = w.touch[k];
        if (t.parted) continue;
        const Push p = push(t, h);
        resist(w.along, t.link, t.x, t.normal, p.force, p.along, p.across);
#if TURNS
        if (!turns(t)) continue;
        const V3 torque = turn_torque(t, t.spin - t.turn_offset);
        const double pull[3] = {torque.x, torque.y, torque.z};
        for (int c = 0; c < 3; c++) {
            const V3 d = turn_torque(t, unit(c)) * -h;
            const double column[3] = {d.x, d.y, d.z};
            w.along.force[t.link][c] -= pull[c];
            for (int r = c; r < 3; r++) w.along.inertia[t.link][LOWER(r, c)] += column[r];
        }
#endif
    }
    for (int k = w.points; k < w.touches; k++) {
        const Touch& t = w.touch[k];
        const Pull p = pull(t, h);
        w.qdd[t.dof] += p.torque;
        w.along.joints[t.dof - DOFS] += p.resists;
    }
    if (!factorise(tr, w.along, w.along.joints)) return false;
    for (int k = 0; k < NV; k++) w.along.x[k] = w.qdd[k];
    solve(tr, w.along);
    for (int k = 0; k < NV; k++) w.qdd[k] = (real)w.along.x[k];
    return true;
}

// Updates drags, separated contacts and drives at their bounds from w.qdd. Returns whether a new solve is needed.
BIG bool update_touches(Work& w, real h, real settled, int pass) {
    const bool leaps = pass < BREAKAWAY_SOLVES;
    Motion twist[NL];
    if (!ALONG) twists(w.tree, w.qdd, twist);
    bool changed = false;
    w.creeps = false;
    for (int k = 0; k < w.points; k++) {
        Touch& t = w.touch[k];
        if (t.parted) continue;
        const V3 n = t.normal;
        const V3 change = (ALONG ? reached(w.along, t.link, t.x) : at(twist[t.link], t.x)) * h + t.turn * h;
        const V3 velocity = t.start;
        const real vn = dot(n, velocity), dn = dot(n, change);
        const real normal = -(t.stiffness * (t.gap + t.theta[0] * h * dn) + t.damping * (vn + t.theta[1] * dn));
        t.parted = normal < 0;
        w.may_gain_energy = w.may_gain_energy || t.parted;
        const V3 seen = velocity + change * t.theta[2];
        const V3 slip = seen - n * dot(n, seen) - t.slip_offset;
        t.force = t.parted ? v3(0, 0, 0) : n * normal - slip * t.drag;
        const real slips = norm(slip), inertia = 2 * t.friction_damping / STICK_DRAG;
        const real leap = leaps ? inertia : infinite();
        real next = breaking(most(normal, 0), slips, t.drag, t.friction_damping, t.friction, leap);
        // If a force within the friction cone stops the slip, the contact sticks at once.
        if (pass == 0 && slips * (t.drag + inertia) <= t.friction * normal) next = t.friction_damping;
        w.creeps = w.creeps || next >= t.friction_damping && norm(slip + t.slip_offset) > CREEPS;
        const real enough = next > t.drag ? settled * (1 + t.drag / inertia) : settled;
        changed = changed || t.parted || size(next / t.drag - 1) > enough;
        t.drag = next;
        const real damping = t.damping;
        take_side(t, vn, dn, h, w.weight[t.index], w.mean_theta);
        changed = changed || size(t.damping - damping) * size(vn + t.theta[1] * dn) > settled * size(normal);
#if TURNS
        if (!turns(t)) continue;
        const V3 turned = ALONG ? reached(w.along, t.link) : twist[t.link].ang;
        real about, turning;
        const V3 turn = t.spin + turned * h - t.turn_offset;
        t.torque = t.parted ? v3(0, 0, 0) : turn_torque(t, turn);
        turn_drags(t, t.parted ? 0 : normal, turn, leaps, about, turning);
        const auto differs = [&](real now, real before) {
            return size(now - before) > settled * most(before, (real)1e-12);
        };
        changed = changed || differs(about, t.about) || differs(turning, t.turning);
        t.about = about; t.turning = turning;
#endif
    }
    for (int k = w.points; k < w.touches; k++) {
        Touch& t = w.touch[k];
        if (t.spring) continue;
        const real change = w.qdd[t.dof] * h;
        // Dry friction has theta 1, so it may add energy where its joint reverses.
        w.may_gain_energy = w.may_gain_energy || t.start.y * (t.start.y + change) < 0;
        const real speed = size(t.start.y + change * t.theta[2]);
        const real next = drag(-t.stiffness * t.gap, speed, t.friction_damping, t.friction);
        changed = changed || size(next / t.drag - 1) > settled;
        t.drag = next;
    }
    // A drive at a torque bound stays at that bound for the substep. All drives are tested before any is written, so
    // that no load from memory waits for another.
    Drives& d = w.drives;
    unsigned beyond[PULLS / 32 + 1] = {};
    const auto torque = [&](int i) { return d.torque[i] - d.resists[i] * (w.qdd[DOFS + i] * h); };
    for_up<0, DRIVES>([&](auto i) {
        const real t = torque(i);
        beyond[i / 32] |= (unsigned)!((d.low[i] <= t) & (t <= d.high[i])) << i % 32;
    });
    for (int k = 0; DRIVEN && k <= DRIVES / 32; k++) {
        beyond[k] &= ~d.held[k];
        if (!beyond[k]) continue;
        changed = true;
        d.held[k] |= beyond[k];
        for (int i = 32 * k; i < DRIVES && i < 32 * (k + 1); i++) {
            if (!(beyond[k] >> i % 32 & 1)) continue;
            d.torque[i] = most(d.low[i], least(d.high[i], torque(i)));
            d.resists[i] = 0;
        }
    }
    return changed;
}
