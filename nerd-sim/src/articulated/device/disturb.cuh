// Disturbances of an episode, as in disturb.rs, from a random stream of their own. Every PUSH_EVERY frames (0: never) a
// push changes the root's velocity by PUSHED (range, m/s). Its direction is random in the plane of LEVEL (two axes).
// With BLURRED, sensors have NOISE: standard deviations for joints (rad or m), root position (m) and root orientation
// (rad). A frame's noise takes NOISE_BLOCKS random blocks.

FN Draws drawn_at(const unsigned long long* key, unsigned long long stream, unsigned long long block) {
    Draws d = draws(key, stream);
    d.block = block;
    return d;
}

// Pushes the root, if `frame` of the episode has a push.
FN void shoved(const unsigned long long* key, unsigned long long stream, unsigned long long frame, double* state) {
#if PUSH_EVERY
    if (frame == 0 || frame % PUSH_EVERY) return;
    Draws d = drawn_at(key, stream, PUSHES + frame / PUSH_EVERY);
    const double size = between(d, PUSHED), angle = 2 * PI * one(d);
    for (int k = 0; k < 3; k++)
        state[NQ + 3 + k] += LEVEL[k] * (size * cos(angle)) + LEVEL[3 + k] * (size * sin(angle));
#endif
}

#if BLURRED
FN double normal(Draws& d, double size) {
    const double u = one(d), v = one(d);
    return size * (sqrt(-2 * log(1 - u)) * cos(2 * PI * v));
}
// Adds the sensor noise of a frame to a state.
BIG void blurred(const unsigned long long* key, unsigned long long stream, unsigned long long frame,
                 const double* scene, double* state) {
    Draws d = drawn_at(key, stream, NOISES + frame * NOISE_BLOCKS);
    const double joint = NOISE(scene)[0], place = NOISE(scene)[1], turn = NOISE(scene)[2], per = 1 / FRAME;
    double* qd = state + NQ;
    if (DOFS && (place != 0 || turn != 0)) {
        double by[4][3], angle = 0;
        for (int v = 0; v < 4; v++)
            for (int k = 0; k < 3; k++) by[v][k] = normal(d, (v % 2 ? turn : place) * (v < 2 ? 1 : per));
        for (int k = 0; k < 3; k++) angle += by[1][k] * by[1][k];
        angle = sqrt(angle);
        const double s = angle > 0 ? sin(angle / 2) / angle : 0.5,
                     turned[4] = {by[1][0] * s, by[1][1] * s, by[1][2] * s, cos(angle / 2)};
        about(state, qd, 1);
        double now[4];
        multiply(state + 3, turned, now);
        for (int k = 0; k < 4; k++) state[3 + k] = now[k];
        for (int k = 0; k < 3; k++) { state[k] += by[0][k]; qd[k] += by[3][k]; qd[3 + k] += by[2][k]; }
        about(state, qd, -1);
    }
    for (int i = 0; i < NJ; i++) state[COORDS + i] += normal(d, joint);
    for (int i = 0; i < NJ; i++) qd[DOFS + i] += normal(d, joint * per);
    wrap(state);
}
#endif
