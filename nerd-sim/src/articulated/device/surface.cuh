// Surfaces of a scene's record, as scene.rs and parry have them: NC colliders at most.

constexpr int COLLIDER = 20;   // numbers of one: kind, geometry, material
constexpr int SHARED = 3 + COLLIDER * NC;   // of a record what robots share: gravity, colliders

// As seen from some place: a plane n . x = offset (1), a box (2), a cylinder about y, of which `half` has the radius and half the height (3), or,
// with FIELDS, heights of `grid` along the z axis of `turn` (4), nowhere above the plane, of which a place is in cell `cell` at `part`.
struct Surface {
    int kind; V3 normal; real offset; M3 turn; V3 place, half; real material[4];
#if FIELDS
    const double* grid;     // cell, nodes along x and y, highest place, bound of the squared slope, heights
    int cell[2]; real scale, part[2], steep;
#endif
};

#if FIELDS
// The grid of a collider's record stands behind all records.
FN const double* grid(const double* s) { return s + (long long)s[14]; }

// That of the ground.
template <class T> FN T* terrain(T* scene) {
    T* s = scene + 3;
    while ((int)s[0] != 4) s += COLLIDER;
    return s;
}

FN int around(long long k, int n) { const int r = (int)(k % n); return r < 0 ? r + n : r; }

// Height, and how it rises along x and y, at a place so many cells from a node.
FN real height(const double* grid, real scale, const int* node, real u, real v, real* slope) {
    const real fu = floor(u), fv = floor(v), a = u - fu, b = v - fv;
    const int n = (int)grid[1], m = (int)grid[2], i = around(node[0] + (long long)fu, n), j = around(node[1] + (long long)fv, m);
    const int right = i + 1 < n ? i + 1 : 0, up = j + 1 < m ? j + 1 : 0;
    const double* h = grid + 5;
    const real o = (real)h[i * m + j] * scale, p = (real)h[right * m + j] * scale, q = (real)h[i * m + up] * scale, r = (real)h[right * m + up] * scale;
    const real low = o + a * (p - o), high = q + a * (r - q), cell = (real)grid[0];
    slope[0] = ((p - o) + b * ((r - q) - (p - o))) / cell;
    slope[1] = (high - low) / cell;
    return low + b * (high - low);
}

FN real over(const Surface& s, V3 l, V3& normal) {
    const real cell = (real)s.grid[0];
    real slope[2];
    const real d = l.z - s.place.z - height(s.grid, s.scale, s.cell, s.part[0] + l.x / cell, s.part[1] + l.y / cell, slope);
    normal = v3(-slope[0], -slope[1], 1);
    normal = normal * (1 / norm(normal));
    return d * normal.z;
}
#endif

// That of a record, seen from o.
FN void read(Surface& u, const double* s, const double* o) {
    u.kind = (int)s[0];
    if (u.kind == 1) {
        u.normal = v3((real)s[1], (real)s[2], (real)s[3]);
        u.offset = (real)(s[4] - (s[1] * o[0] + s[2] * o[1] + s[3] * o[2]));
    } else {
        for (int k = 0; k < 9; k++) u.turn.m[k] = (real)s[1 + k];
#if FIELDS
        if (u.kind == 4) {
            double at[3] = {0, 0, 0};
            for (int k = 0; k < 3; k++) for (int i = 0; i < 3; i++) at[k] += s[1 + 3 * i + k] * (o[i] - s[10 + i]);
            u.grid = grid(s);
            u.scale = (real)s[13];
            for (int k = 0; k < 2; k++) {
                const double cells = at[k] / u.grid[0], whole = floor(cells);
                u.cell[k] = around((long long)whole, (int)u.grid[1 + k]);
                u.part[k] = (real)(cells - whole);
            }
            u.place = v3(0, 0, (real)-at[2]);
            u.normal = v3(u.turn.m[2], u.turn.m[5], u.turn.m[8]);
            u.offset = (real)(u.grid[3] * u.scale - at[2]);
            u.steep = (real)sqrt(1 + u.grid[4] * u.scale * u.scale);
            for (int k = 0; k < 4; k++) u.material[k] = (real)s[16 + k];
            return;
        }
#endif
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
#if FIELDS
    if (s.kind == 4) {
        V3 n;
        const real d = over(s, back(s.turn, p), n);
        normal = s.turn * n;
        nearest = p - normal * d;
        return d;
    }
#endif
    V3 b;
    const V3 l = back(s.turn, p - s.place);
    const bool inside = s.kind == 2 ? box(s.half, l, b) : peg(s.half, l, b);
    nearest = s.place + s.turn * b;
    const V3 gap = p - nearest;
    const real sign = inside ? -1 : 1, length = norm(gap);
    normal = length > (real)1e-12 ? gap * (sign / length) : v3(0, 0, 0);
    return sign * length;
}
