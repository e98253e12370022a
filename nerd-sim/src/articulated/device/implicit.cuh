// A substep that looks ahead, as articulated/implicit.rs, where the equations are.

// The share of a spring with z = h^2 k w: it keeps energy, or loses it where the substep is too long to follow it.
FN real foresight(real z) { return most((real)0.5 - (real)0.5 * inverse(z), EVEN); }

// x^T M^-1 x = |L^-T x|^2 of what is zero but for a DoF and those above it.
template <class I> FN real eased(const Tree& t, I last, real* x) {
    real sum = 0;
    upward(last, [&](auto i) {
        x[i] *= t.factor[LOWER(i, i)];
        above(i, [&](auto j) { x[j] -= t.factor[LOWER(i, j)] * x[i]; });
        sum += x[i] * x[i];
    });
    return sum;
}

// The inverse of the mass matrix alone, if it is not there yet, and w of each joint by it.
BIG bool plain(Work& w) {
    Tree& t = w.tree;
    if (w.plain) return true;
    w.plain = true;
    if (!(ALONG ? spread(t, w.along) : refill(t))) return false;
    if (ALONG) {
        for (int i = 0; i < NJ; i++) w.alone[i] = (real)w.along.alone[i + FIRST];
        return true;
    }
    onward<DOFS, NV>([&](auto k) {
        real x[NV];
        upward(k, [&](auto i) { x[i] = 0; });
        x[k] = 1;
        w.alone[k - DOFS] = eased(t, k, x);
    });
    return true;
}

// Dampings of the joints, and shares of their dampers and springs.
BIG bool damp(Work& w, real h) {
    for (int i = 0; i < NJ; i++) {
        w.braked[i] = DAMPING(w.tree)[i]; w.damper[i] = (real)0.5; w.spring[i] = EVEN;
        if (h * most(DAMPING(w.tree)[i], h * SPRING[i]) <= LEAST(w.tree)[i]) continue;
        if (!plain(w)) return false;
        const real ease = w.alone[i];
        const real soft = h * h * SPRING[i] * ease;
        w.braked[i] = most(DAMPING(w.tree)[i], h * SPRING[i] * least(soft, CALM));
        const real z = h * w.braked[i] * ease;
        w.damper[i] = z > 1 ? -1 / expm1(-z) - 1 / z : (real)0.5;
        w.spring[i] = foresight(soft);
    }
    return true;
}

// w of a point's touch by it.
template <class I> FN real eased(const Tree& t, const Touch& touch, I link) {
    V3 a[NV];
    real x[NV];
    columns(t, link, touch.x, a);
    const auto last = last_dof(link);
    upward(last, [&](auto k) { x[k] = dot(touch.normal, a[k]); });
    return eased(t, last, x);
}

// How far ahead each force must look to be stable.
BIG bool weigh(Work& w, real h) {
    bool fresh = false;
    if (DRIVEN) fresh = w.weight[DRIVEN_AT] < 0;
    for (int n = 0; n < w.touches; n++) fresh = fresh || w.weight[w.touch[n].index] < 0;
    if (fresh) {
        if (!plain(w)) return false;
        const auto known = [&](int index, real weight) { w.weight[index] = weight > 0 ? weight : infinite(); };
        points(w, [&](const Touch& t, auto link) {
            if (w.weight[t.index] < 0) known(t.index, ALONG ? (real)eased(w.along, t.link, t.x, t.normal) : eased(w.tree, t, link));
        });
        for (int n = w.points; n < w.touches; n++) {
            const Touch& t = w.touch[n];
            if (w.weight[t.index] < 0) known(t.index, dot(t.normal, t.x) * dot(t.normal, t.x) * w.alone[t.dof - DOFS]);
        }
        if (DRIVEN && w.weight[DRIVEN_AT] < 0) for (int i = 0; i < DRIVES; i++) known(DRIVEN_AT + i, w.alone[i]);
    }
    for (int n = 0; n < w.touches; n++) {
        Touch& t = w.touch[n];
        const real weight = w.weight[t.index];
        const real vn = dot(t.normal, t.velocity);
        // Beyond its surface for a part of the substep, if its gap at one end is positive.
        if (t.gap + (real)0.5 * h * size(vn) > 0) w.eventful = true;
        if (vn >= 0 && !t.sticky) t.damping = t.stiffness * t.release;
        const real normal = most(-(t.stiffness * t.gap + t.damping * vn), 0);
        t.across = drag(normal, norm(t.velocity - t.normal * vn), t.friction_damping, t.friction);
#if TURNS
        if (turns(t)) turn_drags(t, normal, t.spin, t.about, t.turning);
#endif
        t.ahead[0] = foresight(h * h * t.stiffness * weight);
        t.ahead[1] = most(1 - 1 / (h * t.damping * weight), (real)0.5);
        t.ahead[2] = most(1 - 1 / (h * t.across * weight), (real)0.5);
        if (w.even && (t.link >= 0 || t.sticky)) { t.ahead[0] = EVEN; t.ahead[1] = t.ahead[2] = (real)0.5; }
    }
    Drives& d = w.drives;
    for (int k = 0; DRIVEN && k <= DRIVES / 32; k++) d.held[k] = 0;
    onward<0, DRIVES>([&](auto i) {
        const real weight = w.weight[DRIVEN_AT + i], v = w.tree.qd[DOFS + i], gap = (real)(w.tree.q[COORDS + i] - d.target[i]), effort = d.effort[i];
        d.ahead[0][i] = foresight(h * h * d.kp[i] * weight);
        d.ahead[1][i] = most(1 - inverse(h * d.kd[i] * weight), (real)0.5);
        d.torque[i] = -(d.kp[i] * gap + d.kd[i] * (v - d.speed[i]));
        d.resists[i] = d.ahead[0][i] * h * d.kp[i] + d.ahead[1][i] * d.kd[i];
        d.low[i] = v < -TOP[i] ? 0 : -effort;
        d.high[i] = v > TOP[i] ? 0 : effort;
    });
    return true;
}

