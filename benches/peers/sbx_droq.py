#!/usr/bin/env python3
"""Steps a second of a training with SBX (Stable-Baselines3 in JAX): SAC with DroQ's critics at the paper's sizes, one
update a step, on an environment whose step costs nothing, so that only acting, replay and update are measured. Compilation
is not measured; the start-up time runs from this script's beginning to the first step, before updates are compiled.

    benches/peers/sbx_droq.sh [seconds] [threads]
"""

import time

began = time.perf_counter()

import json
import os
import resource
import sys

seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 3.0
threads = int(sys.argv[2]) if len(sys.argv) > 2 else 1
os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:threads])
os.environ["JAX_PLATFORMS"] = "cpu"

import gymnasium
import jax
import numpy as np
import sbx
import torch
from stable_baselines3.common.callbacks import BaseCallback

from droq_sizes import *

torch.set_num_threads(threads)
WARMUP = 300  # Steps before the clock starts: the first of them without updates, the later ones compile.


class Nothing(gymnasium.Env):
    """An environment that always returns the same."""

    observation_space = gymnasium.spaces.Box(-1, 1, (OBSERVATION,), np.float32)
    action_space = gymnasium.spaces.Box(-1, 1, (ACTION,), np.float32)
    observation = observation_space.sample()

    def reset(self, seed=None, options=None):
        return self.observation, {}

    def step(self, action):
        return self.observation, 0.0, False, False, {}


class Clock(BaseCallback):
    """Measures from the end of the warm-up until the time is up."""

    def _on_step(self):
        now = time.perf_counter()
        if self.num_timesteps == 1:
            self.start_up = now - began
        if self.num_timesteps <= WARMUP:
            self.begin = now
        self.secs, self.steps = now - self.begin, self.num_timesteps - WARMUP
        return self.secs < seconds


model = sbx.SAC(
    "MlpPolicy", Nothing(), learning_rate=RATE, learning_starts=BATCH, batch_size=BATCH, tau=POLYAK, gamma=DISCOUNT,
    gradient_steps=1, policy_delay=1, target_entropy=TARGET_ENTROPY, seed=0,
    buffer_size=1_000_000,  # As ours; the system gives the memory as it fills.
    policy_kwargs=dict(net_arch=HIDDEN, dropout_rate=DROPOUT, layer_norm=True, activation_fn=jax.nn.gelu),
)
clock = Clock()
model.learn(10**9, callback=clock, log_interval=None)
print(json.dumps({
    "peer": f"SBX {sbx.__version__} DroQ, empty environment",
    "threads": threads,
    "steps_per_sec": round(clock.steps / clock.secs, 1),
    "start_up_secs": round(clock.start_up, 2),
    "peak_memory_mib": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, 1),
}))
