#!/usr/bin/env python3
"""Checks the files of one run of `etude perform` with other libraries and against published data.

    check_robot_recording.py DIR

run-1.mcap is read by the mcap package: one header, one `/step` and one `/policy` a control step,
set-points every 5 ms, periods of the hand every 3 ms, reports of the arm every 10 ms. What was sent
must keep the limits of the rig's file, taken as differences of the recording, and no PWM may exceed
the table of the v4 hand. The paper's F1 of run-1.csv is computed again by scikit-learn.
"""

import csv
import json
import pathlib
import sys

import numpy as np
from mcap.reader import make_reader
from sklearn.metrics import f1_score

LOWEST, KEY_COUNT, RAIL = 36, 49, 12
PWM = [375, 675, 450, 285] * 3 + [525, 405, 270, 270]
FINGER = {"velocity": 13.0, "acceleration": 2000.0, "jerk": 400_000.0}
RAIL_LIMITS = {"velocity": 0.8, "acceleration": 7.5, "jerk": 1500.0}
SETPOINT_SECS = 0.005


def down(pitches):
    row = np.zeros(KEY_COUNT, dtype=int)
    row[np.array(pitches, dtype=int) - LOWEST] = 1
    return row


def keys(text):
    return down([int(pitch) for pitch in text.split()])


def heard_at(secs, strokes):
    """The keys that are down at this time of the control steps, by the strokes until then."""
    velocities = {stroke["pitch"]: stroke["velocity"] for at, stroke in strokes if at <= secs + 1e-9}
    return down([pitch for pitch, velocity in velocities.items() if velocity > 0])


def main(folder: pathlib.Path) -> int:
    wrong = []

    def holds(what, truth):
        if not truth:
            wrong.append(what)

    messages, times = {}, {}
    with open(folder / "run-1.mcap", "rb") as file:
        for _, channel, message in make_reader(file, validate_crcs=True).iter_messages(log_time_order=False):
            messages.setdefault(channel.topic, []).append(json.loads(message.data))
            times.setdefault(channel.topic, []).append(message.log_time * 1e-9)
    report = json.loads((folder / "report.json").read_text())
    run = report["runs"][0]
    steps = run["steps"][0]
    holds("one header", len(messages["/header"]) == 1)
    for topic in ["/step", "/policy"]:
        holds(f"one {topic} a control step", [m["step"] for m in messages[topic]] == list(range(steps)))
    for topic, secs in [("/setpoint", SETPOINT_SECS), ("/hand", 0.003), ("/arm", 0.01)]:
        playing = np.array([t for t in times[topic] if t > 0])
        rate = len(playing) / (playing[-1] - playing[0])
        holds(f"{topic} every {secs} s, not {1 / rate:.5f}", abs(rate * secs - 1) < 0.01)

    sent = np.array([m["sent"] for m in messages["/setpoint"]])
    gaps = np.diff(times["/setpoint"])
    begin = int(np.argmax(np.array(times["/setpoint"]) > 0))
    sent = sent[begin:]
    holds("no set-point left out", np.all(gaps[begin:] < 1.5 * SETPOINT_SECS))
    velocity = np.diff(sent, axis=0) / SETPOINT_SECS
    acceleration = np.diff(velocity, axis=0) / SETPOINT_SECS
    jerk = np.diff(acceleration, axis=0) / SETPOINT_SECS
    for name, values in [("velocity", velocity), ("acceleration", acceleration), ("jerk", jerk)]:
        most = np.abs(values).max(axis=0)
        holds(f"{name} of the fingers: {most[:RAIL].max()}", most[:RAIL].max() <= FINGER[name] * 1.001)
        holds(f"{name} of the rail: {most[RAIL]}", most[RAIL] <= RAIL_LIMITS[name] * 1.001)
    pwm = np.abs([m["pwm"] for m in messages["/hand"]]).max(axis=0)
    holds(f"PWM within the table: {pwm}", np.all(pwm <= PWM))
    holds("the hand was driven", np.all(pwm[:RAIL] > 0))

    with open(folder / "run-1.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    # Also of keys that were down before the beginning, and until what was played last is heard.
    header, strokes = messages["/header"][0], list(zip(times["/key"], messages["/key"]))
    early = header["latency_compensation_secs"]
    drift = [abs(at - early - stroke["secs"]) for at, stroke in strokes if at > 0]
    holds("a stroke's own time is that of its message less the latency compensation", max(drift, default=0) < 1e-8)
    holds("keys due at each step", [keys(r["due"]).tolist() for r in rows] == [down(due).tolist() for due in header["due"]])
    ends = [(step + 1) / header["control_hz"] for step in range(steps)]
    there = [heard_at(end + header["late_secs"], strokes).tolist() for end in ends]
    holds("keys heard for each step", there == [keys(r["pressed"]).tolist() for r in rows[:steps]])
    at_ends = [heard_at(end, strokes).tolist() for end in ends]
    holds("keys pressed at the end of each step", at_ends == [down(m["pressed"]).tolist() for m in messages["/step"]])
    f1 = np.mean([f1_score(keys(r["due"]), keys(r["pressed"]), zero_division=1) for r in rows])
    holds(f"F1 {run['f1']} here, {f1} there", abs(f1 - run["f1"]) < 1e-9)

    for line in wrong:
        print(f"WRONG: {line}")
    if not wrong:
        print(f"recording of {steps} steps: {len(sent)} set-points within their limits, F1 {f1:.4f} as scikit-learn's")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(pathlib.Path(sys.argv[1])))