// A point's `start` and `turn`, at velocities w.middle; the root's turn is one part.
FN void bend(Work& w, Touch& t, V3 turned, real h) {
    const Tree& tr = w.tree;
    const int point = t.index / w.surfaces;
    const Motion twist = tr.velocity[t.link];
    Motion a = motion(v3(0, 0, 0), v3(0, 0, 0));
    for (int i = t.link; i >= (DOFS ? 1 : 0); i = PARENT[i]) a = a + cross(tr.velocity[i], tr.axis[i] * w.middle[DOF[i]]);
    V3 moves = at(twist, t.x + t.normal * RADIUS[point]);
    if (LOCI && LOCUS[point] == 1) moves = at(twist, middle(tr, point)) + runs(tr, point, t.normal, twist.ang, h);
    const V3 bent = at(a, t.x) + cross(twist.ang, moves) - turned;
    t.start = t.velocity - bent * ((real)0.5 * h);
    t.turn = turned + bent;
}

// What the joints' own dampers and springs resist with.
FN void share(Work& w, real h) {
    onward<0, NJ>([&](auto i) {
        const real share = w.damper[i] * h * w.braked[i] + w.spring[i] * h * h * SPRING[i];
        if (ALONG) w.along.dampers[i] = share;
        else w.tree.mass[LOWER(DOFS + i, DOFS + i)] += share;
    });
}

