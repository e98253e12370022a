// The way back through steps of a policy around a solver's: the task's part of it. Slopes by a state are in its tangent space.

// Steps that were made, and what the way back finds; by step [step][env], by frame [frame][env].
struct Steps {
    // State and goal before each frame, torques in it; what each step led to, no number where the solver could not go on.
    const double *states, *goals, *torques, *reached;
    // What was seen before each step; rows of which more is asked for; a network sees (row - mean) inverse, within +-5.
    const double *seen, *rows, *mean, *inverse;
    // What a step's reward counts, how the step ended, the number of the row that it led to, if more is asked for, or -1.
    const double* shares;
    const unsigned char* ends;
    const int* asked;
    // Actions as they were drawn, and their means.
    const float *drawn, *means;
    // Gradients by what networks see: before the step after, by environment; of the rows.
    const float *by_seen, *by_rows;
    // By environment: gradients by a state, by torques of its reward and of the frame after it, and by an action.
    double *slope, *by_torques, *pushed, *by_action;
    // Whether an environment has a frame without slopes: then nothing is learned from any of its steps.
    unsigned* without;
    // Gradients by what the policy said, `outputs` numbers of which the means are the first, and by the logarithms of its spread.
    float *by_said, *by_spread;
    // Of all shares.
    double scale;
    int outputs, horizon;
};

// An environment as it was before a frame.
FN Seen was(const World& w, const Steps& b, long long frame, int env, Work& work, const double* state, bool asks) {
    const Seen s = {state, b.goals + (frame * w.n + env) * GOALS, w.scenes + (long long)w.scene_of[env] * SCENE, &work};
    if (asks) settle(work, state, s.scene);
    return s;
}

// Adds what comes of a gradient by what a network sees.
FN void seen_back(const Steps& b, const Seen& s, const double* row, const float* by, double* slope) {
    double all[SEEN];
    for (int k = 0; k < SEEN; k++) all[k] = fabs((row[k] - b.mean[k]) * b.inverse[k]) < 5 ? by[k] * b.inverse[k] : 0;
    task_observe_back(s, all, slope);
}

FN bool sound(const double* x, int n) {
    for (int k = 0; k < n; k++) if (!(x[k] - x[k] == 0)) return false;
    return true;
}
FN void zeros(double* x, int n) { for (int k = 0; k < n; k++) x[k] = 0; }

// From the state before the step after, whose policy is gone through, to the state that step t led to.
FN void arrive_back(const World& w, const Steps& b, int t, int env) {
    const long long i = (long long)t * w.n + env, frame = (long long)(t + 1) * STEP_FRAMES;
    double *slope = b.slope + (long long)env * 2 * NV, *by_torques = b.by_torques + (long long)env * NJ;
    Work work;
    // Nothing leads back from the start of another episode.
    if (t + 1 == b.horizon || b.ends[i]) {
        zeros(slope, 2 * NV);
    } else {
        const Seen s = was(w, b, frame, env, work, b.states + (frame * w.n + env) * STATE, OBSERVE_ASKS);
        seen_back(b, s, b.seen + (i + w.n) * SEEN, b.by_seen + (long long)env * SEEN, slope);
        if (!sound(slope, 2 * NV)) b.without[env] = 1;
    }
    zeros(by_torques, NJ);
    const double *state = b.reached + i * STATE, by = -b.scale * b.shares[i];
    if (!(state[0] == state[0])) return;
    Seen s = was(w, b, frame - 1, env, work, state, REWARD_ASKS || (OBSERVE_ASKS && b.asked[i] >= 0));
    // As it is once the step is over.
    double goal[GOALS + 1];
    for (int k = 0; k < GOALS; k++) goal[k] = s.goal[k];
    remember(goal, b.drawn + i * ACTIONS);
    s.goal = goal;
    task_reward_back(s, b.torques + ((frame - 1) * w.n + env) * NJ, &by, slope, by_torques);
    if (b.asked[i] >= 0) seen_back(b, s, b.rows + (long long)b.asked[i] * SEEN, b.by_rows + (long long)b.asked[i] * SEEN, slope);
}

// From the torques of a frame, whose solver is gone through, to the action of its step, and before the first of the step's frames to what drew that.
FN void act_back(const World& w, const Steps& b, long long frame, int env) {
    const bool last = (frame + 1) % STEP_FRAMES == 0, first = frame % STEP_FRAMES == 0;
    const long long i = frame / STEP_FRAMES * w.n + env;
    double *slope = b.slope + (long long)env * 2 * NV, *kept = b.by_action + (long long)env * ACTIONS;
    double *pushed = b.pushed + (long long)env * NJ, *by_torques = b.by_torques + (long long)env * NJ;
    const double reached = b.reached[i * STATE];
    const bool lost = !(reached == reached);
    if (!lost && (!sound(slope, 2 * NV) || !sound(pushed, NJ))) b.without[env] = 1;
    if (lost || b.without[env]) {
        zeros(slope, 2 * NV);
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
    task_act_back(was(w, b, frame, env, work, b.states + (frame * w.n + env) * STATE, ACT_ASKS), action, by, slope, by_action);
    for (int k = 0; k < ACTIONS; k++) kept[k] = by_action[k];
    if (!sound(by_action, ACTIONS)) b.without[env] = 1;
    if (!first) return;
    for (int k = 0; k < ACTIONS; k++) {
        const double drawn = b.drawn[i * ACTIONS + k];
        // At a bound what leads outside ends.
        const double g = fabs(drawn) > 1 && by_action[k] * drawn < 0 ? 0 : by_action[k];
        b.by_said[i * b.outputs + k] = (float)g;
        b.by_spread[i * ACTIONS + k] = (float)(g * (drawn - b.means[i * ACTIONS + k]));
    }
    for (int k = ACTIONS; k < b.outputs; k++) b.by_said[i * b.outputs + k] = 0;
}

// Takes a step out of an environment that has no slopes; begins its next episode.
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
