"""Tasks with environments on a GPU, for learners with arrays on the same GPU."""

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from ._nerd import CardTask
from ._seeds import whole_seed


class CardVectorEnv(VectorEnv):
    """n environments of a task on a GPU, stepped together; no data pass through the host.

    Actions are float32 [n, action] on the GPU, from any library with DLPack, and are clamped to [-1, 1]. `step` returns
    arrays of `xp` (torch, jax.numpy, cupy): observations float32 [n, observation], rewards float32 [n], terminated and
    truncated bool [n]. They use the same memory in every step, so copy them to keep them. Ended episodes restart in the
    same step. infos["final_obs"] [n, observation] has the last observation of truncated episodes; its other rows equal
    the observations.

    Episodes are drawn as on the CPU, and computed in float32.
    """

    def __init__(self, num_envs=1, *, task, robot=None, solver="articulated", xp, family=None):
        self.metadata = {"autoreset_mode": AutoresetMode.SAME_STEP, "render_modes": []}
        self._task, self._xp = CardTask(task, robot, num_envs, solver, family), xp
        self._arrays = self._task.arrays()
        self.num_envs = num_envs
        box = lambda most, width: gymnasium.spaces.Box(-most, most, (width,), np.float32)
        self.single_observation_space, self.single_action_space = box(np.inf, self._task.observation), box(1.0, self._task.action)
        self.observation_space, self.action_space = (
            batch_space(space, num_envs) for space in (self.single_observation_space, self.single_action_space)
        )

    def reset(self, *, seed=None, options=None):
        """Begins the first episodes of a seed; without one, of a random seed. Returns observations [n, observation] and
        {}."""
        seed = whole_seed(seed, options)
        super().reset(seed=seed)
        self._task.reset(int(self.np_random.integers(2**63 - 1)) if seed is None else seed)
        return self._xp.from_dlpack(self._arrays[0]), {}

    def step(self, actions):
        self._task.step(actions)
        # Taking an array makes its stream wait for the step, and so until the step has read the actions.
        observations, rewards, terminated, truncated, final = map(self._xp.from_dlpack, self._arrays)
        return observations, rewards, terminated, truncated, {"final_obs": final}

    def failed(self):
        """Episodes ended by solver failures, without reward, since the last call. Waits for the GPU."""
        return self._task.failed()
