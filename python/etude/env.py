"""One environment, in Gymnasium's idiom."""

from __future__ import annotations

import json
import os
import secrets
from collections.abc import Mapping
from typing import Any, Literal

import gymnasium
import numpy as np
from numpy.typing import NDArray

from ._native import EtudeError, Pianos
from .pictures import check_rendering, picture
from .task import SCORES, Buffers, check_seed, single_spaces, task_config
from .window import Window

Observation = NDArray[np.float32]


class PianoEnv(gymnasium.Env[Observation, NDArray[np.float32]]):
    """A song, played once an episode, at 20 control steps a second.

    An action has a target for each of the twelve finger joints that move and for the rail: −1 to 1
    of the range from `action_low` to `action_high` (rad, the rail in m). The rail's range is the
    part of the keyboard that the song needs, so it differs between songs. With the options
    `fingering` and `finger_range` the ranges are around the planned rail position and pose;
    `action_low` and `action_high` are then those of the first step.

    An observation has the joints, the previous action (preset `paper`), the 49 keys that sound, and the 49 keys
    that are due now and in each of the next five steps. Finger joints are scaled by their range to
    −1 … 1, and the rail is in white keys from the middle. The options `previous_actions`,
    `fingering` and `velocities` add columns (docs/algorithm.md has the tables).

    The episode ends with the song, which is a truncation. `info` has `reward_terms` (the weighted
    terms of the reward), `collided`, and `precision`, `recall` and `f1` of the song so far.
    Environments are not copied or pickled: build another one and give it `get_state()`.

    Args:
        song: A built-in song (`etude.SONGS`) or the path of a MIDI file.
        render_mode: `rgb_array` draws off-screen (EGL), `human` opens MuJoCo's window.
        width: Pixels of a picture.
        height: Pixels of a picture.
        view: Where the camera stands in pictures: `player`, `side`, `top` or `fingers`. The window
            of `human` has its own camera and size, and shows the world without randomisation.
        preset: The task of this preset, see `etude.task.task_config`.
        options: Values of the task by path, `{"stage.fences": False}`.
        config: The task of a policy, `policy.task`, instead of preset and options.

    Raises:
        EtudeError: If the song, a path or a value cannot be used.
    """

    metadata = {"render_modes": ["human", "rgb_array"], "render_fps": 20}

    def __init__(
        self,
        song: str | os.PathLike[str] = "twinkle",
        *,
        render_mode: Literal["human", "rgb_array"] | None = None,
        width: int = 640,
        height: int = 480,
        view: str = "player",
        preset: str = "paper",
        options: Mapping[str, Any] | None = None,
        config: Mapping[str, Any] | None = None,
    ):
        check_rendering(render_mode, self.metadata, width, height, view)
        self.render_mode = render_mode
        self._task = task_config(preset, options, config)
        self._native = Pianos(os.fspath(song), self._task, 1, 1)
        self._picture = (width, height, view)
        self._window: Window | None = None
        self._buffers = Buffers(self._native, 1, autoreset=False)
        self._everywhere = np.ones(1, np.bool_)
        self._begun = False
        self.reward_terms: list[str] = self._native.reward_terms
        self.title: str = self._native.title
        self.steps: int = self._native.steps
        self.action_low, self.action_high = map(np.array, self._native.action_range)
        self.observation_space, self.action_space = single_spaces(self._native)

    @property
    def task(self) -> dict[str, Any]:
        """The complete configuration of the task."""
        task: dict[str, Any] = json.loads(self._task.json())
        return task

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Restarts the song. A seed, 0 to 2⁶⁴ − 1, determines all later random draws (of the
        randomised worlds). If the first reset has none, `np_random_seed` is the one that was drawn.
        """
        if seed is None and not self._begun:
            seed = secrets.randbits(62)
        check_seed(seed)
        super().reset(seed=seed)
        self._native.reset([seed], self._everywhere, self._buffers.observations)
        self._begun = True
        if self.render_mode == "human":
            self.render()
        return self._buffers.observations[0].copy(), {}

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Plays one control step."""
        if not self._begun:
            raise EtudeError("call reset() before the first step")
        action = np.asarray(action)
        if action.shape != self.action_space.shape:
            raise EtudeError(f"an action must have the shape {self.action_space.shape}, not {action.shape}")
        buffers = self._buffers
        buffers.step(self._native, action[np.newaxis])
        info: dict[str, Any] = dict(zip(SCORES, buffers.scores[0].tolist()))
        info["collided"] = bool(buffers.collided[0])
        info["reward_terms"] = dict(zip(self.reward_terms, buffers.terms[0].tolist()))
        if self.render_mode == "human":
            self.render()
        return buffers.observations[0].copy(), float(buffers.rewards[0]), False, bool(buffers.over[0]), info

    def get_state(self) -> bytes:
        """Everything that the episode needs to continue bit for bit."""
        return self._native.state(0)

    def set_state(self, state: bytes) -> Observation:
        """Continues from `get_state` of this environment, or of another one of the same song and
        task.

        Returns:
            The observation there.

        Raises:
            EtudeError: If it is not such a state; the episode continues unchanged.
        """
        self._native.set_state(0, state, self._buffers.observations)
        self._begun = True
        observation: Observation = self._buffers.observations[0].copy()
        return observation

    def render(self) -> NDArray[np.uint8] | None:
        """A picture, `[height, width, 3]`; in the mode `human` it goes to the window."""
        if self.render_mode is None:
            gymnasium.logger.warn("give a render_mode to see something: human or rgb_array")
            return None
        if self.render_mode == "human":
            if self._window is None:
                self._window = Window(self._native.mjcf(), self.metadata["render_fps"])
            self._window.show(self._native.qpos(0))
            return None
        return picture(self._native, 0, *self._picture)

    def close(self) -> None:
        """Closes the window, if there is one."""
        if self._window is not None:
            self._window.close()
            self._window = None
