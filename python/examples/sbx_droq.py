#!/usr/bin/env python3
"""SBX's DroQ (SAC in JAX with dropout and layer normalisation in the critics) learning a song in
Étude's world.

    pip install sbx-rl stable-baselines3
    sbx_droq.py [SONG] [--steps N] [--envs N] [--seed N] [--curve FILE.csv]

Eight environments, two updates of 256 a vector step, returns over three steps, discount 0.9,
temperature from 0.1. The curve has a row an evaluation: steps, seconds, updates, F1 of the whole
song without exploration.
"""

import argparse
import csv
import os
import time

os.environ.setdefault("JAX_PLATFORMS", "cpu")

import jax
import numpy as np
import sbx
from stable_baselines3.common.callbacks import BaseCallback

import etude
from etude.sb3 import PianoVecEnv


def evaluate(model, song):
    """F1 of the whole song, without exploration."""
    env = etude.PianoEnv(song)
    observation, _ = env.reset(seed=0)
    over = False
    while not over:
        action, _ = model.predict(observation, deterministic=True)
        observation, _, _, over, info = env.step(action)
    return info["f1"]


class Curve(BaseCallback):
    """Evaluates every so many steps, and keeps the curve."""

    def __init__(self, song, every, path):
        super().__init__()
        self.song, self.every, self.path = song, every, path
        self.rows, self.next, self.secs, self.last = [], 0, 0.0, time.monotonic()

    def _on_step(self):
        if self.num_timesteps < self.next:
            return True
        self.secs += time.monotonic() - self.last
        f1 = evaluate(self.model, self.song)
        self.last = time.monotonic()
        self.next = self.num_timesteps + self.every
        self.rows.append((self.num_timesteps, round(self.secs, 1), self.model._n_updates, round(f1, 4)))
        print(f"{self.num_timesteps:8} steps {self.secs:7.0f} s  F1 {f1:.3f}", flush=True)
        if self.path:
            with open(self.path, "w", newline="") as file:
                csv.writer(file).writerows([("step", "secs", "updates", "f1"), *self.rows])
        return True


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("song", nargs="?", default="c-major-scale")
    parser.add_argument("--steps", type=int, default=600_000)
    parser.add_argument("--envs", type=int, default=8)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--every", type=int, default=20_000, help="steps between evaluations")
    parser.add_argument("--curve", metavar="FILE.csv")
    arguments = parser.parse_args()
    model = sbx.SAC(
        "MlpPolicy",
        PianoVecEnv(arguments.envs, arguments.song),
        learning_rate=3e-4,
        learning_starts=5_000,
        batch_size=256,
        tau=0.005,
        gamma=0.9,
        train_freq=1,
        gradient_steps=2,
        n_steps=3,
        policy_delay=1,
        ent_coef="auto_0.1",
        target_entropy=-6.5,
        seed=arguments.seed,
        policy_kwargs=dict(net_arch=[128, 128, 128], dropout_rate=0.01, layer_norm=True, activation_fn=jax.nn.gelu),
    )
    curve = Curve(arguments.song, arguments.every, arguments.curve)
    model.learn(arguments.steps, callback=curve, log_interval=None)
    best = max(curve.rows, key=lambda row: row[3])
    print(f"{arguments.song}, seed {arguments.seed}: best F1 {best[3]:.3f} at {best[0]} steps, {best[1]:.0f} s")


if __name__ == "__main__":
    main()
