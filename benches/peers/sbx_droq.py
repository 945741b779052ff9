#!/usr/bin/env python3
"""Steps a second of a training with SBX (Stable-Baselines3 in JAX): SAC with DroQ's critics at the paper's sizes, one
update a step, in one of the worlds of sbx_worlds.py. Compilation is not measured; the start-up time runs from this script's
beginning to the first step, before updates are compiled.

    benches/peers/sbx_droq.sh [seconds] [threads]         in an environment whose step costs nothing
    benches/peers/sbx_etude.sh [seconds] [threads]        in Étude's, through its Python package
    benches/peers/sbx_robopianist.sh [seconds] [threads]  in RoboPianist's
"""

import time

began = time.perf_counter()

import json
import os
import resource
import sys

seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 3.0
threads = int(sys.argv[2]) if len(sys.argv) > 2 else 1
world = sys.argv[3] if len(sys.argv) > 3 else "empty"
os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:threads])
os.environ["JAX_PLATFORMS"] = "cpu"

import jax
import sbx
import torch
from stable_baselines3.common.callbacks import BaseCallback

from droq_sizes import *
from sbx_worlds import WORLDS

torch.set_num_threads(threads)
WARMUP = 300  # Steps before the clock starts: the first of them without updates, the later ones compile.


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


where, environment = WORLDS[world]()
model = sbx.SAC(
    "MlpPolicy", environment, learning_rate=RATE, learning_starts=BATCH, batch_size=BATCH, tau=POLYAK, gamma=DISCOUNT,
    gradient_steps=1, policy_delay=1, target_entropy=TARGET_ENTROPY, seed=0,
    buffer_size=1_000_000,  # As ours; the system gives the memory as it fills.
    policy_kwargs=dict(net_arch=HIDDEN, dropout_rate=DROPOUT, layer_norm=True, activation_fn=jax.nn.gelu),
)
clock = Clock()
model.learn(10**9, callback=clock, log_interval=None)
print(json.dumps({
    "peer": f"SBX {sbx.__version__} DroQ, {where}",
    "threads": threads,
    "steps_per_sec": round(clock.steps / clock.secs, 1),
    "start_up_secs": round(clock.start_up, 2),
    "peak_memory_mib": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, 1),
}))
