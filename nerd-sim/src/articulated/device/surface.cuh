// Surfaces of a scene's record, as scene.rs and parry have them: NC colliders at most.

constexpr int COLLIDER = 20;   // numbers of one: kind, geometry, material
constexpr int SHARED = 3 + COLLIDER * NC;   // of a record what robots share: gravity, colliders

// As seen from some place: a plane n . x = offset (1), a box (2), or a cylinder about y, of which `half` has the radius and half the height (3).
struct Surface { int kind; V3 normal; real offset; M3 turn; V3 place, half; real material[4]; };

// That of a record, seen from o.
FN void read(Surface& u, const double* s, const double* o) {
    u.kind = (int)s[0];
    if (u.kind == 1) {
        u.normal = v3((real)s[1], (real)s[2], (real)s[3]);
        u.offset = (real)(s[4] - (s[1] * o[0] + s[2] * o[1] + s[3] * o[2]));
    } else {
        for (int k = 0; k < 9; k++) u.turn.m[k] = (real)s[1 + k];
        u.place = v3((real)(s[10] - o[0]), (real)(s[11] - o[1]), (real)(s[12] - o[2]));
        u.half = v3((real)s[13], (real)s[14], (real)s[15]);
    }
    for (int k = 0; k < 4; k++) u.material[k] = (real)s[16 + k];
}

// The nearest place of a box to l, both from its middle; whether l is inside.
FN bool box(V3 half, V3 l, V3& nearest) {
    real a[3] = {l.x, l.y, l.z}, h[3] = {half.x, half.y, half.z}, b[3];
    bool inside = true;
    for (int k = 0; k < 3; k++) {
        b[k] = most(-h[k], least(h[k], a[k]));
        inside = inside && b[k] == a[k];
    }
    if (inside) {
        int axis = 0;
        real depth = infinite();
        for (int k = 0; k < 3; k++) if (h[k] - size(a[k]) < depth) { depth = h[k] - size(a[k]); axis = k; }
        b[axis] = a[axis] >= 0 ? h[axis] : -h[axis];
    }
    nearest = v3(b[0], b[1], b[2]);
    return inside;
}

// The same of a cylinder.
FN bool peg(V3 half, V3 l, V3& nearest) {
    const real radius = half.x, high = half.y, across = sqrt(l.x * l.x + l.z * l.z);
    const bool level = size(l.y) <= high, within = across <= radius, axial = across <= (real)1e-15;
    const real x = axial ? radius : l.x / across * radius, z = axial ? 0 : l.z / across * radius;
    const bool inside = level && within;
    const real top = high - l.y, foot = l.y + high, side = radius - across;
    if (inside && top < foot && top < side) nearest = v3(l.x, high, l.z);
    else if (inside && foot < top && foot < side) nearest = v3(l.x, -high, l.z);
    else if (inside || level) nearest = v3(x, l.y, z);
    else nearest = v3(within ? l.x : x, l.y > 0 ? high : -high, within ? l.z : z);
    return inside;
}

// Signed distance of a point, with the outward normal and the nearest place.
FN real distance(const Surface& s, V3 p, V3& normal, V3& nearest) {
    if (s.kind == 1) {
        const real d = dot(s.normal, p) - s.offset;
        normal = s.normal;
        nearest = p - normal * d;
        return d;
    }
    V3 b;
    const V3 l = back(s.turn, p - s.place);
    const bool inside = s.kind == 2 ? box(s.half, l, b) : peg(s.half, l, b);
    nearest = s.place + s.turn * b;
    const V3 gap = p - nearest;
    const real sign = inside ? -1 : 1, length = norm(gap);
    normal = length > (real)1e-12 ? gap * (sign / length) : v3(0, 0, 0);
    return sign * length;
}
