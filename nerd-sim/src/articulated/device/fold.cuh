// Self-collision, as articulated/fold.rs, which has the law. FOLDS pairs of parts: FOLD_PARTS, FOLD_INV_MASS (w times
// most contacts, 1/kg), FOLD_MATERIAL (with a margin). Per part: FOLD_LINK, FOLD_OWN (first and end of its capsules),
// FOLD_BALL (centre, radius). CAPSULE: middle, half axis, radius.

struct Capsule { V3 middle, half; real radius; };

FN Capsule placed(const Tree& t, int link, int k) {
    const real* own = CAPSULE + 7 * k;
    const Capsule c = {t.position[link] + t.rotation[link] * read3(own), t.rotation[link] * read3(own + 3), own[6]};
    return c;
}

FN real within(real s) { return most((real)-1, least((real)1, s)); }

// Two capsules => gap (returned), its gradient w.r.t. a's position, place between them.
FN real meets(const Capsule& a, const Capsule& b, V3& normal, V3& place) {
    const V3 u = a.half, v = b.half, apart = a.middle - b.middle;
    const real reach = a.radius + b.radius, barrel = BARREL * reach * reach;
    const real uu = dot(u, u) + barrel, vv = dot(v, v) + barrel, uv = dot(u, v), ud = dot(u, apart), vd = dot(v, apart);
    real s = within((uv * vd - vv * ud) / (uu * vv - uv * uv));
    const real best = (vd + uv * s) / vv, t = within(best);
    if (best != t) s = within((uv * t - ud) / uu);
    const V3 between = apart + u * s - v * t;
    const real distance = sqrt(dot(between, between) + barrel * (s * s + t * t));
    place = b.middle + v * t + between * (b.radius / reach);
    normal = distance > 0 ? between * (1 / distance) : between;
    return distance - reach;
}

// Length (s) of a substep before any refinement.
constexpr real WHOLE = (real)(FRAME / CONTACT_SUBSTEPS);

// Calls met(a, b, m, stiffness, bound, gap, n, x, v) for capsules of links a and b that may meet within h / 2. m:
// material; stiffness (N/m); bound: of dampings (N s/m); gap (m); n: gradient of the gap w.r.t. a's position. x: place
// (m); v: velocity (m/s) of a relative to b.
template <class F> FN void meetings(const Tree& t, real h, const F& met) {
    for (int p = 0; p < FOLDS; p++) {
        const int first = FOLD_PARTS[2 * p], second = FOLD_PARTS[2 * p + 1], a = FOLD_LINK[first],
                  b = FOLD_LINK[second];
        const real *m = FOLD_MATERIAL(t) + 6 * p, *balls[2] = {FOLD_BALL + 4 * first, FOLD_BALL + 4 * second};
        const V3 one = t.position[a] + t.rotation[a] * read3(balls[0]),
                 other = t.position[b] + t.rotation[b] * read3(balls[1]);
        const real reach = balls[0][3] + balls[1][3];
        const Motion twist = t.velocity[a] + t.velocity[b] * (real)-1;
        const real way = (real)0.5 * h * (norm(at(twist, one)) + norm(twist.ang) * reach) + m[4];
        if (norm(one - other) > reach + way) continue;
        const real inv_mass = WHOLE * FOLD_INV_MASS(t)[p],
                   stiffness = least(m[0], MAX_FOLD_STIFFNESS / inv_mass / WHOLE);
        for (int k = FOLD_OWN[2 * first]; k < FOLD_OWN[2 * first + 1]; k++) {
            const Capsule mine = placed(t, a, k);
            if (norm(mine.middle - other) > norm(mine.half) + mine.radius + balls[1][3] + way) continue;
            for (int l = FOLD_OWN[2 * second]; l < FOLD_OWN[2 * second + 1]; l++) {
                V3 n, x;
                const real gap = meets(mine, placed(t, b, l), n, x) - m[4];
                met(a, b, m, stiffness, MAX_FOLD_DAMPING / inv_mass, gap, n, x, at(twist, x));
            }
        }
    }
}

// Forces between links, in the middle of a substep h => w.external.
BIG void fold(Work& w, real h) {
    for (int i = 0; i < NL; i++) w.external[FOLDS ? i : 0] = wrench(v3(0, 0, 0), v3(0, 0, 0));
    meetings(w.tree, h, [&](int a, int b, const real* m, real stiffness, real bound, real gap, V3 n, V3 x, V3 v) {
        const real vn = dot(n, v), damping = least(m[1], bound), friction_damping = least(m[2], bound);
        real part;
        if (!inside(gap, (real)0.5 * h * vn, part)) return;
        const real normal =
            most(0, -(part * stiffness * gap + part * (vn < 0 ? damping : least(stiffness * m[5], bound)) * vn));
        const V3 slip = v - n * vn, f = n * normal - slip * drag(normal, norm(slip), part * friction_damping, m[3]),
                 turn = cross(x, f);
        w.external[a] = w.external[a] + wrench(turn, f);
        w.external[b] = wrench(w.external[b].ang - turn, w.external[b].lin - f);
        w.may_gain_energy = true;
    });
}
