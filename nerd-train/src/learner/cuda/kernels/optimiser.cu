// partial[block]: sum of squared gradient entries.
extern "C" __global__ void square_partial(const float* g, u64 n, float* partial) {
    float sum = 0.0f;
    for (u64 i = (u64)blockIdx.x * blockDim.x + threadIdx.x; i < n; i += (u64)gridDim.x * blockDim.x)
        sum += g[i] * g[i];
    sum = block_sum(sum);
    if (threadIdx.x == 0) partial[blockIdx.x] = sum;
}

// Computes gradient norm, clip factor, bias corrections and decay of the average, adds to the progress and counts the
// update. Launched as one block of 256 threads.
extern "C" __global__ void finish(const float* partial, int count, const float* squares, float mean, float clip,
                                  double average, double beta, Scalars* s) {
    __shared__ double part[256];
    double sum = 0.0;
    for (int i = threadIdx.x; i < count; i += 256) sum += partial[i];
    part[threadIdx.x] = sum;
    __syncthreads();
    for (int o = 128; o > 0; o /= 2) {
        if (threadIdx.x < o) part[threadIdx.x] += part[threadIdx.x + o];
        __syncthreads();
    }
    if (threadIdx.x) return;
    const double norm = sqrt(part[0]);
    const float loss = *squares * mean;
    if (s->bad_step == ~0ull && !(isfinite(loss) && isfinite(norm))) {
        s->bad_step = s->step;
        s->bad_loss = isfinite(loss) ? nanf("") : loss;
    }
    const double t = (double)(s->step + 1), k = (double)s->step;
    s->scale = (float)fmin(1.0, clip / (norm + 1e-6));
    s->rate = (float)(s->lr / (1.0 - pow(0.9, t)));
    s->root = (float)(1.0 / sqrt(1.0 - pow(beta, t)));
    // `blend` in learner/optimiser.rs explains the sixteen.
    const double growing = (1.0 + k) / (10.0 + k);
    s->blend = (float)(growing < average ? 1.0 - growing : (s->step + 1) % 16 == 0 ? 1.0 - pow(average, 16.0) : 0.0);
    s->loss_sum += loss;
    s->norm_sum += norm;
    s->count += 1;
    s->step += 1;
}

// Clips the gradient and updates parameters outside Muon by Adam, and their moving average `a`; for training and PPO.
// `factors` are clip, rate, root of the second correction and blend of the average. `a`, `hidden` and `bad` may be
// null. After a loss that is not finite, the weights stay as they were.
extern "C" __global__ void adam(float* w, const float* g, float* m, float* v, float* a, const float* factors,
                                const u64* bad, u64 n, const unsigned char* hidden, double first, double beta) {
    const u64 i = (u64)blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= n || (bad && *bad != ~0ull) || (hidden && hidden[i])) return;
    const float d = g[i] * factors[0];
    const float mean = m[i] + (float)(1.0 - first) * (d - m[i]);
    const float second = (float)beta * v[i] + (float)(1.0 - beta) * d * d;
    const float x = w[i] - factors[1] * mean / (sqrtf(second) * factors[2] + 1e-8f);
    m[i] = mean;
    v[i] = second;
    w[i] = x;
    if (a) a[i] += factors[3] * (x - a[i]);
}

// Index of entry i of packed matrix k in the flat vector. Table rows: offset, stride, transposed.
__device__ __forceinline__ u64 hidden_at(const int4* table, int k, int i, int columns) {
    const int4 t = table[k];
    const int r = i / columns, c = i % columns;
    return t.x + (t.z ? (u64)c * t.y + r : (u64)r * t.y + c);
}

// Updates the momentum and packs its Nesterov step, [matrix][rows][columns]. Grid (ceil(rows columns / 256), matrices).
extern "C" __global__ void muon_pack(const float* g, float* m, float* x, const int4* table, const Scalars* s,
                                     float beta, int rows, int columns) {
    const int i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= rows * columns) return;
    const u64 at = hidden_at(table, blockIdx.y, i, columns);
    const float d = g[at] * s->scale;
    const float mean = beta * m[at] + (1.0f - beta) * d;
    if (s->bad_step == ~0ull) m[at] = mean;
    x[(u64)blockIdx.y * rows * columns + i] = beta * mean + (1.0f - beta) * d;
}

// Divides each packed matrix of n entries by its Frobenius norm. One block of 1024 per matrix.
extern "C" __global__ void muon_unit(float* x, int n) {
    __shared__ float scale;
    x += (u64)blockIdx.x * n;
    float sum = 0.0f;
    for (int i = threadIdx.x; i < n; i += blockDim.x) sum += x[i] * x[i];
    sum = block_sum(sum);
    if (threadIdx.x == 0) scale = 1.0f / (sqrtf(sum) + 1e-7f);
    __syncthreads();
    for (int i = threadIdx.x; i < n; i += blockDim.x) x[i] *= scale;
}

// p = a 1 + b gram + c p. Grid (ceil(rows rows / 256), matrices).
extern "C" __global__ void muon_polynomial(const float* gram, float* p, float a, float b, float c, int rows) {
    const int i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= rows * rows) return;
    const u64 at = (u64)blockIdx.y * rows * rows + i;
    p[at] = (i / rows == i % rows ? a : 0.0f) + b * gram[at] + c * p[at];
}

// w -= lr gain x, and the moving average.
extern "C" __global__ void muon_apply(float* w, float* a, const float* x, const int4* table, const Scalars* s,
                                      float gain, int rows, int columns) {
    const int i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= rows * columns || s->bad_step != ~0ull) return;
    const u64 at = hidden_at(table, blockIdx.y, i, columns);
    const float y = w[at] - s->lr * gain * x[(u64)blockIdx.y * rows * columns + i];
    w[at] = y;
    a[at] += s->blend * (y - a[at]);
}
