// Episodes of a task in many environments, as in episodes.rs.

constexpr int STATE = NQ + NV;
// A coordinate (m, rad) or velocity (m/s, rad/s) beyond this is a failure.
constexpr double FAR = 1e5;

// All environments, row-major. `begun` and the seed's key determine the next draws; `memory` counts the frames that a
// learned solver remembers.
struct World {
    double *states, *goals, *torques, *scenes;
    const int* scene_of;
    int* faults;
    unsigned *memory, *failed;
    unsigned long long *frames, *begun, key[4], first;
    // Number of failed episodes, and 1 + the index of an environment with a start state that cannot be stepped.
    unsigned* counts;
    // Number of environments; whether the level changes between episodes.
    int n, climbs;
    // States before the last frames of each environment, the newest first, for delayed observations.
    double* before;
};

// Random stream of an environment's present episode.
FN unsigned long long stream_of(const World& w, int env) { return (w.first + env) << 32 | (w.begun[env] - 1); }

BIG void restart(const World& w, int env) {
    Draws d = draws(w.key, (w.first + env) << 32 | w.begun[env]);
    w.begun[env]++;
    double *goal = w.goals + (long long)env * GOALS, *scene = w.scenes + (long long)w.scene_of[env] * SCENE;
    const double level = LEVELS ? goal[LEVEL_AT] : 1;
    for (int k = 0; k < GOALS; k++) goal[k] = k < GOALS - MEMORY ? between(d, COMMAND + 2 * k) : 0;
    double state[STATE];
    for (int k = 0; k < STATE; k++) state[k] = 0;
    start(d, state);
#if FIELDS
#if LEVELS
    if (w.climbs) goal[LEVEL_AT] = level;
    terrain(scene)[13] = goal[LEVEL_AT];
#endif
    if (DOFS && terrain(scene)) strewn(d, state, scene);
#endif
    for (int k = 0; k < STATE; k++) w.states[(long long)env * STATE + k] = state[k];
    w.frames[env] = 0;
    w.faults[env] = 0;
    if (w.memory) w.memory[env] = 0;
}

// Counts a frame, or restarts an environment that could not be stepped.
FN void counted(const World& w, int env) {
    if (!w.faults[env]) { w.frames[env]++; return; }
    if (w.frames[env] == 0 && !w.failed[env]) w.counts[1] = 1 + env;
    w.failed[env] = 1;
    restart(w, env);
}

// Level of the next episode: up after an episode that lasts and succeeds, down after a terminated one.
FN void climb(const World& w, int env, bool lasted) {
#if LEVELS
    constexpr unsigned long long steps = LENGTH / STEP_FRAMES;
    double* goal = w.goals + (long long)env * GOALS + LEVEL_AT;
    const double level = floor(goal[0] * LEVELS + 0.5) + (!lasted ? -1 : goal[1] <= steps - steps / 2 ? 1 : 0);
    if (w.climbs) goal[0] = fmin(fmax(level, 1.0), (double)LEVELS) / LEVELS;
#endif
}

// The view of an environment that formulas read. With `asks`, kinematics and distances are computed first.
FN Seen seen(const World& w, int env, Work& work, bool asks) {
    const Seen s = {w.states + (long long)env * STATE, w.goals + (long long)env * GOALS,
                    w.scenes + (long long)w.scene_of[env] * SCENE, &work};
    if (asks) settle(work, s.state, s.scene);
    return s;
}

// Records of a frame: state and goal before it, torques in it. Null pointers mean no record.
struct Past { double *states, *torques, *goals; };

// Updates the memory at the goal's end after a step: the step's action becomes the last action, and a count of steps
// advances.
FN void remember(double* goal, const float* action) {
    double* kept = goal + GOALS - MEMORY;
    if (MEMORY % 2) kept[MEMORY - 1] += 1;
    for (int k = 0; k < MEMORY / 2; k++) {
        kept[MEMORY / 2 + k] = kept[k];
        kept[k] = fmin(fmax((double)action[k], -1.0), 1.0);
    }
}

// Computes the torques of one frame of a step.
FN void act(const World& w, int env, const float* actions, int frame, Past past) {
    if (frame) counted(w, env);
    shoved(w.key, stream_of(w, env), w.frames[env], w.states + (long long)env * STATE);
    Work work;
    const Seen s = seen(w, env, work, ACT_ASKS);
    double action[ACTIONS + 1], *tau = w.torques + (long long)env * NJ;
    for (int k = 0; k < ACTIONS; k++) action[k] = actions[(long long)env * ACTIONS + k];
    task_act(s, action, tau);
    if (past.states) {
        for (int k = 0; k < STATE; k++) past.states[(long long)env * STATE + k] = s.state[k];
        for (int k = 0; k < NJ; k++) past.torques[(long long)env * NJ + k] = tau[k];
        for (int k = 0; k < GOALS && past.goals; k++) past.goals[(long long)env * GOALS + k] = s.goal[k];
    }
#if LAGGED
    double* before = w.before + (long long)env * LATEST * STATE;
    for (int k = LATEST * STATE - 1; k >= 0; k--) before[k] = k < STATE ? s.state[k] : before[k - STATE];
#endif
    if (frame == STEP_FRAMES - 1) remember(w.goals + (long long)env * GOALS, actions + (long long)env * ACTIONS);
}

