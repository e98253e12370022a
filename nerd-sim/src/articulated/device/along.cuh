// Implicit steps of deep robots by the articulated-body algorithm, O(n), as nerd_core's TreeFactor and
// articulated/along.rs. Always in 64 bits: about one common origin, a light link's inertia is a small difference of
// large numbers.

constexpr int LINKS = ALONG ? NL : 1;
constexpr int FIRST = DOFS ? 1 : 0;

// Lower triangle of a symmetric 6x6 matrix, row by row.
constexpr int PACKED = 21;
#define ENTRY(r, c) ((r) >= (c) ? LOWER(r, c) : LOWER(c, r))

struct Along {
    double inertia[LINKS][PACKED];      // articulated-body inertias
    double gain[LINKS][6], inverse[LINKS], size[LINKS];   // U = I S; 1 / D; trace, the scale for tests of D
    double inv_inertia[LINKS][PACKED];         // inverse inertias: acceleration of a link under a unit wrench on it
    double alone[LINKS];                // acceleration of a joint under a unit torque on it
    double force[LINKS][6], residual[LINKS], acceleration[LINKS][6];
    double root[PACKED];                // Cholesky factor of a floating root's inertia, diagonal inverted
    double joints[NJ + 1], dampers[NJ + 1], x[NV];
};

FN void stack(const Motion& m, double* s) {
    s[0] = m.ang.x; s[1] = m.ang.y; s[2] = m.ang.z;
    s[3] = m.lin.x; s[4] = m.lin.y; s[5] = m.lin.z;
}
FN double dot6(const double* a, const double* b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] + a[4] * b[4] + a[5] * b[5];
}
FN void times(const double* a, const double* x, double* y) {
    for (int r = 0; r < 6; r++) {
        y[r] = 0;
        for (int c = 0; c < 6; c++) y[r] += a[ENTRY(r, c)] * x[c];
    }
}

// Spatial inertias of single links about the origin: tree => f.inertia.
BIG void inertias(const Tree& t, Along& f) {
    for (int i = 0; i < NL; i++) {
        const real *q = t.rotation[i].m, *b = BODY(t) + 9 * i;
        const double m = MASS(t)[i], p[3] = {t.position[i].x, t.position[i].y, t.position[i].z};
        double half[9], c[3], *own = f.inertia[i];
        for (int r = 0; r < 3; r++) {
            c[r] = p[r] + (double)q[3 * r] * COM(t)[3 * i] + (double)q[3 * r + 1] * COM(t)[3 * i + 1]
                   + (double)q[3 * r + 2] * COM(t)[3 * i + 2];
            for (int k = 0; k < 3; k++)
                half[3 * r + k] = (double)q[3 * r] * b[k] + (double)q[3 * r + 1] * b[3 + k]
                                  + (double)q[3 * r + 2] * b[6 + k];
        }
        const double square = m * (c[0] * c[0] + c[1] * c[1] + c[2] * c[2]);
        for (int r = 0; r < 3; r++)
            for (int k = 0; k <= r; k++) {
                const double turned = half[3 * r] * q[3 * k] + half[3 * r + 1] * q[3 * k + 1]
                                      + half[3 * r + 2] * q[3 * k + 2];
                own[LOWER(r, k)] = turned - m * c[r] * c[k] + (r == k ? square : 0);
                own[LOWER(r + 3, k + 3)] = r == k ? m : 0;
            }
        for (int k = 0; k < 3; k++) own[LOWER(3 + k, k)] = 0;
        own[LOWER(3, 1)] = m * c[2]; own[LOWER(3, 2)] = -m * c[1];
        own[LOWER(4, 0)] = -m * c[2]; own[LOWER(4, 2)] = m * c[0];
        own[LOWER(5, 0)] = m * c[1]; own[LOWER(5, 1)] = -m * c[0];
    }
}

