"""PPO in PyTorch on a card: thousands of robots, their task and the learner there, and nothing over the host but a line an iteration.

    python ppo_card.py ant-run --iterations 200
"""

import argparse
import time

import nerd
import torch
from torch import nn
from torch.distributions import Normal


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

    def forward(self, rows):
        rows = ((rows - self.mean) / torch.sqrt(self.var + 1e-5)).clamp(-5, 5)
        return Normal(self.actor(rows), self.log_std.exp()), self.critic(rows).squeeze(-1)


def rollout(env, agent, seen, horizon, scale=0.1, gamma=0.99):
    """So many steps of every environment. A reward, scaled, gets the value of what was reached where time ran out."""
    kept = []
    with torch.no_grad():
        for _ in range(horizon):
            law, value = agent(seen)
            before, action = seen.clone(), law.sample()
            next_seen, reward, terminated, truncated, infos = env.step(action)
            _, reached = agent(infos["final_obs"])
            worth = scale * reward + gamma * reached * truncated
            kept.append((before, action, law.log_prob(action).sum(1), value, worth, terminated | truncated, reward.clone()))
            seen = next_seen
    return [torch.stack(numbers) for numbers in zip(*kept)], seen


def update(agent, adam, seen, kept, gamma=0.99, lam=0.95, epochs=5, minibatches=4, clip=0.2):
    """What PPO learns of a rollout."""
    rows, actions, logs, values, rewards, ends = kept[:6]
    advantages, last = torch.zeros_like(rewards), 0.0
    with torch.no_grad():
        following = agent(seen)[1]
        for t in reversed(range(len(rows))):
            goes_on = ~ends[t]
            last = rewards[t] + goes_on * gamma * (following + lam * last) - values[t]
            advantages[t], following = last, values[t]
    rows, actions, logs, advantages, values = (x.flatten(0, 1) for x in (rows, actions, logs, advantages, values))
    returns, advantages = advantages + values, (advantages - advantages.mean()) / (advantages.std() + 1e-8)
    for _ in range(epochs):
        for part in torch.randperm(len(rows), device=rows.device).chunk(minibatches):
            law, value = agent(rows[part])
            ratio = (law.log_prob(actions[part]).sum(1) - logs[part]).exp()
            gain = torch.minimum(ratio * advantages[part], ratio.clamp(1 - clip, 1 + clip) * advantages[part])
            loss = -gain.mean() + 0.5 * (value - returns[part]).square().mean()
            adam.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(agent.parameters(), 1.0)
            adam.step()
    agent.see(rows)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("task", nargs="?", default="ant-run")
    parser.add_argument("--environments", type=int, default=4096)
    parser.add_argument("--horizon", type=int, default=16)
    parser.add_argument("--iterations", type=int, default=200)
    asked = parser.parse_args()
    env = nerd.make_vec(asked.task, n=asked.environments, device="cuda", xp=torch)
    seen, _ = env.reset(seed=0)
    agent = Agent(seen.shape[1], env.single_action_space.shape[0]).cuda()
    adam, started = torch.optim.Adam(agent.parameters(), lr=3e-4), time.time()
    for iteration in range(1, asked.iterations + 1):
        kept, seen = rollout(env, agent, seen, asked.horizon)
        update(agent, adam, seen, kept)
        if iteration % 10 == 0:
            steps = iteration * asked.horizon * asked.environments / (time.time() - started)
            print(f"iteration {iteration}: reward of a step {kept[6].mean():.3f}, {steps:.0f} steps/s, {env.failed()} failed")


if __name__ == "__main__":
    main()
