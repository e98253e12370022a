"""Records MuJoCo into trajectories that NeRD learns from (needs `pip install mujoco`):

    python record.py ant.xml out/ant
    python record.py ant.xml out/ant-half --replay out/ant --substeps 10

The first writes robot.urdf, robot.toml (what a URDF cannot say), log.npz and log.toml (which array is what). Controls are random and held for a
few frames. The second plays starts and torques of what is held out again, in steps of another size. Hinges and slides, one free body at most,
a plane as ground; spheres, capsules, cylinders and boxes touch it.
"""

import argparse
import os
import pathlib
import time
import tomllib

import mujoco
import mujoco.rollout
import numpy as np

FREE, BALL, SLIDE, HINGE = range(4)


def matrix(quat):
    m = np.zeros(9)
    mujoco.mju_quat2Mat(m, np.asarray(quat, float))
    return m.reshape(3, 3)


def text(numbers):
    return " ".join(f"{x:.12g}" for x in numbers)


def origin(pos, quat=(1, 0, 0, 0)):
    m = matrix(quat)
    rpy = np.arctan2(m[2, 1], m[2, 2]), np.arcsin(np.clip(-m[2, 0], -1, 1)), np.arctan2(m[1, 0], m[0, 0])
    if abs(m[2, 0]) > 1 - 1e-12:  # Straight up or down only one of two turns counts.
        rpy = 0.0, rpy[1], np.arctan2(-m[0, 1], m[1, 1])
    return f'<origin xyz="{text(pos)}" rpy="{text(rpy)}"/>'


def shape(m, g):
    """A geom's shape in a URDF's words; nothing of one that touches nothing."""
    size, kind = m.geom_size[g], mujoco.mjtGeom(m.geom_type[g]).name[7:].lower()
    if not (m.geom_contype[g] or m.geom_conaffinity[g]) or kind not in ("sphere", "capsule", "cylinder", "box"):
        return None
    if kind == "box":
        return f'<box size="{text(2 * size)}"/>'
    return f'<{kind} radius="{size[0]:.9g}"' + ("/>" if kind == "sphere" else f' length="{2 * size[1]:.9g}"/>')


def model(path, torque):
    """The model with a sensor of the actuators' torque at every joint; with a motor at each if it has none."""
    spec = mujoco.MjSpec.from_file(str(path))
    joints = [j for j in spec.joints if j.type in (mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE)]
    for k, joint in enumerate(joints):
        joint.name = joint.name or f"joint{k}"
        if not spec.actuators:
            motor = {"name": f"motor_{joint.name}", "target": joint.name, "trntype": mujoco.mjtTrn.mjTRN_JOINT}
            spec.add_actuator(ctrllimited=True, ctrlrange=[-torque, torque], **motor)
    for joint in joints:
        kind = {"type": mujoco.mjtSensor.mjSENS_JOINTACTFRC, "objtype": mujoco.mjtObj.mjOBJ_JOINT}
        spec.add_sensor(name=f"torque of {joint.name}", objname=joint.name, **kind)
    return spec.compile()


