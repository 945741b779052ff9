#!/usr/bin/env python3
"""Golden numbers for crates/learn, from an independent implementation in PyTorch.

    python3 -m venv /tmp/venv-learn
    /tmp/venv-learn/bin/pip install torch numpy safetensors
    /tmp/venv-learn/bin/python scripts/golden_learn.py

Writes crates/learn/tests/golden/{plain,dropout}.safetensors: parameters before, one batch per
update, the noise and (dropout) the masks of every pass, and what PyTorch's autograd and Adam make
of them: losses and gradients of the first update, parameters and targets after the first and after
the last. The networks are computed in double precision, so that the numbers are exact for a test in
single precision. Everything is drawn from fixed seeds; run twice, same bytes.
"""

import math
import pathlib

import numpy as np
import torch
import torch.nn.functional as F
from safetensors.numpy import save_file

REAL, BINARY, ACTION = 5, 40, 3
HIDDEN = [20, 12, 16]
BATCH, UPDATES = 8, 5
DISCOUNT, POLYAK, RATE = 0.8, 0.05, 3e-3
LOG_STD = (-1.5, 0.1)  # Narrow, so that the clip acts on some rows.
TARGET_ENTROPY = -0.5 * ACTION
EPSILON = 1e-6
torch.set_default_dtype(torch.float64)


def layer_sizes(inputs, outputs):
    widths = [inputs, *HIDDEN]
    return list(zip(widths[:-1], widths[1:])), (HIDDEN[-1], outputs)


def make_network(generator, inputs, outputs, normalised):
    """Parameters by name; weights [inputs, outputs]. Biases and norms are random too, so that no
    gradient is hidden."""
    hidden, head = layer_sizes(inputs, outputs)
    normal = lambda *shape: torch.tensor(generator.normal(size=shape).astype(np.float32), dtype=torch.float64)
    parameters = {}
    for index, (i, o) in enumerate(hidden):
        parameters[f"layer{index}.weight"] = normal(i, o) / math.sqrt(i)
        parameters[f"layer{index}.bias"] = 0.1 * normal(o)
        if normalised:
            parameters[f"layer{index}.norm_scale"] = 1 + 0.1 * normal(o)
            parameters[f"layer{index}.norm_shift"] = 0.1 * normal(o)
    parameters["head.weight"] = normal(*head) / math.sqrt(head[0])
    parameters["head.bias"] = 0.1 * normal(head[1])
    rounded = {name: value.float().double() for name, value in parameters.items()}
    return {name: value.clone().requires_grad_() for name, value in rounded.items()}


def run(parameters, x, masks=None, rate=0.0):
    """masks: one [batch, width] array of kept units (0 or 1) per hidden layer; None for actors."""
    for index in range(len(HIDDEN)):
        p = lambda name: parameters[f"layer{index}.{name}"]
        x = x @ p("weight") + p("bias")
        if masks is not None:
            x = x * masks[index] / (1 - rate)
            x = F.layer_norm(x, (x.shape[-1],), p("norm_scale"), p("norm_shift"), EPSILON)
        x = F.gelu(x, approximate="tanh")
    return x @ parameters["head.weight"] + parameters["head.bias"]


def sample(actor, observation, noise):
    mean, log_std = run(actor, observation).chunk(2, dim=-1)
    log_std = log_std.clamp(*LOG_STD)
    raw = mean + log_std.exp() * noise
    action = torch.tanh(raw)
    density = torch.distributions.Normal(mean, log_std.exp()).log_prob(raw)
    squash = 2 * (math.log(2) - raw - F.softplus(-2 * raw))
    return action, (density - squash).sum(-1)


def critic_input(observation, action):
    """Rows of a critic's first weight: real columns, action, binary columns."""
    return torch.cat([observation[:, :REAL], action, observation[:, REAL:]], dim=-1)


