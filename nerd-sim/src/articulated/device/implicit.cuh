// A substep that looks ahead, as articulated/implicit.rs, where the equations are.

// The share of a spring with z = h^2 k w: it keeps energy, or loses it where the substep is too long to follow it.
FN real foresight(real z) { return most((real)0.5 - (real)0.5 / z, EVEN); }

// The inverse of the mass matrix alone.
FN bool plain(Work& w) { return ALONG ? spread(w.tree, w.along) : refill(w.tree); }

// Dampings of the joints, and shares of their dampers and springs.
BIG bool damp(Work& w, real h) {
    bool factored = false;
    for (int i = 0; i < NJ; i++) {
        w.braked[i] = DAMPING(w.tree)[i]; w.damper[i] = (real)0.5; w.spring[i] = EVEN;
        if (h * most(DAMPING(w.tree)[i], h * SPRING[i]) <= LEAST(w.tree)[i]) continue;
        if (!factored && !plain(w)) return false;
        factored = true;
        real ease;
        if (ALONG) {
            ease = (real)w.along.alone[i + FIRST];
        } else {
            for (int k = 0; k < NV; k++) w.right[k] = 0;
            w.right[DOFS + i] = 1;
            solve(w.tree, w.right);
            ease = w.right[DOFS + i];
        }
        const real soft = h * h * SPRING[i] * ease;
        w.braked[i] = most(DAMPING(w.tree)[i], h * SPRING[i] * least(soft, CALM));
        const real z = h * w.braked[i] * ease;
        w.damper[i] = z > 1 ? -1 / expm1(-z) - 1 / z : (real)0.5;
        w.spring[i] = foresight(soft);
    }
    return true;
}

// w of a joint's touch, or of a point's, by the factor of the mass matrix alone.
FN real eased(const Tree& t, const Touch& touch) {
    real x[NV];
    for (int k = 0; k < NV; k++) x[k] = 0;
    x[touch.dof] = dot(touch.normal, touch.x);
    real way = x[touch.dof];
    solve(t, x);
    return way * x[touch.dof];
}
template <class I> FN real eased(const Tree& t, const Touch& touch, I link) {
    V3 a[NV];
    real x[NV], sum = 0;
    columns(t, link, touch.x, a);
    const auto last = last_dof(link);
    upward(last, [&](auto k) { x[k] = dot(touch.normal, a[k]); });
    // n^T J M^-1 J^T n = |L^-T J^T n|^2, and what no DoF above it shares stays zero.
    upward(last, [&](auto i) {
        x[i] *= t.factor[LOWER(i, i)];
        above(i, [&](auto j) { x[j] -= t.factor[LOWER(i, j)] * x[i]; });
        sum += x[i] * x[i];
    });
    return sum;
}

// How far ahead each force must look to be stable.
BIG bool weigh(Work& w, real h) {
    bool fresh = false;
    for (int n = 0; n < w.touches; n++) fresh = fresh || w.weight[w.touch[n].index] < 0;
    if (fresh) {
        if (!plain(w)) return false;
        const auto known = [&](const Touch& t, real weight) { w.weight[t.index] = weight > 0 ? weight : infinite(); };
        if (ALONG) {
            for (int n = 0; n < w.touches; n++) {
                const Touch& t = w.touch[n];
                if (w.weight[t.index] < 0) known(t, (real)eased(w.along, t.link, t.dof, t.x, t.normal));
            }
        } else {
            points(w, [&](const Touch& t, auto link) { if (w.weight[t.index] < 0) known(t, eased(w.tree, t, link)); });
            for (int n = 0; n < w.touches; n++) {
                const Touch& t = w.touch[n];
                if (w.weight[t.index] < 0) known(t, eased(w.tree, t));
            }
        }
    }
    for (int n = 0; n < w.touches; n++) {
        Touch& t = w.touch[n];
        const real weight = w.weight[t.index];
        const real vn = dot(t.normal, t.velocity);
        // Beyond its surface for a part of the substep, if its gap at one end is positive.
        if (!t.bounded && t.gap + (real)0.5 * h * size(vn) > 0) w.eventful = true;
        if (vn >= 0 && !t.sticky) t.damping = 0;
        const real normal = most(-(t.stiffness * t.gap + t.damping * vn), 0);
        t.across = drag(normal, norm(t.velocity - t.normal * vn), t.friction_damping, t.friction);
        t.ahead[0] = foresight(h * h * t.stiffness * weight);
        t.ahead[1] = most(1 - 1 / (h * t.damping * weight), (real)0.5);
        t.ahead[2] = most(1 - 1 / (h * t.across * weight), (real)0.5);
        if (w.even && !t.bounded && (t.link >= 0 || t.sticky)) { t.ahead[0] = EVEN; t.ahead[1] = t.ahead[2] = (real)0.5; }
    }
    return true;
}

