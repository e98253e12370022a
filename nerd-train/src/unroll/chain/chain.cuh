// Rollouts of chains and the gradient of their loss in f64, as in mod.rs, view.rs and loss.rs. A rollout has a block, a
// rod has a thread. Beside the constants of nerd_model's chain.cuh, the host defines SHARE, BY_RATE, BY_SPEED and
// BY_LED[12], the units of errors, and ASTRAY.

#ifdef __CUDACC_RTC__
#define EACH(k, n) for (int k = threadIdx.x; k < (n); k += blockDim.x)
#define SYNC __syncthreads()
#define OF_BLOCK __shared__
#else
#define EACH(k, n) for (int k = 0; k < (n); k++)
#define SYNC
#define OF_BLOCK
#endif

// States of motions are chains `[CHAIN]`; torques act on the gripper's axes `[6]`.
constexpr int RATES = GRIPPER + 3 * RODS;
constexpr int SCENE = 3 + COLLIDER * NC;
// Shared memory of the largest kernel (bytes).
static_assert(8 * (3 * CHAIN + 13 * RODS + 40) + (NC + 1) * sizeof(Surface) < 49152,
              "so many rods or colliders are too many to be trained on the card; leave --device cuda out");

FN V3 seen(const View& v, V3 a) {
    const double y = a.y * v.mirror;
    return v3(v.cosine * a.x - v.sine * y, v.sine * a.x + v.cosine * y, a.z);
}
FN V3 unseen(const View& v, V3 a) {
    return v3(v.cosine * a.x + v.sine * a.y, v.mirror * (v.cosine * a.y - v.sine * a.x), a.z);
}
FN V3 turned(const View& v, V3 a) { return v3(a.x * v.mirror, a.y, a.z * v.mirror); }
FN V3 home() { return read3(HOME); }

// The true chain k frames after the rollout's first frame, transformed by the rollout's view.
FN void truth(const Rollout& r, const Motions& m, int k, double* chain) {
    const double* row = m.truths + ((long long)r.motion * (m.frames + 1) + (long long)r.frame + k) * CHAIN;
    EACH(i, 2 * RODS) write3(chain + GRIPPER + 3 * i, seen(r.view, read3(row + GRIPPER + 3 * i)));
    EACH(one, 1) {
        write3(chain, home() + seen(r.view, read3(row) - home()));
        write3(chain + 3, seen(r.view, read3(row + 3)));
        write3(chain + 6, turned(r.view, read3(row + 6)) + v3(r.view.yaw, 0, 0));
        write3(chain + 9, turned(r.view, read3(row + 9)));
    }
    SYNC;
}

// The gripper after frame k under its drives alone.
FN void led(const Rollout& r, const Motions& m, int k, const double* chain, double* glided) {
    EACH(one, 1) {
        const double* row = m.torques + ((long long)r.motion * m.frames + (long long)r.frame + k) * 6;
        const V3 force = seen(r.view, read3(row));
        const double tau[6] = {force.x, force.y, force.z,
                               row[3] * r.view.mirror + STIFFNESS[3] * r.view.yaw, row[4], row[5] * r.view.mirror};
        glide(chain, tau, glided);
    }
    SYNC;
}

// Positions of rod ends (m), then their velocities (m/s), `[2][RODS][3]`.
FN void nodes(const double* chain, double* ends) {
    EACH(c, 6) {
        const int of = c / 3, i = c % 3;
        double at = chain[3 * of + i];
        for (int k = of * RODS; k < (of + 1) * RODS; k++) {
            at += LENGTH * chain[GRIPPER + 3 * k + i];
            ends[3 * k + i] = at;
        }
    }
    SYNC;
}

// Adjoint of `nodes`: adds to `gradient`.
FN void nodes_back(const double* behind, double* gradient) {
    EACH(c, 6) {
        const int of = c / 3, i = c % 3;
        double total = 0;
        for (int k = (of + 1) * RODS - 1; k >= of * RODS; k--) {
            total += behind[3 * k + i];
            gradient[GRIPPER + 3 * k + i] += LENGTH * total;
        }
        gradient[3 * of + i] += total;
    }
    SYNC;
}

// Tokens of rods. If `touches` is not null, also normals and gaps `[RODS][4]` for the backward pass.
FN void look(const Rollout& r, const Motions& m, const double* chain, const double* glided, double* ends, float* tokens,
             double* touches) {
    OF_BLOCK Surface surface[NC + 1];
    const double *scene = m.scenes + (long long)r.motion * SCENE, origin[3] = {0, 0, 0};
    EACH(c, NC) if ((int)scene[3 + COLLIDER * c]) read(surface[c], scene + 3 + COLLIDER * c, origin);
    int surfaces = 0;
    while (surfaces < NC && (int)scene[3 + COLLIDER * surfaces]) surfaces++;
    nodes(chain, ends);
    const Ahead seen_ahead = ahead(chain, glided);
    EACH(k, RODS) {
        V3 normal;
        double gap;
        // NaNs are kept, so that they can be reported.
        if (touch(surface, surfaces, home() + unseen(r.view, read3(ends + 3 * k) - home()), normal, gap))
            gap = infinite() - infinite();
        normal = seen(r.view, normal);
        const V3 along = read3(chain + GRIPPER + 3 * k), rate = read3(chain + RATES + 3 * k);
        token(tokens + k * LDX, along, rate, read3(ends + 3 * (RODS + k)), normal, gap, seen_ahead);
        if (touches) { write3(touches + 4 * k, normal); touches[4 * k + 3] = gap; }
    }
    SYNC;
}

