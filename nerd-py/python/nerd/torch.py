"""Gradients for PyTorch: a frame of a simulation as a differentiable function."""

import torch

from ._nerd import vjp

__all__ = ["step"]


class _Step(torch.autograd.Function):
    @staticmethod
    def forward(ctx, simulation, states, tau):
        ctx.simulation = simulation
        ctx.save_for_backward(states, tau)
        return torch.from_numpy(vjp(simulation, states.numpy(), tau.numpy())[0])

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, by_next):
        states, tau = ctx.saved_tensors
        _, by_states, by_tau = vjp(ctx.simulation, states.numpy(), tau.numpy(), by_next.contiguous().numpy())
        return None, torch.from_numpy(by_states), torch.from_numpy(by_tau)


def step(simulation, states, tau):
    """Steps `states` [n, nq + nv] one frame under torques `tau` [n, joints] (N m or N); returns the next states.

    Both are float64 tensors on the CPU, and so is the result; gradients flow to both. The simulation provides robot,
    scenes and solver, "articulated" or a model whose network sees one frame; its own states do not change.

    Raises TypeError for other tensors, and ValueError for other shapes or for a solver without gradients.
    """
    for name, given in (("states", states), ("tau", tau)):
        if not isinstance(given, torch.Tensor):
            raise TypeError(f"{name}: a torch tensor is needed, not {type(given).__name__}; take torch.as_tensor(..)")
        if given.dtype != torch.float64 or given.device.type != "cpu":
            raise TypeError(f"{name}: a tensor of float64 on the CPU is needed, not {given.dtype} on {given.device}; take .double().cpu()")
    return _Step.apply(simulation, states, tau)
