"""Tasks as Gymnasium environments, single (`gymnasium.make("nerd/AntRun-v0")`) or n at once (`nerd.make_vec`)."""

import os

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from ._nerd import System, Task
from ._seeds import whole_seed


def make_vec(task, robot=None, n=1, *, solver="articulated", device="cpu", autoreset_mode=None, xp=None, family=None):
    """n environments of a task: "ant-run", or "walk" with robot="go2.xml", or the path of a task's .toml.

    solver: "articulated", "rapier", "neural" or the path of a model's folder. autoreset_mode: Gymnasium's
    AutoresetMode; the default is NEXT_STEP. family: a robot whose TOML has [vary]; each environment draws its own
    robot. device="cuda" with xp=torch, or another array library, keeps observations, actions and rewards on a GPU
    (nerd.card), with SAME_STEP.

    Raises TypeError or ValueError for arguments that do not fit.
    """
    if str(task).startswith("nerd/"):
        task = gymnasium.spec(task).kwargs["task"]
    of = {"task": task, "robot": robot, "solver": solver, "family": family}
    return _vector(num_envs=n, device=device, autoreset_mode=autoreset_mode, xp=xp, **of)


def _vector(num_envs=1, *, device="cpu", autoreset_mode=None, xp=None, **of):
    if isinstance(num_envs, bool) or not isinstance(num_envs, (int, np.integer)) or abs(num_envs) >= 2**63:
        raise TypeError(f"n={num_envs!r}: a whole number of environments is needed")
    for name, value in ((name, of[name]) for name in ("task", "robot", "solver", "family") if name in of):
        kinds = (str, os.PathLike, System, type(None)) if name in ("robot", "family") else (str, os.PathLike)
        if not isinstance(value, kinds):
            raise TypeError(f"{name}: a name or a path is needed, not {type(value).__name__}")
    if autoreset_mode is not None and autoreset_mode not in [*AutoresetMode, *(mode.value for mode in AutoresetMode)]:
        raise ValueError(f"autoreset_mode={autoreset_mode!r}: choose from {', '.join(map(str, AutoresetMode))}")
    if device == "cpu" and xp is None:
        return TaskVectorEnv(num_envs, autoreset_mode=autoreset_mode or AutoresetMode.NEXT_STEP, **of)
    if device != "cuda" or xp is None:
        raise ValueError(f"device={device!r}, xp={xp}: on the CPU there is no xp, on \"cuda\" it names the library of arrays, as in xp=torch")
    if autoreset_mode is not None and AutoresetMode(autoreset_mode) != AutoresetMode.SAME_STEP:
        raise ValueError(f"autoreset_mode={autoreset_mode}: on a card ended episodes restart in the same step")
    try:
        from .card import CardVectorEnv
    except ImportError as missing:
        raise ValueError('device="cuda": this package was built without it; build it with `--features cuda`') from missing
    return CardVectorEnv(num_envs, xp=xp, **of)


_RENDER = "render_mode: there is none; `python -m nerd policy show` writes an episode as a page"


def _spaces(task):
    box = lambda most, width: gymnasium.spaces.Box(-most, most, (width,), np.float64)
    return box(np.inf, task.observation), box(1.0, task.action)


class _Tasks:
    """Common parts of a task's environments."""

    @property
    def task(self):
        """The task: nerd.Task."""
        return self._task

    @property
    def system(self):
        """The robot: nerd.System."""
        return self._task.system

    @property
    def states(self):
        """A copy of the present states, float64 [n, nq + nv]; after a restart in the same step, the new starts."""
        return self._task.states

    def swap(self, solver):
        """Continues with another solver from the same states."""
        self._task.swap(solver)

    def render(self):
        raise NotImplementedError(_RENDER)

    # With a seed, begins its first episodes, as on the command line; otherwise the next ones.
    def _restart(self, seed, mask):
        if seed is None and not self._began:
            seed = int(self.np_random.integers(2**63 - 1))
        if seed is not None:
            self._task.reset(seed)
        else:
            # An ended environment is already at the start of its next episode, which has not been returned yet.
            self._task.begin(mask & ~self._fresh, self._task.numbers + 1)
        self._began = True
        self._fresh[mask] = False


