// A program of the task's text for a machine without a card.

// From standard input: n and depth; key and first; states, goals, frames, begun, planted faults, actions, rows, how many numbers of scenes, these. To standard output: what one
// step makes of them in which nothing moves, and what is planted fails in every frame.
template <typename T> void put_out(const T* all, long long n) { std::fwrite(all, sizeof(T), n, stdout); }
int main() {
    const int* head = take_in<int>(2);
    const int n = head[0], depth = head[1];
    const unsigned long long* key = take_in<unsigned long long>(5);
    double *states = take_in<double>(n * STATE), *goals = take_in<double>(n * GOALS);
    unsigned long long *frames = take_in<unsigned long long>(n), *begun = take_in<unsigned long long>(n);
    const int* planted = take_in<int>(n);
    const float* actions = take_in<float>(n * ACTIONS);
    const double* rows = take_in<double>(n * depth * SEEN);
    double* scenes = take_in<double>(take_in<int>(1)[0]);
    double* before = take_in<double>(LAGGED ? n * LATEST * STATE : 0);
    int *of = new int[n], *faults = new int[n]();
    unsigned *failed = new unsigned[n](), *cuts = new unsigned[n](), counts[2] = {0, 0};
    double *torques = new double[n * NJ + 1](), *next = new double[n * depth * SEEN](), *cut = new double[n * depth * SEEN]();
    double *rewards = new double[n](), *reached = new double[n * STATE]();
    unsigned char* ends = new unsigned char[n]();
    const World w = {states, goals, torques, scenes, of, faults, 0, failed, frames, begun, {key[0], key[1], key[2], key[3]}, key[4], counts, n, LEVELS > 0, before};
    for (int env = 0; env < n; env++) of[env] = env;
    for (int f = 0; f < STEP_FRAMES; f++)
        for (int env = 0; env < n; env++) {
            act(w, env, actions, f, {});
            faults[env] = planted[env];
        }
    for (int env = 0; env < n; env++) {
        const long long at = (long long)env * depth * SEEN;
        judge(w, env, rows + at, next + at, cut, cuts, depth, rewards + env, ends + env, reached);
    }
    put_out(torques, n * NJ);
    put_out(rewards, n);
    put_out(ends, n);
    put_out(next, n * depth * SEEN);
    put_out(cut, n * depth * SEEN);
    put_out(states, n * STATE);
    put_out(goals, n * GOALS);
    put_out(frames, n);
    put_out(begun, n);
    put_out(counts, 2);
    put_out(reached, n * STATE);
    return 0;
}
