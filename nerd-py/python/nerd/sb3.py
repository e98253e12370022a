"""A task's environments as a Stable-Baselines3 VecEnv."""

import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.vec_env import VecEnv as _VecEnv

from .gym import make_vec


class VecEnv(_VecEnv):
    """n environments of a task, stepped together: VecEnv("ant-run", n=64), VecEnv("walk", robot="go2.xml", n=64); see
    nerd.make_vec.

    Observations and rewards are float32. It can be wrapped in VecMonitor and VecNormalize. `env` is the Gymnasium
    environment.
    """

    def __init__(self, task, robot=None, n=1, *, solver="articulated", family=None):
        self.env = make_vec(task, robot, n, solver=solver, family=family, autoreset_mode=AutoresetMode.SAME_STEP)
        box = lambda space: Box(np.float32(space.low), np.float32(space.high), dtype=np.float32)
        super().__init__(n, box(self.env.single_observation_space), box(self.env.single_action_space))

    def reset(self):
        observations, _ = self.env.reset(seed=self._seeds[0], options=self._options[0])
        self._reset_seeds()
        self._reset_options()
        return np.float32(observations)

    def step_async(self, actions):
        self._actions = np.float64(actions)

    def step_wait(self):
        observations, rewards, terminated, truncated, all_ = self.env.step(self._actions)
        infos = [{} for _ in range(self.num_envs)]
        ended = terminated | truncated
        for env in np.flatnonzero(ended):
            last = np.float32(all_["final_obs"][env])
            infos[env] = {"terminal_observation": last, "TimeLimit.truncated": bool(truncated[env])}
        return np.float32(observations), np.float32(rewards), ended, infos

    def close(self):
        self.env.close()

    def get_attr(self, attr_name, indices=None):
        return [getattr(self.env, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name, value, indices=None):
        raise AttributeError(f"{attr_name}: they step together and have nothing of their own; `env` is what they share")

    def env_method(self, method_name, *args, indices=None, **options):
        self.set_attr(method_name, None)

    def env_is_wrapped(self, wrapper_class, indices=None):
        return [False for _ in self._get_indices(indices)]
