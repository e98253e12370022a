// Parts of a PPO update around the network: the loss of loss.rs with its gradient, and Adam's factors. All sums have a
// fixed order. The prefix `ppo` keeps kernel names apart from those of the network.

typedef unsigned long long u64;

struct PassState {
    double learning_rate, sums[6], norms, batches;
    u64 step;
    float scale, used, root; // Factors of the network's kernel `adam`.
};

#define INDEX ((u64)blockIdx.x * blockDim.x + threadIdx.x)

// Gathers rows in the order of a pass.
extern "C" __global__ void ppo_gather(const float* from, const unsigned* order, float* to, u64 n, int width) {
    const u64 i = INDEX;
    if (i >= n) return;
    to[i] = from[(u64)order[i / width] * width + i % width];
}

__device__ double warp_sum(double x) {
    for (int o = 16; o > 0; o /= 2) x += __shfl_xor_sync(0xffffffffu, x, o);
    return x;
}

// Loss of each row. A row of `said` holds mean action and value, then the log standard deviation if `parameter` is
// null. Otherwise `parameter` holds the log standard deviation. Writes the gradient with respect to these three, and
// sums of the loss terms by block. Stores the present mean and log standard deviation, for the next pass's KL
// divergence.
extern "C" __global__ void ppo_loss(const float* said, const float* parameter, const unsigned* order,
                                    const float* actions, const float* neg_log_prob, const float* advantages,
                                    const float* value_targets, const float* values, float* means, float* spreads,
                                    float* d, float* d_spread, double* partial, int rows, int a, int outputs,
                                    float clip_coef, float vf_coef, float bounds_coef, float ent_coef,
                                    float value_clip) {
    const float half_ln_tau = 0.9189385f, bound = 1.1f, share = 1.0f / rows;
    __shared__ double part[4][6];
    const int row = (int)INDEX;
    double terms[6] = {0, 0, 0, 0, 0, 0};
    if (row < rows) {
        const u64 i = order[row];
        const float *mu = said + (u64)row * outputs, *s = parameter ? parameter : mu + a + 1;
        const float *action = actions + i * a, v = mu[a];
        float *d_mu = d + (u64)row * outputs, *d_s = parameter ? d_spread + (u64)row * a : d_mu + a + 1;
        float now = 0, kl = 0;
        for (int k = 0; k < a; k++) {
            const float z = (action[k] - mu[k]) * expf(-s[k]);
            now += 0.5f * z * z + s[k] + half_ln_tau;
            const float ratio = 2.0f * (s[k] - spreads[i * a + k]),
                        far = (mu[k] - means[i * a + k]) * expf(-spreads[i * a + k]);
            kl += 0.5f * (expf(ratio) + far * far - 1.0f - ratio);
        }
        const float ratio = expf(neg_log_prob[i] - now), low = 1.0f - clip_coef, high = 1.0f + clip_coef,
                    advantage = advantages[i];
        const float free = -advantage * ratio, held = -advantage * fminf(fmaxf(ratio, low), high);
        const float by_log = free >= held ? -advantage * ratio : 0.0f;
        terms[0] = fmaxf(free, held);
        terms[5] = !(low <= ratio && ratio <= high);
        terms[4] = kl;
        for (int k = 0; k < a; k++) {
            const float e = expf(-s[k]), z = (action[k] - mu[k]) * e,
                        beyond = fmaxf(mu[k] - bound, 0.0f) + fminf(mu[k] + bound, 0.0f);
            terms[2] += (double)(beyond * beyond);
            terms[3] += (double)(s[k] + half_ln_tau + 0.5f);
            d_mu[k] = share * (by_log * z * e + 2.0f * bounds_coef * beyond);
            d_s[k] = share * (by_log * (z * z - 1.0f) - ent_coef);
        }
        const float most = value_clip > 0.0f ? value_clip : 3.4e38f, moved = v - values[i],
                    value_target = value_targets[i];
        const float near = values[i] + fminf(fmaxf(moved, -most), most);
        const float plain = (v - value_target) * (v - value_target),
                    kept = (near - value_target) * (near - value_target);
        terms[1] = fmaxf(plain, kept);
        d_mu[a] = share * vf_coef
                  * (plain >= kept ? v - value_target : fabsf(moved) < most ? near - value_target : 0.0f);
        for (int k = 0; k < a; k++) {
            means[i * a + k] = mu[k];
            spreads[i * a + k] = s[k];
        }
    }
    for (int k = 0; k < 6; k++) {
        const double sum = warp_sum(terms[k]);
        if (threadIdx.x % 32 == 0) part[threadIdx.x / 32][k] = sum;
    }
    __syncthreads();
    if (threadIdx.x < 6) {
        double sum = 0;
        for (int w = 0; w < blockDim.x / 32; w++) sum += part[w][threadIdx.x];
        partial[(u64)blockIdx.x * 6 + threadIdx.x] = sum;
    }
}

extern "C" __global__ void squares(const float* g, u64 n, double* partial) {
    __shared__ double part[8];
    double sum = 0;
    for (u64 i = INDEX; i < n; i += (u64)gridDim.x * blockDim.x) sum += (double)g[i] * g[i];
    sum = warp_sum(sum);
    if (threadIdx.x % 32 == 0) part[threadIdx.x / 32] = sum;
    __syncthreads();
    if (threadIdx.x) return;
    for (int w = 1; w < blockDim.x / 32; w++) sum += part[w];
    partial[blockIdx.x] = sum;
}

// Computes means of the six loss terms, gradient norm, Adam's factors and the next minibatch's learning rate. Runs in
// one block of 7 warps.
extern "C" __global__ void ppo_finish(const double* partial, int blocks, const double* squares, int count, int rows,
                                  float max_grad_norm, double target_kl, double beta, double beta2, PassState* s) {
    __shared__ double means[7];
    const int warp = threadIdx.x / 32, lane = threadIdx.x % 32;
    double sum = 0;
    if (warp < 6) for (int b = lane; b < blocks; b += 32) sum += partial[b * 6 + warp];
    else for (int b = lane; b < count; b += 32) sum += squares[b];
    sum = warp_sum(sum);
    if (lane == 0) means[warp] = warp < 6 ? sum / rows : sqrt(sum);
    __syncthreads();
    if (threadIdx.x) return;
    const float found = (float)means[6];
    s->scale = fminf(max_grad_norm / (found + 1e-6f), 1.0f);
    s->step += 1;
    s->used = (float)(s->learning_rate / (1.0 - pow(beta, (double)s->step)));
    s->root = (float)(1.0 / sqrt(1.0 - pow(beta2, (double)s->step)));
    s->norms += found;
    s->batches += 1;
    for (int k = 0; k < 6; k++) s->sums[k] += means[k];
    if (target_kl > 0 && means[4] > 2 * target_kl) s->learning_rate = fmax(s->learning_rate / 1.5, 1e-6);
    else if (target_kl > 0 && means[4] < 0.5 * target_kl) s->learning_rate = fmin(s->learning_rate * 1.5, 1e-2);
}
