"""Simulations: arrays without copies, names, refusals in one line, threads."""

import copy
import pickle
import sys
import threading
import time

import nerd
import numpy as np
import pytest


def driven(simulation, frames, seed=0):
    rng = np.random.default_rng(seed)
    shape = (simulation.n, len(simulation.system.joints))
    for _ in range(frames):
        simulation.step(rng.uniform(-1.0, 1.0, shape))
    return simulation


def line(error):
    """The one line of a refusal."""
    text = str(error.value)
    assert text and "\n" not in text, text
    return text


def test_a_system_says_what_its_numbers_are():
    ant = nerd.System("ant")
    assert (ant.nq, ant.nv, len(ant.joints)) == (15, 14, 8)
    assert len(ant.columns) == ant.nq + ant.nv and ant.columns[:3] == ["px", "py", "pz"]
    assert {"ground", "plane", "hills"} < set(ant.scenes) and ant.gravity[1] < 0 and ant.mass > 0
    assert all(nerd.Simulation(ant, scene=scene).n for scene in ant.scenes)
    assert ant.limits.shape == (8, 2) and ant.default_state.shape == (29,) and ant.efforts.shape == (8,)
    assert "torso" in ant.links and ant.frame_time > 0
    assert ant.source == "ant" and "nq=15" in repr(ant)


def test_systems_are_read_from_files(tmp_path, monkeypatch):
    file = tmp_path / "two.urdf"
    inertial = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    file.write_text(
        f'<robot name="two"><link name="base"/><link name="arm">{inertial}</link><joint name="hinge" type="continuous">'
        '<parent link="base"/><child link="arm"/><axis xyz="0 1 0"/></joint></robot>'
    )
    for name in (file, str(file)):
        system = nerd.System(name)
        assert system.joints == ["hinge"] and system.source == str(file)
    # Only a file's path is made absolute, not a name that matches a built-in robot.
    monkeypatch.chdir(tmp_path)
    (tmp_path / "ant").mkdir()
    assert nerd.System("two.urdf").source == str(file) and nerd.System("ant").source == "ant"
    hinge = nerd.Simulation(system, n=2)
    hinge.reset(states=np.zeros(2))
    hinge.step(np.array([[1.0], [0.0]]))
    assert hinge.states[0, 1] == pytest.approx(system.frame_time, rel=1e-6), "a unit torque on a unit inertia"
    assert (hinge.states[1] == 0).all()


@pytest.mark.parametrize("solver", ["articulated", "rapier", "neural"])
def test_states_are_the_memory_that_is_stepped(solver, models):
    simulation = nerd.Simulation("ant", n=40, solver=models / "ant" if solver == "neural" else solver)
    states = simulation.states
    address, before = states.ctypes.data, states.copy()
    assert states.shape == (40, 29) and states.dtype == np.float64 and not states.flags.owndata
    driven(simulation, 3)
    assert simulation.states.ctypes.data == address and (states != before).any(axis=1).all()
    states[:, 2] = 5.0
    assert (simulation.poses("torso")[:, 2] == 5.0).all(), "what is written is what is there"
    assert (simulation.frames == 3).all()


def test_states_outlive_their_simulation():
    states = driven(nerd.Simulation("pendulum", n=1000), 2).states
    kept = states.copy()
    others = [nerd.Simulation("pendulum", n=1000) for _ in range(20)]
    assert len(others) == 20 and (states == kept).all()
    counted = sys.getrefcount(states.base)
    view = states[3:]
    assert view.base is states or sys.getrefcount(states.base) > counted


def test_same_seed_same_numbers_and_reset_begins_where_it_is_told():
    one, two, other = (driven(nerd.Simulation("ant", n=9, seed=seed), 20) for seed in (4, 4, 5))
    assert (one.states == two.states).all() and (one.states != other.states).any()
    mask = np.zeros(9, bool)
    mask[[2, 7]] = True
    before = one.states.copy()
    one.reset(mask)
    assert (one.states[~mask] == before[~mask]).all() and (one.states[mask] != before[mask]).any(axis=1).all()
    assert (one.frames == np.where(mask, 0, 20)).all()
    one.reset(mask, before[0])
    assert (one.states[mask] == before[0]).all()


def test_a_swapped_solver_goes_on_from_the_same_state(models):
    simulation = driven(nerd.Simulation("pendulum", n=4), 5)
    before, address = simulation.states.copy(), simulation.states.ctypes.data
    simulation.swap(nerd.Model(models / "pendulum"))
    assert (simulation.states == before).all()
    truth = nerd.Simulation("pendulum", n=4)
    truth.reset(states=before)
    for each in (simulation, truth):
        each.step(np.zeros((4, 2)))
    apart = np.abs(simulation.states - truth.states).max()
    assert 0 < apart < 0.1 and simulation.states.ctypes.data == address, apart


