// One gradient in the backward pass of a frame, as articulated/gradients/row.rs.

FN V3 three(const double* x) { return v3((real)x[0], (real)x[1], (real)x[2]); }
template <class T> FN void write3(T* to, V3 v) { to[0] = v.x; to[1] = v.y; to[2] = v.z; }

// Gradient w.r.t. the state after the frame, in its tangent space => b.
FN void begin(Back& b, const double* state, const double* by) {
    for (int k = 0; k < NV; k++) { b.pose[k] = (real)by[k]; b.speed[k] = (real)by[NV + k]; b.rate[k] = 0; }
    for (int k = 0; k < WEIGHTS; k++) b.weight[k] = 0;
    for (int k = 0; k < PAIRS; k++) b.across[k] = 0;
    for (int i = 0; i < NJ; i++) b.torque[i] = b.damping_used[i] = b.share[i] = 0;
    for (int i = 0; i < PULLS; i++) b.drives[i][0] = b.drives[i][1] = 0;
    if (!DOFS) return;
    V3 w, v;
    own_velocity(state, w, v);
    const M3 r = matrix(read4(state + 3));
    const V3 turn = three(by), way = three(by + 3), by_w = three(by + NV), by_v = three(by + NV + 3);
    write3(b.pose, r * (turn - cross(w, by_w) - cross(v, by_v)));
    write3(b.pose + 3, r * way);
    write3(b.speed, r * by_w);
    write3(b.speed + 3, r * by_v);
}

// b => gradient w.r.t. the state before the frame, in its tangent space.
FN void end(const Back& b, const double* state, double* out) {
    for (int k = 0; k < NV; k++) { out[k] = b.pose[k]; out[NV + k] = b.speed[k]; }
    if (!DOFS) return;
    V3 w, v;
    own_velocity(state, w, v);
    const M3 r = matrix(read4(state + 3));
    const V3 by_w = back(r, read3(b.speed)), by_v = back(r, read3(b.speed + 3));
    write3(out, back(r, read3(b.pose)) + cross(w, by_w) + cross(v, by_v));
    write3(out + 3, back(r, read3(b.pose + 3)));
    write3(out + NV, by_w);
    write3(out + NV + 3, by_v);
}

// Gradients w.r.t. the root's position => w.r.t. its link's centre of mass (sign -1), at `state`; or back.
FN void centre_back(const Tree& t, Back& b, const double* state, real sign) {
    if (!CENTRED) return;
    const V3 arm = matrix(read4(state + 3)) * read3(COM(t)) * sign, w = three(state + NQ), by_v = read3(b.speed + 3);
    write3(b.pose, read3(b.pose) + cross(arm, read3(b.pose + 3) + cross(by_v, w)));
    write3(b.speed, read3(b.speed) + cross(arm, by_v));
}

// Adjoint of `drift`, with the root's rotation exp(w time).
FN void drift_back(Back& b, const real* qd, real time) {
    for (int k = DOFS; k < NV; k++) b.speed[k] += time * b.pose[k];
    if (!DOFS) return;
    const V3 phi = read3(qd) * time, turn = read3(b.pose), once = cross(phi, turn), twice = cross(phi, once);
    const real square = dot(phi, phi), angle = sqrt(square);
    // (1 - cos) / phi^2 and (phi - sin) / phi^3.
    real near = (real)0.5 - square / 24 + square * square / 720,
         far = (real)1 / 6 - square / 120 + square * square / 5040;
    if (square > (real)1e-3) { near = (1 - cos(angle)) / square; far = (angle - sin(angle)) / (square * angle); }
    write3(b.speed, read3(b.speed) + (turn - once * near + twice * far) * time);
    write3(b.speed + 3, read3(b.speed + 3) + read3(b.pose + 3) * time);
    write3(b.pose, turn - once * (1 - far * square) + twice * near);
}
