// A program of the way back through steps for a machine without a card, in which a solver leaves slopes as they are.

int main() {
    const int *head = take_in<int>(3), n = head[0], horizon = head[1], rows = head[2], steps = n * horizon, frames = steps * STEP_FRAMES;
    Steps b = {};
    b.states = take_in<double>(frames * STATE), b.goals = take_in<double>(frames * GOALS), b.torques = take_in<double>(frames * NJ);
    b.reached = take_in<double>(steps * STATE), b.seen = take_in<double>((steps + n) * SEEN), b.rows = take_in<double>(rows * SEEN);
    b.mean = take_in<double>(SEEN), b.inverse = take_in<double>(SEEN), b.shares = take_in<double>(steps);
    const double* pushed = take_in<double>(frames * NJ);
    double* scenes = take_in<double>(n * SCENE);
    b.drawn = take_in<float>(steps * ACTIONS), b.means = take_in<float>(steps * ACTIONS);
    const float* by_seen = take_in<float>(steps * SEEN);
    b.by_rows = take_in<float>(rows * SEEN);
    b.asked = take_in<int>(steps), b.ends = take_in<unsigned char>(steps);
    b.slope = new double[n * 2 * NV](), b.by_torques = new double[n * NJ](), b.pushed = new double[n * NJ](), b.by_action = new double[n * ACTIONS]();
    b.outputs = ACTIONS + 1, b.by_said = new float[steps * b.outputs](), b.by_spread = new float[steps * ACTIONS]();
    b.without = new unsigned[n](), b.scale = 0.25, b.horizon = horizon;
    int* of = new int[n]();
    World w = {};
    w.scenes = scenes, w.scene_of = of, w.n = n;
    for (int t = horizon - 1; t >= 0; t--) {
        b.by_seen = by_seen + t * n * SEEN;
        for (int env = 0; env < n; env++) arrive_back(w, b, t, env);
        for (int frame = (t + 1) * STEP_FRAMES - 1; frame >= t * STEP_FRAMES; frame--)
            for (int env = 0; env < n; env++) {
                for (int k = 0; k < NJ; k++) b.pushed[env * NJ + k] = pushed[(frame * n + env) * NJ + k];
                act_back(w, b, frame, env);
            }
    }
    for (int t = 0; t < horizon; t++) for (int env = 0; env < n; env++) leave(w, b, t, env);
    std::fwrite(b.slope, 8, n * 2 * NV, stdout);
    std::fwrite(b.by_said, 4, steps * b.outputs, stdout);
    std::fwrite(b.by_spread, 4, steps * ACTIONS, stdout);
    std::fwrite(b.without, 4, n, stdout);
    return 0;
}