// The chain after a frame.
FN void advance(const double* chain, const double* glided, const float* numbers, double* after) {
    EACH(k, RODS) {
        V3 u;
        const V3 raw = said(chain, k, numbers + k * OUTPUTS, u), t = raw * (1 / norm(raw));
        write3(after + GRIPPER + 3 * k, t);
        write3(after + RATES + 3 * k, u - t * dot(t, u));
    }
    EACH(k, GRIPPER) after[k] = glided[k] + numbers[6 + k] * STRETCH[6 + k];
    SYNC;
}

// Gradients with respect to a rod's raw direction (returned) and its rate u, from the upstream gradient.
FN V3 advance_back(const double* chain, int k, const float* numbers, const double* behind, V3& by_u) {
    V3 u;
    const V3 raw = said(chain, k, numbers + k * OUTPUTS, u);
    const double length = norm(raw);
    const V3 t = raw * (1 / length), g = read3(behind + RATES + 3 * k);
    const V3 by_t = read3(behind + GRIPPER + 3 * k) - g * dot(t, u) - u * dot(t, g);
    const V3 by_raw = (by_t - t * dot(t, by_t)) * (1 / length);
    by_u = g - t * dot(t, g) + by_raw * (0.5 * FRAME);
    return by_raw;
}

// Gradients with respect to the outputs, `[RODS][OUTPUTS]`.
FN void said_back(const double* chain, const float* numbers, const double* behind, float* by_said) {
    EACH(k, RODS) {
        V3 by_u;
        const V3 by_raw = advance_back(chain, k, numbers, behind, by_u);
        const double own[6] = {by_u.x, by_u.y, by_u.z, by_raw.x, by_raw.y, by_raw.z};
        for (int i = 0; i < 6; i++) by_said[k * OUTPUTS + i] = (float)(own[i] * STRETCH[i]);
        for (int i = 6; i < OUTPUTS; i++) by_said[k * OUTPUTS + i] = k ? 0.0f : (float)(behind[i - 6] * STRETCH[i]);
    }
    SYNC;
}

// Adjoint of `points`: adds to `gradient`.
FN void points_back(const double* gripper, V3 t, V3 rate, double* gradient) {
    const double sy = sin(gripper[6]), cy = cos(gripper[6]), sp = sin(gripper[7]), cp = cos(gripper[7]);
    const V3 by_yaw = v3(-sy * cp, cy * cp, 0), by_pitch = v3(-cy * sp, -sy * sp, -cp);
    const V3 yaw_yaw = v3(-cy * cp, -sy * cp, 0), yaw_pitch = v3(sy * sp, -cy * sp, 0),
             pitch_pitch = v3(-cy * cp, -sy * cp, sp);
    gradient[6] += dot(by_yaw, t) + dot(yaw_yaw * gripper[9] + yaw_pitch * gripper[10], rate);
    gradient[7] += dot(by_pitch, t) + dot(yaw_pitch * gripper[9] + pitch_pitch * gripper[10], rate);
    gradient[9] += dot(by_yaw, rate);
    gradient[10] += dot(by_pitch, rate);
}

// Adjoint of `glide`, in place.
FN void glide_back(double* gradient) {
    for (int k = 0; k < 6; k++) {
        const int i = k < 3 ? k : k + 3;
        const double w = PULSE[k], fade = exp(-w * FRAME), x = gradient[i], v = gradient[i + 3];
        gradient[i] = (x * (1 + w * FRAME) - v * w * w * FRAME) * fade;
        gradient[i + 3] = (x * FRAME + v * (1 - w * FRAME)) * fade;
    }
}

