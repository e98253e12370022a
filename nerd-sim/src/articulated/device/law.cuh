// Slopes of what touches do in a substep, by what they see, as articulated/slopes/law.rs, where they are explained.

FN M3 outer(V3 a, V3 b) {
    M3 m = {{a.x * b.x, a.x * b.y, a.x * b.z, a.y * b.x, a.y * b.y, a.y * b.z, a.z * b.x, a.z * b.y, a.z * b.z}};
    return m;
}
FN M3 sum(const M3& a, const M3& b, real k) {
    M3 m;
    for (int i = 0; i < 9; i++) m.m[i] = a.m[i] + k * b.m[i];
    return m;
}

struct Drag { real value, by_normal, by_speed, by_damping; };

FN Drag dragged(real normal, real speed, real friction_damping, real friction) {
    Drag d = {drag(most(normal, 0), speed, friction_damping, friction), 0, 0, 0};
    if (friction_damping * speed <= friction * normal) {
        d.by_damping = 1;
    } else if (normal > 0) {
        d.by_normal = friction / speed;
        d.by_speed = -d.value / speed;
    }
    return d;
}

// A share of a stiffness or damping x at a weight w, unless it is the least one.
template <class T> FN void shared(real share, real bound, real top, real x, real w, T by_share, T& by_own, T& by_weight) {
    if (!(share > bound)) return;
    by_own = by_own + by_share * ((top - share) / x);
    by_weight = by_weight + by_share * ((top - share) / w);
}

// The part of a substep in which a touch is inside, and its mean gap there, by the gap in the middle: `by_gap` becomes that by the middle.
// Adds to what is by the size of half a substep's change; false of what is inside all the time.
template <class T> FN bool parted(real gap, real half, T by_part, T& by_gap, T& by_half) {
    half = size(half);
    if (!(gap + half > 0)) return false;
    const real middle = 2 * gap + half;
    by_half = by_gap * (real)-0.5 + by_part * ((real)0.5 * middle / (half * half));
    by_gap = by_gap * (real)0.5 + by_part * ((real)-0.5 / half);
    return true;
}

// Of a point's force: by `h J qdd` and by `h w x v`; by its velocity at the start and what that bends by; by the gap in the middle; by w.
struct Law { V3 force, by_gap, by_weight; M3 by_change, by_velocity, by_bend; };

template <class M> BIG void contact_law(const Touch& t, V3 change, real weight, real h, bool first, bool even, const M* material, Law& law) {
    const V3 n = t.normal;
    const real k = t.stiffness, d = t.damping, spring = t.ahead[0], damper = t.ahead[1], slide = t.ahead[2];
    change = change + t.turn * h;
    const real vn = dot(n, t.start), dn = dot(n, change);
    const real normal = -(k * (t.gap + spring * h * dn) + d * (vn + damper * dn));
    const V3 seen = t.start + change * slide, slip = seen - n * dot(n, seen);
    const real vn_then = dot(n, t.velocity);
    const V3 slip_then = t.velocity - n * vn_then;
    const real speed_then = norm(slip_then);
    const Drag then = dragged(-(k * t.gap + d * vn_then), speed_then, t.friction_damping, t.friction);
    Drag now = {then.value, 0, 0, 0};
    if (!first) now = dragged(normal, norm(slip), t.friction_damping, t.friction);
    law.force = n * normal - slip * now.value;
    const V3 by_normal = n - slip * now.by_normal;
    const M3 nn = outer(n, n), pressed = outer(by_normal, n);
    const real along = now.by_speed == 0 ? 0 : now.by_speed / norm(slip);
    M3 by_slip;
    for (int i = 0; i < 9; i++) by_slip.m[i] = nn.m[i] * now.value - (i % 4 == 0 ? now.value : 0);
    by_slip = sum(by_slip, outer(slip, slip), -along);
    const M3 by_start = sum(by_slip, pressed, -d);
    for (int i = 0; i < 9; i++) law.by_change.m[i] = by_slip.m[i] * slide - pressed.m[i] * (k * spring * h + d * damper);
    V3 by_gap = by_normal * -k, by_k = by_normal * -(t.gap + spring * h * dn), by_d = by_normal * -(vn + damper * dn);
    V3 by_drag = slip * -now.by_damping, by_then = first ? slip * (real)-1 : v3(0, 0, 0);
    law.by_weight = v3(0, 0, 0);
    if (!even) {
        shared(spring, EVEN, (real)0.5, k, weight, by_normal * -(k * h * dn), by_k, law.by_weight);
        shared(damper, (real)0.5, (real)1, d, weight, by_normal * -(d * dn), by_d, law.by_weight);
        shared(slide, (real)0.5, (real)1, then.value, weight, by_slip * change, by_then, law.by_weight);
    }
    const V3 normal_then = by_then * then.by_normal;
    by_gap = by_gap - normal_then * k;
    by_k = by_k - normal_then * t.gap;
    by_d = by_d - normal_then * vn_then;
    by_drag = by_drag + by_then * then.by_damping;
    V3 by_vn = normal_then * -d, by_half;
    const V3 by_part = by_k * (real)material[0] + by_d * (real)(vn_then < 0 ? material[1] : material[0] * material[7]) + by_drag * (real)material[2];
    if (parted(t.gap, (real)0.5 * h * vn_then, by_part, by_gap, by_half)) by_vn = by_vn + by_half * ((vn_then < 0 ? -1 : 1) * (real)0.5 * h);
    law.by_gap = by_gap;
    law.by_velocity = sum(by_start, outer(by_vn, n), 1);
    if (speed_then > 0) law.by_velocity = sum(law.by_velocity, outer(by_then, slip_then), then.by_speed / speed_then);
    for (int i = 0; i < 9; i++) law.by_bend.m[i] = (law.by_change.m[i] - (real)0.5 * by_start.m[i]) * h;
}

