// What formulas may ask about one environment.

// What constants that are no finite numbers are divided by.
FN double zero() { return 0; }

struct Seen { const double *state, *goal; Work* work; };

// In the world.
FN double place(const Seen& s, int link, double x, double y, double z, int k) {
    const Tree& t = s.work->tree;
    const V3 p = t.position[link] + t.rotation[link] * v3(x, y, z);
    return (k == 0 ? p.x : k == 1 ? p.y : p.z) + stands(*s.work, k);
}
FN double gap(const Seen& s, int point) { return nearest(*s.work, point); }
