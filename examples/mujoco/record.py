"""Records MuJoCo into trajectories that NeRD learns from: `python record.py ant.xml out/ant` (needs `pip install mujoco`).

Writes robot.urdf, robot.toml (what a URDF cannot say), data/*.csv (an episode each) and log.toml (which column is what). Controls are random
and held for a few frames. Hinges and slides, one free body at most, a plane as ground; spheres, capsules, cylinders and boxes touch.
"""

import argparse
import csv
import pathlib

import mujoco
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
            at = origin(place + matrix(quat) @ here, quat) if k == 0 else origin(here - anchor)
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
    head = f'like = "urdf"\nfloating = {str(bool(free)).lower()}\nframe_time = {frame_time}\ngravity = {m.opt.gravity.tolist()}\n'
    own += [f'[[scene]]\nname = "ground"\nplane = {{ height = {m.geom_pos[g][2]}, angles = [0.0, 0.0, 0.0] }}\n' for g in planes[:1]]
    return urdf, head + "".join(own), order, [name("JOINT", j) for j in order], bool(free), bool(planes)


def main():
    ask = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ask.add_argument("model", type=pathlib.Path, help="MJCF file")
    ask.add_argument("out", type=pathlib.Path, help="folder to write")
    numbers = {"episodes": (100, ""), "frames": (200, "of an episode"), "skip": (5, "steps of MuJoCo in a frame"), "seed": (0, "")}
    numbers["hold"] = (8, "most frames for which a control is held")
    for option, (default, help) in numbers.items():
        ask.add_argument(f"--{option}", type=int, default=default, help=help)
    asked = ask.parse_args()
    m = mujoco.MjModel.from_xml_path(str(asked.model))
    d, rng, frame_time = mujoco.MjData(m), np.random.default_rng(asked.seed), asked.skip * m.opt.timestep
    urdf, toml, order, names, free, ground = robot(m, frame_time)
    log = f'file = "data"\nrobot = "robot.urdf"\nscene = "{"ground" if ground else "free"}"\ntime = "t"\n'
    if free:
        log += '[root]\nposition = ["px", "py", "pz"]\nquaternion = ["qw", "qx", "qy", "qz"]\norder = "wxyz"\n'
        log += 'velocity = ["vx", "vy", "vz"]\nangular = ["wx", "wy", "wz"]\naxes = "body"\n'
    for n in names:
        log += f'[[joint]]\nname = "{n}"\nposition = "q_{n}"\nvelocity = "qd_{n}"\ntorque = "tau_{n}"\n'
    (asked.out / "data").mkdir(parents=True, exist_ok=True)
    for file, content in [("robot.urdf", urdf), ("robot.toml", toml), ("log.toml", log)]:
        (asked.out / file).write_text(content)
    q, v, limited = m.jnt_qposadr[order], m.jnt_dofadr[order], m.jnt_limited[order].astype(bool)
    root = "px,py,pz,qw,qx,qy,qz,vx,vy,vz,wx,wy,wz".split(",") if free else []
    header = ["t", *root, *(f"{what}_{n}" for what in ("q", "qd", "tau") for n in names)]
    low, high = np.where(m.actuator_ctrllimited[:, None], m.actuator_ctrlrange, [-1.0, 1.0]).T
    for episode in range(asked.episodes):
        mujoco.mj_resetData(m, d)
        start = d.qpos[q] + rng.uniform(-0.1, 0.1, len(order))
        d.qpos[q] = np.where(limited, np.clip(start, *m.jnt_range[order].T), start)
        d.qvel[:] = rng.normal(0.0, 0.1, m.nv)
        with open(asked.out / "data" / f"{episode:05}.csv", "w", newline="") as file:
            table, left = csv.writer(file), 0
            table.writerow(header)
            for frame in range(asked.frames + 1):
                state = [frame * frame_time, *(d.qpos[:7] if free else []), *(d.qvel[:6] if free else []), *d.qpos[q], *d.qvel[v]]
                torques = np.zeros(len(order))
                if left == 0:
                    d.ctrl[:], left = rng.uniform(low, high), int(rng.integers(1, asked.hold + 1))
                left -= 1
                for _ in range(asked.skip):
                    mujoco.mj_step(m, d)
                    torques += d.qfrc_actuator[v] / asked.skip
                # Nothing follows the last state.
                cells = [f"{x:.6g}" for x in torques] if frame < asked.frames else [""] * len(order)
                table.writerow([*(f"{x:.9g}" for x in state), *cells])


if __name__ == "__main__":
    main()