#if TURNS
// Of a point's torque, as articulated/slopes/turn.rs: by the change `h J qdd` of its link's turn, by that at the start; by the normal force, which is that
// of the law, or with `first` that of the substep's start, by the gap in the middle and by the velocity along the normal.
struct TurnLaw { V3 torque, by_press; M3 by_change, by_spin; real by_gap, by_vn; };

template <class M> BIG void turn_law(const Touch& t, V3 change, real h, bool first, const M* material, const Law& law, TurnLaw& own) {
    const V3 n = t.normal, seen = t.spin + change, spin = first ? t.spin : seen;
    real press = most(dot(n, law.force), 0);
    own.by_gap = own.by_vn = 0;
    if (first) {
        const real vn = dot(n, t.velocity);
        press = -(t.stiffness * t.gap + t.damping * vn);
        if (press > 0) {
            real by_half;
            own.by_gap = -t.stiffness; own.by_vn = -t.damping;
            const real by_part = -t.gap * (real)material[0] - vn * (real)(vn < 0 ? material[1] : material[0] * material[7]);
            if (parted(t.gap, (real)0.5 * h * vn, by_part, own.by_gap, by_half)) own.by_vn += by_half * (vn < 0 ? -1 : 1) * (real)0.5 * h;
        } else {
            press = 0;
        }
    }
    const real about = dot(n, seen), about_then = dot(n, spin);
    const V3 across = seen - n * about, across_then = spin - n * about_then;
    const real fast = size(about_then), faster = norm(across_then), ease = 1 / most(fast, CREEP), ease_across = 1 / most(faster, CREEP);
    const real drag = t.torsion * press * ease, drag_across = t.rolling * press * ease_across;
    const V3 by_fast = fast > CREEP ? n * (-drag / about_then) : v3(0, 0, 0);
    const V3 by_faster = faster > CREEP ? across_then * (-drag_across / (faster * faster)) : v3(0, 0, 0);
    const M3 nn = outer(n, n);
    for (int i = 0; i < 9; i++) own.by_spin.m[i] = nn.m[i] * (drag_across - drag) - (i % 4 == 0 ? drag_across : 0);
    own.torque = own.by_spin * seen;
    own.by_change = own.by_spin;
    own.by_spin = sum(sum(own.by_spin, outer(n, by_fast), -about), outer(across, by_faster), -1);
    if (!first) own.by_change = own.by_spin;
    own.by_press = n * (-about * ease * t.torsion) - across * (ease_across * t.rolling);
}
#endif

// Of a torque at a joint: by `h qdd`, by its coordinate and rate, by w.
struct JointLaw { real by_change, by_gap, by_rate, by_weight; };

FN JointLaw joint_law(const Touch& t, real change, real weight, real h, bool first, bool even) {
    JointLaw law = {0, 0, 0, 0};
    if (!t.sticky) {
        // Dry friction.
        const real rate = t.velocity.y, seen = rate + change, at = first ? rate : seen;
        const Drag d = dragged(-t.gap, size(at), t.friction_damping, 1);
        law.by_change = -(d.value + (first ? 0 : size(seen) * d.by_speed));
        law.by_rate = first ? -(d.value + seen * d.by_speed * (rate < 0 ? -1 : 1)) : law.by_change;
        return law;
    }
    const real* limit = LIMIT + 4 * (t.dof - DOFS);
    const real k = t.stiffness, d = t.damping, spring = t.ahead[0], damper = t.ahead[1], side = t.x.x, rate = t.velocity.x;
    change *= side;
    real by_k = -(t.gap + spring * h * change), by_d = -(rate + damper * change), by_half;
    law.by_change = -(k * spring * h + d * damper); law.by_gap = -k; law.by_rate = -d;
    if (!even || t.bounded) {
        shared(spring, EVEN, (real)0.5, k, weight, -k * h * change, by_k, law.by_weight);
        shared(damper, (real)0.5, (real)1, d, weight, -d * change, by_d, law.by_weight);
    }
    if (!t.bounded && parted(t.gap, (real)0.5 * h * rate, by_k * limit[2] + by_d * limit[3], law.by_gap, by_half))
        law.by_rate += by_half * (real)0.5 * h * (rate < 0 ? -1 : 1);
    law.by_weight *= side;
    return law;
}
