"""Steps a model with MuJoCo for `nerd_cli::mujoco::Python`.

JSON in, JSON out, a line each: `answer`, or `error`. First line: `mjcf` or the `path` of one, `frame_time` (s),
`frames`, and `starts` as [qpos, qvel]; optionally `targets` [target][start][joint] for the actuators, each held for
`every` frames. The answer is MuJoCo's version.
Every other line is one of these requests:
- `integrator`, `substeps` a frame, `timed`: rolls out. Answer: states at frame ends, [frame][start], null once MuJoCo
  has given one up, and the seconds of the fastest run. A timed run calls MuJoCo once for each start and target, so
  Python's time is excluded; it must end in the recorded state.
- `accelerate`: states without contact, limits, dry friction, equalities and actuators, with velocities restricted to
  the columns of `along`. Answer: qacc along them.
- `stand`: a state, stepped `steps` times by `frame_time` with actuators off, joints held at `target` by gains `kp` and
  `kd`. Answer: the last state, or null. With `floor`, a file without ground contact gets a plane.
- `move`: states, stepped a frame of `substeps` under `forces` on all DoF. Answer: the next states, or null. MuJoCo's
  data of each index, with its warm start, serves the next request too.
"""

import json
import sys
import time


def say(answer, kind="answer"):
    print(json.dumps({kind: answer}), flush=True)


def main():
    request = json.loads(sys.stdin.readline())
    frames, starts = request["frames"], request["starts"]
    targets, every = request.get("targets"), request.get("every", 1)
    try:
        import mujoco
    except ImportError as error:
        return say(f"no MuJoCo here ({error}); name a Python that has it", "error")
    # Warnings are counted; MuJoCo need not write them to a file.
    mujoco.set_mju_user_warning(lambda text: None)
    path = request.get("path")
    model = mujoco.MjModel.from_xml_path(path) if path else mujoco.MjModel.from_xml_string(request["mjcf"])
    if request.get("floor"):
        touches = (model.geom_contype > 0) | (model.geom_conaffinity > 0)
        if not (touches & (model.body_weldid[model.geom_bodyid] == 0)).any():
            spec = mujoco.MjSpec.from_file(path)
            spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1])
            model = spec.compile()
    data = mujoco.MjData(model)
    bad = [getattr(mujoco.mjtWarning, "mjWARN_BAD" + what) for what in ("QPOS", "QVEL", "QACC")]
    say(mujoco.__version__)

    def begin(start):
        mujoco.mj_resetData(model, data)
        data.qpos[:] = start[: model.nq]
        data.qvel[:] = start[model.nq :]

    def aim(target, k):
        if targets:
            data.ctrl[:] = targets[target][k]

    def state(data=data):
        values = data.qpos.tolist() + data.qvel.tolist()
        # MuJoCo resets a diverged simulation and counts a warning.
        fine = all(abs(x) < 1e10 for x in values) and not any(data.warning[kind].number for kind in bad)
        return values if fine else None

    def accelerate(asked):
        import numpy

        for part in "CONTACT", "LIMIT", "FRICTIONLOSS", "EQUALITY", "ACTUATION":
            model.opt.disableflags |= getattr(mujoco.mjtDisableBit, "mjDSBL_" + part)
        answers, mass, along = [], numpy.zeros((model.nv, model.nv)), numpy.array(asked["along"])
        if along.shape[0] != model.nv or any(len(start) != model.nq + model.nv for start in asked["accelerate"]):
            return say(f"MuJoCo counts {model.nv} velocities and {model.nq} positions", "error")
        for start in asked["accelerate"]:
            begin(start)
            mujoco.mj_forward(model, data)
            for k, unit in enumerate(numpy.eye(model.nv)):
                mujoco.mj_mulM(model, data, mass[k], unit)
            answers.append(numpy.linalg.solve(along.T @ mass @ along, along.T @ data.qfrc_smooth).tolist())
        say(answers)

    def stand(asked):
        first = model.nv - len(asked["kp"])
        if len(asked["stand"]) != model.nq + model.nv:
            return say(f"MuJoCo counts {model.nv} velocities and {model.nq} positions", "error")
        model.opt.timestep, model.opt.integrator = request["frame_time"], mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ACTUATION
        # As joint damping, which MuJoCo integrates implicitly.
        model.dof_damping[first:] += asked["kd"]
        begin(asked["stand"])
        for _ in range(int(asked["steps"])):
            at = data.qpos[model.nq - len(asked["kp"]) :]
            data.qfrc_applied[first:] = [kp * (target - q) for kp, target, q in zip(asked["kp"], asked["target"], at)]
            mujoco.mj_step(model, data)
        say(state())

    kept = []

    def move(asked):
        model.opt.timestep = request["frame_time"] / asked["substeps"]
        model.opt.integrator = getattr(mujoco.mjtIntegrator, "mjINT_" + asked["integrator"])
        answers = []
        kept.extend(mujoco.MjData(model) for _ in asked["move"][len(kept) :])
        for own, start, force in zip(kept, asked["move"], asked["forces"]):
            own.qpos[:], own.qvel[:], own.qfrc_applied[:] = start[: model.nq], start[model.nq :], force
            mujoco.mj_step(model, own, nstep=asked["substeps"])
            answers.append(state(own))
        say(answers)

    for line in sys.stdin:
        setting = json.loads(line)
        if "move" in setting:
            move(setting)
            continue
        if "stand" in setting:
            stand(setting)
            continue
        if "accelerate" in setting:
            accelerate(setting)
            continue
        substeps = setting["substeps"]
        model.opt.timestep = request["frame_time"] / substeps
        model.opt.integrator = getattr(mujoco.mjtIntegrator, "mjINT_" + setting["integrator"])
        states = [[] for _ in range(frames)]
        for k, start in enumerate(starts):
            begin(start)
            for i, frame in enumerate(states):
                aim(i // every, k)
                mujoco.mj_step(model, data, nstep=substeps)
                frame.append(state())
        best, total, runs = float("inf"), 0.0, 0
        while setting["timed"] and (runs == 0 or total < 0.3 and runs < 20 or runs < 3 and total < 10.0):
            spent = 0.0
            for k, start in enumerate(starts):
                begin(start)
                before = time.perf_counter()
                for i in range(0, frames, every):
                    aim(i // every, k)
                    mujoco.mj_step(model, data, nstep=substeps * min(every, frames - i))
                spent += time.perf_counter() - before
                if state() != states[-1][k]:
                    return say("MuJoCo came to another state when timed", "error")
            best, total, runs = min(best, spent), total + spent, runs + 1
        say([states, best if setting["timed"] else None])


try:
    main()
except Exception as error:
    say(f"MuJoCo: {error}", "error")
