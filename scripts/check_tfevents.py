#!/usr/bin/env python3
"""Compares a TensorBoard event file, by TensorBoard's own reader, with metrics.jsonl beside it.

    python3 -m venv /tmp/venv-learn && /tmp/venv-learn/bin/pip install tensorboard
    /tmp/venv-learn/bin/python scripts/check_tfevents.py RUN_FOLDER

Exits with an error when a tag, a step or a value differs.
"""

import json
import math
import pathlib
import sys

import numpy as np
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator


def main():
    folder = pathlib.Path(sys.argv[1])
    (events,) = folder.glob("events.out.tfevents.*")
    reader = EventAccumulator(str(events), size_guidance={"scalars": 0})
    reader.Reload()
    read = {tag: [(event.step, event.value) for event in reader.Scalars(tag)] for tag in reader.Tags()["scalars"]}
    written = {}
    for line in (folder / "metrics.jsonl").read_text().splitlines():
        row = json.loads(line)
        step = row.pop("step")
        for tag, value in row.items():
            written.setdefault(tag, []).append((step, float("nan") if value is None else value))
    assert read.keys() == written.keys(), f"tags differ: {sorted(read.keys() ^ written.keys())}"
    for tag, rows in written.items():
        assert len(rows) == len(read[tag]), f"{tag}: {len(read[tag])} events, {len(rows)} rows"
        for (step, value), (read_step, read_value) in zip(rows, read[tag]):
            same = float(np.float32(value)) == read_value or (math.isnan(value) and math.isnan(read_value))
            assert step == read_step and same, f"{tag} at {step}: {value} was read as {read_value} at {read_step}"
    print(f"{events.name}: {len(read)} tags, {sum(map(len, read.values()))} values agree with metrics.jsonl")


if __name__ == "__main__":
    main()
