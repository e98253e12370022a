"""Examples are run, shorter than they are meant."""

import json

import numpy as np
import pytest


def test_the_notebook_runs(root, capsys):
    for library in ("stable_baselines3", "torch"):
        pytest.importorskip(library)
    notebook = json.loads((root / "nerd-py/examples/tour.ipynb").read_text(encoding="utf-8"))
    code = "\n".join("".join(cell["source"]) for cell in notebook["cells"])
    assert "learn(300_000)" in code and "n_eval_episodes=256" in code
    names = {}
    exec(code.replace("300_000", "4096").replace("256", "2"), names)  # noqa: S102 - it is ours
    apart = np.abs(names["one"].poses(names["tip"]) - names["two"].poses(names["tip"]))[:, :3].max()
    assert 0 < apart < 0.1 and names["push"].grad[0, 0] != 0, (apart, names["push"].grad)
    assert capsys.readouterr().out.count(":") == 3
