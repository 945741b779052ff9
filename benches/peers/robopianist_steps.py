#!/usr/bin/env python3
"""Control steps a second of RoboPianist's own environment, with one Shadow hand and with its usual two, under random
actions, on one thread. The start-up time is that of the imports and of building the environment up to its first step.

    benches/peers/robopianist.sh [seconds] [threads, which must be 1]
"""

import time

began = time.perf_counter()

import json
import os
import resource
import sys

seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 3.0
if sys.argv[2:3] not in ([], ["1"]):
    sys.exit("RoboPianist's environment has one thread")
os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:1])

import numpy as np

import robopianist_world as world

imports = time.perf_counter() - began


def measure(hands):
    began = time.perf_counter()
    environment = world.environment(hands)
    spec = environment.action_spec()
    random = np.random.default_rng(0)

    def step():
        if environment.step(random.uniform(spec.minimum, spec.maximum)).last():
            environment.reset()

    environment.reset()
    step()
    begin, steps = time.perf_counter(), 0
    start_up = imports + begin - began
    while time.perf_counter() - begin < seconds:
        step()
        steps += 1
    print(json.dumps({
        "peer": f"RoboPianist {world.VERSION}, {hands}",
        "threads": 1,
        "control_steps_per_sec": round(steps / (time.perf_counter() - begin), 1),
        "start_up_secs": round(start_up, 2),
        "peak_memory_mib": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, 1),
    }))


measure("one hand")
measure("two hands")
