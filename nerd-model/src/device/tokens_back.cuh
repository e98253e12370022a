// Adjoint of a frame around the network in 64 bits, as in nerd_model's gradients.rs and trapezoid.rs.

// Gradient with respect to the change of the state, from the gradient with respect to the next state. Adds the direct
// part of the gradient with respect to the state before the frame to `gradient`.
FN void change_back(const double* state, const float* said, const double* behind, double* by_change, double* gradient) {
    double change[STATE];
    for (int k = 0; k < STATE; k++) change[k] = (double)said[k] * STRETCH[k] + SHIFT[k];
    trapezoid(state, change);
    for (int i = 0; i < NJ; i++) {
        by_change[COORDS + i] = behind[DOFS + i];
        by_change[NQ + DOFS + i] = behind[NV + DOFS + i];
        gradient[DOFS + i] += behind[DOFS + i];
        gradient[NV + DOFS + i] += behind[NV + DOFS + i];
    }
    if (!DOFS) return;
    V3 a, b;
    own_velocity(state, a, b);
    const double *c = change + 3, length = sqrt(c[0] * c[0] + c[1] * c[1] + c[2] * c[2] + c[3] * c[3]);
    const double q[4] = {c[0] / length, c[1] / length, c[2] / length, c[3] / length};
    const M3 n = matrix(read4(q));
    const V3 d = read3(change), spin = a + read3(change + NQ), speed = b + read3(change + NQ + 3) + cross(spin, d);
    const V3 by_turn = read3(behind), by_x = n * read3(behind + 3), by_a = read3(behind + NV),
             by_b = read3(behind + NV + 3);
    const V3 by_spin = n * by_a, by_speed = n * by_b, by_own = by_spin + cross(d, by_speed);
    const V3 by_n = (by_turn + cross(by_a, back(n, spin)) + cross(by_b, back(n, speed))) * (2 / length),
             v = v3(q[0], q[1], q[2]);
    put3(by_change, by_x + cross(by_speed, spin));
    put3(by_change + 3, by_n * q[3] + cross(v, by_n));
    by_change[6] = -dot(v, by_n);
    put3(by_change + NQ, by_own);
    put3(by_change + NQ + 3, by_speed);
    add3(gradient, n * by_turn + cross(d, by_x));
    add3(gradient + 3, by_x);
    add3(gradient + NV, by_own);
    add3(gradient + NV + 3, by_speed);
}

// Adjoint of `trapezoid`: `by` is the gradient with respect to the change on entry, and to the prediction on return.
FN void trapezoid_back(const double* state, const float* said, double* by, double* gradient) {
    const double time = TRAPEZOID;
    if (time == 0) return;
    for (int i = 0; i < NJ; i++) {
        gradient[NV + DOFS + i] += time * by[COORDS + i];
        by[NQ + DOFS + i] += 0.5 * time * by[COORDS + i];
    }
    if (!DOFS) return;
    double change[STATE], e[4], own[4], c[4], twist[4];
    for (int k = 0; k < STATE; k++) change[k] = (double)said[k] * STRETCH[k] + SHIFT[k];
    V3 u, way;
    carried(state, change, u, way);
    const V3 by_way = read3(by);
    exponential(u, e);
    for (int k = 0; k < 4; k++) c[k] = k < 3 ? -change[3 + k] : change[3 + k];
    const double back_e[4] = {-e[0], -e[1], -e[2], e[3]};
    product(back_e, by + 3, own);
    product(own, c, twist);
    const V3 t = v3(twist[0], twist[1], twist[2]) * 0.5, once = cross(u, t);
    const double angle = norm(u), first = angle > 1e-4 ? (1 - cos(angle)) / (angle * angle) : 0.5;
    const double second = angle > 1e-4 ? (angle - sin(angle)) / (angle * angle * angle) : 1.0 / 6;
    const V3 by_u = t + once * first + cross(u, once) * second;
    for (int k = 0; k < 4; k++) by[3 + k] = own[k];
    add3(gradient + NV, by_u * time);
    add3(gradient + NV + 3, by_way * time);
    add3(by + NQ, by_u * (0.5 * time));
    add3(by + NQ + 3, by_way * (0.5 * time));
}

// Gradient with respect to the prediction, from the gradient with respect to the next state. Adds the gradient with
// respect to the state before to `gradient`.
FN void apply_back(const double* state, const float* said, const double* behind, double* by_said, double* gradient) {
    change_back(state, said, behind, by_said, gradient);
    trapezoid_back(state, said, by_said, gradient);
}

FN V3 three(const float* by, int k) { return v3(by[k] / SCALE[k], by[k + 1] / SCALE[k + 1], by[k + 2] / SCALE[k + 2]); }

// Adds the gradient of along . v, v a point's velocity, with respect to the poses of its link's joints (gradients.rs).
FN void quickened(const Tree& t, int link, V3 x, V3 along, double* gradient) {
    const V3 velocity = at(t.velocity[link], x);
    for (int i = link; i >= (DOFS ? 1 : 0); i = PARENT[i]) {
        const Motion none = motion(v3(0, 0, 0), v3(0, 0, 0)), parent = PARENT[i] >= 0 ? t.velocity[PARENT[i]] : none;
        const V3 way = cross(parent.ang, at(t.axis[i], x)) + cross(t.axis[i].ang, velocity - at(parent, x));
        gradient[DOF[i]] += dot(along, way);
    }
}

