"""Many environments over threads, in Gymnasium's idiom."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from ._native import EtudeError, Pianos
from .pictures import check_rendering, picture
from .task import SCORES, Buffers, check_seed, single_spaces, task_config

Array = NDArray[Any]


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class PianoVectorEnv(gymnasium.vector.VectorEnv[Array, Array, Array]):
    """`num_envs` environments of one song that step together, over threads and without the GIL.

    An episode that ends begins again in the same step (`AutoresetMode.SAME_STEP`):
    `info["final_obs"]` and `info["final_info"]` have what it ended with. Environment `i` of
    `reset(seed=s)` observes what a `PianoEnv` observes after `reset(seed=s + i)`, byte for byte,
    however many threads there are. Actions and observations are those of `PianoEnv`.

    Args:
        num_envs: How many.
        song: A built-in song (`etude.SONGS`) or the path of a MIDI file.
        threads: How many to use; one a core if not given, and never more than environments.
        copy: Whether returned arrays are the caller's to keep. Otherwise the next step overwrites
            them, and no other thread may touch them meanwhile.
        render_mode: `rgb_array`, for `render()`.
        width: Pixels of a picture.
        height: Pixels of a picture.
        view: Where the camera stands: `player`, `side`, `top` or `fingers`.
        preset: As for `PianoEnv`.
        options: As for `PianoEnv`.
        config: As for `PianoEnv`.

    Raises:
        EtudeError: If the song, a path or a value cannot be used.
    """

    metadata = {"autoreset_mode": AutoresetMode.SAME_STEP, "render_modes": ["rgb_array"], "render_fps": 20}

    def __init__(
        self,
        num_envs: int = 1,
        song: str | os.PathLike[str] = "twinkle",
        *,
        threads: int | None = None,
        copy: bool = True,
        render_mode: Literal["rgb_array"] | None = None,
        width: int = 320,
        height: int = 240,
        view: str = "player",
        preset: str = "paper",
        options: Mapping[str, Any] | None = None,
        config: Mapping[str, Any] | None = None,
    ):
        if not isinstance(num_envs, (int, np.integer)):
            raise TypeError(f"num_envs comes first and is a whole number, not {num_envs!r}: PianoVectorEnv(8, 'twinkle')")
        num_envs = int(num_envs)
        check_rendering(render_mode, self.metadata, width, height, view)
        threads = min(num_envs, _cores()) if threads is None else threads
        self._task = task_config(preset, options, config)
        self._native = Pianos(os.fspath(song), self._task, num_envs, threads)
        self.num_envs = num_envs
        self.render_mode = render_mode
        self._picture = (width, height, view)
        self._copy = copy
        self._buffers = Buffers(self._native, num_envs, autoreset=True)
        self._begun = np.zeros(num_envs, np.bool_)
        self.reward_terms: list[str] = self._native.reward_terms
        self.title: str = self._native.title
        self.steps: int = self._native.steps
        self.action_low, self.action_high = map(np.array, self._native.action_range)
        self.single_observation_space, self.single_action_space = single_spaces(self._native)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    @property
    def task(self) -> dict[str, Any]:
        """The complete configuration of the task."""
        task: dict[str, Any] = json.loads(self._task.json())
        return task

    def _own(self, array: Array) -> Array:
        return array.copy() if self._copy else array

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Restarts the song, in all environments or in those of `options["reset_mask"]`. Seeds lie
        in 0 … 2⁶⁴ − 1."""
        seed = int(seed) if isinstance(seed, np.integer) else seed
        seeds = [seed + i for i in range(self.num_envs)] if isinstance(seed, int) else seed
        seeds = [None] * self.num_envs if seeds is None else list(seeds)
        for one in seeds:
            check_seed(one)
        super().reset(seed=seed if isinstance(seed, int) else None)
        mask = (options or {}).get("reset_mask")
        mask = np.ones(self.num_envs, np.bool_) if mask is None else np.ascontiguousarray(mask)
        if mask.dtype != np.bool_ or not mask.any():
            raise EtudeError("options['reset_mask'] must be an array of truth values, one of them true")
        if len(seeds) != self.num_envs:
            raise EtudeError(f"there must be a seed for each of {self.num_envs} environments, not {len(seeds)}")
        # An environment that was never reset and has no seed gets a random one.
        fresh = [one is None and not begun for one, begun in zip(seeds, self._begun)]
        seeds = [int(self.np_random.integers(2**62)) if new else one for one, new in zip(seeds, fresh)]
        self._native.reset(seeds, mask, self._buffers.observations)
        self._begun |= mask
        return self._own(self._buffers.observations), {}

    def step(self, actions: Array) -> tuple[Array, Array, Array, Array, dict[str, Any]]:
        """Plays one control step in every environment."""
        if not self._begun.all():
            raise EtudeError("call reset() before the first step")
        buffers = self._buffers
        buffers.step(self._native, actions)
        over = buffers.over.copy()
        info = self._info(~over)
        if over.any():
            assert buffers.last_observations is not None
            last = np.full(self.num_envs, None, object)
            for index in np.flatnonzero(over):
                last[index] = buffers.last_observations[index].copy()
            info |= {"final_obs": last, "_final_obs": over, "final_info": self._info(over), "_final_info": over}
        observations, rewards = self._own(buffers.observations), self._own(buffers.rewards)
        return observations, rewards, np.zeros(self.num_envs, np.bool_), over.copy(), info

    def _info(self, of: Array) -> dict[str, Any]:
        """The `info` of the environments `of`."""
        buffers = self._buffers
        info: dict[str, Any] = {}
        if not of.any():
            return info
        for column, name in enumerate(SCORES):
            info[name] = np.where(of, buffers.scores[:, column], 0.0)
        info["collided"] = buffers.collided & of
        terms = np.where(of[:, np.newaxis], buffers.terms, np.float32(0.0)).astype(np.float64)
        info["reward_terms"] = {name: terms[:, column] for column, name in enumerate(self.reward_terms)}
        info["reward_terms"] |= {f"_{name}": of for name in self.reward_terms}
        return info | {f"_{name}": of for name in info}

    def get_state(self, index: int) -> bytes:
        """Everything that environment `index` needs to continue bit for bit."""
        return self._native.state(index)

    def set_state(self, index: int, state: bytes) -> NDArray[np.float32]:
        """Restores environment `index` from a state; returns its observation."""
        row = self._buffers.observations[index : index + 1]
        self._native.set_state(index, state, row)
        self._begun[index] = True
        observation: NDArray[np.float32] = row[0].copy()
        return observation

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """A picture of each environment, `[height, width, 3]`."""
        if self.render_mode is None:
            gymnasium.logger.warn("give the render_mode rgb_array to see something")
            return None
        return tuple(picture(self._native, index, *self._picture) for index in range(self.num_envs))
