#!/usr/bin/env python3
"""Steps an exported model in stock MuJoCo under recorded torques and compares the positions.

    check_model.py MODEL.xml TRACE

TRACE has one line of numbers for the start and one for each physics step: the torques in the order
of the model's actuators, then all joint positions after the step (the start line's torques count
for nothing). Written by crates/stage/tests/stage/exported.rs. It shows that the model which Étude
exports needs nothing of Étude to run.
"""

import sys

import mujoco
import numpy as np

VERSION = "3.17.0"
TOLERANCE = 1e-9


def main(model_path: str, trace_path: str) -> int:
    if mujoco.__version__ != VERSION:
        print(f"this is MuJoCo {mujoco.__version__}; the models are for {VERSION}: pip install mujoco=={VERSION}")
        return 2
    model = mujoco.MjModel.from_xml_path(model_path)
    data = mujoco.MjData(model)
    trace = np.loadtxt(trace_path)
    if trace.ndim != 2 or trace.shape[1] != model.nu + model.nq:
        print(f"{trace_path} has shape {trace.shape}; the model wants {model.nu} torques and {model.nq} positions")
        return 2
    torques, positions = trace[:, : model.nu], trace[:, model.nu :]
    data.qpos[:] = positions[0]
    mujoco.mj_forward(model, data)
    worst, when = 0.0, 0
    for step in range(1, len(trace)):
        data.ctrl[:] = torques[step]
        mujoco.mj_step(model, data)
        difference = float(np.abs(data.qpos - positions[step]).max())
        # `not <=` rather than `>`: a NaN must fail too.
        if not difference <= worst:
            worst, when = difference, step
    moved = float(np.abs(positions - positions[0]).max())
    print(f"{len(trace) - 1} physics steps, positions move by up to {moved:.3g}, differ by up to {worst:.3g} (step {when})")
    if not worst <= TOLERANCE:
        print(f"the positions must agree to {TOLERANCE:g}")
        return 1
    return 0


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    sys.exit(main(sys.argv[1], sys.argv[2]))
