"""Plays an exported policy in MuJoCo for `nerd_cli::mujoco::player`, from its ONNX and contract alone.

JSON in, JSON out, a line each: `answer`, or `error`. First line: the `onnx` file and its `contract`; `mjcf` with the
`substeps` of a frame, or the `path` of a file with its own settings; `planes` of the task's `scene`; `starts`, one
[qpos, qvel] for each episode: a free root, then the contract's joints. The answer is versions.
Every other line is one step of the `live` episodes with their `goals`. Answer for each episode: the observation, the
action, and by frame [torques of the contract's joints, next state]. The state is null once MuJoCo has given it up.
Without `live`: the model's settings.
"""

import json
import math
import sys


def say(answer, kind="answer"):
    print(json.dumps({kind: answer}), flush=True)


def turned(w, x, y, z):
    """Rotation matrix of a quaternion, by rows."""
    return [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]


def wrap(x):
    return (x + math.pi) % (2 * math.pi) - math.pi


def main():
    import hashlib

    request = json.loads(sys.stdin.readline())
    try:
        import mujoco
        import numpy
        import onnxruntime
    except ImportError as error:
        return say(f"{error}; name a Python that has mujoco, numpy and onnxruntime", "error")
    mujoco.set_mju_user_warning(lambda text: None)
    contract = request["contract"]
    with open(request["onnx"], "rb") as file:
        network = file.read()
    if hashlib.sha256(network).hexdigest() != contract["onnx_sha256"]:
        return say("the ONNX is not the one of the contract", "error")
    session = onnxruntime.InferenceSession(network, providers=["CPUExecutionProvider"])
    robot = Model(mujoco, request)
    model, joint, place, rate = robot.model, robot.joint, robot.place, robot.rate
    at, dof = robot.root or (0, 0)
    bad = [getattr(mujoco.mjtWarning, "mjWARN_BAD" + what) for what in ("QPOS", "QVEL", "QACC")]
    endless = {name: not model.jnt_limited[k] and model.jnt_type[k] == mujoco.mjtJoint.mjJNT_HINGE for name, k in joint.items()}
    law, stable_pd, servo = contract["law"], contract["law"].get("stable_pd", False), contract["law"].get("servo", False)
    frame, timestep = contract["frame_time"], model.opt.timestep
    axes = "xyz"

    def q(data, name):
        return float(data.qpos[model.jnt_qposadr[joint[name]]])

    def qd(data, name):
        return float(data.qvel[model.jnt_dofadr[joint[name]]])

    def quantity(data, what, of, goal, past, time):
        if what in ("last action", "action before last"):
            return past[what == "action before last"][int(of)]
        if what == "constant":
            return 0.0
        if what == "time since the episode began":
            return time
        if what == "goal":
            return goal[int(of)]
        if what == "goal from root position":
            k, axis = of.split()
            return goal[int(k)] - data.qpos[at + axes.index(axis)]
        if what.startswith("root"):
            rows = turned(*data.qpos[at + 3 : at + 7])
            body = [[row[k] for row in rows] for k in range(3)]
            along = lambda matrix, x: [sum(a * b for a, b in zip(row, x)) for row in matrix]
            if what == "root quaternion":
                return data.qpos[at + 3 + "wxyz".index(of)]
            if what == "root axis along world axis":
                own, world = of.split()
                return rows[axes.index(world)][axes.index(own)]
            vector = {
                "root position": lambda: data.qpos[at : at + 3],
                "root velocity": lambda: data.qvel[dof : dof + 3],
                "root angular velocity": lambda: along(rows, data.qvel[dof + 3 : dof + 6]),
                "root velocity in its axes": lambda: along(body, data.qvel[dof : dof + 3]),
                "root angular velocity in its axes": lambda: data.qvel[dof + 3 : dof + 6],
            }[what]
            return vector()[axes.index(of)]
        return {
            "joint position": lambda: q(data, of),
            "joint velocity": lambda: qd(data, of),
            "joint position within [-pi, pi)": lambda: wrap(q(data, of)),
            "sine of joint position": lambda: math.sin(q(data, of)),
            "cosine of joint position": lambda: math.cos(q(data, of)),
        }[what]()

    def observe(data, goal, past, time):
        return [s["scale"] * float(quantity(data, s["quantity"], s["of"], goal, past, time)) + s["offset"] for s in contract["observation"]]

    def torques(data, action):
        """Torques by joint of the contract."""
        tau = dict.fromkeys(contract["joints"], 0.0)
        if law["kind"] == "torque":
            for a, x in zip(contract["action"], action):
                tau[a["joint"]] += a["scale"] * x
            return tau
        gaps = {}
        for a, x in zip(contract["action"], action):
            name, now = a["joint"], q(data, a["joint"])
            gap = a["scale"] * x if law["relative"] else a["default_q"] + a["scale"] * x - now
            gaps[name] = [wrap(gap) if endless[name] and not law["relative"] else gap, qd(data, name)]
        if stable_pd:
            h, mass = frame, numpy.zeros((model.nv, model.nv))
            mujoco.mj_forward(model, data)
            for k, unit in enumerate(numpy.eye(model.nv)):
                mujoco.mj_mulM(model, data, mass[k], unit)
            push = -data.qfrc_bias
            for a in contract["action"]:
                k, (gap, speed) = model.jnt_dofadr[joint[a["joint"]]], gaps[a["joint"]]
                mass[k, k] += h * (a["kd"] + h * a["kp"])
                push[k] += a["kp"] * (gap - h * speed) - a["kd"] * speed
            then = numpy.linalg.solve(mass, push)
            for name, pair in gaps.items():
                acceleration = float(then[model.jnt_dofadr[joint[name]]])
                pair[0] -= h * (pair[1] + h * acceleration)
                pair[1] += h * acceleration
        for a in contract["action"]:
            gap, speed = gaps[a["joint"]]
            # A servo's torque is limited later, in `serve`.
            limit = math.inf if servo or a["torque_limit"] is None else a["torque_limit"]
            tau[a["joint"]] = min(max(a["kp"] * gap - a["kd"] * speed, -limit), limit)
        return tau

    games = []
    for start in request["starts"]:
        data = mujoco.MjData(model)
        data.qpos[place], data.qvel[rate] = start[: len(place)], start[len(place) :]
        robot.follow(data)
        games.append([data, [], [[0.0] * len(contract["action"])] * 2, [0]])
    say(f"MuJoCo {mujoco.__version__}, onnxruntime {onnxruntime.__version__}")

    def drive(data, action, tau):
        """Sets targets of the file's own actuators, or applies the contract's torques."""
        data.qfrc_applied[:] = 0.0
        for a, x in zip(contract["action"], action):
            if a["joint"] in robot.actuators:
                (k, gear), now, target = robot.actuators[a["joint"]], q(data, a["joint"]), a["default_q"] + a["scale"] * x
                data.ctrl[k] = gear * (now + wrap(target - now) if endless[a["joint"]] else target)
        for name, x in tau.items():
            if name not in robot.actuators:
                data.qfrc_applied[model.jnt_dofadr[joint[name]]] = x

    def serve(data, action):
        """Steps once with servos that the file lacks; MuJoCo integrates their damping implicitly as joint damping."""
        tau = torques(data, action)
        for a in contract["action"]:
            limit, damped = math.inf if a["torque_limit"] is None else a["torque_limit"], a["kd"] * qd(data, a["joint"])
            tau[a["joint"]] = min(max(tau[a["joint"]], -limit), limit) + damped
        drive(data, action, tau)
        mujoco.mj_step(model, data)

    def step(data, frames, past, passed, goal):
        seen = observe(data, goal, past, passed[0] * frame)
        # Newest first; frames before the episode repeat its first one.
        frames[:] = ([seen] + frames if frames else [seen] * contract["observations_seen"])[: contract["observations_seen"]]
        given = numpy.array(frames if len(frames) > 1 else seen, dtype=numpy.float32)[None]
        action = session.run([contract["output"]], {contract["input"]: given})[0][0].tolist()
        past[:] = [action, past[0]]
        then = []
        for _ in range(contract["frames_per_action"]):
            tau = torques(data, action)
            # A frame ends at the last MuJoCo step that does not pass the frame's end.
            before, after = (math.floor(n * frame / timestep + 1e-6) for n in (passed[0], passed[0] + 1))
            if servo and not robot.actuators:
                for _ in range(after - before):
                    serve(data, action)
            else:
                drive(data, action, tau)
                mujoco.mj_step(model, data, nstep=after - before)
            passed[0] += 1
            state = data.qpos[place].tolist() + data.qvel[rate].tolist()
            fine = all(abs(x) < 1e10 for x in state) and not any(data.warning[kind].number for kind in bad)
            then.append([list(tau.values()), state if fine else None])
        robot.watch(data)
        return [seen, action, then]

    for line in sys.stdin:
        asked = json.loads(line)
        if "live" in asked:
            say([step(*games[k], goal) for k, goal in zip(asked["live"], asked["goals"])])
        else:
            say(robot.settings())


try:
    main()
except Exception as error:
    say(f"MuJoCo: {error}", "error")
