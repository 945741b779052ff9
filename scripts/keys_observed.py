"""Whether policies correct wrong keys that they observe: F1 in simulation where the rail is somewhere else than its encoder says, with the keys that
sound in the observation, with the keys that are due in their place, and with none. Means over the policies; an offset is tried to both sides, and at
most half of the rail's range.

    python3 scripts/python_package.py test
    .venv/bin/python scripts/keys_observed.py runs/after/appendix-fast/0/*/training
"""

import statistics
import sys

import etude
import numpy as np
from etude.recordings import KEYS

JOINTS, RAIL, FINGERS = 13, 12, 3
WHITE_KEY_MM = 23.5
# A goal that is farther away is observed as this far, in white keys.
FARTHEST_KEYS = 4
SHOWN = ["those that sound", "those due", "none"]


def f1(policy, song, offset_mm, shown):
    env = etude.PianoEnv(song, config=policy.task)
    task = env.task
    if task["scale"] != "normalised" or task.get("view", "keyboard") != "keyboard":
        sys.exit(f"{policy.path}: only observations from the keyboard with normalised joints are known here")
    # Joints, previous actions, goals; then the keys that sound and those due now. What is not 0 or 1 is before the keys.
    actions = JOINTS * (1 + task["previous_joints"])
    goals = actions + JOINTS * task["previous_actions"]
    keys = int(np.isinf(env.observation_space.low).sum())
    sounding, due = slice(keys, keys + KEYS), slice(keys + KEYS, keys + 2 * KEYS)
    white_keys = offset_mm / WHITE_KEY_MM
    to_the_offset = offset_mm / 1000 / half_range(env)
    observation, _ = env.reset(seed=0)
    over = False
    while not over:
        seen = observation.copy()
        seen[RAIL:actions:JOINTS] -= white_keys
        seen[actions + RAIL : goals : JOINTS] -= to_the_offset
        for goal in seen[goals:keys].reshape(FINGERS, -1) if goals < keys else []:
            # 0, 0, 1: no goal.
            if tuple(goal[:3]) != (0, 0, 1):
                goal[1] = np.clip(goal[1] - white_keys, -FARTHEST_KEYS, FARTHEST_KEYS)
        seen[sounding] = {"those that sound": observation[sounding], "those due": observation[due], "none": 0}[shown]
        action = policy.act(seen)
        action[RAIL] = np.clip(action[RAIL] + to_the_offset, -1, 1)
        observation, _, _, over, info = env.step(action)
    return info["f1"]


def half_range(env):
    """Of the rail's action, m."""
    return (env.action_high[RAIL] - env.action_low[RAIL]) / 2


def main():
    policies = [etude.load_policy(path) for path in sys.argv[1:]] or sys.exit(__doc__)
    ids = {title: song for song, title in etude.SONGS.items()}
    print(f"| the rail is off by | {' | '.join(SHOWN)} |\n|---|{'---|' * len(SHOWN)}")
    least = min(half_range(etude.PianoEnv(ids[policy.song], config=policy.task)) for policy in policies)
    for offset in (offset for offset in (0, 6, 12) if offset / 1000 <= least / 2):
        sides = (offset, -offset) if offset else (0,)
        means = [
            statistics.mean(f1(policy, ids[policy.song], side, shown) for policy in policies for side in sides)
            for shown in SHOWN
        ]
        print(f"| {offset} mm | {' | '.join(f'{mean:.3f}' for mean in means)} |", flush=True)


if __name__ == "__main__":
    main()
