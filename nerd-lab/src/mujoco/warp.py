"""Steps a model with MuJoCo Warp, on a GPU, for `nerd_lab::mujoco::Referee`.

Requests and answers as in referee.py, but starts are parallel worlds. A timed run steps `worlds` worlds, which take the
starts and their first targets in turn; a step is one captured graph, compiled before timing. Contacts and solver are
set as for the robots of `mjlab`: pyramidal friction cones, at most 10 iterations of 20 line searches.
"""

import json
import os
import sys
import time

# Warp prints compiler messages to standard output.
answers = os.fdopen(os.dup(1), "w")
os.dup2(2, 1)


def say(answer, kind="answer"):
    print(json.dumps({kind: answer}), file=answers, flush=True)


def main():
    request = json.loads(sys.stdin.readline())
    frames, starts, targets, every = request["frames"], request["starts"], request["targets"], request["every"]
    try:
        import mujoco
        import mujoco_warp
        import numpy
        import warp
    except ImportError as error:
        return say(f"no MuJoCo Warp here ({error}); name a Python that has it", "error")
    model = mujoco.MjModel.from_xml_string(request["mjcf"])
    model.opt.cone, model.opt.impratio = mujoco.mjtCone.mjCONE_PYRAMIDAL, 1
    model.opt.iterations, model.opt.ls_iterations = 10, 20
    card = warp.get_preferred_device()
    say(f"Warp {mujoco_warp.__version__} of {mujoco.__version__}, {card.name}")
    first = numpy.array(starts, dtype=numpy.float32)
    aims = numpy.array(targets, dtype=numpy.float32)
    kinds = mujoco_warp.OverflowType
    full = int(kinds.NEFC | kinds.NJMAX_NNZ | kinds.BROADPHASE | kinds.NARROWPHASE)
    room = {"nconmax": 24, "njmax": 128}

    class Run:
        """Parallel worlds at the present settings."""

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
            self.begin()

        def begin(self):
            mujoco_warp.reset_data(self.model, self.data)
            self.data.qpos.assign(self.first[:, : model.nq])
            self.data.qvel.assign(self.first[:, model.nq :])
            self.aim(0)

        def aim(self, target):
            if targets:
                self.data.ctrl.assign(numpy.resize(aims[target], (self.first.shape[0], model.nu)))

        def steps(self, n):
            for _ in range(n):
                if self.graph:
                    warp.capture_launch(self.graph)
                else:
                    mujoco_warp.step(self.model, self.data)

        def states(self):
            both = numpy.concatenate([self.data.qpos.numpy(), self.data.qvel.numpy()], axis=1)
            return [row.tolist() if numpy.isfinite(row).all() and (abs(row) < 1e10).all() else None for row in both]

        def crowded(self):
            # Contacts and constraints beyond the allocated size are dropped silently.
            return bool((self.data.overflow.numpy() & full).any())

    def recorded(substeps):
        run, states = Run(len(starts)), []
        for i in range(frames):
            if i % every == 0:
                run.aim(i // every)
            run.steps(substeps)
            states.append(run.states())
        return run, states

    def timed(substeps, worlds):
        run = Run(worlds)
        warp.synchronize()
        before = time.perf_counter()
        run.steps(substeps * frames)
        warp.synchronize()
        return run, time.perf_counter() - before

    def roomy(play, *asked):
        """Runs `play` again with twice the room until all contacts and constraints fit."""
        while True:
            run, found = play(*asked)
            if not run.crowded():
                return run, found
            room.update({key: 2 * size for key, size in room.items()})
            if room["njmax"] > 4096:
                raise RuntimeError("more constraints than it can have room for")

    for line in sys.stdin:
        setting = json.loads(line)
        model.opt.timestep = request["frame_time"] / setting["substeps"]
        model.opt.integrator = getattr(mujoco.mjtIntegrator, "mjINT_" + setting["integrator"])
        _, states = roomy(recorded, setting["substeps"])
        seconds = 0.0
        if setting["timed"]:
            run, seconds = roomy(timed, setting["substeps"], setting["worlds"])
            if None in run.states():
                seconds = None
        say([states, seconds])


try:
    main()
except Exception as error:
    say(f"MuJoCo Warp: {error}", "error")