def golden(rate, seed):
    generator = np.random.default_rng(seed)
    out = {}

    def put(name, value):
        out[name] = np.ascontiguousarray(np.asarray(value.detach() if torch.is_tensor(value) else value), dtype=np.float32)

    def draw(*shape):
        return generator.normal(size=shape).astype(np.float32).astype(np.float64)

    actor = make_network(generator, REAL + BINARY, 2 * ACTION, False)
    critics = [make_network(generator, REAL + ACTION + BINARY, 1, True) for _ in range(2)]
    targets = [{name: (value.detach() + 0.05 * torch.tensor(draw(*value.shape))).float().double() for name, value in c.items()} for c in critics]
    log_temperature = torch.tensor(float(np.float32(math.log(0.3))), requires_grad=True)
    networks = {"actor.parameters": actor, "critic0.parameters": critics[0], "critic1.parameters": critics[1], "critic0.target": targets[0], "critic1.target": targets[1]}

    def put_state(when):
        for prefix, parameters in networks.items():
            for name, value in parameters.items():
                put(f"{when}.{prefix}.{name}", value)
        put(f"{when}.log_temperature", log_temperature.reshape(1))

    put_state("before")
    adam = lambda values: torch.optim.Adam(values, lr=RATE)
    actor_adam, temperature_adam = adam(list(actor.values())), adam([log_temperature])
    critic_adam = adam([value for critic in critics for value in critic.values()])

    def observations():
        return np.concatenate([draw(BATCH, REAL), (generator.random((BATCH, BINARY)) < 0.1).astype(np.float64)], axis=1)

    for update in range(UPDATES):
        batch = {
            "observation": observations(),
            "next_observation": observations(),
            "action": np.tanh(draw(BATCH, ACTION)).astype(np.float32).astype(np.float64),
            "reward": draw(BATCH),
            "continues": (generator.random(BATCH) < 0.8).astype(np.float64),
            "next_noise": draw(BATCH, ACTION),
            "noise": draw(BATCH, ACTION),
        }
        masks = {}
        for critic in range(2):
            for use in ["target", "online", "actor"]:
                masks[critic, use] = [(generator.random((BATCH, w)) >= rate).astype(np.float64) for w in HIDDEN]
                for layer, mask in enumerate(masks[critic, use]):
                    put(f"update{update}.mask.critic{critic}.{use}.{layer}", mask)
        for name, value in batch.items():
            put(f"update{update}.{name}", value)
        b = {name: torch.tensor(value) for name, value in batch.items()}
        masks = {key: [torch.tensor(mask) for mask in value] for key, value in masks.items()}
        q = lambda parameters, index, use, o, a: run(parameters, critic_input(o, a), masks[index, use], rate)[:, 0]
        temperature = log_temperature.exp().detach()

        with torch.no_grad():
            next_action, next_log_prob = sample(actor, b["next_observation"], b["next_noise"])
            low = torch.minimum(*[q(targets[i], i, "target", b["next_observation"], next_action) for i in range(2)])
            wanted = b["reward"] + DISCOUNT * b["continues"] * (low - temperature * next_log_prob)
        values = torch.stack([q(critics[i], i, "online", b["observation"], b["action"]) for i in range(2)])
        critic_loss = ((values - wanted) ** 2).mean()
        critic_adam.zero_grad()
        critic_loss.backward()
        gradients = {f"critic{i}.{name}": value.grad.clone() for i in range(2) for name, value in critics[i].items()}
        critic_adam.step()
        with torch.no_grad():
            for critic, target in zip(critics, targets):
                for name, value in target.items():
                    value += POLYAK * (critic[name] - value)

        action, log_prob = sample(actor, b["observation"], b["noise"])
        judged = torch.stack([q(critics[i], i, "actor", b["observation"], action) for i in range(2)])
        actor_loss = (temperature * log_prob - judged.mean(0)).mean()
        actor_adam.zero_grad()
        actor_loss.backward()
        gradients |= {f"actor.{name}": value.grad.clone() for name, value in actor.items()}
        actor_adam.step()

        entropy = -log_prob.detach().mean()
        temperature_loss = (log_temperature.exp() * (entropy - TARGET_ENTROPY)).mean()
        temperature_adam.zero_grad()
        temperature_loss.backward()
        temperature_adam.step()

        put(f"update{update}.losses", np.array([critic_loss.item(), actor_loss.item(), temperature_loss.item(), entropy.item(), values.mean().item()]))
        if update == 0:
            for name, value in gradients.items():
                put(f"gradient.{name}", value)
            put_state("first")
    put_state("last")
    metadata = {"dropout": str(rate), "torch": torch.__version__, "updates": str(UPDATES)}
    return out, metadata


def main():
    folder = pathlib.Path(__file__).resolve().parent.parent / "crates/learn/tests/golden"
    folder.mkdir(parents=True, exist_ok=True)
    for name, rate, seed in [("plain", 0.0, 1), ("dropout", 0.1, 2)]:
        tensors, metadata = golden(rate, seed)
        path = folder / f"{name}.safetensors"
        save_file(dict(sorted(tensors.items())), path, {"made_by": "scripts/golden_learn.py"})
        path.chmod(0o644)
        print(path, path.stat().st_size, metadata)


if __name__ == "__main__":
    main()