def robot(m, frame_time):
    """The robot as URDF and TOML, its joints in the order of the links, whether it is free, and whether there is a ground."""
    name = lambda kind, i: mujoco.mj_id2name(m, getattr(mujoco.mjtObj, f"mjOBJ_{kind}"), i) or f"{kind.lower()}{i}"
    free = [b for b in range(1, m.nbody) if m.body_jntnum[b] and m.jnt_type[m.body_jntadr[b]] == FREE]
    if len(free) > 1 or BALL in m.jnt_type or any(t != mujoco.mjtTrn.mjTRN_JOINT for t in m.actuator_trntype):
        raise SystemExit("one free body at most, no balls, and actuators on joints alone can be recorded")
    links, joints, order, own = [] if free else ['<link name="world"/>'], [], [], []
    # From a body's origin to that of its link, which is where its last joint is.
    shift = {0: np.zeros(3)}
    for b in range(1, m.nbody):
        if free and m.body_rootid[b] != free[0]:
            continue
        body, parent, quat = name("BODY", b), m.body_parentid[b], m.body_quat[b]
        above, place, anchor = name("BODY", parent) if parent else "world", m.body_pos[b] - shift[parent], np.zeros(3)
        moving = [j for j in range(m.body_jntadr[b], m.body_jntadr[b] + m.body_jntnum[b]) if m.jnt_type[j] != FREE]
        for k, j in enumerate(moving):
            here, dof, last = m.jnt_pos[j], m.jnt_dofadr[j], j == moving[-1]
            # A slide counts from where it is by its `ref`.
            ref = m.qpos0[m.jnt_qposadr[j]]
            if ref and m.jnt_type[j] == HINGE:
                raise SystemExit(f"joint {name('JOINT', j)}: a hinge with `ref` cannot be recorded")
            back = here - ref * m.jnt_axis[j]
            at = origin(place + matrix(quat) @ back, quat) if k == 0 else origin(back - anchor)
            below = body if last else f"{body}_{k}"
            kind = "prismatic" if m.jnt_type[j] == SLIDE else "revolute" if m.jnt_limited[j] else "continuous"
            low, high = m.jnt_range[j] if m.jnt_limited[j] else (-1e3, 1e3)
            ends = "" if kind == "continuous" else f'lower="{low:.9g}" upper="{high:.9g}" '
            acts = [a for a in range(m.nu) if m.actuator_trnid[a][0] == j]
            reach = sum(abs(m.actuator_gear[a][0]) * (abs(m.actuator_ctrlrange[a]).max() if m.actuator_ctrllimited[a] else 1) for a in acts)
            joints.append(
                f'<joint name="{name("JOINT", j)}" type="{kind}"><parent link="{above}"/><child link="{below}"/>{at}'
                f'<axis xyz="{text(m.jnt_axis[j])}"/><limit {ends}effort="{reach or 1e3:.9g}" velocity="1000"/>'
                f'<dynamics damping="{m.dof_damping[dof]:.9g}" friction="{m.dof_frictionloss[dof]:.9g}"/></joint>'
            )
            spring = f"stiffness = {m.jnt_stiffness[j]}\nrest = {m.qpos_spring[m.jnt_qposadr[j]]}\n" if m.jnt_stiffness[j] else ""
            own.append(f'[[joint]]\nname = "{name("JOINT", j)}"\narmature = {m.dof_armature[dof]}\n{spring}')
            links += [] if last else [f'<link name="{below}"/>']
            order.append(j)
            above, anchor = below, here
        if not moving and b not in free:
            ends = f'<parent link="{above}"/><child link="{body}"/>{origin(place, quat)}'
            joints.append(f'<joint name="{body}_fixed" type="fixed">{ends}</joint>')
        shift[b] = anchor
        x, y, z = m.body_inertia[b]
        solid = f'<mass value="{m.body_mass[b]:.12g}"/><inertia ixx="{x:.12g}" iyy="{y:.12g}" izz="{z:.12g}" ixy="0" ixz="0" iyz="0"/>'
        solid = f"<inertial>{origin(m.body_ipos[b] - anchor, m.body_iquat[b])}{solid}</inertial>" if m.body_mass[b] else ""
        for g in np.flatnonzero(m.geom_bodyid == b):
            if shape(m, g):
                solid += f"<collision>{origin(m.geom_pos[g] - anchor, m.geom_quat[g])}<geometry>{shape(m, g)}</geometry></collision>"
        links.append(f'<link name="{body}">{solid}</link>')
    urdf = '<robot name="recorded">\n' + "\n".join(links + joints) + "\n</robot>\n"
    planes = [g for g in range(m.ngeom) if m.geom_bodyid[g] == 0 and m.geom_type[g] == mujoco.mjtGeom.mjGEOM_PLANE]
    touching = [g for g in range(m.ngeom) if (m.geom_contype[g] or m.geom_conaffinity[g]) and g not in planes]
    left_out = sum(m.geom_bodyid[g] == 0 or not shape(m, g) for g in touching)
    if left_out:
        print(f"left out: {left_out} geoms that touch and are no sphere, capsule, cylinder or box of the robot")
    if any(abs(matrix(m.geom_quat[g])[2, 2] - 1) > 1e-9 for g in planes) or len(planes) > 1:
        raise SystemExit("one level plane at most can be recorded")
    head = f'like = "urdf"\nfloating = {str(bool(free)).lower()}\nframe_time = {frame_time}\nsubsteps = {max(1, round(480 * frame_time))}\ngravity = {m.opt.gravity.tolist()}\n'
    own += [f'[[scene]]\nname = "ground"\nplane = {{ height = {m.geom_pos[g][2]}, angles = [0.0, 0.0, 0.0] }}\n' for g in planes[:1]]
    return urdf, head + "".join(own), order, [name("JOINT", j) for j in order], bool(free), bool(planes)


