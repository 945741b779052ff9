"""The environments as Stable-Baselines3 and SBX take them; needs `stable-baselines3`."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.vec_env.base_vec_env import VecEnv

from .task import SCORES
from .vector import PianoVectorEnv


class PianoVecEnv(VecEnv):
    """A `PianoVectorEnv` in Stable-Baselines3's idiom.

    The infos have `collided`, `reward_terms`, and `precision`, `recall` and `f1` of the song so
    far; those of an episode's last step also `terminal_observation`, `TimeLimit.truncated` (always
    true: the song is over, and the learner bootstraps on) and `episode` with return `r` and length
    `l`, which the algorithms log, and the same scores. Options of a reset are not known here.

    Args:
        num_envs: How many environments.
        song: A built-in song or the path of a MIDI file.
        keywords: As of `PianoVectorEnv`.
    """

    _actions: NDArray[np.float32]

    def __init__(self, num_envs: int, song: str | os.PathLike[str] = "twinkle", **keywords: Any):
        if "copy" in keywords:
            raise TypeError("PianoVecEnv has no copy: Stable-Baselines3 keeps what it is given, so it always gets copies")
        self.envs = PianoVectorEnv(num_envs, song, **keywords)
        self.render_mode = self.envs.render_mode
        self._returns = np.zeros(num_envs)
        self._lengths = np.zeros(num_envs, int)
        super().__init__(num_envs, self.envs.single_observation_space, self.envs.single_action_space)
        self.metadata: dict[str, Any] = dict(self.envs.metadata)

    def reset(self) -> np.ndarray:
        """Restarts the song in all environments."""
        seeds = None if all(seed is None for seed in self._seeds) else self._seeds
        observations, _ = self.envs.reset(seed=seeds)
        self._reset_seeds()
        self._reset_options()
        self._returns[:], self._lengths[:] = 0.0, 0
        return observations

    def step_async(self, actions: np.ndarray) -> None:
        """Keeps the actions until `step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Plays one control step."""
        observations, rewards, _, over, info = self.envs.step(self._actions)
        self._returns += rewards
        self._lengths += 1
        infos: list[dict[str, Any]] = []
        for index in range(self.num_envs):
            of = info["final_info"] if over[index] else info
            terms = {name: float(of["reward_terms"][name][index]) for name in self.envs.reward_terms}
            scores = {name: float(of[name][index]) for name in SCORES}
            infos.append({"collided": bool(of["collided"][index]), "reward_terms": terms, **scores})
        for index in map(int, np.flatnonzero(over)):
            infos[index] |= {
                "terminal_observation": info["final_obs"][index],
                "TimeLimit.truncated": True,
                "episode": {
                    "r": float(self._returns[index]),
                    "l": int(self._lengths[index]),
                    **{name: infos[index][name] for name in SCORES},
                },
            }
            self._returns[index], self._lengths[index] = 0.0, 0
        return observations, rewards.astype(np.float32), over, infos

    def get_images(self) -> Sequence[np.ndarray | None]:
        """A picture of each environment."""
        return [None] * self.num_envs if self.render_mode is None else self.envs.render() or []

    def close(self) -> None:
        """Does nothing: there is nothing to close."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """An attribute, which all environments share."""
        return [getattr(self.envs, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Environments that step together share their attributes: none can be set."""
        raise AttributeError(f"{attr_name} cannot be set: the environments are built with their keywords")

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **keywords: Any) -> list[Any]:
        """Calls `get_state` or `set_state`, which take the index of an environment first."""
        method = getattr(self.envs, method_name)
        return [method(index, *args, **keywords) for index in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """Always false: no wrappers are used."""
        return [False for _ in self._get_indices(indices)]

    def _get_indices(self, indices: Any) -> Iterable[int]:
        if indices is None:
            return range(self.num_envs)
        return [indices] if isinstance(indices, int) else indices
