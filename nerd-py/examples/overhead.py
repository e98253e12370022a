"""Seconds of a frame and of a step of many Ants by loops in Python and in Rust, by turns in one run.

    cargo build --release -p nerd-py --example steps      # with `--features cuda` for a card
    python overhead.py cpu target/release/examples/steps
"""

import subprocess
import sys
import time

import nerd
import numpy as np

device, program = sys.argv[1:3]
n, frames, rounds = (int(word) for word in (sys.argv[3:] or ["4096", "20" if device == "cpu" else "500", "15"]))


def loops():
    """A frame and a step, and what waits for all of them."""
    if device == "cpu":
        simulation, env = nerd.Simulation("ant", n=n), nerd.make_vec("ant-run", n=n, autoreset_mode="SameStep")
        torques = actions = np.zeros((n, 8))
        wait = lambda: None
    else:
        import torch

        simulation = nerd.Simulation("ant", n=n, device="cuda", xp=torch)
        env = nerd.make_vec("ant-run", n=n, device="cuda", xp=torch)
        torques, actions = (torch.zeros(n, 8, dtype=kind, device="cuda") for kind in (torch.float64, torch.float32))
        wait = torch.cuda.synchronize
    env.reset(seed=0)
    return (lambda: simulation.step(torques)), (lambda: env.step(actions)), wait


def seconds(once, wait):
    started = time.perf_counter()
    for _ in range(frames):
        once()
    wait()
    return (time.perf_counter() - started) / frames


frame, step, wait = loops()
rust = subprocess.Popen([program, device, str(n), str(frames)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
found = []
for _ in range(rounds + 1):
    rust.stdin.write("\n")
    rust.stdin.flush()
    found.append([*map(float, rust.stdout.readline().split()), seconds(frame, wait), seconds(step, wait)])
rust.stdin.close()
# The first round warms up.
found = np.array(found[1:])
for what, own, ours in (("frame", 0, 2), ("step", 1, 3)):
    ratio = np.quantile(found[:, ours] / found[:, own], [0.25, 0.5, 0.75])
    print(
        f"{what}: Rust {1e3 * np.median(found[:, own]):.3f} ms, Python {1e3 * np.median(found[:, ours]):.3f} ms, "
        f"{n / np.median(found[:, ours]):.0f} environments/s; Python / Rust {ratio[1]:.3f} (quartiles {ratio[0]:.3f} to {ratio[2]:.3f})"
    )
