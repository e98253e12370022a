// Surfaces of a scene's record, as scene/collider.rs and parry: NC colliders at most.

constexpr int MATERIAL = 8;    // stiffness, damping, friction damping, friction, torsion, rolling, margin, release
constexpr int COLLIDER = 16 + MATERIAL;     // numbers of a collider: kind, geometry, material
constexpr int PAIRS_AT = 3 + COLLIDER * NC;
// Part of a record that robots share: gravity, colliders, and with PAIRED the material of each point on each collider.
// A negative stiffness means that the point and the collider never meet.
#if PAIRED
constexpr int SHARED = PAIRS_AT + MATERIAL * NP * NC;
#else
constexpr int SHARED = PAIRS_AT;
#endif

// A surface relative to an origin, by kind. 1: plane n . x = offset. 2: box. 3: cylinder about y; `half` has radius and
// half height. 4, with FIELDS: heights of `grid` along the z axis of `turn`, none above n.x = offset; the origin is in
// cell `cell` at `part`. With HULLS, 5: capsule about z; `half` has radius and half length. 6: hull within radius
// `half.x`; `grid` has the number of triangles, then three corners and a normal of each.
struct Surface {
    int kind; V3 normal; real offset; M3 turn; V3 place, half; real material[MATERIAL];
#if FIELDS || HULLS
    const double* grid;     // of a height field (GRID_CELLS ...) or a hull
#endif
#if FIELDS
    int cell[2]; real scale, part[2], steep;
#endif
};

#if FIELDS || HULLS
// Grid of a collider's height field or hull, stored behind all records.
FN const double* grid(const double* s) { return s + (long long)s[14]; }
#endif

#if FIELDS
// Offsets in a grid: two cell sizes, two numbers of nodes, highest place, bound of the squared slope, depth (0 if the
// ground repeats), heights.
constexpr int GRID_CELLS = 0, GRID_NODES = 2, GRID_TOP = 4, GRID_STEEP = 5, GRID_BASE = 6, GRID_HEIGHTS = 7;
FN bool bounded(const double* grid) { return grid[GRID_BASE] > 0; }

// Collider of the ground that repeats, or null.
template <class T> FN T* terrain(T* scene) {
    for (T* s = scene + 3; s < scene + PAIRS_AT; s += COLLIDER) if ((int)s[0] == 4 && !bounded(grid(s))) return s;
    return nullptr;
}

FN int around(long long k, int n) { const int r = (int)(k % n); return r < 0 ? r + n : r; }

// Position u (cells) from `node` => nodes on both sides, fraction between them (returned); clamped to a bounded grid's
// edge.
FN real nodes(const double* grid, int axis, int node, real u, int* at) {
    const int n = (int)grid[GRID_NODES + axis];
    const real whole = floor(u);
    if (!bounded(grid)) {
        at[0] = around(node + (long long)whole, n);
        at[1] = at[0] + 1 < n ? at[0] + 1 : 0;
        return u - whole;
    }
    const long long first = node + (long long)whole;
    at[0] = first < 0 ? 0 : first > n - 2 ? n - 2 : (int)first;
    at[1] = at[0] + 1;
    // NaN stays NaN.
    return first < 0 ? u * 0 : first > n - 2 ? 1 + u * 0 : u - whole;
}

// Bilinear height (returned) and its gradient along x and y, at (u, v) cells from `node`.
FN real height(const double* grid, real scale, const int* node, real u, real v, real* slope) {
    int x[2], y[2];
    const real a = nodes(grid, 0, node[0], u, x), b = nodes(grid, 1, node[1], v, y);
    const double* h = grid + GRID_HEIGHTS;
    const int m = (int)grid[GRID_NODES + 1];
    const real o = (real)h[x[0] * m + y[0]] * scale, p = (real)h[x[1] * m + y[0]] * scale;
    const real q = (real)h[x[0] * m + y[1]] * scale, r = (real)h[x[1] * m + y[1]] * scale;
    const real low = o + a * (p - o), high = q + a * (r - q);
    slope[0] = ((p - o) + b * ((r - q) - (p - o))) / (real)grid[GRID_CELLS];
    slope[1] = (high - low) / (real)grid[GRID_CELLS + 1];
    return low + b * (high - low);
}

