#!/usr/bin/env python3
"""Control steps a second (ten physics steps each) of `mujoco.rollout` on our exported model. The work is the same as that
of our bare engine: the torques that our controllers made of random actions, over one episode, from the same start. TRACE
has one line for the start and one for each physics step: torques, then positions after the step; the last positions must
come out again.

    benches/peers/rollout.sh SECONDS THREADS MODEL.xml TRACE
"""

import json
import os
import sys
import time

seconds, threads = float(sys.argv[1]), int(sys.argv[2])
os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:threads])

import mujoco
import mujoco.rollout
import numpy as np

PHYSICS_STEPS = 10  # In one control step.


def main():
    model = mujoco.MjModel.from_xml_path(sys.argv[3])
    trace = np.loadtxt(sys.argv[4])
    torques, positions = trace[1:, : model.nu], trace[:, model.nu :]
    data = [mujoco.MjData(model) for _ in range(threads)]
    data[0].qpos[:] = positions[0]
    mujoco.mj_forward(model, data[0])
    start = np.empty(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    mujoco.mj_getState(model, data[0], start, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    starts, controls = np.tile(start, (threads, 1)), np.tile(torques, (threads, 1, 1))
    with mujoco.rollout.Rollout(nthread=threads) as rollout:
        states, _ = rollout.rollout(model, data, starts, controls)
        error = np.abs(states[0, -1, 1 : 1 + model.nq] - positions[-1]).max()  # The state begins with the time.
        if not error < 1e-6:
            sys.exit(f"mujoco.rollout ends {error:.1e} away from where our world ends: this is not the same work")
        begin, episodes = time.perf_counter(), 0
        while time.perf_counter() - begin < seconds:
            rollout.rollout(model, data, starts, controls)
            episodes += threads
        rate = episodes * len(torques) / PHYSICS_STEPS / (time.perf_counter() - begin)
    peer = f"mujoco.rollout {mujoco.__version__}"
    print(json.dumps({"peer": peer, "threads": threads, "control_steps_per_sec": round(rate, 1)}))


main()
