// Links of a robot on each other, as articulated/fold.rs, where the law is. FOLDS pairs, each FOLD_LINKS and FOLD_EASE; by link FOLD_OWN (first of
// its capsules, and end) and FOLD_BALL (centre, radius); CAPSULE: middle, half, radius; FOLD_MATERIAL.

struct Capsule { V3 middle, half; real radius; };

FN Capsule placed(const Tree& t, int link, int k) {
    const real* own = CAPSULE + 7 * k;
    const Capsule c = {t.position[link] + t.rotation[link] * read3(own), t.rotation[link] * read3(own + 3), own[6]};
    return c;
}

FN real within(real s) { return most((real)-1, least((real)1, s)); }

// The gap of two capsules, its gradient when the first moves, and the place between them.
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

// Into w.external, what links do to each other in a substep h in whose middle they are now; `whole` is the frame's.
BIG void fold(Work& w, real whole, real h) {
    const Tree& t = w.tree;
    for (int i = 0; i < NL; i++) w.external[FOLDS ? i : 0] = wrench(v3(0, 0, 0), v3(0, 0, 0));
    for (int p = 0; p < FOLDS; p++) {
        const int a = FOLD_LINKS[2 * p], b = FOLD_LINKS[2 * p + 1];
        const V3 one = t.position[a] + t.rotation[a] * read3(FOLD_BALL + 4 * a), other = t.position[b] + t.rotation[b] * read3(FOLD_BALL + 4 * b);
        const real reach = FOLD_BALL[4 * a + 3] + FOLD_BALL[4 * b + 3];
        const Motion twist = t.velocity[a] + t.velocity[b] * (real)-1;
        const real way = (real)0.5 * h * (norm(at(twist, one)) + norm(twist.ang) * reach);
        if (norm(one - other) > reach + way) continue;
        const real ease = whole * FOLD_EASE(t)[p], bound = FOLLOWED / ease;
        const real stiffness = least(FOLD_MATERIAL(t)[0], STIFFEST / ease / whole), damping = least(FOLD_MATERIAL(t)[1], bound);
        const real friction_damping = least(FOLD_MATERIAL(t)[2], bound);
        Wrench sum = wrench(v3(0, 0, 0), v3(0, 0, 0));
        for (int k = FOLD_OWN[2 * a]; k < FOLD_OWN[2 * a + 1]; k++) {
            const Capsule mine = placed(t, a, k);
            if (norm(mine.middle - other) > norm(mine.half) + mine.radius + FOLD_BALL[4 * b + 3] + way) continue;
            for (int l = FOLD_OWN[2 * b]; l < FOLD_OWN[2 * b + 1]; l++) {
                V3 n, x;
                real gap = meets(mine, placed(t, b, l), n, x), part;
                const V3 v = at(twist, x);
                const real vn = dot(n, v);
                if (!inside(gap, (real)0.5 * h * vn, part)) continue;
                const real normal = -(part * stiffness * gap + part * damping * least(vn, 0));
                const V3 slip = v - n * vn;
                const V3 f = n * normal - slip * drag(normal, norm(slip), part * friction_damping, FOLD_MATERIAL(t)[3]);
                sum = sum + wrench(cross(x, f), f);
            }
        }
        w.external[a] = w.external[a] + sum;
        w.external[b] = wrench(w.external[b].ang - sum.ang, w.external[b].lin - sum.lin);
    }
}