// Signed distance of a place l (axes of the field, from the origin) from a height field => normal.
FN real over(const Surface& s, V3 l, V3& normal) {
    const real cell[2] = {(real)s.grid[GRID_CELLS], (real)s.grid[GRID_CELLS + 1]}, at[2] = {l.x, l.y},
               z = l.z - s.place.z;
    real slope[2];
    const real high = height(s.grid, s.scale, s.cell, s.part[0] + l.x / cell[0], s.part[1] + l.y / cell[1], slope);
    normal = v3(-slope[0], -slope[1], 1);
    normal = normal * (1 / norm(normal));
    real d = (z - high) * normal.z;
    if (!bounded(s.grid)) return d;
    // Of top, sides and bottom, take the one that the place is farthest outside of.
    for (int k = 0; k < 2; k++) {
        const real half = (real)0.5 * ((real)s.grid[GRID_NODES + k] - 1),
                   x = (((real)s.cell[k] - half) + s.part[k]) * cell[k] + at[k];
        if (size(x) - half * cell[k] > d) {
            d = size(x) - half * cell[k];
            const real way = x < 0 ? -1 : 1;
            normal = v3(k == 0 ? way : 0, k == 1 ? way : 0, 0);
        }
    }
    const real under = -(real)s.grid[GRID_BASE] - z;
    if (under > d) { d = under; normal = v3(0, 0, -1); }
    return d;
}
#endif

// Collider s of a record => surface relative to o.
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
                const double n = u.grid[GRID_NODES + k],
                             cells = at[k] / u.grid[GRID_CELLS + k] + (bounded(u.grid) ? 0.5 * (n - 1) : 0),
                             whole = floor(cells);
                // Far beyond an edge, `cell` is limited and `part` holds the remainder.
                const double near = fmin(fmax(whole, -1e6), 1e6);
                u.cell[k] = bounded(u.grid) ? (int)near : around((long long)whole, (int)n);
                u.part[k] = (real)(cells - (bounded(u.grid) ? near : whole));
            }
            u.place = v3(0, 0, (real)-at[2]);
            u.normal = v3(u.turn.m[2], u.turn.m[5], u.turn.m[8]);
            u.offset = (real)(u.grid[GRID_TOP] * u.scale - at[2]);
            u.steep = (real)sqrt(1 + u.grid[GRID_STEEP] * u.scale * u.scale);
            for (int k = 0; k < MATERIAL; k++) u.material[k] = (real)s[16 + k];
            return;
        }
#endif
        u.place = v3((real)(s[10] - o[0]), (real)(s[11] - o[1]), (real)(s[12] - o[2]));
        u.half = v3((real)s[13], (real)s[14], (real)s[15]);
#if HULLS
        if (u.kind == 6) u.grid = grid(s);
#endif
    }
    for (int k = 0; k < MATERIAL; k++) u.material[k] = (real)s[16 + k];
}

// Nearest surface place of a box to l, both from its centre. Returns whether l is inside.
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

// As `box`, for a cylinder about y.
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

#if HULLS
FN V3 corner(const double* t, int k) { return v3((real)t[3 * k], (real)t[3 * k + 1], (real)t[3 * k + 2]); }

// As `box`, for a convex hull. For l outside, the place is on a triangle that faces l: at the foot of l, or on an edge.
FN bool hull(const Surface& s, V3 l, V3& nearest) {
    const int count = (int)s.grid[0];
    real depth = infinite(), way = infinite();
    bool inside = true;
    for (int i = 0; i < count; i++) {
        const double* t = s.grid + 1 + 12 * i;
        const V3 n = corner(t, 3);
        const real high = dot(n, l - corner(t, 0));
        const V3 foot = l - n * high;
        if (high <= 0) {
            if (inside && -high < depth) { depth = -high; nearest = foot; }
            continue;
        }
        inside = false;
        V3 place = foot;
        real off = infinite();
        for (int k = 0; k < 3; k++) {
            const V3 a = corner(t, k), edge = corner(t, (k + 1) % 3) - a;
            if (dot(cross(edge, foot - a), n) >= 0) continue;
            const V3 at = a + edge * most(0, least(1, dot(l - a, edge) / dot(edge, edge)));
            const real d = dot(l - at, l - at);
            if (d < off) { off = d; place = at; }
        }
        const real d = dot(l - place, l - place);
        if (d < way) { way = d; nearest = place; }
    }
    return inside;
}
#endif

// Signed distance of a place => outward normal, nearest place of the surface.
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
#if HULLS
    bool inside = false;
    const real away = norm(l);
    if (s.kind == 5) {
        const V3 axis = v3(0, 0, most(-s.half.y, least(s.half.y, l.z))), out = l - axis;
        const real off = norm(out);
        inside = off < s.half.x;
        b = off > (real)1e-15 ? axis + out * (s.half.x / off) : axis + v3(s.half.x, 0, 0);
    } else if (s.kind == 6 && away > (real)1.5 * s.half.x) {
        b = l * (s.half.x / away);      // far away, the bounding ball stands for the hull
    } else {
        inside = s.kind == 6 ? hull(s, l, b) : s.kind == 2 ? box(s.half, l, b) : peg(s.half, l, b);
    }
#else
    const bool inside = s.kind == 2 ? box(s.half, l, b) : peg(s.half, l, b);
#endif
    nearest = s.place + s.turn * b;
    const V3 gap = p - nearest;
    const real sign = inside ? -1 : 1, length = norm(gap);
    normal = length > (real)1e-12 ? gap * (sign / length) : v3(0, 0, 0);
    return sign * length;
}
