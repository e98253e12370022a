"""The command line behind functions, folders of models and policies, recordings, processes."""

import multiprocessing
import os
import signal
import subprocess
import sys
import types

import nerd
import numpy as np
import pytest


def test_the_command_line_is_the_module(root):
    said = subprocess.run([sys.executable, "-m", "nerd", "list", "robots"], cwd=root, capture_output=True, text=True, check=True)
    assert "| ant " in said.stdout
    rows = nerd.run("list", "robots")["robots"]
    assert any("ant" in row.values() for row in rows)
    wrong = subprocess.run([sys.executable, "-m", "nerd", "list", "nothing"], cwd=root, capture_output=True, text=True)
    assert wrong.returncode == 2 and wrong.stderr.count("\n") == 1 and wrong.stderr.startswith("error: ")
    private = subprocess.run([sys.executable, "-m", "nerd", "chart"], cwd=root, capture_output=True, text=True)
    assert private.returncode == 2 and private.stderr.count("\n") == 1 and "a checkout of the project alone" in private.stderr
    with pytest.raises(ValueError) as error:
        nerd.run("evaluate", robot="aunt")
    assert "aunt" in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize(
    "solver",
    ["articulated", "articulated(substeps=4)", "articulated(method=euler, substeps=64)", "rapier", "rapier(steps=1, axes=world)", "neural(models/ant)"],
)
def test_a_solver_steps_as_the_command_line_does_to_the_bit(solver, root, tmp_path):
    simulation = nerd.Simulation("ant", "ground", solver=solver)
    state, columns = simulation.states[0].tolist(), nerd.System("ant").columns
    (tmp_path / "start.csv").write_text(f"traj,step,{','.join(columns)}\n0,0,{','.join(map(repr, state))}\n")
    words = ["rollout", "--robot", "ant", "--scene", "ground", "--frames", "50", "--solver", solver]
    out = tmp_path / "out.csv"
    files = ["--states", tmp_path / "start.csv", "--out", out]
    subprocess.run([sys.executable, "-m", "nerd", *words, *files], cwd=root, check=True, capture_output=True)
    for _ in range(50):
        simulation.step(np.zeros((1, 8)))
    last = [float(x) for x in out.read_text().splitlines()[-1].split(",")[2:]]
    assert simulation.states[0].tolist() == last != state


def test_models_and_policies_say_what_they_are(models):
    model = nerd.Model("models/ant")
    assert os.fspath(model) == str(models / "ant")
    assert (model.robot, model.reach) == ("ant", 1) and "articulated" in model.truth and len(model.sha256) == 64
    policy = nerd.Policy(models / "policies/ant-run-articulated-0")
    rows = np.zeros((3, policy.inputs))
    actions = policy(rows)
    assert policy.task == "ant-run" and actions.shape == (3, 8) and (actions == actions[0]).all() and (policy(rows[0]) == actions[0]).all()
    with pytest.raises(ValueError):
        policy(np.zeros((3, 1)))


def test_a_model_is_trained_evaluated_and_used(tmp_path):
    small = {"recipe": "quick", "transitions": 2000, "updates": 20, "rollouts": 0, "validation_windows": 64}
    with pytest.raises(RuntimeError, match="^stopped at update"):
        nerd.train("pendulum", tmp_path / "run", minutes=0.001, **small | {"updates": 10**6})
    model = nerd.train("pendulum", tmp_path / "done", **small)
    assert model.robot == "pendulum"
    assert "python -m nerd train --robot pendulum" in (tmp_path / "done/model/config.json").read_text(encoding="utf-8")
    tables = nerd.evaluate("pendulum", solver=model, trajectories=4, frames=5, scene="free")
    [row] = tables["passive"]
    assert row["robot"] == "pendulum" and 0 <= row["diverged"] <= 4 and row["paper"] is None, row
    assert len(row["error (rad or m)"]) == 2 and all(0 < error < 1 for error in row["error (rad or m)"]), row
    simulation = nerd.Simulation("pendulum", n=3, solver=model)
    simulation.step(np.zeros((3, 2)))
    assert np.isfinite(simulation.states).all()


def test_names_stay_text_and_columns_of_numbers_are_numbers(tmp_path):
    nerd.train_policy("cartpole-swingup", tmp_path / "007", envs=2, horizon=8, minibatch=16, iterations=1)
    played = nerd.run("policy", "evaluate", policy=tmp_path / "007/policy", episodes=2, truth_only=True, name="played", out=tmp_path)
    [row] = played["policies"]
    assert (row["task"], row["policy"], row["games"], row["gap (%)"]) == ("cartpole-swingup", "007", 2.0, None), row
    assert len(row["reward in truth"]) == 2 and all(isinstance(x, float) for x in row["reward in truth"]), row


