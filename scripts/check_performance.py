#!/usr/bin/env python3
"""Checks the files of `etude play`: the scores with scikit-learn, the recording with mcap.

    check_performance.py DIR

From frames.csv the paper's precision, recall and F1 (the binary figures of each control step, 1
where they are 0/0, averaged) and the pooled ones are computed again and compared with report.json.
recording.mcap must hold one header, one message a control step, and the same keys due and pressed
as frames.csv.
"""

import csv
import json
import pathlib
import sys

import numpy as np
from mcap.reader import make_reader
from sklearn.metrics import precision_recall_fscore_support

LOWEST, KEY_COUNT = 36, 49
TOLERANCE = 1e-9
NAMES = ["precision", "recall", "f1"]


def scores(due, pressed):
    return precision_recall_fscore_support(due, pressed, average="binary", zero_division=1)[:3]


def keys(pitches):
    row = np.zeros(KEY_COUNT, dtype=int)
    row[[pitch - LOWEST for pitch in pitches]] = 1
    return row


def main(folder: pathlib.Path) -> int:
    wrong = []

    def same(what, ours, theirs, tolerance=0.0):
        if not (ours == theirs if tolerance == 0.0 else abs(ours - theirs) <= tolerance):
            wrong.append(f"{what}: {ours!r} here, {theirs!r} there")

    with open(folder / "frames.csv", newline="") as file:
        reader = csv.DictReader(file)
        same("columns of frames.csv", reader.fieldnames, ["step", "due", "pressed"])
        rows = [{name: [int(n) for n in (text or "").split()] for name, text in row.items()} for row in reader]
    same("steps of frames.csv", [row["step"] for row in rows], [[step] for step in range(len(rows))])
    due = np.array([keys(row["due"]) for row in rows])
    pressed = np.array([keys(row["pressed"]) for row in rows])

    report = json.loads((folder / "report.json").read_text())
    same("steps of report.json", report["steps"], len(rows))
    means = np.mean([scores(*step) for step in zip(due, pressed)], axis=0)
    for name, value, pooled in zip(NAMES, means, scores(due.ravel(), pressed.ravel())):
        same(name, report[name], float(value), TOLERANCE)
        same(f"pooled_{name}", report[f"pooled_{name}"], float(pooled), TOLERANCE)

    messages = {}
    with open(folder / "recording.mcap", "rb") as file:
        reader = make_reader(file, validate_crcs=True)
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            same("encoding", (schema.encoding, channel.message_encoding), ("jsonschema", "json"))
            messages.setdefault(channel.topic, []).append(json.loads(message.data))
        counted = reader.get_summary().statistics.message_count
    same("messages in the statistics", counted, sum(map(len, messages.values())))
    same("unknown topics", sorted(set(messages) - {"/header", "/step", "/key", "/reward"}), [])
    same("headers", len(messages["/header"]), 1)
    header, steps = messages["/header"][0], messages["/step"]
    same("keys due", header["due"], [row["due"] for row in rows])
    same("keys pressed", [step["pressed"] for step in steps], [row["pressed"] for row in rows])
    same("step numbers", [step["step"] for step in steps], list(range(len(rows))))
    for name in ("targets", "positions", "velocities", "torques"):
        same(f"length of {name}", {len(step[name]) for step in steps}, {len(header["joints"])})

    earned = [sum(reward["terms"].values()) for reward in messages["/reward"]]
    same("rewards", len(earned), len(rows))
    same("reward", report["reward"], sum(earned), 1e-3)

    for line in wrong:
        print(line)
    print(f"{folder}: {len(rows)} control steps, F1 {report['f1']:.4f}, {len(messages.get('/key', []))} key events:", end=" ")
    print(f"{len(wrong)} differences" if wrong else "all agree")
    return 1 if wrong else 0


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    sys.exit(main(pathlib.Path(sys.argv[1])))
