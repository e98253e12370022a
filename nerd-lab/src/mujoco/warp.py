"""Steps a model with MuJoCo Warp, on a GPU, for `nerd_lab::mujoco::Referee`.

As referee.py, but that starts are worlds side by side, all of one robot. A timed run steps so many `worlds`, which take the starts in turn; with
room for contacts twice that of the fullest start, and its seconds are those of all of them. One step is one captured graph.
"""

import json
import os
import sys
import time

# Warp tells standard output what it compiles.
answers = os.fdopen(os.dup(1), "w")
os.dup2(2, 1)


def say(answer):
    print(json.dumps(answer), file=answers, flush=True)


def main():
    request = json.loads(sys.stdin.readline())
    frames, starts = request["frames"], request["starts"]
    try:
        import mujoco
        import mujoco_warp
        import numpy
        import warp
    except ImportError as error:
        return say({"error": f"no MuJoCo Warp here ({error}); name a Python that has it"})
    model = mujoco.MjModel.from_xml_string(request["mjcf"])
    data = mujoco.MjData(model)
    card = warp.get_preferred_device()
    say({"version": f"Warp {mujoco_warp.__version__} of {mujoco.__version__}, {card.name}"})
    fullest = [0, 0]
    for start in starts:
        data.qpos[:], data.qvel[:] = start[: model.nq], start[model.nq :]
        mujoco.mj_forward(model, data)
        fullest = [max(fullest[0], data.ncon), max(fullest[1], data.nefc)]
    room = {"nconmax": 2 * fullest[0] + 8, "njmax": 2 * fullest[1] + 4 * model.nv + 16}
    kinds = mujoco_warp.OverflowType
    full = int(kinds.NEFC | kinds.NJMAX_NNZ | kinds.BROADPHASE | kinds.NARROWPHASE)
    cones = model.opt.cone, model.opt.impratio
    first = numpy.array(starts, dtype=numpy.float32)

    class Run:
        """So many worlds at the present settings."""

        def __init__(self, worlds):
            self.model = mujoco_warp.put_model(model)
            self.data = mujoco_warp.make_data(model, nworld=worlds, **room)
            self.first = numpy.resize(first, (worlds, first.shape[1]))
            self.graph = None
            self.begin()
            mujoco_warp.step(self.model, self.data)
            if card.is_cuda:
                with warp.ScopedCapture() as capture:
                    mujoco_warp.step(self.model, self.data)
                self.graph = capture.graph

        def begin(self):
            mujoco_warp.reset_data(self.model, self.data)
            self.data.qpos.assign(self.first[:, : model.nq])
            self.data.qvel.assign(self.first[:, model.nq :])

        def steps(self, n):
            for _ in range(n):
                if self.graph:
                    warp.capture_launch(self.graph)
                else:
                    mujoco_warp.step(self.model, self.data)

        def states(self):
            both = numpy.concatenate([self.data.qpos.numpy(), self.data.qvel.numpy()], axis=1)
            return [row.tolist() if numpy.isfinite(row).all() and (abs(row) < 1e10).all() else None for row in both]

        def check(self):
            # Contacts and constraints beyond the room are left out without a word.
            if (self.data.overflow.numpy() & full).any():
                raise RuntimeError(f"more contacts or constraints than there is room for ({room})")

    for line in sys.stdin:
        setting = json.loads(line)
        substeps = setting["substeps"]
        model.opt.timestep = request["frame_time"] / substeps
        model.opt.integrator = getattr(mujoco.mjtIntegrator, "mjINT_" + setting["integrator"])
        model.opt.cone, model.opt.impratio = (mujoco.mjtCone.mjCONE_PYRAMIDAL, 1) if setting["plain"] else cones
        states, spent, lost = [], 0.0, 0
        run = Run(len(starts))
        run.begin()
        for _ in range(frames):
            run.steps(substeps)
            states.append(run.states())
        run.check()
        if setting["timed"]:
            run = Run(setting["worlds"] or len(starts))
            run.begin()
            warp.synchronize()
            before = time.perf_counter()
            run.steps(substeps * frames)
            warp.synchronize()
            spent = time.perf_counter() - before
            run.check()
            lost = sum(state is None for state in run.states())
        say({"states": states, "seconds": spent, "lost": lost})


try:
    main()
except Exception as error:
    say({"error": f"MuJoCo Warp: {error}"})
