"""What is played and how: the keywords of the environments, as the configuration that Étude's own trainer reads."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, Literal

from gymnasium import spaces

import numpy as np

from ._native import EtudeError, Pianos, Task

PRESETS = {"main": "paper", "appendix": "appendix"}
SCORES = ("precision", "recall", "f1")


def check_seed(seed: int | None) -> None:
    """Refuses a seed beyond what the random numbers are drawn by."""
    if isinstance(seed, (int, np.integer)) and not 0 <= seed < 2**64:
        raise EtudeError(f"a seed must lie in 0 … 2⁶⁴ − 1, which {seed} is not")


def _toml(path: str, value: object) -> str:
    """The value of a keyword as TOML."""
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
    *,
    variant: Literal["main", "appendix"] = "main",
    observation_scale: Literal["normalised", "si"] | None = None,
    previous_joints: bool | None = None,
    previous_actions: int | None = None,
    fingering: bool | None = None,
    change_steps: int | None = None,
    finger_range: float | None = None,
    rail_range: float | None = None,
    rail_set_point: bool | None = None,
    velocities: bool | None = None,
    plan: Mapping[str, Any] | None = None,
    lookahead: int | None = None,
    initial_silence_secs: float | None = None,
    side: Literal["left", "right"] | None = None,
    fences: bool | None = None,
    actuation: str | None = None,
    reward: Mapping[str, float] | None = None,
    physics: Mapping[str, float] | None = None,
    randomisation: float | Mapping[str, Any] | None = None,
    config: Mapping[str, Any] | None = None,
) -> Task:
    """The complete task.

    Args:
        variant: The decision process of the paper's main text or of its appendix; the rest changes single things of it.
        observation_scale: `normalised` (finger joints by their range to −1 … 1, the rail in white keys from the middle), or `si` (rad and m).
        previous_joints: Whether the observation holds the joints of one step ago.
        previous_actions: Previous actions that the observation shows, 0 to 4.
        fingering: Whether a fingering is planned for the song: the observation shows each finger its goal, and the rail's action is a
            distance from its planned place. The reward terms `fingering`, `velocity`, `dynamics` and `holding` need it.
        change_steps: Control steps of silence in which a fingering lets a finger change from one key to another of the same
            colour, 1 to 20.
        finger_range: How far the target of a finger joint may be from the pose that holds the fingertip over its goal, rad; 0 stands for
            the joint's whole range. It needs a fingering.
        rail_range: How far the target of the rail may be from its planned place, m, with a fingering.
        rail_set_point: Whether the observation has the rail's set-point instead of its measured place.
        velocities: Whether the observation shows, with each finger's goal, how loud its note is. It needs a fingering.
        plan: What is due, by name: `rule` (`robopianist` or `articulated`), `restrike_secs` and `latency_compensation_secs`; the others keep the
            variant's.
        lookahead: Control steps of the sheet shown beyond the current one, 0 to 40.
        initial_silence_secs: Silence before the first note, s.
        side: Which hand plays.
        fences: Whether fences stand between the white keys.
        actuation: How the joints are driven, `controlled` (as identified: torque by our controller) or `position`.
        reward: Weights of reward terms by name; the others keep the variant's.
        physics: Physical numbers by path (`etude model params` lists them).
        randomisation: Intensity of the domain randomisation, 0 to 1, or its table (`intensity`, `widths`).
        config: A task as a policy carries it, instead of the other keywords; what it leaves out is as in the paper's main text. It alone
            has `view` (`hand`: the observation of the sight-reader).

    Raises:
        EtudeError: If a name is unknown or a value cannot be used.
    """
    single = {
        "scale": observation_scale,
        "previous_joints": previous_joints,
        "previous_actions": previous_actions,
        "fingering": fingering,
        "change_steps": change_steps,
        "finger_range": finger_range,
        "rail_range": rail_range,
        "rail_set_point": rail_set_point,
        "velocities": velocities,
        "lookahead": lookahead,
        "initial_silence_secs": initial_silence_secs,
        "stage.side": side,
        "stage.fences": fences,
        "stage.actuation": actuation,
    }
    changes = {path: value for path, value in single.items() if value is not None}
    if plan is not None:
        changes |= _flat("plan", plan)
    if reward is not None:
        changes |= _flat("reward", reward)
    if physics is not None:
        changes |= _flat("physics", physics)
    if isinstance(randomisation, Mapping):
        changes |= _flat("randomisation", randomisation)
    elif randomisation is not None:
        changes["randomisation.intensity"] = randomisation
    if config is not None:
        if changes or variant != "main":
            raise TypeError("config is a complete task: give no other task keyword with it")
        if not isinstance(config, Mapping):
            raise TypeError(f"config must be a mapping, not {type(config).__name__}")
        return Task.of_json(json.dumps(dict(config), default=_plain))
    if variant not in PRESETS:
        raise EtudeError(f"variant must be one of {', '.join(PRESETS)}, not {variant!r}")
    return Task.of_preset(PRESETS[variant], [f"task.{path}={_toml(path, value)}" for path, value in changes.items()])


def _flat(prefix: str, table: Mapping[str, Any]) -> dict[str, Any]:
    """The values of a table by their paths."""
    if not isinstance(table, Mapping):
        raise TypeError(f"{prefix} must be a mapping of names to values, not {type(table).__name__}")
    flat: dict[str, Any] = {}
    for key, value in table.items():
        if not isinstance(key, str) or "=" in key:
            raise EtudeError(f"{prefix} has no {key!r}")
        path = f"{prefix}.{key}"
        flat |= _flat(path, value) if isinstance(value, Mapping) else {path: value}
    return flat


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
        """One control step. The actions are copied: they must not change while the interpreter's lock is released."""
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
