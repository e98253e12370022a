"""Prints MuJoCo's compilation of a file, masses and contacts, for `nerd_cli::mujoco::compiled`.

JSON in, JSON out, a line each: `answer`, or `error`. A line in: the `path` of an MJCF. The answer:
- `masses`: mass of each moving body with all bodies welded to it (kg), by name; `body3` is the unnamed body 3
- `geoms`: `name` (or ""), `body`, `place` among the body's geoms, and whether it `moves`
- `pairs`: indices of two geoms that may touch, at least one of them moving, and of their law
- `laws`: `condim`, `friction` (two sliding, one torsional, two rolling), `margin` (m), `solref`, `solimp`

Pairs and laws follow the manual (Computation: contact, selection and parameters); `gap` does not affect forces.
"""

import json
import sys

# A smaller `solmix` counts as 0.
SMALL = 1e-15


def say(answer, kind="answer"):
    print(json.dumps({kind: answer}), flush=True)


def compiled(mujoco, path):
    """Compiles a file and keeps every body and geom, so that they keep their indices."""
    spec = mujoco.MjSpec.from_file(path)
    spec.compiler.fusestatic = spec.compiler.discardvisual = False
    return spec.compile()


def softness(a, b):
    """Mixed solref and solimp of two geoms of equal priority."""
    x, y = a["solmix"], b["solmix"]
    share = x / (x + y) if x >= SMALL and y >= SMALL else 0.5 if x < SMALL and y < SMALL else float(x >= SMALL)
    mixed = {key: [share * p + (1 - share) * q for p, q in zip(a[key], b[key])] for key in ("solref", "solimp")}
    if a["solref"][0] <= 0 or b["solref"][0] <= 0:
        mixed["solref"] = [min(p, q) for p, q in zip(a["solref"], b["solref"])]
    return mixed


def of_geoms(a, b):
    """Contact law of two geoms by their own parameters."""
    if a["priority"] != b["priority"]:
        best = max(a, b, key=lambda geom: geom["priority"])
        condim, (slide, spin, roll) = best["condim"], best["friction"]
        soft = {key: best[key] for key in ("solref", "solimp")}
    else:
        condim = max(a["condim"], b["condim"])
        slide, spin, roll = (max(p, q) for p, q in zip(a["friction"], b["friction"]))
        soft = softness(a, b)
    return dict(condim=condim, friction=[slide, slide, spin, roll, roll], margin=a["margin"] + b["margin"], **soft)


def facts(mujoco, model):
    names = [model.body(i).name or ("world" if i == 0 else f"body{i}") for i in range(model.nbody)]
    weld, parent = model.body_weldid.tolist(), model.body_parentid.tolist()
    moves = [bool(model.body_dofnum[weld[i]]) for i in range(model.nbody)]
    above = [weld[parent[weld[i]]] for i in range(model.nbody)]
    masses = {names[i]: 0.0 for i in range(model.nbody) if moves[i] and weld[i] == i}
    for i in filter(lambda i: moves[i], range(model.nbody)):
        masses[names[weld[i]]] += float(model.body_mass[i])
    geoms, own = [], []
    for g in range(model.ngeom):
        body = int(model.geom_bodyid[g])
        place = g - int(model.body_geomadr[body])
        geoms.append(dict(name=model.geom(g).name, body=names[body], place=place, moves=moves[body]))
        lists = {key: getattr(model, "geom_" + key)[g].tolist() for key in ("friction", "solref", "solimp")}
        numbers = {key: getattr(model, "geom_" + key)[g].item() for key in ("condim", "priority", "margin", "solmix")}
        own.append(dict(body=body, bits=(int(model.geom_contype[g]), int(model.geom_conaffinity[g])), **lists, **numbers))
    return dict(masses=masses, geoms=geoms, **contacts(mujoco, model, own, weld, above, moves))


def contacts(mujoco, model, geoms, weld, above, moves):
    """Geom pairs that may touch, and their laws."""
    off = int(mujoco.mjtDisableBit.mjDSBL_CONTACT) | int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    parents = model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_FILTERPARENT)
    override = model.opt.enableflags & int(mujoco.mjtEnableBit.mjENBL_OVERRIDE)
    excluded = {tuple(sorted((int(s) >> 16, int(s) & 0xFFFF))) for s in model.exclude_signature}
    listed = {}
    for k in range(model.npair):
        pair = tuple(sorted((int(model.pair_geom1[k]), int(model.pair_geom2[k]))))
        law = {key: getattr(model, "pair_" + key)[k].tolist() for key in ("friction", "solref", "solimp")}
        listed.setdefault(pair, dict(condim=int(model.pair_dim[k]), margin=float(model.pair_margin[k]), **law))
    laws, pairs = {}, []
    if model.opt.disableflags & off:
        return dict(laws=[], pairs=[])
    touching = [g for g, geom in enumerate(geoms) if any(geom["bits"]) or any(g in pair for pair in listed)]
    for n, b in enumerate(touching):
        for a in touching[:n]:
            one, two = geoms[a], geoms[b]
            p, q = weld[one["body"]], weld[two["body"]]
            if p == q or not (moves[one["body"]] or moves[two["body"]]):
                continue
            law = listed.get((a, b))
            if law is None:
                kin = not parents and p and q and (above[one["body"]] == q or above[two["body"]] == p)
                apart = tuple(sorted((one["body"], two["body"]))) in excluded
                met = one["bits"][0] & two["bits"][1] or two["bits"][0] & one["bits"][1]
                if kin or apart or not met:
                    continue
                law = of_geoms(one, two)
            if override:
                option = {key: getattr(model.opt, "o_" + key) for key in ("friction", "solref", "solimp")}
                law = dict(condim=law["condim"], margin=float(model.opt.o_margin), **{key: x.tolist() for key, x in option.items()})
            key = json.dumps(law)
            pairs.append([a, b, laws.setdefault(key, len(laws))])
    return dict(laws=[json.loads(law) for law in laws], pairs=pairs)


def main():
    try:
        import mujoco
    except ImportError as error:
        return say(f"no MuJoCo here ({error}); name a Python that has it", "error")
    mujoco.set_mju_user_warning(lambda text: None)
    for line in sys.stdin:
        try:
            say(facts(mujoco, compiled(mujoco, json.loads(line)["path"])))
        except Exception as error:
            say(f"MuJoCo: {error}", "error")


if __name__ == "__main__":
    main()
