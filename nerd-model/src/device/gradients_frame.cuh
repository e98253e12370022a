// Kernels of a frame and its adjoint, one thread per environment. States are `[env][STATE]`, torques `[env][NJ]`.
// Gradients with respect to next states, and with respect to states and torques, are `[env][rows]`; a launch computes
// row `row`. `gradients_look` writes tokens of `n` states, frame by frame, with `envs` environments in each frame.

#define EACH                                                   \
    const int env = blockIdx.x * blockDim.x + threadIdx.x;     \
    if (env >= n) return;                                      \
    const double* state = states + (long long)env * STATE;
#define KERNEL extern "C" __global__ void

KERNEL gradients_look(const double* states, const double* torques, const double* scenes, const int* scene_of,
                      float* tokens, int n, int envs) {
    EACH
    tell(state, torques + (long long)env * NJ, scenes + (long long)scene_of[env % envs] * SCENE,
         tokens + (long long)env * LDX);
}

KERNEL gradients_said(const double* states, const float* said, const double* grad_next, double* next, float* by_said,
                      int rows, int row, int n) {
    EACH
    const float* own = said + (long long)env * STATE;
    if (row == 0 && next) advance(state, own, next + (long long)env * STATE);
    said_back(state, own, grad_next + ((long long)env * rows + row) * 2 * NV, by_said + (long long)env * STATE);
}

KERNEL gradients_back(const double* states, const double* scenes, const int* scene_of, const float* said,
                      const float* by_tokens, const double* grad_next, double* gradients, double* by_torques, int rows,
                      int row, int n) {
    EACH
    const long long at = (long long)env * rows + row;
    const float* by_token = by_tokens + (long long)env * INPUTS;
    // `grad_next` and `gradients` may share memory, so the part read here is copied first.
    double behind[2 * NV];
    for (int i = 0; i < 2 * NV; i++) behind[i] = grad_next[at * 2 * NV + i];
    frame_back(state, scenes + (long long)scene_of[env] * SCENE, said + (long long)env * STATE, by_token, behind,
               gradients + at * 2 * NV);
    for (int i = 0; i < NJ; i++) by_torques[at * NJ + i] = by_token[TORQUES + i] / SCALE[TORQUES + i];
}
