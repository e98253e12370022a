// Implicit substeps, as articulated/implicit.rs, which has the equations.

// theta of a spring with z = h^2 k w: MEAN_THETA keeps its energy; a larger theta, for a spring too stiff for h, loses
// some.
FN real spring_theta(real z) { return most((real)0.5 - (real)0.5 * inverse(z), MEAN_THETA); }

// x^T M^-1 x = |L^-T x|^2 for an x that is zero except at DoF `last` and above.
template <class I> FN real inv_mass(const Tree& t, I last, real* x) {
    real sum = 0;
    upward(last, [&](auto i) {
        x[i] *= t.factor[LOWER(i, i)];
        above(i, [&](auto j) { x[j] -= t.factor[LOWER(i, j)] * x[i]; });
        sum += x[i] * x[i];
    });
    return sum;
}

// Factor of the mass matrix without contacts, unless known, and w of the joints => w.alone. False if not positive
// definite.
BIG bool plain(Work& w) {
    Tree& t = w.tree;
    if (w.plain) return true;
    w.plain = true;
    if (!(ALONG ? spread(t, w.along) : refill(t))) return false;
    if (ALONG) {
        for (int i = 0; i < NJ; i++) w.alone[i] = (real)w.along.alone[i + FIRST];
        return true;
    }
    for_up<DOFS, NV>([&](auto k) {
        real x[NV];
        upward(k, [&](auto i) { x[i] = 0; });
        x[k] = 1;
        w.alone[k - DOFS] = inv_mass(t, k, x);
    });
    return true;
}

// Damping of each joint, theta of its damper and spring => w.damping_used, w.damper, w.spring. False if `plain` fails.
BIG bool damp(Work& w, real h) {
    for (int i = 0; i < NJ; i++) {
        w.damping_used[i] = DAMPING(w.tree)[i]; w.damper[i] = (real)0.5; w.spring[i] = MEAN_THETA;
        if (h * most(DAMPING(w.tree)[i], h * SPRING[i]) <= LEAST(w.tree)[i]) continue;
        if (!plain(w)) return false;
        const real inv_mass = w.alone[i];
        const real soft = h * h * SPRING[i] * inv_mass;
        w.damping_used[i] = most(DAMPING(w.tree)[i], h * SPRING[i] * least(soft, MAX_SPRING_DAMPING));
        const real z = h * w.damping_used[i] * inv_mass;
        w.damper[i] = z > 1 ? -1 / expm1(-z) - 1 / z : (real)0.5;
        w.spring[i] = spring_theta(soft);
    }
    return true;
}

// w of a contact along a direction, from the columns a of its Jacobian.
template <class I> FN real inv_mass(const Tree& t, const V3* a, V3 direction, I last) {
    real x[NV];
    upward(last, [&](auto k) { x[k] = dot(direction, a[k]); });
    return inv_mass(t, last, x);
}

// w (1/kg) along the normal; sum of w over both directions across it.
struct InvMass { real along, across; };
template <class I> FN InvMass inv_mass(const Work& w, const Touch& t, I link) {
    const V3 n = t.normal, s = v3(size(n.x), size(n.y), size(n.z));
    V3 one = cross(n, s.x <= s.y && s.x <= s.z ? unit(0) : s.y <= s.z ? unit(1) : unit(2));
    one = one * (1 / norm(one));
    const V3 other = cross(n, one);
    InvMass e;
    if constexpr (ALONG) {
        e.along = (real)inv_mass(w.along, t.link, t.x, n);
        e.across = (real)(inv_mass(w.along, t.link, t.x, one) + inv_mass(w.along, t.link, t.x, other));
    } else {
        V3 a[NV];
        columns(w.tree, link, t.x, a);
        const auto last = last_dof(link);
        e.along = inv_mass(w.tree, a, n, last);
        e.across = inv_mass(w.tree, a, one, last) + inv_mass(w.tree, a, other, last);
    }
    return e;
}

