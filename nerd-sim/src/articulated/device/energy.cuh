// Energies of a state, for the check of articulated/energy.rs.

struct Energy { double kinetic, kinetic_and_springs, potential; };   // kinetic; kinetic and in springs; in gravity (J)

BIG Energy energy(Work& w, const double* scene) {
    Tree& t = w.tree;
    kinematics(t);
    velocities(t, t.qd);
    see(w, scene);
    Energy e = {0, 0, 0};
    for_up<0, NL>([&](auto i) {
        M3 body;
        for (int k = 0; k < 9; k++) body.m[k] = BODY(t)[9 * i + k];
        const M3 r = t.rotation[i];
        const V3 c = t.position[i] + r * read3(COM(t) + 3 * i), v = at(t.velocity[i], c),
                 spin = back(r, t.velocity[i].ang);
        e.kinetic += 0.5 * (MASS(t)[i] * dot(v, v) + dot(spin, body * spin));
        if (!DOFS || i > 0) e.kinetic += 0.5 * ARMATURE(t)[i] * t.qd[DOF[i]] * t.qd[DOF[i]];
#if LIFTS
        const V3 x = lifted(t, i);
        e.potential += LIFT(t)[4 * i]
                       * (w.gravity.x * (stands(w, 0) + x.x) + w.gravity.y * (stands(w, 1) + x.y)
                          + w.gravity.z * (stands(w, 2) + x.z));
#endif
        e.potential -= MASS(t)[i]
                       * (w.gravity.x * (stands(w, 0) + c.x) + w.gravity.y * (stands(w, 1) + c.y)
                          + w.gravity.z * (stands(w, 2) + c.z));
    });
    e.kinetic_and_springs = e.kinetic;
    for (int point = 0; point < NP; point++)
        for (int c = 0; c < w.surfaces; c++) {
            if (!may(w, point, c)) continue;
            V3 n, nearest;
            const real gap = least(meets(t, w.surface[c], point, n, nearest) - RADIUS[point] - margin(w, point, c), 0);
            e.kinetic_and_springs += 0.5 * (real)material(w, point, c)[0] * gap * gap;
        }
    if (FOLDS)
        meetings(t, 0, [&](int, int, const real*, real stiffness, real, real gap, V3, V3, V3) {
            e.kinetic_and_springs += 0.5 * stiffness * least(gap, 0) * least(gap, 0);
        });
    for (int i = 0; i < NJ; i++) {
        const real* l = LIMIT + 4 * i;
        const double x = t.q[COORDS + i], stretched = SPRING[i] == 0 ? 0 : x - SLACK[i];
        const double beyond = LIMITED[i] ? x - (x < l[0] ? l[0] : x > l[1] ? l[1] : x) : 0;
        e.kinetic_and_springs += 0.5 * (l[2] * beyond * beyond + SPRING[i] * stretched * stretched);
    }
    return e;
}
