"""Seconds of a frame and of a step of many Ants by loops in Python and in Rust, by turns in one run; loop_card.py does so on a card.

    cargo build --release -p nerd-py --example steps
    python overhead.py target/release/examples/steps
"""

import subprocess
import sys
import time

import nerd
import numpy as np

program, n, frames, rounds = sys.argv[1], 4096, 20, 15
simulation, env, zeros = nerd.Simulation("ant", n=n), nerd.make_vec("ant-run", n=n, autoreset_mode="SameStep"), np.zeros((n, 8))
env.reset(seed=0)


def seconds(step):
    started = time.perf_counter()
    for _ in range(frames):
        step(zeros)
    return (time.perf_counter() - started) / frames


rust = subprocess.Popen([program, "cpu", str(n), str(frames)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
found = []
for _ in range(rounds + 1):
    print("", file=rust.stdin, flush=True)
    found.append([*map(float, rust.stdout.readline().split()), seconds(simulation.step), seconds(env.step)])
rust.stdin.close()
# The first round warms up.
found = np.array(found[1:])
for what, own, ours in (("frame", 0, 2), ("step", 1, 3)):
    ratio = np.quantile(found[:, ours] / found[:, own], [0.25, 0.5, 0.75])
    print(
        f"{what}: Rust {1e3 * np.median(found[:, own]):.3f} ms, Python {1e3 * np.median(found[:, ours]):.3f} ms, "
        f"{n / np.median(found[:, ours]):.0f} environments/s; Python / Rust {ratio[1]:.3f} (quartiles {ratio[0]:.3f} to {ratio[2]:.3f})"
    )
