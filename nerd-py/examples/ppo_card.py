"""PPO in PyTorch on a card: thousands of robots, their task and the learner there, and nothing over the host but a line an iteration.

    python ppo_card.py ant-run --iterations 200

What torch does between two steps is recorded once as a CUDA graph: kernel by kernel its launches take as long as the step itself. So
all memory stays in place, and noise is drawn outside of the graphs.
"""

import argparse
import time

import nerd
import torch
from torch import nn


def recorded(work):
    """Work that writes to the same memory in every call, as one launch; it is done three times before."""
    beside = torch.cuda.Stream()
    beside.wait_stream(torch.cuda.current_stream())
    with torch.cuda.stream(beside):
        for _ in range(3):
            work()
    torch.cuda.current_stream().wait_stream(beside)
    graph = torch.cuda.CUDAGraph()
    with torch.cuda.graph(graph):
        work()
    return graph.replay


def layers(*widths):
    pairs = [[nn.Linear(a, b), nn.ELU()] for a, b in zip(widths, widths[1:])]
    return nn.Sequential(*[layer for pair in pairs for layer in pair][:-1])


class Agent(nn.Module):
    """Actor and critic, and moments by which observations are normalised."""

    def __init__(self, observation, action):
        super().__init__()
        self.actor, self.critic = layers(observation, 256, 128, 64, action), layers(observation, 256, 128, 64, 1)
        self.log_std = nn.Parameter(torch.zeros(action))
        for name, start in (("mean", 0.0), ("var", 1.0), ("count", 1e-4)):
            self.register_buffer(name, torch.full(() if name == "count" else (observation,), start))

    def see(self, rows):
        mean, var, n = rows.mean(0), rows.var(0), rows.shape[0]
        all_, apart = self.count + n, mean - self.mean
        self.var.copy_((self.var * self.count + var * n + apart**2 * self.count * n / all_) / all_)
        self.mean.add_(apart * n / all_)
        self.count.copy_(all_)

    def normal(self, rows):
        return ((rows - self.mean) / torch.sqrt(self.var + 1e-5)).clamp(-5, 5)

    def act(self, rows, noise):
        return self.actor(self.normal(rows)) + self.log_std.exp() * noise

    def forward(self, rows, actions):
        """Logarithms of the actions' densities, but for a constant, and values."""
        rows = self.normal(rows)
        apart = (actions - self.actor(rows)) / self.log_std.exp()
        return -(0.5 * apart.square() + self.log_std).sum(-1), self.critic(rows).squeeze(-1)

    def value(self, rows):
        return self.critic(self.normal(rows)).squeeze(-1)


class Learner:
    """PPO with its memory, [horizon, environments, ..], and its work as graphs."""

    def __init__(self, env, horizon=16, minibatches=4, scale=0.1, gamma=0.99, lam=0.95, clip=0.2):
        self.env, self.horizon, self.minibatches = env, horizon, minibatches
        self.scale, self.gamma, self.lam, self.clip = scale, gamma, lam, clip
        self.seen, _ = env.reset(seed=0)
        (n, observation), action = self.seen.shape, env.single_action_space.shape[0]
        self.agent = Agent(observation, action).to(self.seen.device)
        self.adam = torch.optim.Adam(self.agent.parameters(), lr=3e-4, capturable=True)
        memory = lambda *last: torch.zeros(horizon, n, *last, device=self.seen.device)
        self.rows, self.reached, self.noise, self.actions = map(memory, (observation, observation, action, action))
        self.rewards, self.ends, self.cut, self.logs, self.advantages, self.returns = (memory() for _ in range(6))
        self.part = torch.arange(horizon * n // minibatches, device=self.seen.device)
        # Every step returns the same memory.
        _, *self.came, infos = env.step(self.actions[0])
        self.came.append(infos["final_obs"])
        env.reset(seed=0)
        self.between = [recorded(lambda t=t: self.keep_and_act(t)) for t in range(horizon + 1)]
        self.judged, self.improved = recorded(self.judge), None

    @torch.no_grad()
    def keep_and_act(self, t):
        """What came of the step before t, and actions for t."""
        if t > 0:
            reward, terminated, truncated, reached = self.came
            self.rewards[t - 1], self.ends[t - 1], self.cut[t - 1], self.reached[t - 1] = reward, terminated | truncated, truncated, reached
        if t < self.horizon:
            self.rows[t] = self.seen
            self.actions[t] = self.agent.act(self.seen, self.noise[t])

    def rollout(self):
        self.noise.normal_()
        for act, actions in zip(self.between, self.actions):
            act()
            self.env.step(actions)
        self.between[-1]()

    @torch.no_grad()
    def judge(self):
        """Advantages of a rollout. A reward, scaled, gets the value of what was reached where time ran out."""
        logs, values = self.agent(self.rows, self.actions)
        worth = self.scale * self.rewards + self.gamma * self.cut * self.agent.value(self.reached)
        following, last, goes_on = self.agent.value(self.seen), 0.0, self.gamma * (1 - self.ends)
        for t in reversed(range(self.horizon)):
            last = worth[t] + goes_on[t] * (following + self.lam * last) - values[t]
            self.advantages[t], following = last, values[t]
        self.logs.copy_(logs)
        self.returns.copy_(self.advantages + values)
        self.advantages.sub_(self.advantages.mean()).div_(self.advantages.std() + 1e-8)

    def improve(self):
        """What PPO learns of a part of the rows."""
        all_ = (self.rows, self.actions, self.logs, self.advantages, self.returns)
        rows, actions, before, advantages, returns = (x.flatten(0, 1)[self.part] for x in all_)
        logs, values = self.agent(rows, actions)
        ratio = (logs - before).exp()
        gain = torch.minimum(ratio * advantages, ratio.clamp(1 - self.clip, 1 + self.clip) * advantages)
        self.adam.zero_grad()
        (0.5 * (values - returns).square().mean() - gain.mean()).backward()
        nn.utils.clip_grad_norm_(self.agent.parameters(), 1.0)
        self.adam.step()

    def iteration(self, epochs=5):
        self.rollout()
        self.judged()
        self.improved = self.improved or recorded(self.improve)
        for _ in range(epochs):
            for part in torch.randperm(self.rewards.numel(), device=self.part.device).chunk(self.minibatches):
                self.part.copy_(part)
                self.improved()
        self.agent.see(self.rows.flatten(0, 1))


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("task", nargs="?", default="ant-run")
    parser.add_argument("--environments", type=int, default=4096)
    parser.add_argument("--iterations", type=int, default=200)
    asked = parser.parse_args()
    env = nerd.make_vec(asked.task, n=asked.environments, device="cuda", xp=torch)
    learner, started = Learner(env), time.time()
    for iteration in range(1, asked.iterations + 1):
        learner.iteration()
        if iteration % 10 == 0:
            steps = iteration * learner.rewards.numel() / (time.time() - started)
            print(f"iteration {iteration}: reward of a step {learner.rewards.mean():.3f}, {steps:.0f} steps/s, {env.failed()} failed")


if __name__ == "__main__":
    main()
