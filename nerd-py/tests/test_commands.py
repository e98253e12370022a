"""The command line behind functions, folders of models and policies, recordings, processes."""

import multiprocessing
import subprocess
import sys

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
    with pytest.raises(ValueError) as error:
        nerd.run("evaluate", robot="aunt")
    assert "aunt" in str(error.value) and "\n" not in str(error.value)


def test_models_and_policies_say_what_they_are(models):
    model = nerd.Model(models / "ant")
    assert (model.robot, model.reach) == ("ant", 1) and "articulated" in model.truth and len(model.sha256) == 64
    policy = nerd.Policy(models / "policies/ant-run-articulated-0")
    rows = np.zeros((3, policy.inputs))
    actions = policy(rows)
    assert policy.task == "ant-run" and actions.shape == (3, 8) and (actions == actions[0]).all()
    with pytest.raises(ValueError):
        policy(np.zeros((3, 1)))


def test_a_model_is_trained_evaluated_and_used(tmp_path):
    small = {"recipe": "quick", "transitions": 2000, "updates": 20, "rollouts": 0, "validation_windows": 64}
    model = nerd.train("pendulum", tmp_path / "run", **small)
    assert model.robot == "pendulum"
    tables = nerd.evaluate("pendulum", solver="neural", model=model, starts=4, frames=5, scene="free")
    assert tables and all(isinstance(rows, list) for rows in tables.values())
    simulation = nerd.Simulation("pendulum", n=3, solver=model)
    simulation.step(np.zeros((3, 2)))
    assert np.isfinite(simulation.states).all()


@pytest.mark.parametrize("robot", ["pendulum", "ant"])
def test_what_was_recorded_is_what_is_read(robot, tmp_path, models):
    """A recording of our own motion, read back: a model errs on it as little as on motion that it makes itself."""
    simulation, rows, rng = nerd.Simulation(robot, n=6, seed=3), 40, np.random.default_rng(0)
    joints = len(simulation.system.joints)
    states, tau = np.zeros((6, rows, simulation.states.shape[1])), rng.uniform(-0.3, 0.3, (6, rows, joints))
    for row in range(rows):
        states[:, row] = simulation.states
        simulation.step(tau[:, row].copy())
    scene = "ground" if robot == "ant" else "free"
    log = nerd.record(tmp_path / "log", simulation.system, states, tau, scene=scene)
    tables = nerd.run("evaluate", data=log, model=models / robot, frames=10)
    assert tables, "the recording was read"
    with pytest.raises(ValueError, match="needed"):
        nerd.record(tmp_path / "log", simulation.system, states[..., 1:], tau)


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
        "import nerd, numpy as np, sys\n"
        "s = nerd.Simulation('ant', n=256)\n"
        "t = np.zeros((256, 8))\n"
        "print('ready', flush=True)\n"
        "try:\n"
        "    while True: s.step(t)\n"
        "except KeyboardInterrupt:\n"
        "    print('ended', flush=True)\n"
    )
    import signal

    process = subprocess.Popen([sys.executable, "-c", program], cwd=root, stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "ready\n"
    process.send_signal(signal.SIGINT)
    assert process.stdout.readline() == "ended\n"
    assert process.wait(30) == 0
