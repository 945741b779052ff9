"""Whether policies correct wrong keys that they observe."""

from tables.common import Stopped, argument, command, head, mean, row

WHITE_KEY_MM = 23.5
OFFSETS_MM = (0, 6, 12)
# A goal that is farther away is observed as this far, in white keys.
MAX_AWAY_KEYS = 4
SHOWN = ["those that sound", "those due", "none"]


def half_range(env):
    """Of the rail's action, m."""
    return (env.action_high[-1] - env.action_low[-1]) / 2


class Offset:
    """A policy plays while the rail is somewhere else than its encoder says."""

    def __init__(self, env, policy, offset_mm):
        import numpy as np

        task = env.task
        if task["scale"] != "normalised" or task.get("view", "keyboard") != "keyboard":
            raise Stopped(f"{policy.path}: it must observe the keyboard, with normalised joints")
        self.env, self.policy = env, policy
        # Joints, previous actions, goals; then the keys that sound and those due now. What is not
        # 0 or 1 is before the keys.
        joints = len(env.action_low)
        actions = joints * (1 + task["previous_joints"])
        goals = actions + joints * task["previous_actions"]
        keys = int(np.isinf(env.observation_space.low).sum())
        self.readings = slice(joints - 1, actions, joints)
        self.actions = slice(actions + joints - 1, goals, joints)
        self.goals = slice(goals, keys)
        self.white_keys = offset_mm / WHITE_KEY_MM
        self.of_range = offset_mm / 1000 / half_range(env)

    def shifted(self, observation):
        """The observation as the encoder has it."""
        import numpy as np

        seen = observation.copy()
        seen[self.readings] -= self.white_keys
        seen[self.actions] -= self.of_range
        fingers = (len(self.env.action_low) - 1) // 4
        for goal in seen[self.goals].reshape(fingers, -1) if self.goals.start < self.goals.stop else []:
            # 0, 0, 1: no goal.
            if tuple(goal[:3]) != (0, 0, 1):
                goal[1] = np.clip(goal[1] - self.white_keys, -MAX_AWAY_KEYS, MAX_AWAY_KEYS)
        return seen

    def f1(self, shown):
        """F1 of a song, with these keys in the place of those that sound."""
        import numpy as np
        from etude.recordings import KEY_COUNT

        sounding = slice(self.goals.stop, self.goals.stop + KEY_COUNT)
        due = slice(sounding.stop, sounding.stop + KEY_COUNT)
        observation, _ = self.env.reset(seed=0)
        over = False
        while not over:
            seen = self.shifted(observation)
            seen[sounding] = {SHOWN[0]: observation[sounding], SHOWN[1]: observation[due], SHOWN[2]: 0}[shown]
            action = self.policy.act(seen)
            action[-1] = np.clip(action[-1] + self.of_range, -1, 1)
            observation, _, _, over, info = self.env.step(action)
        return info["f1"]


@command("keys-observed", argument("policies", nargs="+", help="names, files or folders of runs"))
def keys_observed(options):
    """F1 in simulation with wrong keys in the observation: the rail is offset from its encoder.

    The observation has the keys that sound, in their place those that are due, or none. Means over
    the policies; an offset is tried to both sides, at most half of the rail's range. Needs the
    Python package: `scripts/python_package.py test`, then `.venv/bin/python scripts/tables.py`.
    """
    import etude

    policies = [etude.load_policy(path) for path in options.policies]
    ids = {title: song for song, title in etude.SONGS.items()}
    envs = [etude.PianoEnv(ids[policy.song], config=policy.task) for policy in policies]
    widest = min(map(half_range, envs)) / 2
    head("the rail is off by", *SHOWN)
    for offset in (offset for offset in OFFSETS_MM if offset / 1000 <= widest):
        sides = (offset, -offset) if offset else (0,)
        both = [Offset(env, policy, side) for env, policy in zip(envs, policies) for side in sides]
        row(f"{offset} mm", *(mean(one.f1(shown) for one in both) for shown in SHOWN))