def test_stiff_drives_hold_where_a_law_once_a_frame_flies():
    def swung(law):
        simulation = nerd.Simulation("pendulum", n=3)
        simulation.reset(states=np.zeros(4))
        for _ in range(60):
            law(simulation)
        return np.abs(simulation.states[:, :2] - 0.5).max()

    def driven_(simulation):
        simulation.drive(0.5, 1e6, np.full(2, 1e4))
        simulation.step(np.zeros((3, 2)))

    def by_torques(simulation):
        q, qd = np.split(simulation.states, 2, axis=1)
        simulation.step(1e6 * (0.5 - q) - 1e4 * qd)

    assert swung(driven_) < 1e-3
    assert swung(by_torques) > 1.0, "it flies"
    ant = nerd.Simulation("ant", n=2)
    ant.drive(ant.system.default_state[7:15])
    free = nerd.Simulation("ant", n=2)
    for simulation in (ant, free):
        simulation.reset(states=ant.system.default_state)
        simulation.step(np.zeros((2, 8)))
    assert (ant.states != free.states).any()
    ant.drive(None)
    ant.reset(states=ant.system.default_state)
    ant.step(np.zeros((2, 8)))
    assert (ant.states == free.states).all(), "no drive any more"


def test_a_family_has_a_robot_for_each_environment():
    with pytest.warns(UserWarning, match="vary=True"):
        alike = nerd.Simulation("ant-family", n=4)
    family, again = (nerd.Simulation("ant-family", n=4, vary=True) for _ in range(2))
    for simulation in (alike, family, again):
        simulation.reset(states=simulation.system.default_state)
        simulation.step(np.ones((4, 8)))
    assert (alike.states == alike.states[0]).all() and (family.states == again.states).all()
    assert len(np.unique(family.states, axis=0)) == 4, "no two are alike"


def test_what_is_read_from_files_is_copied_as_its_name(models):
    for one, of in (
        (nerd.System("ant"), lambda system: system.columns),
        (nerd.Model(models / "ant"), lambda model: model.sha256),
        (nerd.Policy(models / "policies/ant-run-articulated-0"), lambda policy: policy(np.ones(policy.inputs)).tolist()),
    ):
        assert of(pickle.loads(pickle.dumps(one))) == of(copy.deepcopy(one)) == of(one)


def test_contact_carries_the_weight():
    cube = nerd.Simulation("cube", scene="ground", n=3)
    with pytest.raises(ValueError):
        cube.contact_forces(cube.system.links[0])
    for _ in range(600):
        cube.step(np.zeros((3, 0)))
    link = cube.system.links[0]
    assert np.abs(cube.velocities(link)).max() < 1e-3, "it lies still"
    forces = cube.contact_forces(link)
    weight = 1.1510227 * 9.81  # of its URDF's mass (N)
    assert np.abs(forces - [0, 0, weight]).max() < 1e-4 * weight, forces
    assert np.abs(np.linalg.norm(cube.poses(link)[:, 3:], axis=1) - 1).max() < 1e-9


