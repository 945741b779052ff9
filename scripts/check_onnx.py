#!/usr/bin/env python3
"""Checks a model of `etude export onnx` with other libraries: ONNX's checker and ONNX Runtime.

    check_onnx.py MODEL.onnx OBSERVATIONS ACTIONS

The two files hold little-endian f32: rows of observations, and the actions that Étude's own policy
gives for them. The model must give the same to 1e-5, one row at a time and all at once.
"""

import json
import sys

import numpy as np
import onnx
import onnxruntime

TOLERANCE = 1e-5


def main(path, observations, actions):
    model = onnx.load(path)
    onnx.checker.check_model(model, full_check=True)
    contract = json.loads({entry.key: entry.value for entry in model.metadata_props}["etude"])
    session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
    (source,), (target,) = session.get_inputs(), session.get_outputs()
    columns = sum(part["columns"] for part in contract["observation"]["columns"])
    joints = len(contract["action"]["joints"])
    if (source.name, source.shape, target.name, target.shape) != (
        "observation", ["batch", columns], "action", ["batch", joints]
    ):
        sys.exit(f"{path}: {source} to {target}, and the contract says {columns} columns to {joints} joints")
    observations = np.fromfile(observations, "<f4").reshape(-1, columns)
    actions = np.fromfile(actions, "<f4").reshape(-1, joints)
    together = session.run(None, {"observation": observations})[0]
    singly = np.concatenate([session.run(None, {"observation": row[np.newaxis]})[0] for row in observations])
    worst = max(np.abs(together - actions).max(), np.abs(singly - actions).max())
    print(f"{path}: {len(actions)} observations, ONNX Runtime {onnxruntime.__version__}, greatest difference {worst:.2e}")
    if not worst <= TOLERANCE:
        sys.exit(f"more than {TOLERANCE}")


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    main(*sys.argv[1:])
