// Losses of rollouts of a robot that is seen by one token and their gradients, as mod.rs and nerd_core's tangent.rs have them, in
// 64 bits: a thread a rollout. Beside what tokens.cuh asks for, the host gives ROLLOUTS, UNIT and COUNTS (2 NV each), and SHARE.

// The vector part of a^-1 b, its real part, and the sign by which that is the shorter way.
FN V3 turned_by(const double* a, const double* b, double& real_part, double& sign) {
    double turn[4];
    from_to(a + 3, b + 3, turn);
    real_part = turn[3];
    sign = turn[3] < 0 ? -1 : 1;
    return v3(turn[0], turn[1], turn[2]);
}

// How state b lies from a, in the tangent space of a.
FN void difference(const double* a, const double* b, double* out) {
    for (int i = 0; i < NJ; i++) {
        const double d = b[COORDS + i] - a[COORDS + i];
        out[DOFS + i] = WRAPS[i] ? wrapped(d) : d;
        out[NV + DOFS + i] = b[NQ + DOFS + i] - a[NQ + DOFS + i];
    }
    if (!DOFS) return;
    double real_part, sign;
    V3 a0, a1, b0, b1;
    own_velocity(a, a0, a1);
    own_velocity(b, b0, b1);
    const V3 turn = turned_by(a, b, real_part, sign);
    put3(out, turn * (2 * sign));
    put3(out + 3, back(matrix(read4(a + 3)), read3(b) - read3(a)));
    put3(out + NV, b0 - a0);
    put3(out + NV + 3, b1 - a1);
}

// The loss of the k-th frame, k from 1; its gradient goes to `slope`.
FN double loss(const double* predicted, const double* truth, int k, double weight, double* slope) {
    double error[2 * NV], total = 0;
    difference(truth, predicted, error);
    for (int i = 0; i < 2 * NV; i++) total += bent(error[i], UNIT[i] * 2 * SHARE * sqrt((double)k), weight * COUNTS[i], slope[i]);
    if (DOFS) {
        double real_part, sign;
        const V3 turn = turned_by(truth, predicted, real_part, sign), g = read3(slope), way = read3(slope + 3);
        put3(slope, g * (real_part * sign) + cross(g, turn) * sign);
        put3(slope + 3, back(matrix(read4(predicted + 3)), matrix(read4(truth + 3)) * way));
    }
    return total;
}

FN double size_of(const double* slope) {
    double sum = 0;
    for (int i = 0; i < 2 * NV; i++) sum += slope[i] * UNIT[i] * slope[i] * UNIT[i];
    return sqrt(sum);
}

// Adds upstream gradients of so many later frames to its own: at most as much as if each of them were as large as its own.
FN void join(const double* behind, int later, double* slope) {
    const double most = later * size_of(slope), all = size_of(behind);
    const double share = all > most ? most / all : 1;
    for (int i = 0; i < 2 * NV; i++) slope[i] += share * behind[i];
}
