// What formulas may ask about one environment.

// What constants that are no finite numbers are divided by.
FN double zero() { return 0; }

struct Seen { const double *state, *goal, *scene; Work* work; };

// In the world.
FN double place(const Seen& s, int link, double x, double y, double z, int k) {
    const Tree& t = s.work->tree;
    const V3 p = t.position[link] + t.rotation[link] * v3(x, y, z);
    return (k == 0 ? p.x : k == 1 ? p.y : p.z) + stands(*s.work, k);
}
FN double gap(const Seen& s, int point) { return nearest(*s.work, point); }

// Adds to loads on links what a gradient by one of these does.
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
        V3 own, at;
        const real d = meets(w.tree, w.surface[c], point, own, at);
        if (d < least) { least = d; normal = own; }
    }
    push(w.tree, point, facing(w.tree, point, normal, true), normal * by, load);
}
