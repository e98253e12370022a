// Position of a contact point on its link, as nerd-core's contact.rs. NP points: POINT_LINK, POINT, RADIUS. With LOCI
// some points move over their link, by LOCUS (0 fixed, 1 on a rim, 2 on a hull). Their tables: RIM (axis, radius, sine
// and cosine of the point's angle from the deepest), HULL (first VERTEX and end), REACH (m, farthest from POINT).

constexpr int SEARCHES = 4;

FN V3 middle(const Tree& t, int point) {
    const int link = POINT_LINK[point];
    return t.position[link] + t.rotation[link] * read3(POINT + 3 * point);
}

FN V3 on_rim(const real* rim, V3 centre, V3 n, bool own) {
    const V3 axis = read3(rim), slope = n - axis * dot(axis, n);
    const real steep = norm(slope);
    V3 up = slope * (1 / steep);
    if (!(steep > (real)1e-9)) {
        const real x = size(axis.x), y = size(axis.y), z = size(axis.z);
        up = cross(axis, x <= y && x <= z ? v3(1, 0, 0) : y <= z ? v3(0, 1, 0) : v3(0, 0, 1));
        up = up * (1 / norm(up));
    }
    const real sin = own ? rim[4] : 0, cos = own ? rim[5] : 1;
    return centre - (up * cos + cross(axis, up) * sin) * rim[3];
}

// Velocity (m/s) of a point along its rim, as `runs` of contact.rs.
FN V3 runs(const Tree& t, int point, V3 n, V3 spin, real time) {
    const real* rim = RIM + 6 * point;
    const V3 axis = t.rotation[POINT_LINK[point]] * read3(rim), axis_rate = cross(spin, axis),
             slope = n - axis * dot(axis, n);
    const real steep = norm(slope), turns = time * norm(spin);
    if (!(steep > (real)1e-9)) return v3(0, 0, 0);
    const V3 up = slope * (1 / steep), slope_rate = axis * -dot(n, axis_rate) - axis_rate * dot(n, axis);
    const V3 up_rate = (slope_rate - up * dot(up, slope_rate)) * (steep / (steep * steep + turns * turns));
    return (up_rate * rim[5] + (cross(axis_rate, up) + cross(axis, up_rate)) * rim[4]) * -rim[3];
}

// Position of a contact point at a surface of unit normal n. On a rim: at its own angle, or deepest (`own` false).
FN V3 facing(const Tree& t, int point, V3 n, bool own) {
    if (!LOCI || LOCUS[point] == 0) return middle(t, point);
    const int link = POINT_LINK[point];
    const V3 down = back(t.rotation[link], n);
    V3 place;
    if (LOCUS[point] == 1) {
        place = on_rim(RIM + 6 * point, read3(POINT + 3 * point), down, own);
    } else {
        real least = infinite();
        for (int k = HULL[2 * point]; k < HULL[2 * point + 1]; k++) {
            const V3 v = read3(VERTEX + 3 * k);
            const real d = dot(down, v);
            if (d < least) { least = d; place = v; }
        }
    }
    return t.position[link] + t.rotation[link] * place;
}

// Signed distance of a contact point from a surface => outward normal, nearest place.
FN real meets(const Tree& t, const Surface& s, int point, V3& normal, V3& nearest) {
    if (!LOCI || LOCUS[point] == 0) return distance(s, middle(t, point), normal, nearest);
    if (s.kind == 1) return distance(s, facing(t, point, s.normal, true), normal, nearest);
    V3 n;
    if (!FIELDS || s.kind != 4) {
        // Of all planes that touch the convex shape, take the one at the largest signed distance.
        real best = -infinite();
        V3 p;
        distance(s, middle(t, point), n, p);
        normal = n;
        nearest = p;
        for (int k = 0; k < SEARCHES; k++) {
            const V3 place = facing(t, point, n, true);
            const real d = dot(n, place - p);
            if (!(d <= best)) { best = d; normal = n; nearest = p; }
            distance(s, place, n, p);
            if (!(norm(n) > 0)) break;
        }
        return best;
    }
    distance(s, middle(t, point), n, nearest);
    real least = infinite();
    for (int k = 0; k < SEARCHES; k++) {
        const real d = distance(s, facing(t, point, n, false), normal, nearest);
        if (d >= least || !(norm(normal) > 0)) break;
        least = d;
        n = normal;
    }
    return distance(s, facing(t, point, n, true), normal, nearest);
}
