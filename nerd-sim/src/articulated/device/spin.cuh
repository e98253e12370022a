// Angular velocity of a free root that spins fast, as articulated/spin.rs.

// Moves a free root's position and velocity to its link's centre of mass (sign 1), or back (-1).
FN void centre(Tree& t, real sign) {
    if (!CENTRED) return;
    const V3 c = read3(COM(t)), arm = matrix(read4(t.q + 3)) * c * sign, v = cross(read3(t.qd), arm);
    t.centre = sign > 0 ? c : v3(0, 0, 0);
    t.q[0] += (double)arm.x; t.q[1] += (double)arm.y; t.q[2] += (double)arm.z;
    t.qd[3] += v.x; t.qd[4] += v.y; t.qd[5] += v.z;
}

struct Spin { M3 inertia; };   // of the whole robot about its centre of mass

FN bool spins(const real* qd, real h) { return DOFS && h * norm(read3(qd)) > FAST_ROOT; }

BIG Spin spin(const Tree& t) {
    Inertia sum = zero_inertia();
    for (int i = 0; i < NL; i++) add(sum, body(t, i));
    const V3 m = sum.moment;
    const real k = 1 / sum.mass, s = k * dot(m, m);
    const real *i = sum.i, xy = i[3] + k * m.x * m.y, xz = i[4] + k * m.x * m.z, yz = i[5] + k * m.y * m.z;
    return {{{i[0] - s + k * m.x * m.x, xy, xz, xy, i[1] - s + k * m.y * m.y, yz, xz, yz, i[2] - s + k * m.z * m.z}}};
}

// Solves (I + h/2 ([w] I - [I w])) x = right, or the transposed system.
BIG V3 settle(const Spin& s, V3 w, real h, V3 right, bool transposed) {
    V3 a[3];
    for (int k = 0; k < 3; k++) {
        const V3 e = unit(k), own = s.inertia * e;
        // ([w] I)^T = -I [w], [I w]^T = -[I w].
        a[k] = own
               + (transposed ? cross(s.inertia * w, e) - s.inertia * cross(w, e)
                             : cross(w, own) - cross(s.inertia * w, e)) * ((real)0.5 * h);
    }
    const V3 c = cross(a[1], a[2]);
    const real determinant = dot(a[0], c);
    return v3(dot(right, c), dot(right, cross(a[2], a[0])), dot(right, cross(a[0], a[1]))) * (1 / determinant);
}

// Whether the angular velocity of `middle` is too far from the mean of the substep's ends. If so, `next` is the next
// Newton iterate.
FN bool spun(const Spin& s, const real* qd, const real* middle, const real* rate, real h, V3& next) {
    const V3 w = read3(middle), off = read3(qd) + read3(rate) * ((real)0.5 * h) - w;
    if (!(norm(off) > most(SPIN_TOLERANCE, sizeof(real) == 8 ? 0 : (real)1e-6) * norm(w))) return false;
    next = w + settle(s, w, h, s.inertia * off, false);
    return true;
}

// Factor (a power of two) on Runge-Kutta substeps so that a root turns by MAX_ROOT_TURN_RK4 at most in each; bounded by
// `most`.
FN int turned(real turn, int most) {
    int times = 1;
    while (turn > MAX_ROOT_TURN_RK4 * times && 2 * times <= most) times *= 2;
    return times;
}