// w.rate, the change of local velocities, from forces in the substep's middle. 1: found, 0: the substep is too long to find it, -1: no inertia.
BIG int accelerate_ahead(Work& w, real h, bool correct, real settled) {
    Tree& tr = w.tree;
    share(w, h);
    w.twice = false;
    bool all = true, stale = true, corrected = false, quiet = false, found = true, turns = false;
    V3 turned = v3(0, 0, 0), next = turned;
    const bool spinning = spins(tr.qd, h);
    Spin whole;
    if (spinning) whole = spin(tr);
    w.eventful = w.eventful || spinning;
    for (int pass = 0; pass < PASSES + (spinning ? SPIN_PASSES : 0); pass++) {
        if (stale) {
            if (all && pass) {
                w.twice = true;
                w.once = pass == 1;
                for (int k = 0; k < NV; k++) w.guess[k] = w.rate[k];
                for (int k = 0; DRIVEN && k < w.touches + DRIVES; k++) w.early[k] = idle(w, k);
            }
            if (all) onward<0, NV>([&](auto k) { w.middle[k] = tr.qd[k] + (real)0.5 * h * w.rate[k]; });
            if (turns) { w.middle[0] = next.x; w.middle[1] = next.y; w.middle[2] = next.z; }
            bias(tr, w.middle, w.gravity, FOLDS ? w.external : 0);
            // The derivative of a velocity that moves along is the spatial acceleration and w x v.
            if (DOFS) turned = cross(v3(w.middle[0], w.middle[1], w.middle[2]), v3(w.middle[3], w.middle[4], w.middle[5]));
            for (int k = 0; k < w.points; k++) bend(w, w.touch[k], turned, h);
            onward<0, NV>([&](auto k) { w.right[k] = -tr.tau[k]; });
            onward<0, NJ>([&](auto i) { w.right[DOFS + i] += (real)w.tau[i] + w.pull[i] - w.braked[i] * tr.qd[DOFS + i]; });
        }
        if (!(ALONG ? pressed_along(w, h) : pressed(w, h))) return -1;
        const bool changed = judge(w, h, settled);
        if (WHIPS) {
            // A chain may whip: then the rate of the substep before says little of this one's middle.
            real jump = 0;
            onward<DOFS, NV>([&](auto k) { jump = most(jump, size(tr.qd[k] + (real)0.5 * h * w.qdd[k] - w.middle[k])); });
            jump *= h;
            found = jump <= FAR_OFF;
            // What changed because a point has parted is no whip.
            if (!(jump - jump == 0) || (corrected && quiet && !found)) return 0;
            correct = correct || jump > (corrected ? FAR_OFF : OFF);
            quiet = !changed;
        }
        onward<0, NV>([&](auto k) { w.rate[k] = w.qdd[k]; });
        if (DOFS) {
            w.rate[3] += turned.x; w.rate[4] += turned.y; w.rate[5] += turned.z;
        }
        // The rate that an unbounded drive would give says nothing of the middle.
        const bool wait = DRIVEN && changed;
        turns = spinning && !(correct && wait) && spun(whole, tr.qd, w.middle, w.rate, h, next);
        if (!changed && !correct && !turns) return 1;
        all = correct && !wait;
        correct = correct && wait;
        corrected = corrected || all;
        stale = all || turns;
    }
    w.eventful = true;
    return found;
}

// A frame of so many substeps, each in halves while it is too long to be solved.
template <class K>
BIG int implicit(Work& w, const double* scene, double* forces, int substeps, const K& keeper) {
    Tree& tr = w.tree;
    const int whole = 1 << HALVINGS;
    int halved = 0, done = 0;      // how often this substep is; parts of the whole one that are behind
    real shared = 0;               // the length for which dampers are known
    keeper.begin(true, substeps);
    centre(tr, 1);
    for (int k = 0; k < WEIGHTS; k++) w.weight[k] = -1;
    for (int substep = 0; substep < substeps;) {
        const bool first = substep == 0 && done == 0;
        const real h = (real)(FRAME / substeps / (1 << halved));
        if (WHIPS) for (int k = 0; k < NQ; k++) w.before[k] = tr.q[k];
        drift(tr, (real)0.5 * h);
        keeper.begins(w, substep);
        kinematics(tr);
        see(w, scene);
        if (!find(w, h)) return LOST;
        if (FOLDS) fold(w, h);
        if (!ALONG) crba(tr);
        w.plain = false;
        if (shared != h) {
            if (!damp(w, h)) return 1 + tr.lost;
            shared = h;
        }
        if (!weigh(w, h)) return 1 + tr.lost;
        if (first) for (int k = 0; k < NV; k++) w.rate[k] = 0;
        const int found = accelerate_ahead(w, h, first, SETTLED / substeps);
        if (found < 0) return 1 + tr.lost;
        if (!found && halved < HALVINGS) {
            for (int k = 0; k < NQ; k++) tr.q[k] = w.before[k];
            halved++;
            continue;
        }
        onward<0, DRIVES>([&](auto i) {
            const real change = h * w.rate[DOFS + i], torque = w.drives.torque[i] - w.drives.resists[i] * change;
            const real work = torque * h * (tr.qd[DOFS + i] + (real)0.5 * change);
            w.work += work;
            w.effort += size(work);
        });
        keeper.ends(w, substep, h);
        onward<0, NV>([&](auto k) {
            const real before = tr.qd[k], after = before + h * w.rate[k];
            if (k >= DOFS && h * most(size(before), size(after)) > WHIRL) w.eventful = true;
            tr.qd[k] = after;
        });
        if (forces)
            for (int k = 0; k < w.points; k++) {
                const Touch& t = w.touch[k];
                const real share = h / (real)FRAME;
                double* f = forces + 3 * (t.index / w.surfaces);
                f[0] += t.force.x * share; f[1] += t.force.y * share; f[2] += t.force.z * share;
            }
        drift(tr, (real)0.5 * h);
        // The second half of something is its end.
        done += whole >> halved;
        while (halved > 0 && done % (2 * whole >> halved) == 0) halved--;
        if (done == whole) { done = 0; substep++; }
    }
    centre(tr, -1);
    return 0;
}
