// A family's actuator and sensor model around a frame, as rig.rs and system/motors.rs. Parameters (constants, or in the
// record): LATE (frames), STRENGTH, ZERO, LINE (stall torque, no-load speed), RIPPLE.

#if RIGGED
// Sensor readings => joint positions (side 1), or back (-1).
FN void shift(double* state, const double* scene, double side) {
    for (int i = 0; i < NJ; i++) state[COORDS + i] += side * ZERO(scene)[i];
    wrap(state);
}

// Steps `state` by a frame. `asked`: commanded torques of the LATEST frames before, newest first; `known`: frames since
// a start, updated. Returns 0 or a fault.
BIG int rigged(double* state, const double* tau, const double* scene, const double* drives, double* forces,
               double* asked, unsigned* known) {
    double moved[NQ + NV], acting[NJ + 1];
    for (int k = 0; k < NQ + NV; k++) moved[k] = state[k];
    for (int k = 0; !*known && k < LATEST * NJ; k++) asked[k] = 0;
    ++*known;
    shift(moved, scene, 1);
    const int late = (int)LATE(scene)[0];
    const double share = LATE(scene)[0] - late;
    for (int i = 0; i < NJ; i++) {
        const double now = late ? asked[(late - 1) * NJ + i] : tau[i],
                     before = late < LATEST ? asked[late * NJ + i] : now;
        // A stall torque of 0 means no line. A torque that is NaN stays NaN.
        const double rest = LINE(scene)[2 * i], speed = moved[NQ + DOFS + i] / LINE(scene)[2 * i + 1];
        double of = now + share * (before - now);
        if (rest && of == of)
            of = fmin(fmax(of, -rest * fmin(fmax(1 + speed, 0.0), 1.0)), rest * fmin(fmax(1 - speed, 0.0), 1.0));
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