@pytest.mark.parametrize(
    "wrong, kind, word",
    [
        (lambda s: s.step(np.zeros((4, 7))), ValueError, "[4, 8]"),
        (lambda s: s.step(np.zeros(32)), ValueError, "[4, 8]"),
        (lambda s: s.step(np.zeros((4, 8), np.float32)), TypeError, "float64"),
        (lambda s: s.step(np.zeros((4, 8), ">f8")), TypeError, "float64"),
        (lambda s: s.step([[0.0] * 8] * 4), TypeError, "list"),
        (lambda s: s.step(None), TypeError, "NoneType"),
        (lambda s: s.step(np.full((4, 8), np.nan)), RuntimeError, "NaN"),
        (lambda s: s.reset(np.ones(4)), TypeError, "bool"),
        (lambda s: s.reset(np.ones(3, bool)), ValueError, "[4]"),
        (lambda s: s.reset(None, np.zeros((4, 28))), ValueError, "[4, 29]"),
        (lambda s: s.drive(0.0, 1.0), ValueError, "both"),
        (lambda s: s.drive(np.zeros(7)), ValueError, "[4, 8] or [8]"),
        (lambda s: s.poses("nose"), ValueError, "nose"),
        (lambda s: s.contact_forces("nose"), ValueError, "nose"),
        (lambda s: s.swap("newton"), ValueError, "articulated"),
        (lambda s: nerd.Simulation("ant", device="tpu"), ValueError, "cpu"),
        (lambda s: nerd.Simulation("ant", device="cuda"), ValueError, "cuda"),
        (lambda s: nerd.Simulation("ant", xp=np), ValueError, "xp"),
        (lambda s: nerd.System("aunt"), ValueError, "aunt"),
        (lambda s: nerd.System("none.urdf"), ValueError, "none.urdf"),
        (lambda s: nerd.Simulation("ant", scene="moon"), ValueError, "moon"),
        (lambda s: nerd.Simulation("ant", n=0), ValueError, "n=0"),
        (lambda s: nerd.Simulation("ant", n=10**9), ValueError, "n=1000000000"),
        (lambda s: nerd.Simulation("ant", n=-1), ValueError, "n=-1"),
        (lambda s: nerd.Simulation("ant", seed=-1), ValueError, "seed=-1"),
        (lambda s: nerd.Simulation("ant", vary=True), ValueError, "[vary]"),
        (lambda s: s.reset(states=np.zeros(29)), ValueError, "quaternion"),
        (lambda s: s.reset(np.zeros((4, 29))), TypeError, "states="),
        (lambda s: nerd.Simulation("ant", device="cuda:9"), ValueError, "cuda"),
        (lambda s: nerd.Simulation("ant", device=0), TypeError, ""),
        (lambda s: nerd.Model("."), ValueError, "config.json"),
        (lambda s: nerd.Policy("."), ValueError, "config.json"),
    ],
)
def test_what_is_wrong_is_refused_in_one_line(wrong, kind, word):
    simulation = nerd.Simulation("ant", n=4)
    before = simulation.states.copy()
    with pytest.raises(kind) as error:
        wrong(simulation)
    assert word in line(error)
    assert (simulation.states == before).all()


def test_any_layout_of_numbers_is_read_right():
    tau = np.random.default_rng(0).uniform(-1, 1, (8, 4))
    plain, turned = nerd.Simulation("ant", n=4), nerd.Simulation("ant", n=4)
    plain.step(np.ascontiguousarray(tau.T))
    turned.step(tau.T)
    assert (plain.states == turned.states).all()
    reversed_, other = nerd.Simulation("ant", n=4), nerd.Simulation("ant", n=4)
    reversed_.step(tau.T[::-1])
    other.step(tau.T[::-1].copy())
    assert (reversed_.states == other.states).all()


def test_what_cannot_be_stepped_is_named_and_the_others_go_on():
    simulation = nerd.Simulation("ant", n=5)
    simulation.states[3, 20] = np.inf
    before = simulation.states.copy()
    with pytest.raises(RuntimeError) as error:
        simulation.step(np.zeros((5, 8)))
    assert "environment 3" in line(error)
    [(env, frame, reason)] = simulation.faults
    assert (env, frame) == (3, 0) and "inf" in reason
    assert (simulation.states[[0, 1, 2, 4]] != before[[0, 1, 2, 4]]).any(axis=1).all()
    simulation.reset(np.arange(5) == 3)
    simulation.step(np.zeros((5, 8)))
    assert simulation.faults == []


def test_threads_step_simulations_of_their_own_and_share_one():
    alone = driven(nerd.Simulation("ant", n=64, seed=1), 30).states.copy()
    all_ = [nerd.Simulation("ant", n=64, seed=1) for _ in range(4)]
    shared, torques = nerd.Simulation("ant", n=8), np.zeros((8, 8))
    failed = []

    def work(simulation):
        try:
            driven(simulation, 30)
            for _ in range(10):
                shared.step(torques)
        except BaseException as error:  # noqa: BLE001 - whatever it is, the test has to see it
            failed.append(error)

    threads = [threading.Thread(target=work, args=(simulation,)) for simulation in all_]
    [thread.start() for thread in threads]
    [thread.join() for thread in threads]
    assert not failed and all((simulation.states == alone).all() for simulation in all_)
    assert (shared.frames == 40).all()


def test_python_runs_while_a_frame_is_stepped():
    """Nobody is asked to let Python go, so another thread counts only where a step gives it away of its own."""
    simulation, torques = nerd.Simulation("ant", n=512), np.zeros((512, 8))
    counted, done = [0], threading.Event()

    def count():
        while not done.is_set():
            counted[0] += 1
            time.sleep(1e-4)

    interval = sys.getswitchinterval()
    sys.setswitchinterval(1000.0)
    thread = threading.Thread(target=count)
    try:
        thread.start()
        moved = 0
        for _ in range(50):
            before = counted[0]
            simulation.step(torques)
            moved += counted[0] > before
        assert moved
    finally:
        done.set()
        sys.setswitchinterval(interval)
        thread.join()
