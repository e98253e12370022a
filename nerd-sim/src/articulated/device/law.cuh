// Derivatives of contact and joint forces in a substep, as articulated/gradients/law.rs and contact_law.rs.

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

// Gradient w.r.t. theta => added to those w.r.t. x (stiffness or damping) and w, unless theta is at its lower bound.
template <class T>
FN void shared(real share, real bound, real top, real x, real w, T by_share, T& by_own, T& by_weight) {
    if (!(share > bound)) return;
    by_own = by_own + by_share * ((top - share) / x);
    by_weight = by_weight + by_share * ((top - share) / w);
}

// Adjoint of touch.cuh's `inside`. by_gap: gradient w.r.t. the mean gap => w.r.t. the gap in the middle. Sets by_half,
// the gradient w.r.t. the size of half the gap's change. False if inside for all of the substep.
template <class T> FN bool parted(real gap, real half, T by_part, T& by_gap, T& by_half) {
    half = size(half);
    if (!(gap + half > 0)) return false;
    const real middle = 2 * gap + half;
    by_half = by_gap * (real)-0.5 + by_part * ((real)0.5 * middle / (half * half));
    by_gap = by_gap * (real)0.5 + by_part * ((real)-0.5 / half);
    return true;
}

// A contact's force and its derivatives. by_gap: gap in the middle; by_weight: w; by_across: w across the normal.
// by_change: change h J qdd (or the root's h w x v) of the velocity; by_velocity: velocity at the start. by_bend: rate
// of the velocity at zero qdd; by_held: held force.
struct Law { V3 force, by_gap, by_weight, by_across; M3 by_change, by_velocity, by_bend, by_held; };

template <class M>
BIG void contact_law(const Touch& t, V3 change, real weight, real h, bool first, bool again, bool mean_theta,
                     const M* material, Law& law) {
    const V3 n = t.normal;
    const real k = t.stiffness, spring = t.theta[0], slide = t.theta[2];
    change = change + t.turn * h;
    const real vn = dot(n, t.start), dn = dot(n, change), released = k * t.release;
    const bool then_parting = dot(n, t.velocity) >= 0;
    const bool parting = first ? then_parting : parts(t, vn, dn, h, weight, mean_theta);
    const real d_then = then_parting ? released : t.approach, d = parting ? released : t.approach;
    const real damper = damper_theta(h, d, weight, mean_theta);
    const real normal = -(k * (t.gap + spring * h * dn) + d * (vn + damper * dn));
    const V3 seen = t.start + change * slide - t.slip_offset, slip = seen - n * dot(n, seen);
    const real vn_then = dot(n, t.velocity);
    const V3 slip_then = t.velocity - n * vn_then - t.slip_offset_start;
    const real speed_then = norm(slip_then);
    const Drag then = dragged(-(k * t.gap + d_then * vn_then), speed_then, t.friction_damping, t.friction);
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
    for (int i = 0; i < 9; i++)
        law.by_change.m[i] = by_slip.m[i] * slide - pressed.m[i] * (k * spring * h + d * damper);
    V3 by_gap = by_normal * -k, by_k = by_normal * -(t.gap + spring * h * dn), by_d = by_normal * -(vn + damper * dn);
    V3 by_stick = slip * -now.by_damping, by_then = first ? slip * (real)-1 : v3(0, 0, 0);
    law.by_weight = v3(0, 0, 0);
    if (!mean_theta) {
        shared(spring, MEAN_THETA, (real)0.5, k, weight, by_normal * -(k * h * dn), by_k, law.by_weight);
        shared(damper, (real)0.5, (real)1, d, weight, by_normal * -(d * dn), by_d, law.by_weight);
        shared(slide, (real)0.5, (real)1, then.value, weight, by_slip * change, by_then, law.by_weight);
    }
    const V3 normal_then = by_then * then.by_normal;
    by_gap = by_gap - normal_then * k;
    by_k = by_k - normal_then * t.gap;
    V3 by_vn = normal_then * -d_then, by_half;
    const real approach = (real)material[1], release = (real)(material[0] * material[7]);
    const V3 by_part = by_k * (real)material[0] + by_d * (parting ? release : approach)
        - normal_then * (vn_then * (then_parting ? release : approach));
    if (parted(t.gap, (real)0.5 * h * vn_then, by_part, by_gap, by_half))
        by_vn = by_vn + by_half * ((vn_then < 0 ? -1 : 1) * (real)0.5 * h);
    law.by_gap = by_gap;
    law.by_velocity = sum(by_start, outer(by_vn, n), 1);
    const real c = t.friction_damping;
    law.by_held = by_slip;
    // The slip offset is the held force over the sticking drag.
    by_stick = by_stick + by_then * then.by_damping + by_slip * t.slip_offset * (c > 0 ? 1 / c : 0);
    if (speed_then > 0) {
        const M3 own = outer(by_then, slip_then);
        law.by_velocity = sum(law.by_velocity, own, then.by_speed / speed_then);
        by_stick = by_stick + own * t.slip_offset_start * (then.by_speed / speed_then * (c > 0 ? 1 / c : 0));
        if (!again) law.by_held = sum(law.by_held, own, then.by_speed / speed_then);
    }
    for (int i = 0; i < 9; i++) law.by_held.m[i] *= c > 0 ? -1 / c : 0;
    law.by_across = by_stick * (-c * (c * h / STICK_DRAG));
    for (int i = 0; i < 9; i++) law.by_bend.m[i] = (law.by_change.m[i] - (real)0.5 * by_start.m[i]) * h;
}