// Chooses theta of spring, damper and drag so that the step is stable. False if `plain` fails.
BIG bool set_thetas(Work& w, real h) {
    bool fresh = false;
    if (DRIVEN) fresh = w.weight[DRIVEN_AT] < 0;
    for (int n = 0; n < w.touches; n++) fresh = fresh || w.weight[w.touch[n].index] < 0;
    if (fresh) {
        if (!plain(w)) return false;
        const auto known = [&](int index, real weight) { w.weight[index] = weight > 0 ? weight : infinite(); };
        points(w, [&](const Touch& t, auto link) {
            if (!(w.weight[t.index] < 0)) return;
            const InvMass e = inv_mass(w, t, link);
            known(t.index, e.along);
            w.slide[t.index] = e.across;
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
        // A point is outside its surface for a part of the substep if its gap is positive at one end.
        if (t.gap + (real)0.5 * h * size(vn) > 0) w.may_gain_energy = true;
        if (!t.spring) t.damping = vn < 0 ? t.approach : t.stiffness * t.release;
        const real normal = most(-(t.stiffness * t.gap + t.damping * vn), 0);
        if (n < w.points) {
            t.friction_damping = STICK_DRAG / (h * most(w.slide[t.index], MIN_INV_MASS));
            hold(t, w.force_before[t.index]);
            t.slip_offset_start = t.slip_offset;
#if TURNS
            wind(t, w.torque_before[t.index]);
            t.turn_offset_start = t.turn_offset;
#endif
        }
        t.drag = drag(normal, norm(t.velocity - t.normal * vn - t.slip_offset), t.friction_damping, t.friction);
#if TURNS
        if (turns(t)) turn_drags(t, normal, t.spin - t.turn_offset, false, t.about, t.turning);
#endif
        t.theta[0] = spring_theta(h * h * t.stiffness * weight);
        // A single contact too stiff for h gains no energy, but several on one body may.
        w.may_gain_energy = w.may_gain_energy || n < w.points && t.theta[0] > MEAN_THETA;
        t.theta[1] = damper_theta(h, t.damping, weight, false);
        t.theta[2] = most(1 - 1 / (h * t.drag * weight), (real)0.5);
        if (w.mean_theta && (t.link >= 0 || t.spring)) { t.theta[0] = MEAN_THETA; t.theta[1] = t.theta[2] = (real)0.5; }
    }
    Drives& d = w.drives;
    for (int k = 0; DRIVEN && k <= DRIVES / 32; k++) d.held[k] = 0;
    for_up<0, DRIVES>([&](auto i) {
        const real weight = w.weight[DRIVEN_AT + i], effort = d.effort[i];
        const real v = w.tree.qd[DOFS + i], gap = (real)(w.tree.q[COORDS + i] - d.target[i]);
        d.theta[0][i] = spring_theta(h * h * d.kp[i] * weight);
        d.theta[1][i] = most(1 - inverse(h * d.kd[i] * weight), (real)0.5);
        d.torque[i] = -(d.kp[i] * gap + d.kd[i] * (v - d.speed[i]));
        d.resists[i] = d.theta[0][i] * h * d.kp[i] + d.theta[1][i] * d.kd[i];
        d.low[i] = v < -TOP[i] ? 0 : -effort;
        d.high[i] = v > TOP[i] ? 0 : effort;
    });
    return true;
}

// A contact's `start` and `turn` at velocities w.middle; `turned` is the root's w x v.
FN void bend(Work& w, Touch& t, V3 turned, real h) {
    const Tree& tr = w.tree;
    const int point = t.index / w.surfaces;
    const Motion twist = tr.velocity[t.link];
    Motion a = motion(v3(0, 0, 0), v3(0, 0, 0));
    for (int i = t.link; i >= (DOFS ? 1 : 0); i = PARENT[i])
        a = a + cross(tr.velocity[i], tr.axis[i] * w.middle[DOF[i]]);
    V3 moves = at(twist, t.x + t.normal * RADIUS[point]);
    if (LOCI && LOCUS[point] == 1) moves = at(twist, middle(tr, point)) + runs(tr, point, t.normal, twist.ang, h);
    const V3 bent = at(a, t.x) + cross(twist.ang, moves) - turned;
    t.start = t.velocity - bent * ((real)0.5 * h);
    t.turn = turned + bent;
}

// Adds the implicit terms of the joints' own dampers and springs to the matrix.
FN void share(Work& w, real h) {
    for_up<0, NJ>([&](auto i) {
        const real share = w.damper[i] * h * w.damping_used[i] + w.spring[i] * h * h * SPRING[i];
        if (ALONG) w.along.dampers[i] = share;
        else w.tree.mass[LOWER(DOFS + i, DOFS + i)] += share;
    });
}

// Solves for w.rate, the rate of local velocities with forces in the substep's middle. Returns 1; 0: the substep is too
// long; -1: the matrix is not positive definite.
BIG int accelerate_ahead(Work& w, real h, bool correct, real settled) {
    Tree& tr = w.tree;
    share(w, h);
    w.twice = false;
    bool all = true, stale = true, corrected = false, quiet = false, found = true, turns = false;
    V3 turned = v3(0, 0, 0), next = turned;
    const bool spinning = spins(tr.qd, h);
    Spin whole;
    if (spinning) whole = spin(tr);
    w.may_gain_energy = w.may_gain_energy || spinning;
    for (int pass = 0; pass < PASSES + (spinning ? SPIN_PASSES : 0); pass++) {
        if (stale) {
            if (all && pass) {
                w.twice = true;
                w.once = pass == 1;
                for (int k = 0; k < NV; k++) w.guess[k] = w.rate[k];
                for (int k = 0; k < w.points; k++) hold(w.touch[k], w.touch[k].force * HELD_FACTOR);
#if TURNS
                for (int k = 0; k < w.points; k++) wind(w.touch[k], w.touch[k].torque * HELD_FACTOR);
#endif
                for (int k = 0; DRIVEN && k < w.touches + DRIVES; k++) w.early[k] = idle(w, k);
            }
            if (all) for_up<0, NV>([&](auto k) { w.middle[k] = tr.qd[k] + (real)0.5 * h * w.rate[k]; });
            if (turns) { w.middle[0] = next.x; w.middle[1] = next.y; w.middle[2] = next.z; }
            bias(tr, w.middle, w.gravity, FOLDS ? w.external : 0);
            // A root's p_ddot is its spatial acceleration plus w x v.
            const real* m = w.middle;
            if (DOFS) turned = cross(v3(m[0], m[1], m[2]), v3(m[3], m[4], m[5]));
            for (int k = 0; k < w.points; k++) bend(w, w.touch[k], turned, h);
            for_up<0, NV>([&](auto k) { w.right[k] = -tr.tau[k]; });
            for_up<0, NJ>([&](auto i) {
                w.right[DOFS + i] += (real)w.tau[i] + w.pull[i] - w.damping_used[i] * tr.qd[DOFS + i];
            });
        }
        if (!(ALONG ? pressed_along(w, h) : pressed(w, h))) return -1;
        const bool changed = update_touches(w, h, settled, pass);
        if (WHIPS) {
            // In a chain that whips, the rate of the substep before does not predict this substep's middle velocity.
            real jump = 0;
            for_up<DOFS, NV>([&](auto k) {
                jump = most(jump, size(tr.qd[k] + (real)0.5 * h * w.qdd[k] - w.middle[k]));
            });
            jump *= h;
            found = jump <= FAR_OFF;
            // A jump of the velocity because a contact separated is no whip.
            if (!(jump - jump == 0) || (corrected && quiet && !found)) return 0;
            correct = correct || jump > (corrected ? FAR_OFF : OFF);
            quiet = !changed;
        }
        for_up<0, NV>([&](auto k) { w.rate[k] = w.qdd[k]; });
        if (DOFS) {
            w.rate[3] += turned.x; w.rate[4] += turned.y; w.rate[5] += turned.z;
        }
        // A rate found with a drive beyond its bounds does not predict the middle velocity.
        const bool wait = DRIVEN && changed;
        turns = spinning && !(correct && wait) && spun(whole, tr.qd, w.middle, w.rate, h, next);
        if (!changed && !correct && !turns) return 1;
        all = correct && !wait;
        correct = correct && wait;
        corrected = corrected || all;
        stale = all || turns;
    }
    w.may_gain_energy = true;
    return found;
}

// A frame of implicit substeps, each halved while too long to solve. Returns 0 or a fault.
template <class K>
BIG int implicit(Work& w, const double* scene, double* forces, int substeps, const K& keeper) {
    Tree& tr = w.tree;
    const int whole = 1 << MAX_HALVINGS;
    int halved = 0, done = 0;      // halvings of this substep; its finished part, in units of 1 / whole
    real shared = 0;               // substep length (s) of the last call of `damp`
    keeper.begin(true, substeps);
    centre(tr, 1);
    for (int k = 0; k < WEIGHTS; k++) w.weight[k] = -1;
    for (int k = 0; k < PAIRS; k++) w.force_before[k] = v3(0, 0, 0);
#if TURNS
    for (int k = 0; k < PAIRS; k++) w.torque_before[k] = v3(0, 0, 0);
#endif
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
        if (!set_thetas(w, h)) return 1 + tr.lost;
        if (first) for (int k = 0; k < NV; k++) w.rate[k] = 0;
        const int found = accelerate_ahead(w, h, first, SETTLED / substeps);
        if (found < 0) return 1 + tr.lost;
        if (!found && halved < MAX_HALVINGS) {
            for (int k = 0; k < NQ; k++) tr.q[k] = w.before[k];
            halved++;
            continue;
        }
        for_up<0, DRIVES>([&](auto i) {
            const real change = h * w.rate[DOFS + i], torque = w.drives.torque[i] - w.drives.resists[i] * change;
            const real work = torque * h * (tr.qd[DOFS + i] + (real)0.5 * change);
            w.work += work;
            w.effort += size(work);
        });
        keeper.ends(w, substep, h);
        for (int k = 0; k < w.points; k++) {
            w.force_before[w.touch[k].index] = w.touch[k].force;
#if TURNS
            w.torque_before[w.touch[k].index] = w.touch[k].torque;
#endif
            w.touched = w.touched || !w.touch[k].parted;
        }
        for_up<0, NV>([&](auto k) {
            const real before = tr.qd[k], after = before + h * w.rate[k];
            if (k >= DOFS && h * most(size(before), size(after)) > FAST_MOVE[k < DOFS ? 0 : k - DOFS])
                w.may_gain_energy = true;
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
        // The end of a second half is the end of the substep that was halved.
        done += whole >> halved;
        while (halved > 0 && done % (2 * whole >> halved) == 0) halved--;
        if (done == whole) { done = 0; substep++; }
    }
    centre(tr, -1);
    return 0;
}
