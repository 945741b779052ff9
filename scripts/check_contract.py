#!/usr/bin/env python3
"""Checks the contract in a model of `etude export onnx` on a performance of its policy, mode real.

    check_contract.py MODEL.onnx RECORDING.mcap

From the model's own description and from what the recording says of joints and keys alone it
computes each observation, the action (by ONNX Runtime) and the joint targets. They must be those
that Étude recorded.
"""

import json
import sys

import numpy as np
import onnx
import onnxruntime
from mcap.reader import make_reader

OBSERVATION, ACTION, TARGET = 1e-6, 1e-5, 1e-7


class Contract:
    """The description in a model."""

    def __init__(self, path):
        entries = onnx.load(path, load_external_data=False).metadata_props
        self.all = json.loads({entry.key: entry.value for entry in entries}["etude"])
        self.observation, self.plan = self.all["observation"], self.all["fingering"]
        self.joints, self.white = self.all["action"]["joints"], self.observation["white_key_m"]
        self.scale = self.all["task"]["scale"]

    def of_step(self, name, step):
        """A value of the fingering, the last one after the end."""
        return self.plan[name][min(step, len(self.plan[name]) - 1)]

    def goals(self, step):
        goals = self.plan["goals"]
        return goals[step] if step < len(goals) else [None] * len(goals[0])

    def scaled(self, readings, step):
        values = np.array(readings)
        if self.observation["window"]:
            values[-1] -= self.of_step("rail_m", step)
        if self.scale == "normalised":
            ends = np.array([[joint["lowest"], joint["highest"]] for joint in self.joints[:-1]])
            values[:-1] = 2 * (values[:-1] - ends[:, 0]) / (ends[:, 1] - ends[:, 0]) - 1
            values[-1] /= self.white
        return values

    def fingertip(self, finger, readings):
        hand = self.plan["hand"]
        q, rail, root = readings[4 * finger : 4 * finger + 4], readings[-1], hand["fingers"][finger]
        first, *links = hand["links_m"]
        bent = np.cumsum(q[1:])
        along = first + np.dot(links, np.cos(bent))
        aside = -np.sin(q[0]) * np.dot(links, np.sin(bent))
        tilt = root["tilt_rad"]
        x = root["x_m"] - along * np.cos(tilt) + aside * np.sin(tilt)
        return x, root["y_m"] + rail + along * np.sin(tilt) + aside * np.cos(tilt)

    def of_goals(self, readings, step, columns):
        rows = []
        for finger, goal in enumerate(self.goals(step)):
            if goal:
                x, y = self.fingertip(finger, readings)
                away = np.clip([(x - goal["x_m"]) / self.white, (y - goal["y_m"]) / self.white], -4, 4)
                rows += [*away, goal["wait"] / 10, goal["velocity"] / 127][: columns // 3]
            else:
                rows += [0, 0, 1, 0][: columns // 3]
        return rows

    def places(self, step, columns):
        here = self.of_step("rail_m", step)
        middle = self.of_window("middle", step) / 2
        rest = [(self.of_step("rail_m", step + ahead) - here) / self.white for ahead in range(1, columns)]
        return np.clip([here / self.white - middle, *rest], -4, 4)

    def of_window(self, name, step):
        values = self.observation["window"][name]
        return values[min(step, len(values) - 1)]

    def shown(self, keys, step, columns):
        row = np.zeros(columns)
        window = self.observation["window"]
        for key in keys:
            column = window["key_slot"][key] - self.of_window("middle", step) + window["slots_to_a_side"] if window else key
            if 0 <= column < columns:
                row[column] = 1
        return row

    def observe(self, step, readings, actions, pitches):
        """The observation: `readings` and `actions` with the newest first, `pitches` that sound."""
        keys = lambda pitches: [pitch - self.observation["lowest_pitch"] for pitch in pitches]
        due = lambda step: keys(self.all["due"][step]) if step < len(self.all["due"]) else []
        compute = {
            "joints": lambda at, columns: self.scaled(readings[at], step),
            "action": lambda at, columns: actions[at - 1],
            "goals": lambda at, columns: self.of_goals(readings[0], step, columns),
            "places": lambda at, columns: self.places(step, columns),
            "sounding": lambda at, columns: self.shown(keys(pitches), step, columns),
            "due": lambda at, columns: self.shown(due(step + at), step, columns),
            "black": lambda at, columns: self.shown(self.observation["window"]["black_keys"], step, columns),
            "playing": lambda at, columns: [float(bool(goal) and goal["wait"] == 0) for goal in self.goals(step + at)],
        }
        groups = self.observation["columns"]
        return np.concatenate([compute[group["kind"]](group["steps"], group["columns"]) for group in groups])

    def targets(self, action, step):
        ends = np.array([[joint["low"], joint["high"]] for joint in self.joints])
        targets = ends[:, 0] + (np.clip(action, -1, 1) + 1) / 2 * (ends[:, 1] - ends[:, 0])
        if self.plan:
            targets[-1] += self.of_step("rail_m", step)
            if self.plan["pose_rad"]:
                targets[:-1] += self.of_step("pose_rad", step)
        return targets


def read(path):
    """Steps, policy's choices, targets, and the set-points of a robot that were last sent at each choice."""
    topics = {"/step": [], "/policy": [], "/target": [], "/setpoint": []}
    last = []
    with open(path, "rb") as file:
        for _, channel, message in make_reader(file).iter_messages(topics=list(topics)):
            topics[channel.topic].append(json.loads(message.data))
            if channel.topic == "/policy":
                last.append(topics["/setpoint"][-1]["sent"] if topics["/setpoint"] else None)
    return topics["/step"], topics["/policy"], topics["/target"], last


def main(path, recording):
    contract, session = Contract(path), onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
    steps, chosen, sent, last = read(recording)
    worst = np.zeros(3)
    # Before the third step there is nothing to compare: no step has ended whose joints are two
    # steps old.
    for step in range(2, len(chosen)):
        readings = [steps[step - ago]["positions"] for ago in (1, 2)]
        if contract.all["task"].get("rail_set_point"):
            # The limiter may have held the rail back from what it was asked.
            rails = [last[step + 1 - ago] for ago in (1, 2)]
            rails = [rail or steps[step - ago]["targets"] for ago, rail in zip((1, 2), rails)]
            readings = [[*steps[step - ago]["positions"][:-1], rails[ago - 1][-1]] for ago in (1, 2)]
        actions = [chosen[step - ago]["action"] for ago in range(1, min(step, 4) + 1)]
        seen = np.array(chosen[step]["observation"], np.float32)
        if len(actions) >= contract.all["task"]["previous_actions"]:
            computed = contract.observe(step, readings, actions, steps[step - 1]["pressed"])
            worst[0] = max(worst[0], np.abs(computed - seen).max())
        action = session.run(None, {"observation": seen[np.newaxis]})[0][0]
        worst[1] = max(worst[1], np.abs(action - chosen[step]["action"]).max())
        worst[2] = max(worst[2], np.abs(contract.targets(chosen[step]["action"], step) - sent[step]["targets"]).max())
    print(f"{path}: {len(chosen)} steps; greatest difference of observation, action and target {worst}")
    if len(chosen) < 50 or not (worst <= [OBSERVATION, ACTION, TARGET]).all():
        sys.exit(f"more than {OBSERVATION}, {ACTION}, {TARGET}, or fewer than 50 steps")


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])
