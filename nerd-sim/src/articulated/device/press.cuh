// Accelerations under what touches and drives do, and what these then do, as articulated/kick.rs.

// What a touch does at its present drag: a force, and how it resists along its normal and across, times h.
struct Push { V3 force; real along, across; };

// h D a of a column a.
FN V3 resisted(const Push& p, V3 n, V3 a) { return n * ((p.along - p.across) * dot(n, a)) + a * p.across; }

FN Push push(const Touch& t, real h) {
    const V3 n = t.normal;
    const V3 velocity = t.start;
    const real vn = dot(n, velocity);
    Push p = {n * -(t.stiffness * t.gap + t.damping * vn) - (velocity - n * vn) * t.across,
              (t.ahead[0] * h * t.stiffness + t.ahead[1] * t.damping) * h, t.ahead[2] * t.across * h};
    p.force = p.force - resisted(p, n, t.turn);
    return p;
}

// The same of a joint's touch: its torque, and how it resists, times h. A limit lies along its normal, dry friction across it.
struct Pull { real torque, resists; };
FN Pull pull(const Touch& t, real h) {
    if (!t.sticky) { Pull p = {-t.start.y * t.across, t.ahead[2] * t.across * h}; return p; }
    Pull p = {-t.x.x * (t.stiffness * t.gap + t.damping * t.start.x), (t.ahead[0] * h * t.stiffness + t.ahead[1] * t.damping) * h};
    return p;
}

// w.qdd, accelerations with the touches that have not parted, by the matrix; false at what has no inertia.
BIG bool pressed(Work& w, real h) {
    Tree& tr = w.tree;
    real here[HERE], *l = UNROLLED ? here : tr.factor;
    real x[NV], stiff[NV];
    onward<0, NV>([&](auto k) { w.qdd[k] = w.right[k]; stiff[k] = 0; });
    onward<0, DRIVES>([&](auto i) { w.qdd[DOFS + i] += w.drives.torque[i]; stiff[DOFS + i] = w.drives.resists[i] * h; });
    for (int k = w.points; k < w.touches; k++) {
        const Touch& t = w.touch[k];
        const Pull p = pull(t, h);
        w.qdd[t.dof] += p.torque;
        stiff[t.dof] += p.resists;
    }
    entries([&](int k) { l[k] = tr.mass[k]; });
    onward<0, NV>([&](auto k) { x[k] = w.qdd[k]; l[LOWER(k, k)] += stiff[k]; });
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
        const V3 torque = turn_torque(t, t.spin);
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
    onward<0, NV>([&](auto k) { w.qdd[k] = x[k]; });
    return true;
}

// The same along the tree.
BIG bool pressed_along(Work& w, real h) {
    Tree& tr = w.tree;
    inertias(tr, w.along);
    for (int k = 0; k < NV; k++) w.qdd[k] = w.right[k];
    for (int i = 0; i < NJ; i++) w.along.joints[i] = w.along.dampers[i];
    for (int i = 0; i < DRIVES; i++) { w.qdd[DOFS + i] += w.drives.torque[i]; w.along.joints[i] += w.drives.resists[i] * h; }
    for (int i = 0; i < NL; i++) for (int k = 0; k < 6; k++) w.along.force[i][k] = 0;
    for (int k = 0; k < w.points; k++) {
        const Touch& t = w.touch[k];
        if (t.parted) continue;
        const Push p = push(t, h);
        resist(w.along, t.link, t.x, t.normal, p.force, p.along, p.across);
#if TURNS
        if (!turns(t)) continue;
        const V3 torque = turn_torque(t, t.spin);
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

// Whether w.qdd changes anything of the touches: each one's drag is then that of its force and slip at the end, and what would pull has parted.
BIG bool judge(Work& w, real h, real settled) {
    Motion twist[NL];
    if (!ALONG) twists(w.tree, w.qdd, twist);
    bool changed = false;
    for (int k = 0; k < w.points; k++) {
        Touch& t = w.touch[k];
        if (t.parted) continue;
        const V3 n = t.normal;
        const V3 change = (ALONG ? reached(w.along, t.link, t.x) : at(twist[t.link], t.x)) * h + t.turn * h;
        const V3 velocity = t.start;
        const real vn = dot(n, velocity), dn = dot(n, change);
        const real normal = -(t.stiffness * (t.gap + t.ahead[0] * h * dn) + t.damping * (vn + t.ahead[1] * dn));
        t.parted = normal < 0;
        w.eventful = w.eventful || t.parted;
        const V3 seen = velocity + change * t.ahead[2];
        const V3 slip = seen - n * dot(n, seen);
        t.force = t.parted ? v3(0, 0, 0) : n * normal - slip * t.across;
        const real across = drag(most(normal, 0), norm(slip), t.friction_damping, t.friction);
        changed = changed || t.parted || size(across / t.across - 1) > settled;
        t.across = across;
#if TURNS
        if (!turns(t)) continue;
        const V3 turned = ALONG ? reached(w.along, t.link) : twist[t.link].ang;
        real about, turning;
        turn_drags(t, t.parted ? 0 : normal, t.spin + turned * h, about, turning);
        const auto differs = [&](real now, real before) { return size(now - before) > settled * most(before, (real)1e-12); };
        changed = changed || differs(about, t.about) || differs(turning, t.turning);
        t.about = about; t.turning = turning;
#endif
    }
    for (int k = w.points; k < w.touches; k++) {
        Touch& t = w.touch[k];
        if (t.sticky) continue;
        const real change = w.qdd[t.dof] * h;
        const real across = drag(-t.stiffness * t.gap, size(t.start.y + change * t.ahead[2]), t.friction_damping, t.friction);
        changed = changed || size(across / t.across - 1) > settled;
        t.across = across;
    }
    // A held one is not asked again. All are asked before any is written, so that no load waits for another.
    Drives& d = w.drives;
    unsigned beyond[PULLS / 32 + 1] = {};
    const auto torque = [&](int i) { return d.torque[i] - d.resists[i] * (w.qdd[DOFS + i] * h); };
    onward<0, DRIVES>([&](auto i) {
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
