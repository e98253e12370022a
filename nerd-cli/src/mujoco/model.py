"""The MuJoCo model in which a policy plays, and its settings: concatenated before `player.py`."""

import math


class Model:
    """The robot as MJCF: our `mjcf`, or the `path` of its own file, whose ground must match `planes`."""

    def __init__(self, mujoco, request):
        self.mujoco, contract, path = mujoco, request["contract"], request.get("path")
        self.ground = "its own"
        self.model = mujoco.MjModel.from_xml_path(path) if path else mujoco.MjModel.from_xml_string(request["mjcf"])
        if path and request["planes"]:
            self.stand(path, request["planes"], request["scene"])
        model = self.model
        if not path:
            model.opt.timestep = contract["frame_time"] / request["substeps"]
        self.joint = self.joints(contract["joints"])
        # If the file has several free bodies, take the root of the robot's joints.
        tree = {int(model.body_rootid[model.jnt_bodyid[k]]) for k in self.joint.values()}
        free = [k for k in range(model.njnt) if model.jnt_type[k] == mujoco.mjtJoint.mjJNT_FREE]
        free = [k for k in free if not tree or int(model.body_rootid[model.jnt_bodyid[k]]) in tree][:1]
        self.root = (int(model.jnt_qposadr[free[0]]), int(model.jnt_dofadr[free[0]])) if free else None
        at, dof = self.root or (0, 0)
        self.place = (list(range(at, at + 7)) if free else []) + [int(model.jnt_qposadr[k]) for k in self.joint.values()]
        self.rate = (list(range(dof, dof + 6)) if free else []) + [int(model.jnt_dofadr[k]) for k in self.joint.values()]
        self.actuators = self.servos(contract)
        if not self.actuators:
            model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ACTUATION
            # Without actuators of the file, servos are torques of each step, and kd is joint damping.
            for action in contract["action"] if contract["law"].get("servo") else []:
                model.dof_damping[model.jnt_dofadr[self.joint[action["joint"]]]] += action["kd"]
        self.servo = contract["law"].get("servo", False)
        self.friction, self.solref, self.solimp, self.condim, self.own = [], [], [], [], False

    def still(self):
        """Geoms of the world that may touch something."""
        model = self.model
        paired = set(model.pair_geom1.tolist() + model.pair_geom2.tolist())
        touches = lambda g: model.geom_contype[g] or model.geom_conaffinity[g] or g in paired
        return [g for g in range(model.ngeom) if model.body_weldid[model.geom_bodyid[g]] == 0 and touches(g)]

    def stand(self, path, planes, scene):
        """Adds the task's ground if the file has none, and refuses a file with another ground."""
        mujoco, still = self.mujoco, self.still()
        if not still:
            spec = mujoco.MjSpec.from_file(path)
            for plane in planes:
                spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], pos=plane["pos"], quat=plane["quat"])
            self.model, self.ground = spec.compile(), "a plane of MuJoCo's defaults, since the file has none"
            return
        data = mujoco.MjData(self.model)
        mujoco.mj_kinematics(self.model, data)
        flat = [g for g in still if self.model.geom_type[g] == mujoco.mjtGeom.mjGEOM_PLANE]
        theirs = [(data.geom_xmat[g].reshape(3, 3)[:, 2], data.geom_xpos[g]) for g in flat]
        same = lambda p, normal, place: abs(normal @ p["normal"] - 1) < 1e-6 and abs(place @ p["normal"] - p["offset"]) < 1e-6
        if flat and not any(same(p, *own) for p in planes for own in theirs):
            raise ValueError(f"no plane of the file is the ground of the task's scene `{scene}`; train on the file's own ground")

    def joints(self, names):
        """Joint indices by the contract's names; an unnamed joint is BODY.INDEX."""
        model, mujoco, known = self.model, self.mujoco, {}
        name = lambda kind, k: mujoco.mj_id2name(model, kind, k)
        for k in range(model.njnt):
            body = int(model.jnt_bodyid[k])
            own = name(mujoco.mjtObj.mjOBJ_BODY, body) or f"body{body}"
            known[name(mujoco.mjtObj.mjOBJ_JOINT, k) or f"{own}.{k - model.body_jntadr[body]}"] = k
        for missing in [one for one in names if one not in known]:
            raise ValueError(f"the model has no joint {missing}")
        return {one: known[one] for one in names}

    def servos(self, contract):
        """Control index and gear of each joint's position actuator; empty unless every action matches one with the
        contract's gains."""
        model, mujoco, found = self.model, self.mujoco, {}
        if contract["law"]["kind"] != "position" or contract["law"]["relative"]:
            return found
        on = {}
        at_joints = [kind.value for kind in (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)]
        for i, (kind, target) in enumerate(zip(model.actuator_trntype, model.actuator_trnid[:, 0])):
            if kind in at_joints:
                on.setdefault(int(target), []).append(i)
        alike = lambda a, b: abs(a - b) <= 1e-6 * max(abs(a), abs(b), 1e-9)
        for action in contract["action"]:
            acting = on.get(self.joint[action["joint"]], [])
            if len(acting) != 1:
                return {}
            i = acting[0]
            gear, gain, (_, kp, kd) = model.actuator_gear[i, 0], model.actuator_gainprm[i, 0], -model.actuator_biasprm[i, :3]
            affine = model.actuator_gaintype[i] == mujoco.mjtGain.mjGAIN_FIXED and model.actuator_biastype[i] == mujoco.mjtBias.mjBIAS_AFFINE
            if not affine or not alike(gain, kp) or not alike(kp * gear**2, action["kp"]) or not alike(kd * gear**2, action["kd"]):
                return {}
            # An actuator may have several controls.
            first = model.actuator_ctrladr[i] if hasattr(model, "actuator_ctrladr") else i
            found[action["joint"]] = (int(first), float(gear))
        return found

    def follow(self, data):
        """Moves joints that follow others by an equality to their required positions."""
        model, joint = self.model, self.mujoco.mjtEq.mjEQ_JOINT
        for k in range(model.neq):
            one, two = int(model.eq_obj1id[k]), int(model.eq_obj2id[k])
            if model.eq_type[k] == joint and model.eq_active0[k] and two >= 0:
                at, of = model.jnt_qposadr[one], model.jnt_qposadr[two]
                x = data.qpos[of] - model.qpos0[of]
                data.qpos[at] = model.qpos0[at] + sum(c * x**n for n, c in enumerate(model.eq_data[k, :5]))

    def watch(self, data):
        """Extends the recorded bounds on the parameters of contacts with the world."""
        if not data.ncon:
            return
        contact = data.contact
        world = (self.model.body_weldid[self.model.geom_bodyid[contact.geom]] == 0).any(axis=1)
        self.own |= not world.all()
        if not world.any():
            return
        for kept, seen in (self.friction, contact.friction[:, :1]), (self.solref, contact.solref), (self.solimp, contact.solimp):
            low, high = seen[world].min(axis=0).tolist(), seen[world].max(axis=0).tolist()
            kept[:] = [[min(a, c), max(b, d)] for (a, b), c, d in zip(kept or zip(low, high), low, high)]
        self.condim[:] = sorted({*self.condim, *contact.dim[world].tolist()})

    def settings(self):
        """Settings of the simulation; contact parameters are of contacts with the world that occurred."""
        option, mujoco = self.model.opt, self.mujoco
        word = lambda kind, number: kind(int(number)).name.split("_", 1)[1].lower()
        return {
            "timestep": option.timestep,
            "integrator": word(mujoco.mjtIntegrator, option.integrator),
            "cone": word(mujoco.mjtCone, option.cone),
            "solver": word(mujoco.mjtSolver, option.solver),
            "impratio": option.impratio,
            "gravity": option.gravity.tolist(),
            "condim": self.condim,
            "friction": self.friction,
            "solref": self.solref,
            "solimp": self.solimp,
            "armature": [float(self.model.dof_armature[self.model.jnt_dofadr[k]]) for k in self.joint.values()],
            "control": "position actuators" if self.actuators else "torques of each step" if self.servo else "torques",
            "self_contact": bool(self.own),
            "ground": self.ground,
        }
