"""Compares a robot's dynamics with Pinocchio's for `nerd_lab::survey`.

In: a JSON line with `urdf` (a path), `floating`, `joints` as [name, coordinate, ratio, offset], `frames` (names), `states` (how many),
`coordinates` (joints that move by themselves), or an empty line at the end. Then for each state, as little-endian f64, what
`FIELDS` lists. Out: a JSON line with the largest relative difference by quantity, or `error`. Matrices differ by
the largest entry of their difference over the largest entry of Pinocchio's, or over 1e-6 where that is more.

Ours has angular parts first, in world axes at the root; Pinocchio linear parts first, in the root's own axes. Joints that follow others
are folded here: `G^T M G`.
"""

import json
import sys

import numpy as np

FIELDS = ("q", "qd", "qdd", "tau", "mass", "bias", "inverse", "forward", "inverse_q", "inverse_qd", "forward_q", "forward_qd", "jacobians")


def say(answer):
    print(json.dumps(answer), flush=True)


def read(shape):
    count = int(np.prod(shape, dtype=int))
    return np.frombuffer(sys.stdin.buffer.read(8 * count), "<f8").reshape(shape)


def turn(e, parts):
    """Both halves of six numbers turned about e."""
    return np.concatenate([np.cross(e, parts[:3]), np.cross(e, parts[3:6])])


def compare(pin, request, worst):
    root = pin.JointModelFreeFlyer() if request["floating"] else None
    model = pin.buildModelFromUrdf(request["urdf"], root) if root else pin.buildModelFromUrdf(request["urdf"])
    # What brakes joints is no part of the tree's dynamics here.
    for name in ("damping", "friction", "lowerDryFrictionLimit", "upperDryFrictionLimit", "rotorInertia", "armature"):
        if hasattr(model, name):
            setattr(model, name, np.zeros_like(getattr(model, name)))
    data, six = model.createData(), 6 if root else 0
    n = six + request["coordinates"]
    folded = any(ratio != 1 or offset != 0 for _, _, ratio, offset in request["joints"]) or model.nv != n
    g = np.zeros((model.nv, n))
    g[:six, :six] = np.eye(six)
    ids = [model.getJointId(name) for name, *_ in request["joints"]]
    for (_, k, ratio, _), joint in zip(request["joints"], ids):
        g[model.joints[joint].idx_v, six + k] = ratio
    frames = [model.getFrameId(name, pin.FrameType.BODY) for name in request["frames"]]
    shapes = [(n + bool(root),), (n,), (n,), (n,), (n, n), (n,), (n,), (n,), (n, n), (n, n), (n, n), (n, n), (len(frames), 6, n)]

    def full(matrix):
        """A matrix of as many columns as there are velocities: a single column comes as a list of numbers."""
        return np.reshape(matrix, (-1, model.nv))

    def note(name, ours, theirs):
        # What is nothing but rounding has no size of its own.
        size = max(np.abs(theirs).max(), 1e-6)
        worst[name] = max(worst.get(name, 0.0), float(np.abs(ours - theirs).max() / size))

    for _ in range(request["states"]):
        s = {name: read(shape) for name, shape in zip(FIELDS, shapes)}
        t = np.eye(n)
        q = pin.neutral(model)
        if root:
            q[:7] = s["q"][:7]
            r = pin.Quaternion(q[6], q[3], q[4], q[5]).matrix()
            t[:6, :6] = np.block([[np.zeros((3, 3)), r], [r, np.zeros((3, 3))]])
        for (_, k, ratio, offset), joint in zip(request["joints"], ids):
            value, at = ratio * s["q"][six + bool(root) + k] + offset, model.joints[joint].idx_q
            if model.joints[joint].nq == 2:
                q[at : at + 2] = np.cos(value), np.sin(value)
            else:
                q[at] = value
        v, a, tau = (t.T @ s[name] for name in ("qd", "qdd", "tau"))
        mass = full(pin.crba(model, data, q)).copy()
        mass = g.T @ (np.triu(mass) + np.triu(mass, 1).T) @ g
        bias = g.T @ pin.nonLinearEffects(model, data, q, g @ v)
        note("mass", t.T @ s["mass"] @ t, mass)
        note("bias", t.T @ s["bias"], bias)
        note("inverse", t.T @ s["inverse"], g.T @ pin.rnea(model, data, q, g @ v, g @ a))
        # Where nothing follows, g only changes the joints' order.
        forward = np.linalg.solve(mass, tau - bias) if folded else g.T @ pin.aba(model, data, q, g @ v, g @ tau)
        note("forward", t.T @ s["forward"], forward)

        def local(by_q, by_qd, by_other, result, other):
            """Derivatives by q at fixed numbers in the root's own axes, from those at fixed numbers in the world's."""
            by_q = by_q.copy()
            for k in range(3 if root else 0):
                e = np.eye(3)[k]
                by_q[:, k] += by_qd[:, :6] @ turn(e, s["qd"]) + by_other[:, :6] @ turn(e, other)
                by_q[:6, k] -= turn(e, result)
            return t.T @ by_q @ t

        pin.computeRNEADerivatives(model, data, q, g @ v, g @ a)
        note("inverse_q", local(s["inverse_q"], s["inverse_qd"], s["mass"], s["inverse"], s["qdd"]), g.T @ full(data.dtau_dq) @ g)
        note("inverse_qd", t.T @ s["inverse_qd"] @ t, g.T @ full(data.dtau_dv) @ g)
        if folded:
            pin.computeRNEADerivatives(model, data, q, g @ v, g @ forward)
            by_q, by_qd = (-np.linalg.solve(mass, g.T @ d @ g) for d in map(full, (data.dtau_dq, data.dtau_dv)))
        else:
            pin.computeABADerivatives(model, data, q, g @ v, g @ tau)
            by_q, by_qd = (g.T @ full(d) @ g for d in (data.ddq_dq, data.ddq_dv))
        inverse = np.linalg.inv(s["mass"])
        note("forward_q", local(s["forward_q"], s["forward_qd"], inverse, s["forward"], s["tau"]), by_q)
        note("forward_qd", t.T @ s["forward_qd"] @ t, by_qd)
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        for frame, ours in zip(frames, s["jacobians"]):
            theirs = full(pin.getFrameJacobian(model, data, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)) @ g
            note("jacobian", ours[[3, 4, 5, 0, 1, 2]] @ t, theirs)


def main():
    try:
        import pinocchio as pin
    except ImportError as error:
        return say({"error": f"no Pinocchio here ({error}); name a Python that has it (PyPI: pin)"})
    say({"version": pin.__version__})
    while line := sys.stdin.buffer.readline().strip():
        worst = {}
        request = json.loads(line)
        try:
            compare(pin, request, worst)
            say({"worst": worst})
        except Exception as error:  # What it says of a robot is an answer, too; the next one is asked of another process.
            return say({"error": " ".join(f"{type(error).__name__}: {error}".split())})


main()
