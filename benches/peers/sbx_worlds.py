"""The worlds that SBX's DroQ is measured in: name for the table, and Gymnasium environment."""

import gymnasium
import numpy as np

from droq_sizes import ACTION, OBSERVATION


class Nothing(gymnasium.Env):
    """An environment that always returns the same, and costs nothing."""

    observation_space = gymnasium.spaces.Box(-1, 1, (OBSERVATION,), np.float32)
    action_space = gymnasium.spaces.Box(-1, 1, (ACTION,), np.float32)
    observation = observation_space.sample()

    def reset(self, seed=None, options=None):
        return self.observation, {}

    def step(self, action):
        return self.observation, 0.0, False, False, {}


class DmEnvironment(gymnasium.Env):
    """An environment of dm_control in Gymnasium's idiom, its observations one after the other."""

    def __init__(self, environment):
        self.environment = environment
        spec = environment.action_spec()
        self.action_space = gymnasium.spaces.Box(spec.minimum, spec.maximum, dtype=np.float32)
        size = self.flat(environment.reset()).size
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (size,), np.float32)

    @staticmethod
    def flat(time_step):
        return np.concatenate([np.ravel(part) for part in time_step.observation.values()]).astype(np.float32)

    def reset(self, seed=None, options=None):
        return self.flat(self.environment.reset()), {}

    def step(self, action):
        time_step = self.environment.step(action)
        return self.flat(time_step), time_step.reward, False, time_step.last(), {}


def empty():
    return "empty environment", Nothing()


def etude():
    from etude import PianoEnv

    return "in Étude's world", PianoEnv("c-major-scale")


def robopianist():
    import robopianist_world as world

    return f"in RoboPianist {world.VERSION}, one hand", DmEnvironment(world.environment("one hand"))


WORLDS = {"empty": empty, "etude": etude, "robopianist": robopianist}
