"""A robot simulator: thousands of robots of any URDF or MJCF, stepped by equations or by a network trained on them.

    import numpy, nerd

    simulation = nerd.Simulation("ant", n=1024)
    for _ in range(100):
        simulation.step(numpy.random.uniform(-1, 1, (1024, 8)))
    print(simulation.states[:, :3].mean(0))
"""

import copyreg
import os

from ._nerd import Model, Policy, Simulation, System, Task, linearise, vjp
from .commands import evaluate, record, run, train, train_policy

__all__ = [
    "Model",
    "Policy",
    "Simulation",
    "System",
    "Task",
    "evaluate",
    "linearise",
    "make_vec",
    "record",
    "run",
    "train",
    "train_policy",
    "vjp",
]

# A copy is read from the same file.
copyreg.pickle(System, lambda one: (System, (one.source,)))
copyreg.pickle(Model, lambda one: (Model, (os.fspath(one),)))
copyreg.pickle(Policy, lambda one: (Policy, (os.fspath(one),)))

try:
    from .gym import make_vec, register
except ModuleNotFoundError as missing:
    if missing.name != "gymnasium":
        raise

    def make_vec(*_args, **_kwargs):
        """Raises ModuleNotFoundError: make_vec needs Gymnasium."""
        raise ModuleNotFoundError('make_vec needs Gymnasium: pip install "nerd[gym]"')

else:
    register()
