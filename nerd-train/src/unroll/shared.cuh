// Declarations for the kernels of all systems.

// Row of a rollout as the host writes it: motion, first frame of the update, whether the rollout restarts, and view.
struct View { double mirror, sine, cosine, yaw; };
struct Rollout { double motion, frame, anew; View view; };

// Motions of `frames` frames: states `[motion][frames + 1]`, torques `[motion][frames]`, scenes.
struct Motions { const double *truths, *torques, *scenes; int frames; };

#define KERNEL extern "C" __global__ void
#define WORLD const Rollout* rollouts, const double* truths, const double* torques, const double* scenes, int frames
#define MOTIONS(env) const Rollout& r = rollouts[env]; const Motions m = {truths, torques, scenes, frames};

// `weight p(e / unit)` with the pseudo-Huber loss p, and its gradient.
FN double bent(double e, double unit, double weight, double& gradient) {
    e /= unit;
    const double length = sqrt(1 + e * e);
    gradient = weight * e / (length * unit);
    return weight * (length - 1);
}
