"""Scores the shipped policies' performances against RoboPianist's frames: make build && frames_table.py

Each policy plays by its own plan. What it pressed is then compared with the keys that are due by RoboPianist's rule: with the
silence of the first second, and without it.
"""

import csv

from robot_table import etude


def column(folder, name):
    """The sets of keys of a column of frames.csv, one a control step."""
    with open(f"{folder}/frames.csv") as file:
        return [set(row[name].split()) for row in csv.DictReader(file)]


def f1(due, pressed):
    """The mean of the steps' F1."""
    steps = [2 * len(d & p) / (len(d) + len(p)) if d or p else 1.0 for d, p in zip(due, pressed, strict=True)]
    return sum(steps) / len(steps)


SILENCE = 20
print("| song | F1, own plan | F1, RoboPianist's frames | the same, without the first second | frames that differ |")
print("|---|---|---|---|---|")
for song in etude("songs", "--json"):
    song = song["id"]
    policy = ["--policy", f"policies/{song}.safetensors", "--json"]
    own, other = f"out/frames-table/{song}", f"out/frames-table/{song}-robopianist"
    etude("play", song, *policy, "-o", own)
    etude("play", song, *policy, "--set", "task.plan.rule=robopianist", "-o", other)
    pressed, planned, due = column(own, "pressed"), column(own, "due"), column(other, "due")
    scores = f1(planned, pressed), f1(due, pressed), f1(due[SILENCE:], pressed[SILENCE:])
    differ = sum(a != b for a, b in zip(planned, due, strict=True))
    print(f"| {song} | " + " | ".join(f"{score:.3f}" for score in scores) + f" | {differ} of {len(due)} |", flush=True)
