"""The command line's verbs as functions. Each runs in its own process, so Ctrl-C ends it, and a run can be resumed."""

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
    """Runs a verb, as in `run("evaluate", robot="ant", solver="neural")`; returns tables by name, each a list of rows.

    `trajectories=8` is `--trajectories 8`, `stream=True` is `--stream`, and a list is joined by commas. Messages go to standard
    error. A row maps columns to cells. The first column holds names. In a column of numbers alone, `2.1` is a number;
    `1.2 / 3.4`, `1.2 +- 3.4` and `1.2 ± 3.4` are lists; `-` and NaN are None.

    Raises ValueError with the command's error in one line.
    """
    return _run(verb, options)[0]


def _run(verb, options):
    """Its tables, and its last lines on standard error."""
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
                        sys.stderr.write(_named(line) if line.startswith("note: `--") else line)
                process.wait()
            except BaseException:
                # An interrupt must not leave a process that still writes.
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
    """A line with options in Python's notation."""
    option = r"--(?!help)([a-z]+(?:-[a-z]+)*)(?: <[^>]+>)?"
    return re.sub(option, lambda found: found[1].replace("-", "_") + "=", line.replace("cargo xtask", "python -m nerd"))


def train(robot=None, out=None, **options):
    """Trains a model of a robot, or from `data=`, or resumes the run in a folder; see `python -m nerd train --help`.
    Returns the Model.

    Raises RuntimeError if `minutes=` ran out before the end: the same call resumes. Raises ValueError as `run` does.
    """
    _, told = _run(["train"], {"robot": robot, "out": out, **options})
    stopped = [line for line in told if line.startswith("stopped at update")]
    if stopped:
        raise RuntimeError(_named(stopped[-1].strip()))
    return Model(Path(out) / "model")


def train_policy(task, out, robot=None, **options):
    """Trains a policy, or resumes the run in a folder; see `python -m nerd policy train --help`. Returns the Policy."""
    run("policy", "train", task, robot=robot, out=out, **options)
    return Policy(Path(out) / "policy")


def evaluate(robot=None, **options):
    """Measures the drift of a solver or a Model from the truth; see `python -m nerd evaluate --help`. Returns tables as
    `run` does."""
    if isinstance(options.get("solver"), Model):
        options["model"], options["solver"] = options["solver"], "neural"
    return run("evaluate", robot=robot, **options)


def record(folder, system, states, tau, scene=None, about="recorded"):
    """Writes trajectories as a recording, `folder`/log.toml with arrays, for `train(data=)`, `evaluate(data=)` and
    `calibrate`.

    states: float64 [trajectories, rows, nq + nv], one row a frame; tau: float64 [trajectories, rows, joints] (N m or
    N), each held from its row to the next. The last row's tau is unused. system: a System, or its name or path. scene:
    a name; None means the default scene of a Simulation. Returns the path of log.toml.

    Raises ValueError for other shapes, or for numbers that are not finite.
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
        arrays["root_ang_vel"] = qd[..., :3]
        names = lambda array, of: _text([f"{array}.{k}" for k in of])
        lines += ["[root]", f"position = {names('root', range(3))}", f"quaternion = {names('root', range(3, 7))}", 'order = "xyzw"']
        lines += [f"velocity = {names('root_velocity', range(3))}", f"ang_vel = {names('root_ang_vel', range(3))}", 'axes = "world"']
    for k, joint in enumerate(system.joints):
        lines += ["[[joint]]", f"name = {_text(joint)}"]
        lines += [f'position = "position.{k}"', f'velocity = "velocity.{k}"', f'torque = "torque.{k}"']
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(folder / "log.npz", **arrays)
    (folder / "log.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return folder / "log.toml"
