"""Mass matrices, Jacobians and inverse dynamics against differences of motions, and what one says of the other."""

import nerd
import numpy as np
import pytest

ROBOTS = ["pendulum", "franka", "ant", "anymal"]


def motion(robot, n=4):
    """A system, states in motion away from the world's origin, and accelerations."""
    system, rng = nerd.System(robot), np.random.default_rng(0)
    states = np.tile(system.default_state, (n, 1)) + rng.uniform(-0.4, 0.4, (n, system.nq + system.nv))
    if system.nq > system.nv:
        states[:, 3:7] /= np.linalg.norm(states[:, 3:7], axis=1, keepdims=True)
    return system, states, rng.uniform(-1, 1, (n, system.nv))


def product(a, b):
    """Of quaternions x y z w."""
    u, v = a[:, :3], b[:, :3]
    vector = a[:, 3:] * v + b[:, 3:] * u + np.cross(u, v)
    return np.concatenate([vector, a[:, 3:] * b[:, 3:] - (u * v).sum(1, keepdims=True)], 1)


def moved(system, states, accelerations, time):
    """States so much later, to first order."""
    states, nq, free = states.copy(), system.nq, system.nq > system.nv
    q, qd = states[:, :nq], states[:, nq:]
    if free:
        spin, place = qd[:, :3], q[:, :3].copy()
        q[:, :3] += time * (qd[:, 3:6] + np.cross(spin, place))
        turn = np.concatenate([time / 2 * spin, np.ones((len(q), 1))], 1)
        q[:, 3:7] = product(turn / np.linalg.norm(turn, axis=1, keepdims=True), q[:, 3:7])
    q[:, 7 * free :] += time * qd[:, 6 * free :]
    qd += time * accelerations
    return states


def rate(system, states, accelerations, of, eps=1e-6):
    later, sooner = (of(moved(system, states, accelerations, time)) for time in (eps, -eps))
    return (later - sooner) / (2 * eps)


def times(matrices, vectors):
    return np.einsum("nij,nj->ni", matrices, vectors)


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_jacobian_moves_its_link(robot):
    system, states, accelerations = motion(robot)
    simulation, link = nerd.Simulation(system, n=len(states)), system.links[-1]

    def poses(states):
        simulation.reset(states=states)
        return simulation.poses(link)

    found = times(system.jacobian(link, states), states[:, system.nq :])
    by_time, turn = rate(system, states, accelerations, poses), poses(states)[:, 3:]
    spin = 2 * product(by_time[:, 3:], turn * [-1, -1, -1, 1])[:, :3]
    assert np.abs(found - np.concatenate([spin, by_time[:, :3]], 1)).max() < 1e-7, found
    assert np.abs(found - simulation.velocities(link)).max() < 1e-12


@pytest.mark.parametrize("robot", ROBOTS)
def test_forces_are_rates_of_momentum(robot):
    system, states, accelerations = motion(robot)
    momentum = lambda states: times(system.mass_matrix(states), states[:, system.nq :])
    energy = lambda states: (momentum(states) * states[:, system.nq :]).sum(1) / 2
    still = states.copy()
    still[:, system.nq :] = 0
    forces, weight = system.inverse_dynamics(states, accelerations), system.inverse_dynamics(still)
    power = ((forces - weight) * states[:, system.nq :]).sum(1)
    assert np.abs(power - rate(system, states, accelerations, energy)).max() < 1e-5 * np.abs(power).max(), "power is the rate of energy"
    found = rate(system, states, accelerations, momentum)
    if system.nq > system.nv:
        # Of the whole robot, about the world's origin.
        rows = slice(6)
        assert np.abs(weight[:, 3:6] + np.array(system.gravity) * system.mass).max() < 1e-9, "what holds it bears its weight"
    else:
        # Lagrange's equations.
        rows = slice(None)
        for k in range(system.nq):
            sides = [states.copy(), states.copy()]
            for side, eps in zip(sides, (1e-6, -1e-6)):
                side[:, k] += eps
            found[:, k] -= (energy(sides[0]) - energy(sides[1])) / 2e-6
    apart = (forces - weight - found)[:, rows]
    assert np.abs(apart).max() < 1e-5 * np.abs(found).max(), (apart, found)
    apart = forces - system.inverse_dynamics(states) - times(system.mass_matrix(states), accelerations)
    assert np.abs(apart).max() < 1e-10 * np.abs(forces).max(), "M qdd is what accelerations add to the bias"


def test_one_state_and_wrong_ones():
    system, states, accelerations = motion("ant")
    for of in (system.mass_matrix, system.inverse_dynamics, lambda states: system.jacobian("torso", states)):
        assert np.array_equal(of(states[1]), of(states)[1])
    assert np.array_equal(system.inverse_dynamics(states[1], accelerations[1]), system.inverse_dynamics(states, accelerations)[1])
    with pytest.raises(ValueError, match=r"states: an array \[4, 29\]"):
        system.mass_matrix(states[:, 1:])
    with pytest.raises(ValueError, match=r"accelerations: an array \[14\]"):
        system.inverse_dynamics(states[0], accelerations)
    with pytest.raises(ValueError, match="toroso"):
        system.jacobian("toroso", states)
    with pytest.raises(TypeError, match="float32"):
        system.mass_matrix(states.astype(np.float32))