class TaskVectorEnv(_Tasks, VectorEnv):
    """n environments of a task, stepped together.

    Observations are float64 [n, observation]; actions are float64 [n, action], clamped to [-1, 1]. `reset(seed=)` takes
    one integer for all environments: environment i then runs the same episodes as on the command line with `--seed`. In
    infos, `error` is the error of a step in units of the task's tolerance, if the task defines one. `terms` has the
    reward terms by name. `fault` is true where the solver failed: the episode ended, with reward 0.
    """

    def __init__(self, num_envs=1, *, task, robot=None, solver="articulated", autoreset_mode=AutoresetMode.NEXT_STEP, family=None):
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.metadata = {"autoreset_mode": self.autoreset_mode, "render_modes": []}
        self._task = Task(task, robot, num_envs, solver, family=family)
        self._names, self.num_envs = self._task.terms, num_envs
        self.single_observation_space, self.single_action_space = _spaces(self._task)
        self.observation_space, self.action_space = (
            batch_space(space, num_envs) for space in (self.single_observation_space, self.single_action_space)
        )
        self._began = False
        self._fresh = np.zeros(num_envs, bool)
        self._ended = np.zeros(num_envs, bool)

    def reset(self, *, seed=None, options=None):
        seed = whole_seed(seed, options, "reset_mask")
        super().reset(seed=seed)
        mask = (options or {}).get("reset_mask")
        if mask is None:
            mask = np.ones(self.num_envs, bool)
        elif seed is not None:
            raise ValueError("a seed is of all environments: leave reset_mask out")
        if not isinstance(mask, np.ndarray) or mask.dtype != bool or mask.shape != (self.num_envs,) or not mask.any():
            raise ValueError(f"reset_mask: a numpy array of bool [{self.num_envs}] is needed, true somewhere")
        self._restart(seed, mask)
        self._ended[mask] = False
        return self._task.observations(), {}

    def step(self, actions):
        held = self._ended.copy()
        mode = self.autoreset_mode
        if not self._began:
            raise gymnasium.error.ResetNeeded("reset() comes before the first step")
        if held.any() and mode == AutoresetMode.DISABLED:
            ended = f"{held.sum()} of {self.num_envs} environments ended"
            raise gymnasium.error.ResetNeeded(f"{ended}: reset(options={{'reset_mask': mask}}) comes before the next step")
        actions = np.array(actions, np.float64)
        numbers = self._task.numbers
        if held.any() and actions.shape == (self.num_envs, self._task.action):
            actions[held] = 0.0
        rewards, terminated, truncated, observations, errors, faults, terms = self._task.step(actions)
        if held.any():
            # All environments step together; those that only restart in this step restart again.
            self._task.begin(held, numbers)
            observations[held] = self._task.observations()[held]
            rewards[held], terminated[held], truncated[held], errors[held], faults[held] = 0.0, False, False, np.nan, False
            terms[held] = 0.0
        ended = terminated | truncated
        infos = {}
        if np.isfinite(errors).any():
            infos["error"], infos["_error"] = errors, np.isfinite(errors)
        if self._names:
            infos["terms"] = dict(zip(self._names, terms.T))
        if faults.any():
            infos["fault"] = infos["_fault"] = faults
        self._fresh, self._ended = ended.copy(), ended
        if mode == AutoresetMode.SAME_STEP:
            if ended.any():
                final = np.full(self.num_envs, None, object)
                for env in np.flatnonzero(ended):
                    final[env] = observations[env]
                infos.update(final_obs=final, _final_obs=ended.copy(), final_info={}, _final_info=ended.copy())
            observations = self._task.observations()
            self._fresh, self._ended = np.zeros((2, self.num_envs), bool)
        return observations, rewards, terminated, truncated, infos


class TaskEnv(_Tasks, gymnasium.Env):
    """One environment of a task: observations float64 [observation], actions float64 [action], clamped to [-1, 1]."""

    metadata = {"render_modes": []}

    def __init__(self, task, robot=None, solver="articulated", device="cpu", render_mode=None, family=None):
        if render_mode is not None:
            # After a TypeError, Stable-Baselines3 tries again without render_mode.
            raise TypeError(_RENDER)
        self.render_mode = None
        self._task = Task(task, robot, 1, solver, device, family=family)
        self._names = self._task.terms
        self.observation_space, self.action_space = _spaces(self._task)
        self._began = False
        self._fresh = np.zeros(1, bool)

    def reset(self, *, seed=None, options=None):
        seed = whole_seed(seed, options)
        super().reset(seed=seed)
        self._restart(seed, np.ones(1, bool))
        return self._task.observations()[0], {}

    def step(self, action):
        if not self._began or self._fresh[0]:
            raise gymnasium.error.ResetNeeded("the episode ended, or none began: reset() comes before the next step")
        rewards, terminated, truncated, observations, errors, faults, terms = self._task.step(np.array(action, np.float64)[None])
        self._fresh[:] = terminated | truncated
        info = {"error": float(errors[0])} if np.isfinite(errors[0]) else {}
        info.update({"fault": True} if faults[0] else {})
        info.update({"terms": dict(zip(self._names, terms[0].tolist()))} if self._names else {})
        return observations[0], float(rewards[0]), bool(terminated[0]), bool(truncated[0]), info


def register():
    """Registers `nerd/AntRun-v0` and so on: one for each built-in task. Tasks for any robot, such as `nerd/Walk-v0`,
    need robot=."""
    for task in [*Task.names(), *Task.general()]:
        name = "".join(part.capitalize() for part in task.split("-"))
        gymnasium.register(
            f"nerd/{name}-v0", entry_point="nerd.gym:TaskEnv", vector_entry_point="nerd.gym:_vector", kwargs={"task": task}
        )