#if TURNS
// A contact's torque and its derivatives, as articulated/gradients/turn.rs. by_press: normal force (of `law`; with
// `first`, at the start); by_across: w across the normal. by_change: change h J qdd of the link's angular velocity;
// by_spin: that velocity at the start; by_held: held torque. by_gap, by_vn: derivatives of the normal force w.r.t. gap
// and normal velocity, with `first`.
struct TurnLaw { V3 torque, by_press, by_across; M3 by_change, by_spin, by_held; real by_gap, by_vn; };

template <class M>
BIG void turn_law(const Touch& t, V3 change, real h, bool first, bool again, const M* material, const Law& law,
                  TurnLaw& own) {
    const V3 n = t.normal, seen = t.spin + change - t.turn_offset, slip = first ? t.spin - t.turn_offset_start : seen;
    real press = most(dot(n, law.force), 0);
    own.by_gap = own.by_vn = 0;
    if (first) {
        const real vn = dot(n, t.velocity);
        press = -(t.stiffness * t.gap + t.damping * vn);
        if (press > 0) {
            real by_half;
            own.by_gap = -t.stiffness; own.by_vn = -t.damping;
            const real damping = (real)(vn < 0 ? material[1] : material[0] * material[7]);
            const real by_part = -t.gap * (real)material[0] - vn * damping;
            if (parted(t.gap, (real)0.5 * h * vn, by_part, own.by_gap, by_half))
                own.by_vn += by_half * (vn < 0 ? -1 : 1) * (real)0.5 * h;
        } else {
            press = 0;
        }
    }
    const real about = dot(n, seen), about_then = dot(n, slip), c = sticks(t);
    const V3 across = seen - n * about, across_then = slip - n * about_then;
    const real faster = norm(across_then);
    const Drag drag = dragged(press, size(about_then), stick(t, t.torsion), t.torsion);
    const Drag turning = dragged(press, faster, stick(t, t.rolling), t.rolling);
    const V3 by_fast = n * (about_then < 0 ? -drag.by_speed : drag.by_speed);
    const V3 by_faster = turning.by_speed == 0 ? v3(0, 0, 0) : across_then * (turning.by_speed / faster);
    const M3 nn = outer(n, n);
    for (int i = 0; i < 9; i++)
        own.by_held.m[i] = nn.m[i] * (turning.value - drag.value) - (i % 4 == 0 ? turning.value : 0);
    own.torque = own.by_held * seen;
    own.by_spin = sum(sum(own.by_held, outer(n, by_fast), -about), outer(across, by_faster), -1);
    own.by_change = first ? own.by_held : own.by_spin;
    own.by_press = n * (-about * drag.by_normal) - across * turning.by_normal;
    // The turn offset is the held torque over the sticking drag.
    own.by_across = n * (drag.value > 0 ? -about * drag.by_damping : 0)
        - across * (turning.value > 0 ? turning.by_damping : 0);
    own.by_across = own.by_across + own.by_change * t.turn_offset * (1 / c);
    if (first) own.by_across = own.by_across + sum(own.by_spin, own.by_held, -1) * t.turn_offset_start * (1 / c);
    own.by_across = own.by_across * (-c * (t.friction_damping * h / STICK_DRAG));
    own.by_held = first && again ? own.by_held : own.by_spin;
    for (int i = 0; i < 9; i++) own.by_held.m[i] *= -1 / c;
}
#endif

// Derivatives of a joint's torque w.r.t. h qdd, coordinate, rate and w.
struct JointLaw { real by_change, by_gap, by_rate, by_weight; };

FN JointLaw joint_law(const Touch& t, real change, real weight, real h, bool first, bool mean_theta) {
    JointLaw law = {0, 0, 0, 0};
    if (!t.spring) {
        // Dry friction.
        const real rate = t.velocity.y, seen = rate + change, at = first ? rate : seen;
        const Drag d = dragged(-t.gap, size(at), t.friction_damping, 1);
        law.by_change = -(d.value + (first ? 0 : size(seen) * d.by_speed));
        law.by_rate = first ? -(d.value + seen * d.by_speed * (rate < 0 ? -1 : 1)) : law.by_change;
        return law;
    }
    const real* limit = LIMIT + 4 * (t.dof - DOFS);
    const real k = t.stiffness, d = t.damping, spring = t.theta[0], damper = t.theta[1];
    const real side = t.x.x, rate = t.velocity.x;
    change *= side;
    real by_k = -(t.gap + spring * h * change), by_d = -(rate + damper * change), by_half;
    law.by_change = -(k * spring * h + d * damper); law.by_gap = -k; law.by_rate = -d;
    if (!mean_theta || t.drive) {
        shared(spring, MEAN_THETA, (real)0.5, k, weight, -k * h * change, by_k, law.by_weight);
        shared(damper, (real)0.5, (real)1, d, weight, -d * change, by_d, law.by_weight);
    }
    if (!t.drive && parted(t.gap, (real)0.5 * h * rate, by_k * limit[2] + by_d * limit[3], law.by_gap, by_half))
        law.by_rate += by_half * (real)0.5 * h * (rate < 0 ? -1 : 1);
    law.by_weight *= side;
    return law;
}