// Input row of a policy: the newest observation, its difference from the previous one, the difference of differences,
// and so on (stack.rs).
FN void pushed(const double* now, const double* row, double* out, int depth) {
    for (int j = depth - 1; j > 1; j--)
        for (int k = 0; k < SEEN; k++) out[j * SEEN + k] = row[(j - 1) * SEEN + k];
    for (int k = 0; k < SEEN; k++) {
        if (depth > 1) out[SEEN + k] = now[k] - row[k];
        out[k] = now[k];
    }
}
FN void observe(const World& w, int env, Work& work, double* out) {
#if BLURRED || LAGGED
    Seen s = seen(w, env, work, false);
    unsigned long long frame = w.frames[env], late = 0;
#if LAGGED
    late = (unsigned long long)(LAG(s.scene)[0] + 0.5);
    if (late > frame) late = frame;
    if (late) s.state = w.before + ((long long)env * LATEST + late - 1) * STATE;
#endif
    double shown[STATE];
    for (int k = 0; k < STATE; k++) shown[k] = s.state[k];
#if BLURRED
    blurred(w.key, stream_of(w, env), frame - late, s.scene, shown);
#endif
    s.state = shown;
    if (OBSERVE_ASKS) settle(work, shown, s.scene);
    task_observe(s, out);
#else
    task_observe(seen(w, env, work, OBSERVE_ASKS), out);
#endif
}

// After a step: computes reward, end (0 none, 1 terminated, 2 truncated) and next input row. `cut` gets the final row
// of truncated episodes. `reached`, if not null, gets the state, or NaN where the solver failed.
FN void judge(const World& w, int env, const double* row, double* next, double* cut, unsigned* cuts, int depth,
              double* reward, unsigned char* end, double* reached) {
    counted(w, env);
    double *state = w.states + (long long)env * STATE, now[SEEN], out;
    for (int k = 0; k < STATE; k++) if (!(fabs(state[k]) <= FAR)) w.failed[env] = 1;
    for (int k = 0; k < STATE && reached; k++)
        reached[(long long)env * STATE + k] = w.failed[env] ? 0 / zero() : state[k];
    Work work;
    if (w.failed[env]) {
        // Counts episodes as the CPU does: one start after the failure, one after the end.
        w.begun[env]++;
        *reward = 0;
        *end = 1;
#ifdef __CUDACC_RTC__
        atomicAdd(w.counts, 1);
#else
        w.counts[0]++;
#endif
        w.failed[env] = 0;
    } else {
        Seen s = seen(w, env, work, TERMINATED_ASKS);
        task_terminated(s, &out);
        *end = out != 0 ? 1 : w.frames[env] >= LENGTH ? 2 : 0;
        if (REWARD_ASKS && !TERMINATED_ASKS) s = seen(w, env, work, true);
        task_reward(s, w.torques + (long long)env * NJ, reward);
#if LEVELS
        if (ERROR_ASKS && !TERMINATED_ASKS && !REWARD_ASKS) s = seen(w, env, work, true);
        task_error(s, &out);
        if (2 * w.frames[env] > LENGTH) w.goals[(long long)env * GOALS + LEVEL_AT + 1] += out;
#endif
        observe(w, env, work, now);
        pushed(now, row, next, depth);
        if (*end == 2) {
            double* kept = cut + ((long long)cuts[env]++ * w.n + env) * depth * SEEN;
            for (int k = 0; k < depth * SEEN; k++) kept[k] = next[k];
        }
    }
    if (!*end) return;
    climb(w, env, *end == 2);
    restart(w, env);
    for (int k = 0; k < depth * SEEN; k++) next[k] = 0;
    observe(w, env, work, next);
}

extern "C" __global__ void task_act(const World* world, const float* actions, int frame, double* past_states,
                                    double* past_torques, double* past_goals) {
    const int env = blockIdx.x * blockDim.x + threadIdx.x;
    if (env < world->n) act(*world, env, actions, frame, {past_states, past_torques, past_goals});
}
extern "C" __global__ void task_judge(const World* world, const double* rows, double* next, double* cut, unsigned* cuts,
                                      int depth, double* rewards, unsigned char* ends, double* reached) {
    const int env = blockIdx.x * blockDim.x + threadIdx.x;
    const long long at = (long long)env * depth * SEEN;
    if (env < world->n) judge(*world, env, rows + at, next + at, cut, cuts, depth, rewards + env, ends + env, reached);
}
