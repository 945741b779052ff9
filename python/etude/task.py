"""What is played and how: a preset's task, options by path, or the task of a policy."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from gymnasium import spaces

import numpy as np

from ._native import EtudeError, Pianos, Task

SCORES = ("precision", "recall", "f1")


def check_seed(seed: int | None) -> None:
    """Refuses a seed beyond what the random numbers are drawn by."""
    if isinstance(seed, (int, np.integer)) and not 0 <= seed < 2**64:
        raise EtudeError(f"a seed must lie in 0 … 2⁶⁴ − 1, which {seed} is not")


def _toml(path: str, value: object) -> str:
    """The value of an option as TOML."""
    if isinstance(value, (bool, np.bool_)):
        return "true" if value else "false"
    if isinstance(value, (int, np.integer)):
        return str(int(value))
    if isinstance(value, (float, np.floating)):
        return repr(float(value))
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    raise TypeError(f"{path} must be a number, a truth value or a string, not {type(value).__name__}")


def _plain(value: object) -> object:
    """A number of NumPy as one of Python, for JSON."""
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"config has a {type(value).__name__}, which is not of JSON")


def task_config(
    preset: str = "paper",
    options: Mapping[str, Any] | None = None,
    config: Mapping[str, Any] | None = None,
) -> Task:
    """The complete task.

    Args:
        preset: The task of this preset: `paper`, `appendix`, `fast`, `expressive`, `sight-reader`.
        options: Values by path, as `etude train --set task.PATH=VALUE` takes them: for example
            `{"plan.rule": "robopianist", "stage.fences": False, "reward.collision": 0.0}`.
            `PianoEnv(…).task` has all paths with their values.
        config: The task of a policy, `policy.task`, instead of preset and options.

    Raises:
        EtudeError: If a path is unknown or a value cannot be used.
    """
    if config is not None:
        if options is not None or preset != "paper":
            raise TypeError("config is a complete task: give neither preset nor options with it")
        if not isinstance(config, Mapping):
            raise TypeError(f"config must be a mapping, not {type(config).__name__}")
        return Task.of_json(json.dumps(dict(config), default=_plain))
    if not isinstance(options or {}, Mapping):
        raise TypeError(f"options must be a mapping of paths to values, not {type(options).__name__}")
    for path in options or {}:
        if not isinstance(path, str) or "=" in path:
            raise EtudeError(f"options has no {path!r}: a path is a text such as 'plan.rule'")
    changes = [f"task.{path}={_toml(path, value)}" for path, value in (options or {}).items()]
    return Task.of_preset(preset, changes)


def single_spaces(native: Pianos) -> tuple[spaces.Box[np.float32], spaces.Box[np.float32]]:
    """Spaces of an observation (joint readings, then what is 0 or 1) and of an action."""
    real, binary = native.layout
    low = np.concatenate([np.full(real, -np.inf), np.zeros(binary)]).astype(np.float32)
    high = np.concatenate([np.full(real, np.inf), np.ones(binary)]).astype(np.float32)
    return spaces.Box(low, high, dtype=np.float32), spaces.Box(-1.0, 1.0, (native.action_len,), dtype=np.float32)


class Buffers:
    """The arrays that the native part fills: a row an environment."""

    def __init__(self, native: Pianos, num_envs: int, autoreset: bool):
        width, terms = sum(native.layout), len(native.reward_terms)
        self.actions = np.zeros((num_envs, native.action_len), np.float32)
        self.observations = np.zeros((num_envs, width), np.float32)
        self.last_observations = np.zeros((num_envs, width), np.float32) if autoreset else None
        self.rewards = np.zeros(num_envs, np.float64)
        self.over = np.zeros(num_envs, np.bool_)
        self.collided = np.zeros(num_envs, np.bool_)
        self.terms = np.zeros((num_envs, terms), np.float32)
        self.scores = np.ones((num_envs, len(SCORES)), np.float64)

    def step(self, native: Pianos, actions: Any) -> None:
        """One control step. The actions are copied: they must not change while the lock is
        released."""
        actions = np.asarray(actions)
        if actions.shape != self.actions.shape:
            raise EtudeError(f"the actions must have the shape {self.actions.shape}, not {actions.shape}")
        np.copyto(self.actions, actions, casting="same_kind")
        native.step(
            self.actions,
            self.observations,
            self.last_observations,
            self.rewards,
            self.over,
            self.collided,
            self.terms,
            self.scores,
        )
