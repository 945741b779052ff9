#!/usr/bin/env python3
"""Control steps a second of RoboPianist's own environment, with one Shadow hand and with its usual two, under random
actions, on one thread. The options are those of robopianist-rl's training script; physics steps of 5 ms, control steps of
50 ms, as ours. The start-up time is that of the imports and of building the environment up to its first step. The script
is not called robopianist.py because that would hide the package.

    benches/peers/robopianist.sh [seconds] [threads, which must be 1]
"""

import time

began = time.perf_counter()

import json
import os
import resource
import sys
import types

seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 3.0
if sys.argv[2:3] not in ([], ["1"]):
    sys.exit("RoboPianist's environment has one thread")
os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:1])
os.environ["MUJOCO_GL"] = "off"
# They make sound, need system libraries, and are imported whether sound is wanted or not.
for name in ["fluidsynth", "pyaudio"]:
    sys.modules[name] = types.ModuleType(name)

import numpy as np
import robopianist
from mujoco_utils import composer_utils
from robopianist import music
from robopianist.models.hands import HandSide
from robopianist.suite.tasks.piano_with_one_shadow_hand import PianoWithOneShadowHand
from robopianist.suite.tasks.piano_with_shadow_hands import PianoWithShadowHands


imports = time.perf_counter() - began


def measure(hands, make_task):
    began = time.perf_counter()
    environment = composer_utils.Environment(
        task=make_task(), random_state=0, strip_singleton_obs_buffer_dim=True, recompile_physics=False, legacy_step=True
    )
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
        "peer": f"RoboPianist {robopianist.__version__}, {hands}",
        "threads": 1,
        "control_steps_per_sec": round(steps / (time.perf_counter() - begin), 1),
        "start_up_secs": round(start_up, 2),
        "peak_memory_mib": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, 1),
    }))


options = dict(
    midi=music.load("TwinkleTwinkleRousseau"), trim_silence=True, gravity_compensation=True, reduced_action_space=True,
    n_steps_lookahead=10, primitive_fingertip_collisions=True, physics_timestep=0.005, control_timestep=0.05,
    disable_colorization=True,  # Colours cost time, and with one hand they fail ('NoneType' has no 'find_all').
)
measure("one hand", lambda: PianoWithOneShadowHand(hand_side=HandSide.RIGHT, **options))
measure("two hands", lambda: PianoWithShadowHands(**options))
