"""How often the set-points and torques are at their limits while the shipped policies play on the twin in real execution: the table of
docs/results/actuators.md. Set-points are shaped within the limits of the simulator, so none is clamped afterwards. Needs the mcap package and NumPy.

    make build && PYTHONPATH=.python python3 scripts/limits_table.py [--truth standard --truth worn] [--runs 1]
"""

import json
import subprocess
import sys

import numpy as np
from mcap.reader import make_reader

from robot_table import ROOT, etude, perform, truths_and_runs

FINGERS, RAIL = range(12), 12
SETPOINT_SECS = 0.005
# A value counts as at its limit from here on.
SHARE = 0.98
LIMITS = ["velocity", "acceleration", "jerk"]


def limits_of(joint):
    rows = {row["path"]: row["value"] for row in etude("model", "params", "--json")}
    return [rows[f"joint.{joint}.{limit}_limit"] for limit in LIMITS]


def reached(recording, finger_limits, rail_limits):
    """The shares of the fingers' and the rail's set-points at each limit, of the duties at theirs, and of the time in which any duty is."""
    sent, duties = [], []
    with open(ROOT / recording, "rb") as file:
        for _, channel, message in make_reader(file).iter_messages(topics=["/header", "/setpoint", "/hand"]):
            data = json.loads(message.data)
            if channel.topic == "/header":
                most = np.array(data["rig_config"]["hand"]["pwm_limit"])[FINGERS]
            # Everything before the song has time 0.
            elif message.log_time > 0:
                rows, value = (sent, data["sent"]) if channel.topic == "/setpoint" else (duties, data["pwm"])
                rows.append(value)
    changes = [np.array(sent)]
    for _ in LIMITS:
        changes.append(np.diff(changes[-1], axis=0) / SETPOINT_SECS)
    shares = [
        np.mean(np.abs(change[:, joints]) >= SHARE * limit)
        for joints, limits in [(list(FINGERS), finger_limits), ([RAIL], rail_limits)]
        for change, limit in zip(changes[1:], limits)
    ]
    at_most = np.abs(np.array(duties)[:, FINGERS]) >= most
    return [*shares, at_most.mean(), at_most.any(axis=1).mean()]


def performed(song, truth, runs):
    """The runs of a song; none if the twin has stopped itself."""
    try:
        return perform(song, "real", truth, runs)["runs"]
    except subprocess.CalledProcessError as ended:
        print(f"{song} on {truth}: {ended.stderr.strip().splitlines()[-1]}", file=sys.stderr)
        return []


def main():
    truths, runs_each = truths_and_runs(__doc__)
    songs = [song["id"] for song in etude("songs", "--json")]
    limits = [limits_of("index_0"), limits_of("rail")]
    print("| truth | fingers: velocity | acceleration | jerk | rail: velocity | acceleration | jerk | torque | any joint |")
    print("|---|---|---|---|---|---|---|---|---|")
    for truth in truths:
        runs = [run for song in songs for run in performed(song, truth, runs_each)]
        shares = np.mean([reached(run["files"]["recording"], *limits) for run in runs], axis=0)
        print(f"| `{truth}` | " + " | ".join(f"{100 * share:.2f} %" for share in shares) + " |", flush=True)


if __name__ == "__main__":
    main()
