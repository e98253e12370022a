// Gradients w.r.t. a state in its tangent space, as nerd-core's tangent.rs: 2 NV numbers, for a free root in its own
// axes.

FN void add3(double* to, V3 v) { to[0] += v.x; to[1] += v.y; to[2] += v.z; }
FN void put3(double* to, V3 v) { to[0] = v.x; to[1] = v.y; to[2] = v.z; }

// Quaternion product a b, of any lengths.
FN void product(const double* a, const double* b, double* out) {
    for (int k = 0; k < 3; k++) {
        const int i = (k + 1) % 3, j = (k + 2) % 3;
        out[k] = a[3] * b[k] + a[k] * b[3] + a[i] * b[j] - a[j] * b[i];
    }
    out[3] = a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2];
}

// Velocity of the root in its own axes: state => angular a, linear b.
FN void own_velocity(const double* state, V3& a, V3& b) {
    const M3 r = matrix(read4(state + 3));
    const double *w = state + NQ, *o = state;
    const V3 v = v3((real)(w[3] - (o[1] * w[2] - o[2] * w[1])), (real)(w[4] - (o[2] * w[0] - o[0] * w[2])),
                    (real)(w[5] - (o[0] * w[1] - o[1] * w[0])));
    a = back(r, v3((real)w[0], (real)w[1], (real)w[2]));
    b = back(r, v);
}

// Converts `by`, a gradient w.r.t. the numbers of `state`, to the tangent space; adds the result to `gradient`.
BIG void numbers_back(const double* state, const double* by, double* gradient) {
    for (int i = 0; i < NJ; i++) {
        gradient[DOFS + i] += by[COORDS + i];
        gradient[NV + DOFS + i] += by[NQ + DOFS + i];
    }
    if (!DOFS) return;
    V3 a, b;
    own_velocity(state, a, b);
    const M3 r = matrix(read4(state + 3));
    const V3 by_v = v3((real)by[NQ + 3], (real)by[NQ + 4], (real)by[NQ + 5]),
             x = v3((real)state[0], (real)state[1], (real)state[2]);
    const V3 by_a = back(r, v3((real)by[NQ], (real)by[NQ + 1], (real)by[NQ + 2]) + cross(by_v, x)),
             by_b = back(r, by_v);
    const double n = 1 / sqrt(state[3] * state[3] + state[4] * state[4] + state[5] * state[5] + state[6] * state[6]);
    const double conjugate[4] = {-state[3] * n, -state[4] * n, -state[5] * n, state[6] * n};
    double twist[4];
    product(conjugate, by + 3, twist);
    add3(gradient, v3((real)twist[0], (real)twist[1], (real)twist[2]) * (real)0.5 + cross(a, by_a) + cross(b, by_b));
    add3(gradient + 3, back(r, v3((real)by[0], (real)by[1], (real)by[2]) + cross(r * a, by_v)));
    add3(gradient + NV, by_a);
    add3(gradient + NV + 3, by_b);
}

FN void unload(Wrench* load) { for (int i = 0; i < NL; i++) load[i] = wrench(v3(0, 0, 0), v3(0, 0, 0)); }

// Adds the load of a force at a contact point at `place`. A link that rotates about a disc's axis does not move the
// deepest point of its rim.
FN void push(const Tree& t, int point, V3 place, V3 force, Wrench* load) {
    const int link = POINT_LINK[point];
    load[link] = load[link] + wrench(cross(place, force), force);
    if (!LOCI || LOCUS[point] != 1) return;
    const V3 axis = t.rotation[link] * read3(RIM + 6 * point);
    load[link].ang = load[link].ang - axis * dot(axis, cross(place - middle(t, point), force));
}

// J^T of link wrenches => added to `gradient`.
FN void onto(const Tree& t, Wrench* load, double* gradient) {
    const M3 r = t.rotation[0];
    const V3 o = t.position[0];
    for (int i = NL - 1; i >= 0; i--) {
        if (DOFS && i == 0) {
            add3(gradient, back(r, load[0].ang - cross(o, load[0].lin)));
            add3(gradient + 3, back(r, load[0].lin));
        } else {
            gradient[DOF[i]] += dot(t.axis[i], load[i]);
            if (PARENT[i] >= 0) load[PARENT[i]] = load[PARENT[i]] + load[i];
        }
    }
}