FN double nearness_gradient(double gap) {
    const double square = gap * gap + NEAR * NEAR;
    return NEAR * NEAR / (square * sqrt(square));
}

// Adds to `gradient` the gradient that reaches the state through its token.
BIG void tell_back(const double* state, const double* scene, const float* by, double* gradient) {
    int end = INPUTS;
    for (int i = NJ - 1; i >= 0; i--) {
        const double q = state[COORDS + i];
        double g = by[COORDS + i] / SCALE[COORDS + i];
        if (WAVES[i] == 1) g *= cos(q);
        end -= WAVES[i];
        if (WAVES[i] == 2) g += by[end] / SCALE[end] * cos(q);
        if (WAVES[i]) g -= by[end + WAVES[i] - 1] / SCALE[end + WAVES[i] - 1] * sin(q);
        gradient[DOFS + i] += g;
    }
    for (int i = 0; i < NV; i++) gradient[NV + i] += by[NQ + i] / SCALE[NQ + i];
    if (!SITUATED) return;
    Work w;
    Tree& t = w.tree;
    take(t, state);
    kinematics(t);
    if (MOVING) velocities(t, t.qd);
    survey(w, scene);
    const M3 r = t.rotation[0];
    const V3 o = t.position[0];
    Wrench load[NL], impulse[MOVING ? NL : 1];
    for (int i = 0; i < NL; i++) load[i] = wrench(v3(0, 0, 0), v3(0, 0, 0));
    for (int i = 0; MOVING && i < NL; i++) impulse[i] = load[i];
    V3 turn = v3(0, 0, 0), shift = v3(0, 0, 0);
    for (int p = 0; p < NP; p++) {
        const Event e = look(w, p);
        if (!(e.distance < SEEN[p])) continue;
        const V3 by_normal = three(by, STATE + 3 * p), by_place = three(by, STATE + 3 * NP + 3 * p);
        const int depth = STATE + 6 * NP + p;
        turn = turn + cross(by_normal, back(r, e.normal)) + cross(by_place, back(r, e.p1 - o));
        shift = shift - by_place;
        const int link = POINT_LINK[p];
        const V3 place = LOCI && LOCUS[p] ? facing(t, p, e.normal, true) : e.p0;
        double by_depth = by[depth] / SCALE[depth];
        if (MOVING) {
            const int nears = STATE + 10 * NP + p;
            const V3 by_speed = three(by, STATE + 7 * NP + 3 * p), speed = at(t.velocity[link], place);
            const double now = by[nears] / SCALE[nears] * nearness_gradient(gap(e, p, speed, 0));
            const double later = by[nears + NP] / SCALE[nears + NP] * nearness_gradient(gap(e, p, speed, 1)),
                         by_closing = later * FRAME_TIME;
            by_depth += now + later;
            const V3 along = r * by_speed + e.normal * by_closing;
            impulse[link] = impulse[link] + wrench(cross(place, along), along);
            quickened(t, link, place, along, gradient);
            // A floating root's velocity is expressed in axes that rotate with it.
            turn = turn + (DOFS ? back(r, cross(speed, e.normal)) * by_closing : cross(by_speed, back(r, speed)));
        }
        // The nearest surface point follows the contact point along the surface.
        const V3 by_p1 = r * by_place, force = by_p1 + e.normal * (by_depth - dot(e.normal, by_p1));
        push(t, p, place, force, load);
    }
    const V3 g = v3(scene[0], scene[1], scene[2]);
    const double length = norm(g);
    turn = turn + cross(three(by, STATE + (MOVING ? 12 : 7) * NP + NJ), back(r, g * (1 / (length > 0 ? length : 1))));
    for (int i = 1; MOVING && i < NL; i++) {
        for (int k = 0; k < 2; k++) {
            const V3 axis = column(t.rotation[i], k), g = three(by, STATE + 12 * NP + NJ + 3 + 6 * (i - 1) + 3 * k);
            turn = turn + cross(g, back(r, axis));
            load[i].ang = load[i].ang + cross(axis, r * g);
        }
    }
    const V3 push = r * shift;
    load[0] = load[0] + wrench(r * turn + cross(o, push), push);
    onto(t, load, gradient);
    if (MOVING) onto(t, impulse, gradient + NV);
}

// Writes the state after a frame. A failed state becomes NaN, so that the failure is reported.
FN void advance(const double* state, const float* said, double* after) {
    for (int k = 0; k < STATE; k++) after[k] = state[k];
    if (apply(after, said)) for (int k = 0; k < STATE; k++) after[k] = infinite() - infinite();
}

// Gradient with respect to the network's outputs, from the gradient with respect to the next state.
FN void said_back(const double* state, const float* said, const double* behind, float* by_said) {
    double by_change[STATE], none[2 * NV];
    for (int i = 0; i < 2 * NV; i++) none[i] = 0;
    apply_back(state, said, behind, by_change, none);
    for (int k = 0; k < STATE; k++) by_said[k] = (float)(by_change[k] * STRETCH[k]);
}

// Gradient with respect to a state, from the gradients with respect to the next state and to its token.
FN void frame_back(const double* state, const double* scene, const float* said, const float* by_token,
                   const double* behind, double* gradient) {
    double by_change[STATE];
    for (int i = 0; i < 2 * NV; i++) gradient[i] = 0;
    apply_back(state, said, behind, by_change, gradient);
    tell_back(state, scene, by_token, gradient);
}
