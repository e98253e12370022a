// Recurrent cells, one token of every window at a time: GRUs of three gates (r, z, n), LSTMs of four (i, f, g, o). u [rows][T][gates E] is
// from tokens, v [rows][gates E] from states. kept [rows][T][gates + 1][E] holds gates and, of an LSTM, c; of a GRU, v_n;
// before [rows][T][E] the states that tokens find, that of the oldest being zero. A thread an entry of a state.

__device__ __forceinline__ float sigmoid(float x) { return 1.0f / (1.0f + expf(-x)); }

extern "C" __global__ void cell_forward(const float* u, const float* ub, const float* v, const float* b, float* out, float* before,
                                        float* kept, int k, int e, int lstm, int rows) {
    const int i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= rows * e) return;
    const int row = i / e, m = i % e, gates = lstm ? 4 : 3;
    const u64 token = (u64)row * T + k;
    float a[4], s[4];
    for (int g = 0; g < gates; g++) {
        a[g] = u[(token * gates + g) * e + m] + (ub ? ub[g * e + m] : 0.0f);
        s[g] = b[g * e + m] + (k > 0 ? v[((u64)row * gates + g) * e + m] : 0.0f);
    }
    float* now = kept + token * (gates + 1) * e + m;
    float h;
    if (lstm) {
        const float input = sigmoid(a[0] + s[0]), forget = sigmoid(a[1] + s[1]), fresh = tanhf(a[2] + s[2]), open = sigmoid(a[3] + s[3]);
        const float c = forget * (k > 0 ? now[-e] : 0.0f) + input * fresh;
        h = open * tanhf(c);
        now[0] = input, now[e] = forget, now[2 * e] = fresh, now[3 * e] = open, now[4 * e] = c;
    } else {
        const float r = sigmoid(a[0] + s[0]), z = sigmoid(a[1] + s[1]), n = tanhf(a[2] + r * s[2]);
        h = n + z * (before[token * e + m] - n);
        now[0] = r, now[e] = z, now[2 * e] = n, now[3 * e] = s[2];
    }
    out[token * e + m] = h;
    if (k + 1 < T) before[(token + 1) * e + m] = h;
}

// du and dv of token k (one array, of an LSTM) from the upstream gradient of its state, and what goes back to the state before it: dc whole, of dh
// what does not go through v. Beyond the newest token there is none.
extern "C" __global__ void cell_backward(const float* behind, const float* before, const float* kept, float* du, float* dv, float* dh,
                                         float* dc, int k, int e, int lstm, int rows) {
    const int i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= rows * e) return;
    const int row = i / e, m = i % e, gates = lstm ? 4 : 3;
    const u64 token = (u64)row * T + k;
    const float* now = kept + token * (gates + 1) * e + m;
    const bool newest = k + 1 == T;
    const float d = behind[token * e + m] + (newest ? 0.0f : dh[i]);
    float* u = du + token * gates * e + m;
    float* v = dv + token * gates * e + m;
    if (lstm) {
        const float input = now[0], forget = now[e], fresh = now[2 * e], open = now[3 * e], bent = tanhf(now[4 * e]);
        const float slope = (newest ? 0.0f : dc[i]) + d * open * (1.0f - bent * bent);
        u[0] = slope * fresh * input * (1.0f - input);
        u[e] = slope * (k > 0 ? now[-e] : 0.0f) * forget * (1.0f - forget);
        u[2 * e] = slope * input * (1.0f - fresh * fresh);
        u[3 * e] = d * bent * open * (1.0f - open);
        dc[i] = slope * forget;
        dh[i] = 0.0f;
    } else {
        const float r = now[0], z = now[e], n = now[2 * e], slope = d * (1.0f - z) * (1.0f - n * n);
        u[0] = v[0] = slope * now[3 * e] * r * (1.0f - r);
        u[e] = v[e] = d * (before[token * e + m] - n) * z * (1.0f - z);
        u[2 * e] = slope;
        v[2 * e] = slope * r;
        dh[i] = d * z;
    }
}