def roll(m, states, controls, substeps, threads, kind=mujoco.mjtState.mjSTATE_CTRL):
    """States [n, frames + 1, 1 + nq + nv] and mean torques of the actuators [n, frames, joints] from starts under the controls of each frame,
    which of them MuJoCo did not give up, and the seconds that all took."""
    data, n, frames = [mujoco.MjData(m) for _ in range(threads)], len(states), controls.shape[1]
    out, torques = np.empty((n, frames + 1, states.shape[-1])), np.empty((n, frames, m.nsensor))
    out[:, 0], fine, seconds = states, np.ones(n, bool), 0.0
    for some in np.array_split(np.arange(n), -(-n // 200)):
        begun = time.perf_counter()
        steps = np.repeat(controls[some], substeps, 1)
        seen, felt = mujoco.rollout.rollout(m, data, out[some, 0], steps, control_spec=int(kind))
        seconds += time.perf_counter() - begun
        out[some, 1:], torques[some] = seen[:, substeps - 1 :: substeps], felt.reshape(len(some), frames, substeps, -1).mean(2)
        # Where it blows up, MuJoCo begins anew at time 0.
        fine[some] = np.isfinite(seen).all((1, 2)) & (np.diff(seen[:, :, 0]) > 0).all(1)
    return out, torques, fine, seconds


def main():
    ask = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ask.add_argument("model", type=pathlib.Path, help="MJCF file")
    ask.add_argument("out", type=pathlib.Path, help="folder to write")
    ask.add_argument("--replay", type=pathlib.Path, help="folder recorded before, of which every fifth trajectory is played again, as it is held out")
    numbers = {"trajectories": (100, ""), "frames": (None, "of a trajectory, 200; of one played again, 100"), "substeps": (5, "steps of MuJoCo in a frame")}
    numbers |= {"hold": (8, "most frames for which a control is held"), "seed": (0, ""), "threads": (os.cpu_count(), "")}
    numbers["first"] = (20, "frame that those played again begin at, and each so many frames on as they have")
    for option, (default, help) in numbers.items():
        ask.add_argument(f"--{option}", type=int, default=default, help=help)
    ask.add_argument("--torque", type=float, default=1.0, help="largest, where the model has no actuators")
    asked = ask.parse_args()
    m, rng = model(asked.model, asked.torque), np.random.default_rng(asked.seed)
    frame_time = asked.substeps * m.opt.timestep
    if asked.replay:
        frame_time = tomllib.loads((asked.replay / "robot.toml").read_text())["frame_time"]
        m.opt.timestep = frame_time / asked.substeps
    urdf, toml, order, names, free, ground = robot(m, frame_time)
    q, v, limited, d = m.jnt_qposadr[order], m.jnt_dofadr[order], m.jnt_limited[order].astype(bool), mujoco.MjData(m)
    if asked.replay:
        if (m.actuator_gaintype != 0).any() or (m.actuator_biastype != 0).any() or (m.actuator_dyntype != 0).any():
            raise SystemExit("only torques of motors, which do not depend on the state, can be played again")
        log = np.load(asked.replay / "log.npz")
        frames = asked.frames or 100
        held = log["qpos"][4::5], log["qvel"][4::5], log["torque"][4::5]
        starts = range(asked.first, held[0].shape[1] - frames, frames)
        if not starts:
            raise SystemExit(f"--frames {frames}: trajectories of {held[0].shape[1] - 1} frames have none after the first {asked.first}; ask for fewer")
        cut = lambda x, rows: np.concatenate([x[:, f : f + rows] for f in starts]).astype(float)
        states = np.concatenate([np.zeros((len(held[0]) * len(starts), 1)), cut(held[0], 1)[:, 0], cut(held[1], 1)[:, 0]], 1)
        controls = np.zeros((len(states), frames, m.nv))
        controls[:, :, v] = cut(held[2], frames)
        m.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ACTUATION
        kind = mujoco.mjtState.mjSTATE_QFRC_APPLIED
    else:
        n, frames, kind = asked.trajectories, asked.frames or 200, mujoco.mjtState.mjSTATE_CTRL
        qpos = np.tile(d.qpos, (n, 1))
        qpos[:, q] += rng.uniform(-0.1, 0.1, (n, len(q)))
        qpos[:, q] = np.where(limited, np.clip(qpos[:, q], *m.jnt_range[order].T), qpos[:, q])
        states = np.concatenate([np.zeros((n, 1)), qpos, rng.normal(0.0, 0.1, (n, m.nv))], 1)
        low, high = np.where(m.actuator_ctrllimited[:, None], m.actuator_ctrlrange, [-1.0, 1.0]).T
        # A control is drawn where the one before has been held for as long as was drawn for it.
        controls, left = np.empty((n, frames, m.nu)), np.zeros(n, int)
        for frame in range(frames):
            new = (left == 0)[:, None]
            controls[:, frame] = np.where(new, rng.uniform(low, high, (n, m.nu)), controls[:, frame - 1])
            left = np.where(left == 0, rng.integers(1, asked.hold + 1, n), left) - 1
    states, torques, fine, seconds = roll(m, states, controls, asked.substeps, asked.threads, kind)
    rate = controls.shape[0] * controls.shape[1] / seconds
    some = slice(0, 16)
    alone = min(roll(m, states[some, 0], controls[some], asked.substeps, 1, kind)[3] for _ in range(3))
    cost = 1e6 * alone / (len(states[some]) * controls.shape[1])
    about = f"MuJoCo {mujoco.__version__}, {mujoco.mjtIntegrator(m.opt.integrator).name[6:]}, steps of {m.opt.timestep:.6g} s"
    log = f'about = "{about}"\ncost = {cost:.4g}\nfile = "log.npz"\nrobot = "robot.urdf"\nscene = "{"ground" if ground else "free"}"\n'
    columns = lambda name, first, many: str([f"{name}.{k}" for k in range(first, first + many)]).replace("'", '"')
    if free:
        root = list(m.jnt_type).index(mujoco.mjtJoint.mjJNT_FREE)
        place, speed = m.jnt_qposadr[root], m.jnt_dofadr[root]
        log += f'[root]\nposition = {columns("qpos", place, 3)}\nquaternion = {columns("qpos", place + 3, 4)}\norder = "wxyz"\n'
        log += f'velocity = {columns("qvel", speed, 3)}\nang_vel = {columns("qvel", speed + 3, 3)}\naxes = "body"\n'
    for k, n in enumerate(names):
        log += f'[[joint]]\nname = "{n}"\nposition = "qpos.{q[k]}"\nvelocity = "qvel.{v[k]}"\ntorque = "torque.{k}"\n'
    torques = controls[:, :, v] if asked.replay else torques[:, :, [m.sensor(f"torque of {n}").id for n in names]]
    # Nothing follows the last state.
    torques = np.pad(torques, ((0, 0), (0, 1), (0, 0)), constant_values=np.nan)
    asked.out.mkdir(parents=True, exist_ok=True)
    for file, content in [("robot.urdf", urdf), ("robot.toml", toml), ("log.toml", log)]:
        (asked.out / file).write_text(content)
    arrays = {"qpos": states[:, :, 1 : 1 + m.nq], "qvel": states[:, :, 1 + m.nq : 1 + m.nq + m.nv], "torque": torques}
    np.savez(asked.out / "log.npz", **{name: x[fine].astype(np.float32) for name, x in arrays.items()})
    print(f"{about}: {fine.sum()} trajectories of {controls.shape[1]} frames", f"({(~fine).sum()} blew up)" if not fine.all() else "")
    print(f"{rate:.0f} frames/s on {asked.threads} threads, {cost:.1f} us a frame on one")


if __name__ == "__main__":
    main()
