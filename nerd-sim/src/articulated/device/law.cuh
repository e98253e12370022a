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

BIG void contact_law(const Touch& t, V3 change, real weight, real h, bool first, bool even, const real* material, Law& law) {
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
    const V3 by_part = by_k * material[0] + by_d * (vn_then < 0 ? material[1] : 0) + by_drag * material[2];
    if (parted(t.gap, (real)0.5 * h * vn_then, by_part, by_gap, by_half)) by_vn = by_vn + by_half * ((vn_then < 0 ? -1 : 1) * (real)0.5 * h);
    law.by_gap = by_gap;
    law.by_velocity = sum(by_start, outer(by_vn, n), 1);
    if (speed_then > 0) law.by_velocity = sum(law.by_velocity, outer(by_then, slip_then), then.by_speed / speed_then);
    for (int i = 0; i < 9; i++) law.by_bend.m[i] = (law.by_change.m[i] - (real)0.5 * by_start.m[i]) * h;
}

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
