// The task's part of the adjoint through steps of policy and solver. Gradients with respect to a state are in its
// tangent space.

// Records of a rollout, and gradients: by step [step][env], by frame [frame][env].
struct Steps {
    // State and goal before each frame, torques in it; state after each step, NaN where the solver failed.
    const double *states, *goals, *torques, *reached;
    // Observation before each step; rows for the value network. A network's input is (row - mean) inverse, clipped to
    // +-5.
    const double *seen, *rows, *mean, *inverse;
    // For each step: weight of its reward, its end, and index of its row for the value network, or -1.
    const double* shares;
    const unsigned char* ends;
    const int* asked;
    // Sampled actions, and their means.
    const float *drawn, *means;
    // Gradients with respect to network inputs: the policy's before the next step, [env]; the value network's rows.
    const float *by_seen, *by_rows;
    // Per environment: gradients with respect to the state, to torques (by the reward, by the next frame), and to the
    // action.
    double *gradient, *by_torques, *pushed, *by_action;
    // Set if an environment has a frame without a finite gradient; all steps of this environment are then left out.
    unsigned* without;
    // Gradients with respect to the policy's `outputs` outputs, the means first, and to the log standard deviations.
    float *by_said, *by_spread;
    // Factor on all rewards.
    double scale;
    int outputs, horizon;
};

// An environment as it was before a frame.
FN Seen was(const World& w, const Steps& b, long long frame, int env, Work& work, const double* state, bool asks) {
    const Seen s = {state, b.goals + (frame * w.n + env) * GOALS, w.scenes + (long long)w.scene_of[env] * SCENE, &work};
    if (asks) settle(work, state, s.scene);
    return s;
}

// Adds the gradient that reaches the state through a network's input.
FN void seen_back(const Steps& b, const Seen& s, const double* row, const float* by, double* gradient) {
    double all[SEEN];
    for (int k = 0; k < SEEN; k++) all[k] = fabs((row[k] - b.mean[k]) * b.inverse[k]) < 5 ? by[k] * b.inverse[k] : 0;
    task_observe_back(s, all, gradient);
}

FN bool sound(const double* x, int n) {
    for (int k = 0; k < n; k++) if (!(x[k] - x[k] == 0)) return false;
    return true;
}
FN void zeros(double* x, int n) { for (int k = 0; k < n; k++) x[k] = 0; }

// Adjoint from the state before step t + 1 to the state after step t; needs the policy's adjoint of step t + 1.
FN void arrive_back(const World& w, const Steps& b, int t, int env) {
    const long long i = (long long)t * w.n + env, frame = (long long)(t + 1) * STEP_FRAMES;
    double *gradient = b.gradient + (long long)env * 2 * NV, *by_torques = b.by_torques + (long long)env * NJ;
    Work work;
    // No gradient crosses the start of another episode.
    if (t + 1 == b.horizon || b.ends[i]) {
        zeros(gradient, 2 * NV);
    } else {
        const Seen s = was(w, b, frame, env, work, b.states + (frame * w.n + env) * STATE, OBSERVE_ASKS);
        seen_back(b, s, b.seen + (i + w.n) * SEEN, b.by_seen + (long long)env * SEEN, gradient);
        if (!sound(gradient, 2 * NV)) b.without[env] = 1;
    }
    zeros(by_torques, NJ);
    const double *state = b.reached + i * STATE, by = -b.scale * b.shares[i];
    if (!(state[0] == state[0])) return;
    Seen s = was(w, b, frame - 1, env, work, state, REWARD_ASKS || (OBSERVE_ASKS && b.asked[i] >= 0));
    // The goal after the step.
    double goal[GOALS + 1];
    for (int k = 0; k < GOALS; k++) goal[k] = s.goal[k];
    remember(goal, b.drawn + i * ACTIONS);
    s.goal = goal;
    task_reward_back(s, b.torques + ((frame - 1) * w.n + env) * NJ, &by, gradient, by_torques);
    if (b.asked[i] >= 0)
        seen_back(b, s, b.rows + (long long)b.asked[i] * SEEN, b.by_rows + (long long)b.asked[i] * SEEN, gradient);
}