// Articulated-body inertias: f.inertia, `joints` (added to armatures) => f.inertia, f.gain, f.inverse, f.root. False,
// with the DoF in t.lost, if not positive definite.
BIG bool factorise(Tree& t, Along& f, const double* joints) {
    for (int i = 0; i < NL; i++) {
        f.size[i] = 0;
        for (int k = 0; k < 6; k++) f.size[i] += f.inertia[i][LOWER(k, k)];
    }
    for (int i = NL - 1; i >= FIRST; i--) {
        double s[6], gain[6];
        stack(t.axis[i], s);
        const double* own = f.inertia[i];
        times(own, s, gain);
        const double pivot = dot6(s, gain) + ARMATURE(t)[i] + (joints ? joints[DOF[i] - DOFS] : 0);
        if (!(pivot > 1e-14 * f.size[i] * dot6(s, s))) { t.lost = DOF[i]; return false; }
        const double inverse = f.inverse[i] = 1 / pivot;
        for (int k = 0; k < 6; k++) f.gain[i][k] = gain[k];
        if (PARENT[i] < 0) continue;
        double* above = f.inertia[PARENT[i]];
        for (int r = 0; r < 6; r++)
            for (int c = 0; c <= r; c++) above[LOWER(r, c)] += own[LOWER(r, c)] - gain[r] * gain[c] * inverse;
        f.size[PARENT[i]] += f.size[i];
    }
    if (!DOFS) return true;
    for (int r = 0; r < 6; r++)
        for (int c = 0; c <= r; c++) {
            double x = f.inertia[0][LOWER(r, c)];
            for (int k = 0; k < c; k++) x -= f.root[LOWER(r, k)] * f.root[LOWER(c, k)];
            if (r == c && !(x > 0)) { t.lost = 0; return false; }
            f.root[LOWER(r, c)] = r == c ? 1 / sqrt(x) : x * f.root[LOWER(c, c)];
        }
    return true;
}

// Solves for the root's acceleration with f.root, the factor of its inertia: wrench x => acceleration x.
FN void root_solve(const Along& f, double* x) {
    for (int r = 0; r < 6; r++) {
        for (int k = 0; k < r; k++) x[r] -= f.root[LOWER(r, k)] * x[k];
        x[r] *= f.root[LOWER(r, r)];
    }
    for (int r = 5; r >= 0; r--) {
        for (int k = r + 1; k < 6; k++) x[r] -= f.root[LOWER(k, r)] * x[k];
        x[r] *= f.root[LOWER(r, r)];
    }
}

// Accelerations: torques f.x, link wrenches f.force (signed as bias forces) => f.x, f.acceleration.
BIG void solve(const Tree& t, Along& f) {
    double s[6];
    for (int i = NL - 1; i >= FIRST; i--) {
        stack(t.axis[i], s);
        f.residual[i] = f.x[DOF[i]] - dot6(s, f.force[i]);
        if (PARENT[i] < 0) continue;
        const double share = f.residual[i] * f.inverse[i];
        for (int k = 0; k < 6; k++) f.force[PARENT[i]][k] += f.force[i][k] + f.gain[i][k] * share;
    }
    if (DOFS) {
        for (int k = 0; k < 6; k++) f.x[k] -= f.force[0][k];
        root_solve(f, f.x);
        for (int k = 0; k < 6; k++) f.acceleration[0][k] = f.x[k];
    }
    for (int i = FIRST; i < NL; i++) {
        const int p = PARENT[i];
        stack(t.axis[i], s);
        const double own = (f.residual[i] - (p < 0 ? 0 : dot6(f.gain[i], f.acceleration[p]))) * f.inverse[i];
        f.x[DOF[i]] = own;
        for (int k = 0; k < 6; k++) f.acceleration[i][k] = (p < 0 ? 0 : f.acceleration[p][k]) + s[k] * own;
    }
}

