// Actions, values and advantages of a rollout. Noise and arithmetic are those of the CPU, in f64 where the CPU uses
// f64.

// Clamps to +-most; NaN stays NaN.
__device__ double within(double x, double most) { return x < -most ? -most : x > most ? most : x; }

// Normalises observations (normalizer.rs) into network inputs with row stride `padded`.
extern "C" __global__ void normalize(const double* rows, const double* mean, const double* inverse, float* to, u64 n,
                                     int width, int padded) {
    const u64 i = INDEX;
    if (i < n)
        to[i / width * padded + i % width] = (float)within((rows[i] - mean[i % width]) * inverse[i % width], 5.0);
}

// Samples actions. A row of `said` holds mean action and value, then the log standard deviation if `parameter` is null.
// Otherwise `parameter` holds the log standard deviation. Number i of all actions takes the i-th normal number of
// stream `*stream + later`. Box-Muller makes each pair of normal numbers from four 32-bit words. Values are in units of
// reward; `units` holds their mean and scale.
extern "C" __global__ void act(const float* said, const float* parameter, u64 key0, u64 key1, u64 key2, u64 key3,
                               const u64* stream, u64 later, const double* units, float* means, float* spreads,
                               float* actions, float* neg_log_prob, double* values, float* kept, int rows, int a,
                               int outputs) {
    const u64 row = INDEX;
    if (row >= rows) return;
    const u64 key[4] = {key0, key1, key2, key3};
    const float *mu = said + row * outputs, *s = parameter ? parameter : mu + a + 1;
    u64 known = ~(u64)0;
    unsigned words[16];
    float sum = 0;
    for (int k = 0; k < a; k++) {
        const u64 i = row * a + k, two = i / 2;
        if (two / 4 != known) chacha8(key, known = two / 4, *stream + later, words);
        const double u = 1.0 - unit(words + two % 4 * 4), v = unit(words + two % 4 * 4 + 2);
        const double radius = sqrt(-2.0 * log(u)), angle = 6.283185307179586 * v;
        const float drawn = mu[k] + expf(s[k]) * (float)(radius * (i % 2 ? sin(angle) : cos(angle)));
        const float z = (drawn - mu[k]) * expf(-s[k]);
        sum += 0.5f * z * z + s[k] + 0.9189385f;
        means[i] = mu[k];
        spreads[i] = s[k];
        actions[i] = drawn;
        kept[i] = (float)within(drawn, 1.0);
    }
    neg_log_prob[row] = sum;
    values[row] = (double)mu[a] * units[1] + units[0];
}

// Writes values to the indices in `which`, or in order if `which` is null. Rows with index -1 are skipped.
extern "C" __global__ void value(const float* said, const unsigned* which, const double* units, double* values,
                                 int rows, int a, int outputs) {
    const u64 row = INDEX;
    if (row < rows && (!which || which[row] != 0xffffffffu))
        values[which ? which[row] : row] = (double)said[row * outputs + a] * units[1] + units[0];
}

// Maps bootstrap rows to indices of `values`; unused rows get -1. `values` begins with the values of all steps. Then
// come those of the `n` states after the last step, then those of final states of truncated episodes, by step.
extern "C" __global__ void reached(const unsigned char* ends, unsigned* which, int n, int horizon, int slots) {
    const u64 env = INDEX;
    if (env >= n) return;
    which[env] = horizon * n + env;
    for (int slot = 1; slot <= slots; slot++) which[slot * n + env] = 0xffffffffu;
    for (int t = 0, slot = 0; t < horizon; t++)
        if (ends[t * n + env] == 2) which[++slot * n + env] = (horizon + 1 + t) * n + env;
}

// Advantages and returns (gae.rs), a thread per environment. An end is 1 (terminated) or 2 (truncated, bootstraps from
// `cut`).
extern "C" __global__ void gae(const double* rewards, const unsigned char* ends, const double* values,
                               const double* cut, double* both, int n, int horizon, double gamma, double gae_lambda) {
    const u64 env = INDEX;
    if (env >= n) return;
    double advantage = 0;
    for (int t = horizon - 1; t >= 0; t--) {
        const u64 i = (u64)t * n + env;
        const double next = ends[i] == 2 ? cut[i] : values[i + n];
        const double delta = rewards[i] + (ends[i] == 1 ? 0.0 : gamma * next) - values[i];
        advantage = delta + (ends[i] || t + 1 == horizon ? 0.0 : gamma * gae_lambda * advantage);
        both[2 * i] = advantage;
        both[2 * i + 1] = advantage + values[i];
    }
}

// Column sums over every `parts`-th row: of squared deviations from `means`, or of the numbers themselves if `means` is
// null.
extern "C" __global__ void columns(const double* rows, const double* means, u64 n, int width, int parts,
                                   double* partial) {
    const u64 i = INDEX, column = i % width;
    if (i >= (u64)parts * width) return;
    double sum = 0;
    for (u64 row = i / width; row < n; row += parts) {
        const double x = rows[row * width + column] - (means ? means[column] : 0.0);
        sum += means ? x * x : x;
    }
    partial[i] = sum;
}

// Column means from the partial sums of `columns`, added in order.
extern "C" __global__ void mean(const double* partial, u64 n, int width, int parts, double* out) {
    const u64 column = INDEX;
    if (column >= width) return;
    double sum = 0;
    for (int part = 0; part < parts; part++) sum += partial[(u64)part * width + column];
    out[column] = sum / n;
}

// Inputs of the loss: advantage, return and old value, each normalised by its mean and scale.
extern "C" __global__ void loss_inputs(const double* both, const double* said, u64 n, double mean, double scale,
                                       double goal_mean, double goal_scale, double said_mean, double said_scale,
                                       float* advantages, float* value_targets, float* values) {
    const u64 i = INDEX;
    if (i >= n) return;
    advantages[i] = (float)((both[2 * i] - mean) / scale);
    value_targets[i] = (float)within((both[2 * i + 1] - goal_mean) / goal_scale, 5.0);
    values[i] = (float)within((said[i] - said_mean) / said_scale, 5.0);
}