// What a touch does at its present drag: a force, and how it resists along its normal and across, times h.
struct Push { V3 force; real along, across; };

// h D a of a column a.
FN V3 resisted(const Push& p, V3 n, V3 a) { return n * ((p.along - p.across) * dot(n, a)) + a * p.across; }

FN Push push(const Touch& t, real h) {
    const V3 n = t.normal;
    if (t.held) { Push p = {n * t.hold, 0, 0}; return p; }
    const V3 velocity = t.start;
    const real vn = dot(n, velocity);
    Push p = {n * -(t.stiffness * t.gap + t.damping * vn) - (velocity - n * vn) * t.across,
              (t.ahead[0] * h * t.stiffness + t.ahead[1] * t.damping) * h, t.ahead[2] * t.across * h};
    p.force = p.force - resisted(p, n, t.turn);
    return p;
}

// w.qdd, accelerations with the touches that have not parted, by the matrix; false at what has no inertia.
BIG bool pressed(Work& w, real h) {
    Tree& tr = w.tree;
    real here[HERE], *l = UNROLLED ? here : tr.factor;
    real x[NV], stiff[NV];
    for (int k = 0; k < NV; k++) { w.qdd[k] = w.right[k]; stiff[k] = 0; }
    for (int k = 0; k < w.touches; k++) {
        const Touch& t = w.touch[k];
        if (t.link >= 0 || t.parted) continue;
        const Push p = push(t, h);
        w.qdd[t.dof] += dot(t.x, p.force);
        stiff[t.dof] += dot(t.x, resisted(p, t.normal, t.x));
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
    for (int i = 0; i < NL; i++) for (int k = 0; k < 6; k++) w.along.force[i][k] = 0;
    for (int k = 0; k < w.touches; k++) {
        const Touch& t = w.touch[k];
        if (t.parted) continue;
        const Push p = push(t, h);
        if (t.link >= 0) {
            resist(w.along, t.link, t.x, t.normal, p.force, p.along, p.across);
            continue;
        }
        w.qdd[t.dof] += dot(t.x, p.force);
        w.along.joints[t.dof - DOFS] += dot(t.x, resisted(p, t.normal, t.x));
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
    for (int k = 0; k < w.touches; k++) {
        Touch& t = w.touch[k];
        if (t.parted || t.held || (t.sticky && !t.bounded)) continue;
        const V3 n = t.normal;
        const V3 change = (t.link < 0 ? t.x * w.qdd[t.dof] : ALONG ? reached(w.along, t.link, t.x) : at(twist[t.link], t.x)) * h + t.turn * h;
        const V3 velocity = t.start;
        const real vn = dot(n, velocity), dn = dot(n, change);
        const real normal = -(t.stiffness * (t.gap + t.ahead[0] * h * dn) + t.damping * (vn + t.ahead[1] * dn));
        if (t.bounded) {
            t.held = !(t.bounds[0] <= normal && normal <= t.bounds[1]);
            t.hold = most(t.bounds[0], least(t.bounds[1], normal));
            changed = changed || t.held;
            continue;
        }
        t.parted = normal < 0;
        w.eventful = w.eventful || t.parted;
        const V3 seen = velocity + change * t.ahead[2];
        const V3 slip = seen - n * dot(n, seen);
        t.force = t.parted ? v3(0, 0, 0) : n * normal - slip * t.across;
        const real across = drag(most(normal, 0), norm(slip), t.friction_damping, t.friction);
        changed = changed || t.parted || size(across / t.across - 1) > settled;
        t.across = across;
    }
    return changed;
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
    for (int i = 0; i < NJ; i++) {
        const real share = w.damper[i] * h * w.braked[i] + w.spring[i] * h * h * SPRING[i];
        if (ALONG) w.along.dampers[i] = share;
        else w.tree.mass[LOWER(DOFS + i, DOFS + i)] += share;
    }
}

// w.rate, the change of local velocities, from forces in the substep's middle. 1: found, 0: the substep is too long to find it, -1: no inertia.
BIG int accelerate_ahead(Work& w, const double* tau, real h, bool correct, real settled) {
    Tree& tr = w.tree;
    share(w, h);
    w.twice = false;
    bool stale = true, corrected = false, quiet = false, found = true;
    V3 turned = v3(0, 0, 0);
    for (int pass = 0; pass < PASSES; pass++) {
        if (stale) {
            if (pass) {
                w.twice = true;
                w.once = pass == 1;
                for (int k = 0; DRIVEN && k < w.touches; k++) w.early[k] = idle(w.touch[k]);
            }
            for (int k = 0; k < NV; k++) w.middle[k] = tr.qd[k] + (real)0.5 * h * w.rate[k];
            bias(tr, w.middle, w.gravity, FOLDS ? w.external : 0);
            // The derivative of a velocity that moves along is the spatial acceleration and w x v.
            if (DOFS) turned = cross(v3(w.middle[0], w.middle[1], w.middle[2]), v3(w.middle[3], w.middle[4], w.middle[5]));
            for (int k = 0; k < w.touches; k++) if (w.touch[k].link >= 0) bend(w, w.touch[k], turned, h);
            for (int k = 0; k < NV; k++) w.right[k] = -tr.tau[k];
            for (int i = 0; i < NJ; i++) w.right[DOFS + i] += (real)tau[i] + w.pull[i] - w.braked[i] * tr.qd[DOFS + i];
        }
        if (!(ALONG ? pressed_along(w, h) : pressed(w, h))) return -1;
        const bool changed = judge(w, h, settled);
        if (ALONG) {
            // A chain may whip: then the rate of the substep before says little of this one's middle.
            real jump = 0;
            for (int k = DOFS; k < NV; k++) jump = most(jump, size(tr.qd[k] + (real)0.5 * h * w.qdd[k] - w.middle[k]));
            jump *= h;
            found = jump <= FAR_OFF;
            // What changed because a point has parted is no whip.
            if (!(jump - jump == 0) || (corrected && quiet && !found)) return 0;
            correct = correct || jump > (corrected ? FAR_OFF : OFF);
            quiet = !changed;
        }
        for (int k = 0; k < NV; k++) w.rate[k] = w.qdd[k];
        if (DOFS) {
            w.rate[3] += turned.x; w.rate[4] += turned.y; w.rate[5] += turned.z;
        }
        if (!changed && !correct) return 1;
        // The rate that an unbounded drive would give says nothing of the middle.
        const bool wait = DRIVEN && changed;
        stale = correct && !wait;
        correct = correct && wait;
        corrected = corrected || stale;
    }
    w.eventful = true;
    return found;
}

// A frame of so many substeps, each in halves while it is too long to be solved.
template <class K>
BIG int implicit(Work& w, const double* scene, const double* tau, const double* drives, double* forces, int substeps, const K& keeper) {
    Tree& tr = w.tree;
    const int whole = 1 << HALVINGS;
    int halved = 0, done = 0;      // how often this substep is; parts of the whole one that are behind
    real shared = 0;               // the length for which dampers are known
    keeper.begin(true, substeps);
    tr.shift = v3(0, 0, 0);
    for (int k = 0; k < WEIGHTS; k++) w.weight[k] = -1;
    for (int substep = 0; substep < substeps;) {
        const bool first = substep == 0 && done == 0;
        const real h = (real)(FRAME / substeps / (1 << halved));
        if (ALONG) for (int k = 0; k < NQ; k++) w.before[k] = tr.q[k];
        drift(tr, (real)0.5 * h);
        keeper.begins(w, substep);
        kinematics(tr);
        see(w, scene);
        if (!find(w, h, drives)) return LOST;
        if (FOLDS) fold(w, (real)(FRAME / substeps), h);
        if (!ALONG) crba(tr);
        if (shared != h) {
            if (!damp(w, h)) return 1 + tr.lost;
            shared = h;
        }
        if (!weigh(w, h)) return 1 + tr.lost;
        if (first) for (int k = 0; k < NV; k++) w.rate[k] = 0;
        const int found = accelerate_ahead(w, tau, h, first, SETTLED / substeps);
        if (found < 0) return 1 + tr.lost;
        if (!found && halved < HALVINGS) {
            for (int k = 0; k < NQ; k++) tr.q[k] = w.before[k];
            halved++;
            continue;
        }
        for (int k = 0; DRIVEN && k < w.touches; k++) {
            const Touch& t = w.touch[k];
            if (!t.bounded) continue;
            const real change = h * w.rate[t.dof];
            const real force = t.held ? t.hold : -(t.stiffness * (t.gap + t.ahead[0] * h * change) + t.damping * (t.velocity.x + t.ahead[1] * change));
            const real work = force * h * (tr.qd[t.dof] + (real)0.5 * change);
            w.work += work;
            w.effort += size(work);
        }
        keeper.ends(w, substep, h);
        for (int k = DOFS; k < NV; k++)
            if (h * most(size(tr.qd[k]), size(tr.qd[k] + h * w.rate[k])) > WHIRL) w.eventful = true;
        for (int k = 0; k < NV; k++) tr.qd[k] += h * w.rate[k];
        if (forces)
            for (int k = 0; k < w.touches; k++) {
                const Touch& t = w.touch[k];
                if (t.link < 0) continue;
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
    return 0;
}