// Adjoint from the torques of a frame to the action of its step; needs the solver's adjoint of the frame. At the first
// frame of a step, the adjoint goes on to the policy's outputs.
FN void act_back(const World& w, const Steps& b, long long frame, int env) {
    const bool last = (frame + 1) % STEP_FRAMES == 0, first = frame % STEP_FRAMES == 0;
    const long long i = frame / STEP_FRAMES * w.n + env;
    double *gradient = b.gradient + (long long)env * 2 * NV, *kept = b.by_action + (long long)env * ACTIONS;
    double *pushed = b.pushed + (long long)env * NJ, *by_torques = b.by_torques + (long long)env * NJ;
    const double reached = b.reached[i * STATE];
    const bool lost = !(reached == reached);
    if (!lost && (!sound(gradient, 2 * NV) || !sound(pushed, NJ))) b.without[env] = 1;
    if (lost || b.without[env]) {
        zeros(gradient, 2 * NV);
        zeros(pushed, NJ);
        zeros(by_torques, NJ);
    }
    double by[NJ + 1], action[ACTIONS], by_action[ACTIONS];
    for (int k = 0; k < NJ; k++) by[k] = pushed[k] + (last ? by_torques[k] : 0);
    for (int k = 0; k < ACTIONS; k++) {
        action[k] = fmin(fmax((double)b.drawn[i * ACTIONS + k], -1.0), 1.0);
        by_action[k] = last ? 0 : kept[k];
    }
    Work work;
    task_act_back(was(w, b, frame, env, work, b.states + (frame * w.n + env) * STATE, ACT_ASKS), action, by, gradient,
                  by_action);
    for (int k = 0; k < ACTIONS; k++) kept[k] = by_action[k];
    if (!sound(by_action, ACTIONS)) b.without[env] = 1;
    if (!first) return;
    for (int k = 0; k < ACTIONS; k++) {
        const double drawn = b.drawn[i * ACTIONS + k];
        // Beyond a bound of the action, a gradient whose descent leads farther outside is set to zero.
        const double g = fabs(drawn) > 1 && by_action[k] * drawn < 0 ? 0 : by_action[k];
        b.by_said[i * b.outputs + k] = (float)g;
        b.by_spread[i * ACTIONS + k] = (float)(g * (drawn - b.means[i * ACTIONS + k]));
    }
    for (int k = ACTIONS; k < b.outputs; k++) b.by_said[i * b.outputs + k] = 0;
}

// Drops the steps of an environment without finite gradients, and starts its next episode.
FN void leave(const World& w, const Steps& b, int t, int env) {
    if (!b.without[env]) return;
    const long long i = (long long)t * w.n + env;
    for (int k = 0; k < b.outputs; k++) b.by_said[i * b.outputs + k] = 0;
    for (int k = 0; k < ACTIONS; k++) b.by_spread[i * ACTIONS + k] = 0;
}
FN void begin_again(const World& w, const Steps& b, int env, double* rows) {
    if (!b.without[env]) return;
    Work work;
    restart(w, env);
    observe(w, env, work, rows + (long long)env * SEEN);
}

extern "C" __global__ void task_arrive_back(const World* world, const Steps* steps, int t) {
    const int env = blockIdx.x * blockDim.x + threadIdx.x;
    if (env < world->n) arrive_back(*world, *steps, t, env);
}
extern "C" __global__ void task_acted_back(const World* world, const Steps* steps, int frame) {
    const int env = blockIdx.x * blockDim.x + threadIdx.x;
    if (env < world->n) act_back(*world, *steps, frame, env);
}
extern "C" __global__ void task_leave(const World* world, const Steps* steps) {
    const int env = blockIdx.x * blockDim.x + threadIdx.x;
    if (env < world->n) leave(*world, *steps, blockIdx.y, env);
}
extern "C" __global__ void task_begin_again(const World* world, const Steps* steps, double* rows) {
    const int env = blockIdx.x * blockDim.x + threadIdx.x;
    if (env < world->n) begin_again(*world, *steps, env, rows);
}
