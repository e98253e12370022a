"""Gradients: of numbers as they stand against differences, in flight and in contact; through PyTorch where that is."""

import nerd
import numpy as np
import pytest

# So small that no contact begins or ends within it: contacts that carry a robot are some micrometres deep.
EPS = 1e-8


def settled(robot, n=3, frames=400, scene=None, solver="articulated(settled)"):
    """A simulation that has come down, and torques of the next frame. At full rest the next state still jumps by 1e-6
    (docs/gradients.md), so that differences tell no gradient."""
    simulation = nerd.Simulation(robot, scene=scene, n=n, seed=2, solver=solver)
    tau = np.zeros((n, len(simulation.system.joints)))
    for _ in range(frames):
        simulation.step(tau)
    return simulation, np.random.default_rng(1).uniform(-0.2, 0.2, tau.shape)


def off(simulation, states, tau, eps=EPS):
    """Largest distance of gradients from central differences, over the largest difference."""
    rng = np.random.default_rng(0)
    by_next = rng.normal(size=states.shape)
    _, by_states, by_tau = nerd.vjp(simulation, states, tau, by_next)
    apart = most = 0.0
    for which, by in ((0, by_states), (1, by_tau)):
        for column in range(by.shape[1]):
            sides = []
            for sign in (1.0, -1.0):
                moved = [states.copy(), tau.copy()]
                moved[which][:, column] += sign * eps
                sides.append((nerd.vjp(simulation, *moved)[0] * by_next).sum(1))
            found = (sides[0] - sides[1]) / (2 * eps)
            apart, most = max(apart, np.abs(found - by[:, column]).max()), max(most, np.abs(found).max())
    return apart / most


@pytest.mark.parametrize("robot, scene", [("pendulum", "free"), ("cube", "free"), ("ant", "free"), ("ant", "ground"), ("anymal", "ground")])
def test_gradients_by_numbers_are_differences(robot, scene):
    simulation, tau = settled(robot, frames=90 if scene == "ground" else 20, scene=scene)
    if scene == "ground":
        links = simulation.system.links
        touches = sum(np.abs(simulation.contact_forces(link)).sum(1) for link in links)
        assert (touches > 0).all(), "all of them touch"
    states = simulation.states.copy()
    found = off(simulation, states, tau)
    assert found < 1e-5, (found, states)
    assert (simulation.states == states).all(), "the simulation stays as it is"


def test_the_frame_is_the_one_that_is_stepped():
    simulation, tau = settled("ant")
    states = simulation.states.copy()
    following, _, _ = nerd.vjp(simulation, states, tau)
    simulation.step(tau)
    assert np.abs(following - simulation.states).max() < 1e-12
    longer = states.copy()
    longer[:, 3:7] *= 1.7
    assert np.abs(nerd.vjp(simulation, longer, tau)[0] - following).max() < 1e-12, "a quaternion's length counts for nothing"


def test_a_model_has_slopes(models):
    for robot in ("pendulum", "ant"):
        simulation, tau = settled(robot, frames=5)
        states = simulation.states.copy()
        simulation.swap(models / robot)
        # Its network is in f32.
        found = off(simulation, states, tau, 1e-3)
        assert found < 0.02, (robot, found)


def test_who_has_none_says_so():
    simulation = nerd.Simulation("ant", n=2, solver="rapier")
    with pytest.raises(ValueError, match="no gradients"):
        nerd.vjp(simulation, simulation.states, np.zeros((2, 8)))


def test_the_first_order_is_that_of_small_changes():
    simulation, tau = settled("pendulum", scene="free")
    a, b = nerd.linearise(simulation, tau)
    assert a.shape == (3, 4, 4) and b.shape == (3, 4, 2)
    states = simulation.states.copy()
    base = nerd.vjp(simulation, states, tau)[0]
    change = np.random.default_rng(3).normal(size=states.shape) * 1e-6
    found = nerd.vjp(simulation, states + change, tau)[0] - base
    assert np.abs(found - np.einsum("nij,nj->ni", a, change)).max() < 1e-9


def test_gradcheck_of_pytorch_in_sustained_contact():
    torch = pytest.importorskip("torch")
    import nerd.torch

    for wrong in (np.zeros((1, 4)), torch.zeros(1, 4)):
        with pytest.raises(TypeError, match="^states: a .*tensor .*is needed"):
            nerd.torch.step(nerd.Simulation("pendulum"), wrong, wrong)
    for robot in ("pendulum", "ant", "anymal"):
        simulation, tau = settled(robot, n=2, frames=90)
        given = [torch.tensor(numbers, requires_grad=True) for numbers in (simulation.states.copy(), tau)]
        assert torch.autograd.gradcheck(lambda s, t: nerd.torch.step(simulation, s, t), given, eps=EPS, atol=1e-4, rtol=1e-4)


def test_adam_brings_a_cartpole_up():
    torch = pytest.importorskip("torch")
    import nerd.torch

    simulation = nerd.Simulation("cartpole")
    force = torch.zeros(80, 1, 1, dtype=torch.float64, requires_grad=True)
    adam = torch.optim.Adam([force], lr=30.0)
    for _ in range(120):
        states = torch.tensor([[0.0, 3.0, 0.0, 0.0]], dtype=torch.float64)
        for push in force:
            states = nerd.torch.step(simulation, states, torch.nn.functional.pad(push, (0, 1)))
        loss = 1 - torch.cos(states[0, 1]) + 0.01 * states[0, 3] ** 2 + 0.1 * states[0, 0] ** 2
        adam.zero_grad()
        loss.backward()
        adam.step()
    assert abs(states[0, 1]) < 0.1 and abs(states[0, 3]) < 0.5, states
