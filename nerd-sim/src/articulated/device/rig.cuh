// Steps a frame of a family's robot with its actuator and sensor model, by the equations of rig.rs and
// system/motors.rs. Parameters, each a table of constants or a part of the scene's record: LATE (delay of torques,
// frames), STRENGTH (factors on torques), ZERO (joint positions where the sensors read 0, rad or m), LINE (by joint:
// stall torque, N m or N; no-load speed, rad/s or m/s), RIPPLE (amplitudes, N m or N).

#if RIGGED
// Converts sensor readings to joint positions (side 1), or joint positions to sensor readings (side -1).
FN void shift(double* state, const double* scene, double side) {
    for (int i = 0; i < NJ; i++) state[COORDS + i] += side * ZERO(scene)[i];
    wrap(state);
}

// Steps `state`, the sensor readings, by a frame. Returns 0, or a fault and leaves `state`. `tau[NJ]`: commanded
// torques (N m or N). `asked[LATEST][NJ]`: commanded torques of the frames before, newest first. `*known`: frames since
// the start; at 0, `asked` is set to zeros. Updates `asked` and `*known`.
BIG int rigged(double* state, const double* tau, const double* scene, const double* drives, double* forces,
               double* asked, unsigned* known) {
    double actual[NQ + NV], acting[NJ + 1];
    for (int k = 0; k < NQ + NV; k++) actual[k] = state[k];
    for (int k = 0; !*known && k < LATEST * NJ; k++) asked[k] = 0;
    ++*known;
    shift(actual, scene, 1);
    const int late = (int)LATE(scene)[0];
    const double share = LATE(scene)[0] - late;
    for (int i = 0; i < NJ; i++) {
        const double now = late ? asked[(late - 1) * NJ + i] : tau[i];
        const double before = late < LATEST ? asked[late * NJ + i] : now;
        double torque = now + share * (before - now);
        const double stall = LINE(scene)[2 * i], speed = actual[NQ + DOFS + i] / LINE(scene)[2 * i + 1];
        // A stall torque of 0 means no torque-speed line. The bounds would turn a torque that is NaN into a number.
        if (stall && torque == torque) {
            const double low = -stall * fmin(fmax(1 + speed, 0.0), 1.0);
            const double high = stall * fmin(fmax(1 - speed, 0.0), 1.0);
            torque = fmin(fmax(torque, low), high);
        }
        acting[i] = torque * STRENGTH(scene)[i] + RIPPLE(scene)[i] * sin(WAVES * actual[COORDS + i]);
    }
    for (int k = LATEST * NJ - 1; k >= 0; k--) asked[k] = k < NJ ? tau[k] : asked[k - NJ];
    const int fault = frame(actual, acting, scene, drives, forces);
    if (fault) return fault;
    shift(actual, scene, -1);
    for (int k = 0; k < NQ + NV; k++) state[k] = actual[k];
    return 0;
}
#endif