// Inverse inertias of links and joints, from the root outward: tree => f.inv_inertia, f.alone.
// E = E_p - (S v^T + v S^T) / D + S S^T (1 / D + U . v / D^2), v = E_p U.
BIG bool spread(Tree& t, Along& f) {
    inertias(t, f);
    if (!factorise(t, f, 0)) return false;
    if (DOFS)
        for (int k = 0; k < 6; k++) {
            double x[6] = {0, 0, 0, 0, 0, 0};
            x[k] = 1;
            root_solve(f, x);
            for (int r = k; r < 6; r++) f.inv_inertia[0][LOWER(r, k)] = x[r];
        }
    for (int i = FIRST; i < NL; i++) {
        const int p = PARENT[i];
        const double inverse = f.inverse[i];
        double s[6], v[6] = {0, 0, 0, 0, 0, 0};
        stack(t.axis[i], s);
        if (p >= 0) times(f.inv_inertia[p], f.gain[i], v);
        f.alone[i] = inverse + dot6(f.gain[i], v) * inverse * inverse;
        for (int r = 0; r < 6; r++)
            for (int c = 0; c <= r; c++)
                f.inv_inertia[i][LOWER(r, c)] = (p < 0 ? 0 : f.inv_inertia[p][LOWER(r, c)])
                                                - (s[r] * v[c] + v[r] * s[c]) * inverse + s[r] * s[c] * f.alone[i];
    }
    return true;
}

// Wrench about the origin of a force at x.
FN void wrench_at(V3 force, V3 x, double* w) {
    const double p[3] = {x.x, x.y, x.z}, f[3] = {force.x, force.y, force.z};
    w[0] = p[1] * f[2] - p[2] * f[1]; w[1] = p[2] * f[0] - p[0] * f[2]; w[2] = p[0] * f[1] - p[1] * f[0];
    w[3] = f[0]; w[4] = f[1]; w[5] = f[2];
}

// Inverse effective mass w of a point along a normal, after `spread`.
FN double inv_mass(const Along& f, int link, V3 x, V3 normal) {
    double wrench[6], twist[6];
    wrench_at(normal, x, wrench);
    times(f.inv_inertia[link], wrench, twist);
    return dot6(wrench, twist);
}

// Adds a contact at x to its link: `force` to f.force, J_x^T D J_x to f.inertia.
// D = (along - across) n n^T + across 1, J_x = [-x^, 1].
FN void resist(Along& f, int link, V3 x, V3 n, V3 force, double along, double across) {
    double w[6], *own = f.inertia[link];
    wrench_at(force, x, w);
    for (int k = 0; k < 6; k++) f.force[link][k] -= w[k];
    // J_x^T of unit vectors, and of n.
    const double p[3] = {x.x, x.y, x.z}, turn[9] = {0, -p[2], p[1], p[2], 0, -p[0], -p[1], p[0], 0};
    wrench_at(n, x, w);
    for (int r = 0; r < 6; r++)
        for (int c = 0; c <= r; c++) {
            double same;    // entry of J_x^T J_x
            if (r < 3)
                same = turn[3 * r] * turn[3 * c] + turn[3 * r + 1] * turn[3 * c + 1]
                       + turn[3 * r + 2] * turn[3 * c + 2];
            else if (c < 3) same = turn[3 * c + r - 3];
            else same = r == c;
            own[LOWER(r, c)] += (along - across) * w[r] * w[c] + across * same;
        }
}

#if TURNS
// Angular acceleration of a link in the last solution.
FN V3 reached(const Along& f, int link) {
    const double* a = f.acceleration[link];
    return v3((real)a[0], (real)a[1], (real)a[2]);
}
#endif

// Acceleration J qdd of a point of a link in the last solution.
FN V3 reached(const Along& f, int link, V3 x) {
    const double* a = f.acceleration[link];
    return v3((real)(a[3] + a[1] * x.z - a[2] * x.y), (real)(a[4] + a[2] * x.x - a[0] * x.z),
              (real)(a[5] + a[0] * x.y - a[1] * x.x));
}