// Gradients with respect to the chain before a frame: through outputs, tokens `[RODS][INPUTS]` and the gripper's glide.
// `ends` holds the chain's nodes, and is overwritten.
FN void frame_back(const double* chain, const double* glided, const float* numbers, const double* touches,
                   const float* by_tokens, const double* behind, double* ends, double* gradient) {
    OF_BLOCK double sums[12];
    EACH(k, GRIPPER) gradient[k] = 0;
    EACH(k, RODS) {
        V3 by_u;
        const V3 by_raw = advance_back(chain, k, numbers, behind, by_u);
        const float* row = by_tokens + k * INPUTS;
        const V3 normal = read3(touches + 4 * k), velocity = read3(ends + 3 * (RODS + k));
        const double gap = touches[4 * k + 3], speed = dot(velocity, normal);
        write3(gradient + GRIPPER + 3 * k, by_raw + v3(row[0], row[1], row[2]));
        write3(gradient + RATES + 3 * k, by_u + by_raw * (0.5 * FRAME) + v3(row[3], row[4], row[5]) * 0.1);
        const double sharp = tanh(4 * gap / RADIUS), soon = tanh((gap + speed * FRAME) / (0.75 * RADIUS));
        const double by_soon = row[16] * (1 - soon * soon) / (0.75 * RADIUS);
        const double by_gap = 20.0 * row[12] - row[13] * exp(-size(gap) / RADIUS) / RADIUS
                              + row[14] * (1 - sharp * sharp) * 4 / RADIUS + by_soon;
        // Normals count as constant. For a rod out of reach of all surfaces, the normal is zero and nothing depends on
        // the gap.
        write3(ends + 3 * k, normal * by_gap);
        write3(ends + 3 * (RODS + k), v3(row[6], row[7], row[8]) * 0.5 + normal * (0.5 * row[15] + by_soon * FRAME));
    }
    EACH(i, 12) {
        sums[i] = 0;
        for (int k = 0; k < RODS; k++) sums[i] += by_tokens[k * INPUTS + 18 + i];
    }
    SYNC;
    nodes_back(ends, gradient);
    EACH(one, 1) {
        const V3 change = read3(sums), velocity = read3(sums + 3), rate = read3(sums + 6), direction = read3(sums + 9);
        double by_glided[GRIPPER] = {};
        write3(gradient + 3, read3(gradient + 3) - change * QUICK);
        points_back(chain, v3(0, 0, 0), rate * -0.5, gradient);
        write3(by_glided + 3, change * QUICK + velocity);
        points_back(glided, direction, rate * 0.5, by_glided);
        for (int i = 0; i < GRIPPER; i++) by_glided[i] += behind[i];
        glide_back(by_glided);
        for (int i = 0; i < GRIPPER; i++) gradient[i] += by_glided[i];
    }
    SYNC;
}

// Loss of frame k (counted from 1); adds its gradient to `gradient`. Overwrites `ends` and `true_ends`.
FN double loss(const double* after, const double* wanted, double* ends, double* true_ends, int k, double weight,
               double* gradient) {
    OF_BLOCK double parts[RODS + 1];
    const double q = 2 * SHARE * sqrt((double)k), share = weight / (3 * RODS);
    nodes(after, ends);
    nodes(wanted, true_ends);
    EACH(rod, RODS) {
        double part = 0, by;
        for (int i = 0; i < 3; i++) {
            const int along = GRIPPER + 3 * rod + i, rate = RATES + 3 * rod + i, at = 3 * rod + i,
                      speed = 3 * (RODS + rod) + i;
            part += bent(after[rate] - wanted[rate], BY_RATE * q, share, by);
            gradient[rate] += by;
            part += bent(after[along] - wanted[along], BY_RATE * FRAME * q, share, by);
            gradient[along] += by;
            part += bent(ends[at] - true_ends[at], BY_SPEED * FRAME * q, 2 * share, by);
            ends[at] = by;
            part += bent(ends[speed] - true_ends[speed], BY_SPEED * q, share, by);
            ends[speed] = by;
        }
        parts[rod] = part;
    }
    EACH(one, 1) {
        double part = 0, by;
        for (int i = 0; i < GRIPPER; i++) {
            part += bent(after[i] - wanted[i], 2 * BY_LED[i], 0.2 * weight / 12, by);
            gradient[i] += by;
        }
        parts[RODS] = part;
    }
    SYNC;
    nodes_back(ends, gradient);
    double total = 0;
    for (int i = 0; i <= RODS; i++) total += parts[i];
    return total;
}

// Adds the upstream gradient of `later` later frames to the frame's gradient. The upstream gradient is clipped to
// `later` times the norm of the frame's gradient.
FN void join(const double* behind, int later, double* gradient) {
    OF_BLOCK double squares[2];
    EACH(c, 2) {
        squares[c] = 0;
        for (int i = 0; i < CHAIN; i++) squares[c] += c ? behind[i] * behind[i] : gradient[i] * gradient[i];
    }
    SYNC;
    const double share = least(later * sqrt(squares[0]) / most(sqrt(squares[1]), 1e-300), 1);
    EACH(i, CHAIN) gradient[i] += share * behind[i];
    SYNC;
}

// Whether a rollout is close enough to the truth to continue. Overwrites `ends` and `true_ends`.
FN int near(const double* chain, const double* wanted, double* ends, double* true_ends) {
    nodes(chain, ends);
    nodes(wanted, true_ends);
    double apart = 0, all = 0;
    for (int k = 0; k < RODS; k++) apart += norm(read3(ends + 3 * k) - read3(true_ends + 3 * k));
    for (int i = 0; i < CHAIN; i++) all += chain[i] - chain[i];
    return all == 0 && apart <= ASTRAY * RODS;
}
