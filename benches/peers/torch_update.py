#!/usr/bin/env python3
"""Updates a second of the same DroQ update in PyTorch on the CPU, eager and, with `compile`, through torch.compile.

    benches/peers/torch_update.sh [seconds] [threads] [compile]
"""

import json
import math
import os
import sys
import time

seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 3.0
threads = int(sys.argv[2]) if len(sys.argv) > 2 else 1
compiled = "compile" in sys.argv[3:]
os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:threads])

import numpy as np
import torch
import torch.nn.functional as F

from droq_sizes import *

torch.set_num_threads(threads)


class Network(torch.nn.Module):
    def __init__(self, inputs, outputs, normalised):
        super().__init__()
        layers, width = [], inputs
        for hidden in HIDDEN:
            layers.append(torch.nn.Linear(width, hidden))
            if normalised:
                layers += [torch.nn.Dropout(DROPOUT), torch.nn.LayerNorm(hidden, eps=EPSILON)]
            layers.append(torch.nn.GELU(approximate="tanh"))
            width = hidden
        self.layers = torch.nn.Sequential(*layers, torch.nn.Linear(width, outputs))

    def forward(self, x):
        return self.layers(x)


def sample(actor, observation):
    mean, log_std = actor(observation).chunk(2, dim=-1)
    log_std = log_std.clamp(*LOG_STD)
    noise = torch.randn_like(mean)
    raw = mean + log_std.exp() * noise
    log_prob = -0.5 * noise**2 - log_std - 0.5 * math.log(2 * math.pi)
    log_prob = log_prob - 2 * (math.log(2) - raw - F.softplus(-2 * raw))
    return torch.tanh(raw), log_prob.sum(-1)


def main():
    torch.manual_seed(0)
    actor = Network(OBSERVATION, 2 * ACTION, False)
    critics = [Network(OBSERVATION + ACTION, 1, True) for _ in range(2)]
    targets = [Network(OBSERVATION + ACTION, 1, True).requires_grad_(False) for _ in range(2)]
    for target, critic in zip(targets, critics):
        target.load_state_dict(critic.state_dict())
    log_temperature = torch.zeros((), requires_grad=True)
    critic_parameters = [p for critic in critics for p in critic.parameters()]
    target_parameters = [p for target in targets for p in target.parameters()]
    adam = lambda parameters: torch.optim.Adam(parameters, lr=RATE, fused=True)
    critic_adam, actor_adam, temperature_adam = adam(critic_parameters), adam(actor.parameters()), adam([log_temperature])

    def critic_loss(batch):
        with torch.no_grad():
            action, log_prob = sample(actor, batch["next_observation"])
            x = torch.cat([batch["next_observation"], action], -1)
            low = torch.minimum(targets[0](x), targets[1](x))[:, 0]
            wanted = batch["reward"] + DISCOUNT * batch["continues"] * (low - log_temperature.exp() * log_prob)
        x = torch.cat([batch["observation"], batch["action"]], -1)
        return sum(((critic(x)[:, 0] - wanted) ** 2).mean() for critic in critics) / 2

    def actor_loss(batch):
        action, log_prob = sample(actor, batch["observation"])
        x = torch.cat([batch["observation"], action], -1)
        value = (critics[0](x) + critics[1](x))[:, 0] / 2
        return (log_temperature.exp().detach() * log_prob - value).mean(), -log_prob.detach().mean()

    if compiled:
        critic_loss, actor_loss = torch.compile(critic_loss), torch.compile(actor_loss)

    def update(batch):
        critic_adam.zero_grad()
        critic_loss(batch).backward()
        critic_adam.step()
        with torch.no_grad():
            torch._foreach_lerp_(target_parameters, critic_parameters, POLYAK)
        for parameter in critic_parameters:
            parameter.requires_grad_(False)
        loss, entropy = actor_loss(batch)
        actor_adam.zero_grad()
        loss.backward()
        actor_adam.step()
        for parameter in critic_parameters:
            parameter.requires_grad_(True)
        temperature_adam.zero_grad()
        (log_temperature.exp() * (entropy - TARGET_ENTROPY)).backward()
        temperature_adam.step()

    data = [{name: torch.from_numpy(value) for name, value in batch.items()} for batch in batches(np)]

    def repeat(limit):
        start, count = time.perf_counter(), 0
        while time.perf_counter() - start < limit:
            update(data[count % len(data)])
            count += 1
        return count / (time.perf_counter() - start)

    for batch in data[:2]:
        update(batch)
    repeat(1.0)
    peer = f"torch {torch.__version__}" + (" compiled" if compiled else "")
    print(json.dumps({"peer": peer, "threads": threads, "updates_per_sec": round(repeat(seconds), 1)}))


main()
