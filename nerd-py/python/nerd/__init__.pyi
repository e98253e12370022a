from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray

Name = str | PathLike[str]
Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

class System:
    """A robot: a built-in name, or the path of a URDF, an MJCF (.xml) or a cable's TOML."""
    def __init__(self, name: Name) -> None: ...
    @property
    def name(self) -> str: ...
    @property
    def source(self) -> str: ...
    @property
    def frame_time(self) -> float:
        """One control frame (s)."""
    @property
    def nq(self) -> int: ...
    @property
    def nv(self) -> int: ...
    @property
    def joints(self) -> list[str]:
        """All joints, driven or not, in the order of torques."""
    @property
    def efforts(self) -> Floats:
        """[joints] (N m or N), infinite where the file gives none; torques that are given are not clipped to them."""
    @property
    def limits(self) -> Floats:
        """[joints, 2] (rad or m)."""
    @property
    def mass(self) -> float: ...
    @property
    def gravity(self) -> list[float]:
        """(m/s^2), by axis of the world: up is against it."""
    @property
    def default_state(self) -> Floats:
        """[nq + nv], at rest."""
    @property
    def links(self) -> list[str]: ...
    @property
    def frames(self) -> list[str]: ...
    @property
    def columns(self) -> list[str]:
        """Names of a state's numbers."""
    @property
    def scenes(self) -> list[str]: ...
    @property
    def data_scene(self) -> str:
        """The scene of a simulation where none is named."""
    @property
    def notes(self) -> list[str]: ...
    def mass_matrix(self, states: Floats) -> Floats:
        """M [n, nv, nv] for states [n, nq + nv], or [nv, nv] for one, in the order of qd."""
    def jacobian(self, name: str, states: Floats) -> Floats:
        """[n, 6, nv]: J qd is the angular velocity (rad/s) of a link or frame and that of its origin (m/s), world axes."""
    def inverse_dynamics(self, states: Floats, accelerations: Floats | None = None) -> Floats:
        """M qdd + h [n, nv] (N m or N) for the rates qdd [n, nv] of qd; without them h, the bias."""

class Simulation:
    """n environments of a system, and the solver that steps them."""
    def __init__(
        self,
        system: System | Name,
        scene: str | None = None,
        n: int = 1,
        solver: Name | None = None,
        device: str = "cpu",
        seed: int = 0,
        xp: ModuleType | None = None,
        vary: bool = False,
    ) -> None: ...
    def step(self, tau: Floats | Any) -> None:
        """One frame under torques [n, joints] (N m or N)."""
    def reset(self, mask: Bools | None = None, states: Floats | None = None) -> None: ...
    def swap(self, solver: Name) -> None: ...
    def drive(self, targets: Floats | float | None, kp: Floats | float | None = None, kd: Floats | float | None = None) -> None:
        """From now on kp (target - q) - kd qd at every joint, in each substep and within its effort; None: no more."""
    def poses(self, name: str) -> Floats:
        """[n, 7]: position (m), quaternion x y z w."""
    def velocities(self, name: str) -> Floats:
        """[n, 6]: angular (rad/s), linear (m/s), world axes."""
    def contact_forces(self, link: str) -> Floats:
        """[n, 3] (N), world axes, mean of the last frame."""
    @property
    def states(self) -> Floats | Any:
        """[n, nq + nv], the batch's own memory; nobody reads or writes it while another thread steps. On a card an array of `xp`."""
    @property
    def frames(self) -> NDArray[np.uint64]: ...
    @property
    def faults(self) -> list[tuple[int, int, str]]: ...
    @property
    def system(self) -> System: ...
    @property
    def n(self) -> int: ...
    def __len__(self) -> int: ...

class Task:
    """Episodes of a task in n environments, below make_vec."""
    def __init__(
        self,
        name: Name,
        robot: System | Name | None = None,
        n: int = 1,
        solver: Name = "articulated",
        device: str = "cpu",
        seed: int = 0,
        family: System | Name | None = None,
    ) -> None: ...
    def step(self, actions: Floats) -> tuple[Floats, Bools, Bools, Floats, Floats, Bools, Floats]: ...
    def observations(self) -> Floats: ...
    @property
    def states(self) -> Floats: ...
    def swap(self, solver: Name, device: str = "cpu") -> None: ...
    def reset(self, seed: int) -> None: ...
    def begin(self, mask: Bools, numbers: NDArray[np.uint64]) -> None: ...
    @property
    def numbers(self) -> NDArray[np.uint64]: ...
    @property
    def name(self) -> str: ...
    @property
    def terms(self) -> list[str]: ...
    @property
    def system(self) -> System: ...
    @property
    def n(self) -> int: ...
    @property
    def observation(self) -> int: ...
    @property
    def action(self) -> int: ...
    @property
    def steps(self) -> int: ...
    @property
    def frames(self) -> int: ...
    @staticmethod
    def names() -> list[str]: ...
    @staticmethod
    def general() -> list[str]: ...

class Model(PathLike[str]):
    """A trained model; it may stand wherever a solver is named."""
    def __init__(self, folder: Name) -> None: ...
    def __fspath__(self) -> str: ...
    @property
    def robot(self) -> str: ...
    @property
    def truth(self) -> str: ...
    @property
    def sha256(self) -> str: ...
    @property
    def parameters(self) -> int: ...
    @property
    def reach(self) -> int: ...

class Policy(PathLike[str]):
    """A trained policy."""
    def __init__(self, path: Name) -> None: ...
    def __fspath__(self) -> str: ...
    def __call__(self, rows: Floats) -> Floats:
        """Mean actions [n, action] for rows [n, inputs], [action] for one row [inputs]."""
    def play(
        self, n: int, seed: int = 0, solver: Name = "articulated", device: str = "cpu", family: System | Name | None = None
    ) -> tuple[Floats, Floats]:
        """Rewards and lengths [n]."""
    @property
    def task(self) -> str: ...
    @property
    def inputs(self) -> int: ...

def vjp(simulation: Simulation, states: Floats, tau: Floats, by_next: Floats | None = None) -> tuple[Floats, Floats, Floats]: ...
def linearise(simulation: Simulation, tau: Floats) -> tuple[Floats, Floats]: ...
def make_vec(
    task: Name,
    robot: System | Name | None = None,
    n: int = 1,
    *,
    solver: Name = "articulated",
    device: str = "cpu",
    autoreset_mode: AutoresetMode | str | None = None,
    xp: ModuleType | None = None,
    family: System | Name | None = None,
) -> VectorEnv: ...
def run(*verb: object, **options: object) -> Mapping[str, Any]: ...
def train(robot: Name | None = None, out: Name | None = None, **options: object) -> Model: ...
def train_policy(task: Name, out: Name, robot: Name | None = None, **options: object) -> Policy: ...
def evaluate(robot: Name | None = None, **options: object) -> Mapping[str, Any]: ...
def record(
    folder: Name,
    system: System | Name,
    states: Floats | Sequence[Any],
    tau: Floats | Sequence[Any],
    scene: str | None = None,
    about: str = "recorded",
) -> Path: ...
