"""The command line's verbs as functions. Each is a process of its own, so Ctrl-C ends it, and a run can be gone on with."""

import json
import os
import re
import subprocess
import sys
import tempfile
from collections import deque
from functools import partial
from pathlib import Path

from ._nerd import Model, Policy, System


# TOML text; JSON without surrogates is valid TOML.
_text = partial(json.dumps, ensure_ascii=False)


def _word(value):
    return os.fspath(value) if isinstance(value, os.PathLike) else str(value)


def run(*verb, **options):
    """A verb with its options, `run("evaluate", robot="ant", solver="neural")`; its tables, by name, each a list of rows.

    The first column has names. In another that holds nothing but numbers, `2.1` is a number, `1.2 / 3.4`, `1.2 +- 3.4` and
    `1.2 ± 3.4` are lists, and `-` and NaN are None. `starts=8` is `--starts 8`, `stream=True` is `--stream`, a list is joined by commas. What it tells goes to standard
    error.

    Raises ValueError with the one line that it was refused with.
    """
    return _run(verb, options)[0]


def _run(verb, options):
    """Its tables, and what it told last."""
    words = [_word(word) for word in verb]
    for name, value in options.items():
        if value is None or value is False:
            continue
        words.append("--" + name.replace("_", "-"))
        if value is not True:
            words.append(",".join(map(_word, value)) if isinstance(value, (list, tuple)) else _word(value))
    command = [sys.executable, "-m", "nerd", *words, "--json"]
    told = deque(maxlen=20)
    with tempfile.TemporaryFile("w+", encoding="utf-8") as out:
        with subprocess.Popen(command, stdout=out, stderr=subprocess.PIPE, encoding="utf-8") as process:
            try:
                for line in process.stderr:
                    told.append(line)
                    if not line.startswith("error: "):
                        sys.stderr.write(line)
                process.wait()
            except BaseException:
                # An interrupt here leaves no process that goes on writing.
                process.terminate()
                process.wait()
                raise
        out.seek(0)
        said = out.read()
    if process.returncode:
        refused = [line.removeprefix("error: ").strip() for line in told if line.startswith("error: ")]
        raise ValueError(_named(refused[-1]) if refused else f"{' '.join(words)} ended with {process.returncode}: {''.join(told)}")
    if options.get("help"):
        print(said)
        return {}, told
    return json.loads(said) if said.strip() else {}, told


def _named(line):
    """A line that speaks of options as they are called here."""
    option = r"--(?!help)([a-z]+(?:-[a-z]+)*)(?: <[A-Z-]+>)?"
    return re.sub(option, lambda found: found[1].replace("-", "_") + "=", line.replace("cargo xtask", "python -m nerd"))


def train(robot=None, out=None, **options):
    """Trains a model of a robot, or from `data=`, or goes on with the run of a folder; see `python -m nerd train --help`. The model.

    Raises RuntimeError where `minutes=` were over before it was done: the same call goes on.
    """
    _, told = _run(["train"], {"robot": robot, "out": out, **options})
    stopped = [line for line in told if line.startswith("stopped at update")]
    if stopped:
        raise RuntimeError(_named(stopped[-1].strip()))
    return Model(Path(out) / "model")


def train_policy(task, out, robot=None, **options):
    """Trains a policy, or goes on with the run of a folder; see `python -m nerd policy train --help`. The policy."""
    run("policy", "train", task, robot=robot, out=out, **options)
    return Policy(Path(out) / "policy")


def evaluate(robot=None, **options):
    """How far a solver, a Model too, drifts from the truth; see `python -m nerd evaluate --help`. Tables as of `run`."""
    if isinstance(options.get("solver"), Model):
        options["model"], options["solver"] = options["solver"], "neural"
    return run("evaluate", robot=robot, **options)


def record(folder, system, states, tau, scene=None, about="recorded"):
    """Writes trajectories as a recording, which `train(data=)`, `evaluate(data=)` and `calibrate` read: `folder`/log.toml and arrays.

    states: float64 [trajectories, rows, nq + nv], one row a frame; tau: float64 [trajectories, rows, joints], each held from its row
    to the next. The last row's says nothing. system: a System or the name or path of one. scene: a name; None is the one that a
    Simulation has without a name.
    """
    import numpy as np

    system = system if isinstance(system, System) else System(system)
    nq, nv, joints = system.nq, system.nv, len(system.joints)
    states, tau = np.asarray(states, np.float64), np.asarray(tau, np.float64)
    if states.ndim != 3 or states.shape[2] != nq + nv or tau.shape != (*states.shape[:2], joints):
        raise ValueError(f"states {states.shape} and tau {tau.shape}: [trajectories, rows, {nq + nv}] and [.., .., {joints}] are needed")
    if not (np.isfinite(states).all() and np.isfinite(tau[:, :-1]).all()):
        raise ValueError("states and tau: all numbers are finite, but for the last torques of a trajectory")
    q, qd, free = states[..., :nq], states[..., nq:], nq - joints
    arrays = {"position": q[..., free:], "velocity": qd[..., nv - joints :], "torque": tau}
    lines = [f"about = {_text(about)}", 'file = "log.npz"', f"robot = {_text(system.source)}"]
    lines.append(f"scene = {_text(system.data_scene if scene is None else scene)}")
    if free:
        # A state has the twist about the world's origin, a log the velocity of the root's origin.
        arrays["root"] = q[..., :7]
        arrays["root_velocity"] = qd[..., 3:6] + np.cross(qd[..., :3], q[..., :3])
        arrays["root_angular"] = qd[..., :3]
        names = lambda array, of: _text([f"{array}.{k}" for k in of])
        lines += ["[root]", f"position = {names('root', range(3))}", f"quaternion = {names('root', range(3, 7))}", 'order = "xyzw"']
        lines += [f"velocity = {names('root_velocity', range(3))}", f"angular = {names('root_angular', range(3))}", 'axes = "world"']
    for k, joint in enumerate(system.joints):
        lines += ["[[joint]]", f"name = {_text(joint)}"]
        lines += [f'position = "position.{k}"', f'velocity = "velocity.{k}"', f'torque = "torque.{k}"']
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(folder / "log.npz", **arrays)
    (folder / "log.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return folder / "log.toml"
