// A family's motors and sensors around a frame, as rig.rs and system/motors.rs have them: LATE (frames), STRENGTH, ZERO, LINE (torque at rest, top
// speed) and RIPPLE of a robot, in
// its scene's record or the same for all.

#if RIGGED
// From what sensors show to where joints are, or back.
FN void shift(double* state, const double* scene, double side) {
    for (int i = 0; i < NJ; i++) state[COORDS + i] += side * ZERO(scene)[i];
    wrap(state);
}

// Moves `state`; `asked` has the torques asked for in the LATEST frames before, the newest first, of which `known` counts those since a start.
BIG int rigged(double* state, const double* tau, const double* scene, const double* drives, double* forces, double* asked, unsigned* known) {
    double moved[NQ + NV], acting[NJ + 1];
    for (int k = 0; k < NQ + NV; k++) moved[k] = state[k];
    for (int k = 0; !*known && k < LATEST * NJ; k++) asked[k] = 0;
    ++*known;
    shift(moved, scene, 1);
    const int late = (int)LATE(scene)[0];
    const double share = LATE(scene)[0] - late;
    for (int i = 0; i < NJ; i++) {
        const double now = late ? asked[(late - 1) * NJ + i] : tau[i], before = late < LATEST ? asked[late * NJ + i] : now;
        // 0 says that there is no line; a torque that is no number stays none.
        const double rest = LINE(scene)[2 * i], speed = moved[NQ + DOFS + i] / LINE(scene)[2 * i + 1];
        double of = now + share * (before - now);
        if (rest && of == of) of = fmin(fmax(of, -rest * fmin(fmax(1 + speed, 0.0), 1.0)), rest * fmin(fmax(1 - speed, 0.0), 1.0));
        acting[i] = of * STRENGTH(scene)[i] + RIPPLE(scene)[i] * sin(WAVES * moved[COORDS + i]);
    }
    for (int k = LATEST * NJ - 1; k >= 0; k--) asked[k] = k < NJ ? tau[k] : asked[k - NJ];
    const int fault = frame(moved, acting, scene, drives, forces);
    if (fault) return fault;
    shift(moved, scene, -1);
    for (int k = 0; k < NQ + NV; k++) state[k] = moved[k];
    return 0;
}
#endif
