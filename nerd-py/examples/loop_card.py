"""Steps a second of Ants on a card whose policy is PyTorch's, beside our own stepping in the same run, and what is copied to the host.

    cargo build --release -p nerd-py --example steps --features cuda
    python loop_card.py target/release/examples/steps [--short]
"""

import itertools
import statistics
import subprocess
import sys
import time

import nerd
import torch
from ppo_card import Learner, recorded
from torch.distributions import Normal
from torch.profiler import ProfilerActivity, profile

program, short = sys.argv[1], "--short" in sys.argv
times, rounds = (100, 3) if short else (200, 7)


def seconds(work, times=times):
    torch.cuda.synchronize()
    started = time.perf_counter()
    for _ in range(times):
        work()
    torch.cuda.synchronize()
    return (time.perf_counter() - started) / times


def copies(what, work):
    """What the profiler sees on the card."""
    torch.cuda.synchronize()
    with profile(activities=[ProfilerActivity.CPU, ProfilerActivity.CUDA]) as seen:
        work()
        torch.cuda.synchronize()
    names = [event.name for event in seen.events() if "cuda" in str(event.device_type).lower()]
    found = {way: sum(f"memcpy {way}" in name.lower() for name in names) for way in ("htod", "dtoh", "dtod")}
    waits = sum(event.name in ("cudaStreamSynchronize", "cudaEventSynchronize") for event in seen.events())
    print(f"  {what}: {len(names)} pieces of work on the card, copies {found}, waits of the host {waits}", flush=True)


def measure(n, solver):
    env = nerd.make_vec("ant-run", n=n, solver=solver, device="cuda", xp=torch)
    learner = Learner(env)
    agent, seen, fixed = learner.agent, learner.seen, torch.zeros_like(learner.actions[0])
    noise, actions = torch.randn_like(fixed), torch.zeros_like(fixed)
    # Ants that are driven cost more to step than those that rest: what a policy leaves of stepping is seen under actions like its own.
    drawn = torch.randn(times, *fixed.shape, device="cuda") * agent.log_std.exp().detach()
    turn = itertools.cycle(drawn)

    @torch.no_grad()
    def policy(act=agent.act):
        noise.normal_()
        actions.copy_(act(seen, noise))

    @torch.no_grad()
    def recordable():
        actions.copy_(agent.act(seen, noise))

    @torch.no_grad()
    def usual():
        """As most loops have it: the distribution checks its numbers, for which the host waits."""
        actions.copy_(Normal(agent.actor(agent.normal(seen)), agent.log_std.exp()).sample())

    graph = recorded(recordable)
    replayed = lambda: (noise.normal_(), graph())
    and_step = lambda work: lambda: (work(), env.step(actions))
    rows = {
        "env.step, no actions": lambda: env.step(fixed),
        "env.step, drawn actions": lambda: env.step(next(turn)),
        "policy alone, kernel by kernel": policy,
        "policy alone, a graph": replayed,
        "env.step and torch.distributions": and_step(usual),
        "env.step and policy, kernel by kernel": and_step(policy),
        "env.step and policy, a graph": and_step(replayed),
    }
    if not short:
        try:
            compiled = torch.compile(agent.act)
            policy(compiled)
            rows["env.step and policy, torch.compile"] = and_step(lambda: policy(compiled))
        except Exception as error:
            print(f"  no torch.compile: {type(error).__name__}")
    # Each is a horizon of steps.
    whole = {"env.step, policy, all kept": learner.rollout, "whole loop of PPO": learner.iteration}
    rust = subprocess.Popen([program, "cuda", str(n), str(times)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    own, found = [], {name: [] for name in [*rows, *whole]}
    for _ in range(rounds + 1):
        if solver == "articulated":
            print("", file=rust.stdin, flush=True)
            own.append(float(rust.stdout.readline().split()[-1]))
        for name, work in rows.items():
            found[name].append(seconds(work))
        for name, work in whole.items():
            found[name].append(seconds(work, times // 10) / learner.horizon)
    rust.stdin.close()
    # The first round warms up.
    middle = lambda seconds: statistics.median(seconds[1:])
    steps = {**({"Rust, no actions": own} if own else {}), **found}
    base = middle(found["env.step, drawn actions"])
    print(f"{n} Ants, {solver}, {rounds} rounds by turns of {times}; {env.failed()} episodes failed", flush=True)
    for name, took in steps.items():
        share = "" if "alone" in name else f"{n / middle(took):11.0f} steps/s {100 * base / middle(took):6.1f} % of stepping under drawn actions"
        print(f"  {name:38} {1e3 * middle(took):7.3f} ms ({1e3 * min(took[1:]):.3f} to {1e3 * max(took[1:]):.3f}) {share}", flush=True)
    step = and_step(replayed)
    copies("50 steps with a graph", lambda: [step() for _ in range(50)])
    copies("an iteration of PPO", learner.iteration)


print(torch.cuda.get_device_name(), "torch", torch.__version__, flush=True)
for n, solver in [(4096, "articulated")] if short else [(4096, "articulated"), (4096, "neural"), (16384, "articulated")]:
    measure(n, solver)