def test_an_interrupted_verb_leaves_no_process(tmp_path, monkeypatch):
    started = []

    class Kept(subprocess.Popen):
        def __init__(self, *args, **options):
            super().__init__(*args, **options)
            started.append(self)

    def interrupt(_line):
        raise KeyboardInterrupt

    monkeypatch.setattr(subprocess, "Popen", Kept)
    monkeypatch.setattr(sys, "stderr", types.SimpleNamespace(write=interrupt))
    with pytest.raises(KeyboardInterrupt):
        nerd.train("pendulum", tmp_path / "run", recipe="quick", transitions=2000, updates=10**6)
    [process] = started
    assert process.returncode == 128 + signal.SIGTERM


@pytest.mark.parametrize("robot", ["pendulum", "ant"])
def test_what_was_recorded_is_what_is_read(robot, tmp_path, models):
    """On a recording of a solver's motion that solver errs by rounding alone, and a model of it by little; and its scene is named."""
    simulation, rows, rng = nerd.Simulation(robot, n=6, seed=3), 40, np.random.default_rng(0)
    joints = len(simulation.system.joints)
    states, tau = np.zeros((6, rows, simulation.states.shape[1])), rng.uniform(-0.3, 0.3, (6, rows, joints))
    for row in range(rows):
        states[:, row] = simulation.states
        simulation.step(tau[:, row].copy())
    log = nerd.record(tmp_path / "log", simulation.system, states, tau, about="Zürich 😀")
    said = log.read_text(encoding="utf-8")
    assert f'scene = "{simulation.system.data_scene}"' in said and 'about = "Zürich 😀"' in said
    rows = nerd.run("evaluate", data=log, model=models / robot, frames=10)["verdict"]
    errors = {row["solver"]: max(row["error"]) for row in rows}
    # The model's errors are 0.0001 and 0.0005; holding still has errors of 0.1 and more.
    assert errors["articulated, as described"] < 1e-9 < errors["model"] < 2e-3, errors
    with pytest.raises(ValueError, match="needed"):
        nerd.record(tmp_path / "log", simulation.system, states[..., 1:], tau)


def test_a_recording_names_the_scene_that_a_simulation_has(tmp_path):
    """Of a robot of which only its file is known, which stands on a plane: the reader by itself would take free space."""
    file = tmp_path / "box.xml"
    file.write_text(
        '<mujoco><worldbody><body name="torso" pos="0 0 1"><freejoint/><geom type="box" size=".1 .1 .1" mass="1"/>'
        '<body name="leg" pos="0 0 -.1"><joint name="hip" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0 0 -.2" size=".02" mass=".1"/>'
        '</body></body></worldbody><actuator><motor joint="hip"/></actuator></mujoco>'
    )
    simulation = nerd.Simulation(file)
    for _ in range(200):
        simulation.step(np.zeros((1, 1)))
    assert sum(simulation.contact_forces(link)[0, 2] for link in simulation.system.links) > 1.0, "it is borne"
    log = nerd.record(tmp_path / "log", simulation.system, np.zeros((1, 2, simulation.states.shape[1])), np.zeros((1, 2, 1)))
    assert simulation.system.data_scene == "plane" and 'scene = "plane"' in log.read_text(encoding="utf-8")


def stepped(n, answers):
    try:
        simulation = nerd.Simulation("ant", n=n)
        simulation.step(np.zeros((n, 8)))
        answers.put("stepped")
    except RuntimeError as error:
        answers.put(str(error))


@pytest.mark.parametrize("method, answer", [("fork", "spawn"), ("spawn", "stepped")])
def test_a_process_steps_or_says_why_not(method, answer):
    nerd.Simulation("ant", n=200).step(np.zeros((200, 8)))
    context = multiprocessing.get_context(method)
    answers = context.Queue()
    process = context.Process(target=stepped, args=(200, answers))
    process.start()
    assert answer in answers.get(timeout=60)
    process.join(60)


def test_ctrl_c_ends_a_loop_of_steps(root):
    program = (
        "import nerd, numpy as np, signal\n"
        # A shell's background processes ignore it.
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "s = nerd.Simulation('ant', n=256)\n"
        "t = np.zeros((256, 8))\n"
        "try:\n"
        "    print('ready', flush=True)\n"
        "    while True: s.step(t)\n"
        "except KeyboardInterrupt:\n"
        "    print('ended', flush=True)\n"
    )
    process = subprocess.Popen([sys.executable, "-c", program], cwd=root, stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "ready\n"
    process.send_signal(signal.SIGINT)
    assert process.stdout.readline() == "ended\n"
    assert process.wait(30) == 0
