#!/usr/bin/env python3
"""Updates a second of the same DroQ update in JAX, jitted, on the CPU. Compilation is not measured.

    benches/peers/jax_update.sh [seconds] [threads]
"""

import json
import math
import os
import sys
import time

seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 3.0
threads = int(sys.argv[2]) if len(sys.argv) > 2 else 1
# XLA takes its number of threads from the processors that the process may use.
os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:threads])
os.environ["JAX_PLATFORMS"] = "cpu"

import jax
import jax.numpy as jnp
import numpy as np

from droq_sizes import *


def make_network(key, inputs, outputs, normalised):
    widths = [inputs, *HIDDEN, outputs]
    layers = []
    for index, (i, o) in enumerate(zip(widths[:-1], widths[1:])):
        key, use = jax.random.split(key)
        limit = math.sqrt(6 / (i + o))
        layer = {"w": jax.random.uniform(use, (i, o), minval=-limit, maxval=limit), "b": jnp.zeros(o)}
        if normalised and index < len(HIDDEN):
            layer |= {"scale": jnp.ones(o), "shift": jnp.zeros(o)}
        layers.append(layer)
    return layers


def run(layers, x, key=None):
    for index, layer in enumerate(layers[:-1]):
        x = x @ layer["w"] + layer["b"]
        if key is not None:
            keep = jax.random.bernoulli(jax.random.fold_in(key, index), 1 - DROPOUT, x.shape)
            x = jnp.where(keep, x / (1 - DROPOUT), 0)
            x = x - x.mean(-1, keepdims=True)
            x = x * jax.lax.rsqrt((x * x).mean(-1, keepdims=True) + EPSILON)
            x = x * layer["scale"] + layer["shift"]
        x = jax.nn.gelu(x, approximate=True)
    return x @ layers[-1]["w"] + layers[-1]["b"]


def sample(actor, observation, key):
    mean, log_std = jnp.split(run(actor, observation), 2, axis=-1)
    log_std = jnp.clip(log_std, *LOG_STD)
    noise = jax.random.normal(key, mean.shape)
    raw = mean + jnp.exp(log_std) * noise
    log_prob = -0.5 * noise**2 - log_std - 0.5 * math.log(2 * math.pi)
    log_prob -= 2 * (math.log(2) - raw - jax.nn.softplus(-2 * raw))
    return jnp.tanh(raw), log_prob.sum(-1)


def adam(state, parameters, gradient, step):
    mean = jax.tree.map(lambda m, g: 0.9 * m + 0.1 * g, state[0], gradient)
    square = jax.tree.map(lambda v, g: 0.999 * v + 0.001 * g * g, state[1], gradient)
    a, b = 1 - 0.9**step, 1 - 0.999**step
    new = jax.tree.map(lambda p, m, v: p - RATE * (m / a) / (jnp.sqrt(v / b) + 1e-8), parameters, mean, square)
    return new, (mean, square)


def both(critics, observation, action, key):
    x = jnp.concatenate([observation, action], -1)
    return jax.vmap(lambda critic, key: run(critic, x, key)[:, 0])(critics, jax.random.split(key))


def update(s, batch):
    s = dict(s)
    s["key"], k1, k2, k3, k4, k5 = jax.random.split(s["key"], 6)
    s["step"] = s["step"] + 1.0
    temperature = jnp.exp(s["log_temperature"])
    action, log_prob = sample(s["actor"], batch["next_observation"], k1)
    low = both(s["target"], batch["next_observation"], action, k2).min(0)
    wanted = batch["reward"] + DISCOUNT * batch["continues"] * (low - temperature * log_prob)
    loss = lambda critics: ((both(critics, batch["observation"], batch["action"], k3) - wanted) ** 2).mean()
    critic_loss, gradient = jax.value_and_grad(loss)(s["critics"])
    s["critics"], s["critic_adam"] = adam(s["critic_adam"], s["critics"], gradient, s["step"])
    s["target"] = jax.tree.map(lambda t, c: t + POLYAK * (c - t), s["target"], s["critics"])

    def actor_loss(actor):
        action, log_prob = sample(actor, batch["observation"], k4)
        value = both(s["critics"], batch["observation"], action, k5).mean(0)
        return (temperature * log_prob - value).mean(), -log_prob.mean()

    (loss, entropy), gradient = jax.value_and_grad(actor_loss, has_aux=True)(s["actor"])
    s["actor"], s["actor_adam"] = adam(s["actor_adam"], s["actor"], gradient, s["step"])
    gradient = temperature * (entropy - TARGET_ENTROPY)
    s["log_temperature"], s["temperature_adam"] = adam(s["temperature_adam"], s["log_temperature"], gradient, s["step"])
    return s, critic_loss + loss


def main():
    key = jax.random.key(0)
    zeros = lambda tree: (jax.tree.map(jnp.zeros_like, tree),) * 2
    actor = make_network(key, OBSERVATION, 2 * ACTION, False)
    critics = jax.vmap(lambda key: make_network(key, OBSERVATION + ACTION, 1, True))(jax.random.split(key))
    state = {
        "actor": actor, "critics": critics, "target": jax.tree.map(jnp.copy, critics), "key": key,
        "log_temperature": jnp.zeros(()), "step": jnp.zeros(()),
        "actor_adam": zeros(actor), "critic_adam": zeros(critics), "temperature_adam": zeros(jnp.zeros(())),
    }
    state = jax.tree.map(jnp.copy, state)  # Distinct buffers, as donation wants.
    step = jax.jit(update, donate_argnums=0)
    data = [jax.tree.map(jnp.asarray, batch) for batch in batches(np)]

    def repeat(state, limit):
        start, count = time.perf_counter(), 0
        while time.perf_counter() - start < limit:
            for batch in data:
                state, loss = step(state, batch)
                count += 1
            loss.block_until_ready()
        return state, count / (time.perf_counter() - start)

    state, _ = repeat(state, 1.0)
    _, rate = repeat(state, seconds)
    print(json.dumps({"peer": f"jax {jax.__version__}", "threads": threads, "updates_per_sec": round(rate, 1)}))


main()
