// A program of the way back through a task's text for a machine without a card.

// From standard input: n; states, goals, actions, torques, gradients by observations, by torques and by rewards; the scene. To standard output,
// by environment: slopes of observation, act (and by action) and reward (and by torques).
int main() {
    const int n = take_in<int>(1)[0];
    double *states = take_in<double>(n * STATE), *goals = take_in<double>(n * GOALS), *actions = take_in<double>(n * ACTIONS);
    const double *torques = take_in<double>(n * NJ), *by_seen = take_in<double>(n * SEEN), *by_torques = take_in<double>(n * NJ);
    const double *by_reward = take_in<double>(n), *scene = take_in<double>(SCENE);
    for (int i = 0; i < n; i++) {
        Work work;
        const Seen s = {states + i * STATE, goals + i * GOALS, scene, &work};
        settle(work, s.state, scene);
        double out[6 * NV + ACTIONS + NJ] = {};
        task_observe_back(s, by_seen + i * SEEN, out);
        task_act_back(s, actions + i * ACTIONS, by_torques + i * NJ, out + 2 * NV, out + 6 * NV);
        task_reward_back(s, torques + i * NJ, by_reward + i, out + 4 * NV, out + 6 * NV + ACTIONS);
        std::fwrite(out, sizeof(double), 6 * NV + ACTIONS + NJ, stdout);
    }
    return 0;
}
