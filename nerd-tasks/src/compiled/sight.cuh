// Quantities of one environment that formulas read.

// Returns zero, as a divisor that gives constants that are not finite.
FN double zero() { return 0; }

struct Seen { const double *state, *goal, *scene; Work* work; };

// World coordinate k (m) of the point (x, y, z) (m) in a link's frame.
FN double place(const Seen& s, int link, double x, double y, double z, int k) {
    const Tree& t = s.work->tree;
    const V3 p = t.position[link] + t.rotation[link] * v3(x, y, z);
    return (k == 0 ? p.x : k == 1 ? p.y : p.z) + stands(*s.work, k);
}
// Distance (m) of a contact point from the scene. Not inlined: for the 72 points of a G1 inlining took a minute to
// compile.
BIG double gap(const Seen& s, int point) { return nearest(*s.work, point); }

// Height (m) of uneven ground at distances (m) ahead of the root and to its left, relative to its heading.
BIG double ground(const Seen& s, double ahead, double aside) {
#if FIELDS
    const double* f = terrain(s.scene);
    if (!f) return 0;
    const double x[3] = {1, 0, 0};
    double turn[4], along[3], at[3] = {0, 0, 0}, a = 0, b = 0, up = 0, size = 0, slope[2];
    for (int k = 3; k < 7; k++) size += s.state[k] * s.state[k];
    for (int k = 0; k < 4; k++) turn[k] = s.state[3 + k] / sqrt(size);
    rotate(turn, x, 1, along);
    for (int i = 0; i < 3; i++) {
        for (int k = 0; k < 2; k++) at[k] += f[1 + 3 * i + k] * (s.state[i] - f[10 + i]);
        a += f[1 + 3 * i] * along[i];
        b += f[2 + 3 * i] * along[i];
        up += f[3 + 3 * i] * f[10 + i];
    }
    const double length = sqrt(a * a + b * b);
    a = length > 1e-9 ? a / length : 1;
    b = length > 1e-9 ? b / length : 0;
    const int first[2] = {0, 0};
    const double* g = grid(f);
    return up
           + height(g, f[13], first, (at[0] + a * ahead - b * aside) / g[GRID_CELLS],
                    (at[1] + b * ahead + a * aside) / g[GRID_CELLS + 1], slope);
#else
    return 0;
#endif
}

// Adjoints of `place` and `gap`: add gradients to loads on links.
FN void place_back(const Seen& s, int link, double x, double y, double z, int k, double by, Wrench* load) {
    const Tree& t = s.work->tree;
    const V3 p = t.position[link] + t.rotation[link] * v3(x, y, z), force = v3(k == 0, k == 1, k == 2) * by;
    load[link] = load[link] + wrench(cross(p, force), force);
}
FN void gap_back(const Seen& s, int point, double by, Wrench* load) {
    const Work& w = *s.work;
    real least = infinite();
    V3 normal = v3(0, 0, 0);
    for (int c = 0; c < w.surfaces; c++) {
        if (!may(w, point, c)) continue;
        V3 own, at;
        const real d = meets(w.tree, w.surface[c], point, own, at);
        if (d < least) { least = d; normal = own; }
    }
    push(w.tree, point, facing(w.tree, point, normal, true), normal * by, load);
}
