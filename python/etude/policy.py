"""Policies that Étude has trained, acting in NumPy."""

from __future__ import annotations

import json
import os
import pathlib
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open

from ._native import EtudeError, Task

SCHEMA = "etude-policy-2"
#: No training leads to a larger weight.
MAX_WEIGHT = 1e4
SHIPPED = pathlib.Path(__file__).parent / "policies"
SIGHT_READER = SHIPPED / "sight-reader.safetensors"
MIDI = (".mid", ".midi")
# Policy files in the folder of a run, the best first.
IN_A_RUN = ("policy-best.safetensors", "policy-last.safetensors")


def _gelu(x: NDArray[np.float32]) -> NDArray[np.float32]:
    """GELU in its tanh form, as in the learner."""
    share: NDArray[np.float32] = 1 + np.tanh(np.float32(np.sqrt(2 / np.pi)) * (x + np.float32(0.044715) * x**3))
    return np.float32(0.5) * x * share


@dataclass(frozen=True, eq=False)
class Policy:
    """An actor: hidden layers with GELU, and a head of means and logarithms of deviations.

    Attributes:
        weights: `[inputs, outputs]` of each layer, the head last.
        biases: `[outputs]` of each layer.
        header: What the file says about itself.
        path: The file.
    """

    weights: tuple[NDArray[np.float32], ...]
    biases: tuple[NDArray[np.float32], ...]
    header: dict[str, Any]
    path: pathlib.Path

    def act(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """The best action, without exploration: `[…, observation]` to `[…, action]` in [−1, 1]."""
        mean, _ = self.distribution(observation)
        return np.tanh(mean)

    def distribution(
        self, observation: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Mean and logarithm of the deviation of the action before `tanh`, `[…, action]` each.

        The learner explores with the logarithm clipped to `droq.log_std_bounds` of its
        configuration, by default −20 to 2.
        """
        x = np.asarray(observation, np.float32)
        if x.shape[-1:] != self.weights[0].shape[:1]:
            raise EtudeError(
                f"{self.path} reads observations of {self.weights[0].shape[0]} columns, and this one has the shape {x.shape}; "
                "make the environment with config=policy.task"
            )
        for weight, bias in zip(self.weights[:-1], self.biases[:-1]):
            x = _gelu(x @ weight + bias)
        mean, log_std = np.split(x @ self.weights[-1] + self.biases[-1], 2, axis=-1)
        return mean, log_std

    @property
    def task(self) -> dict[str, Any]:
        """The task of its scores, for `PianoEnv(song, config=policy.task)`: that of its training,
        without randomness."""
        try:
            trained = self.header["notes"]["training"]["config"]["task"]
        except (KeyError, TypeError) as error:
            raise EtudeError(
                f"{self.path} does not say in which task it was trained; use a policy written by this version of Étude"
            ) from error
        try:
            stored = Task.stored(json.dumps(trained))
        except EtudeError as error:
            raise EtudeError(f"{self.path} was trained in a task of another version of Étude: {error}") from error
        task: dict[str, Any] = json.loads(stored.json())
        return task

    @property
    def song(self) -> str | None:
        """Title of the song that it learned."""
        return ((self.header["notes"] or {}).get("training") or {}).get("song")

    @property
    def scores(self) -> dict[str, float]:
        """Scores of its evaluation in training."""
        scores: dict[str, float] = (self.header["notes"] or {}).get("scores", {})
        return scores


def _find(song_or_path: str | os.PathLike[str]) -> pathlib.Path:
    path = pathlib.Path(song_or_path)
    shipped = SHIPPED / f"{path.name}.safetensors"
    if str(song_or_path) == path.name and shipped.is_file():
        return shipped
    if path.is_dir():
        found = next((path / name for name in IN_A_RUN if (path / name).is_file()), None)
        if found is None:
            raise EtudeError(f"there is no policy in {path}: train first, `etude train`")
        return found
    if not path.is_file():
        songs = ", ".join(sorted(file.stem for file in SHIPPED.glob("*.safetensors")))
        raise EtudeError(f"there is no policy {path}; give a file, the folder of a run, or one of {songs}")
    return SIGHT_READER if path.suffix.lower() in MIDI else path


def load_policy(song_or_path: str | os.PathLike[str]) -> Policy:
    """The shipped policy of a built-in song, or that of a file or of a run's folder; for a MIDI
    file the sight-reader.

    Raises:
        EtudeError: If there is none, or the file is not a policy.
    """
    path = _find(song_or_path)
    try:
        with safe_open(path, framework="numpy") as file:
            header = json.loads((file.metadata() or {})["etude"])
            if header["schema"] != SCHEMA:
                raise EtudeError(
                    f"{path}: its schema is `{header['schema']}`, and this version of Étude reads `{SCHEMA}`; "
                    "use a policy written by this version"
                )
            layers = [f"actor.layer{index}" for index in range(len(header["hidden"]))] + ["actor.head"]
            names = {f"{layer}.{part}" for layer in layers for part in ("weight", "bias")}
            if set(file.keys()) != names:
                raise EtudeError(f"{path} is damaged: its tensors are not those of its header's layers")
            weights = tuple(file.get_tensor(f"{layer}.weight") for layer in layers)
            biases = tuple(file.get_tensor(f"{layer}.bias") for layer in layers)
        widths = [sum(header["layout"].values()), *header["hidden"], 2 * header["action_len"]]
    except (SafetensorError, OSError, KeyError, TypeError, AttributeError, json.JSONDecodeError) as error:
        raise EtudeError(f"{path} is not a policy of Étude: {error}") from error
    shapes = [(weight.shape, bias.shape) for weight, bias in zip(weights, biases)]
    if shapes != [((inputs, outputs), (outputs,)) for inputs, outputs in zip(widths, widths[1:])]:
        raise EtudeError(f"{path} is damaged: its tensors do not have the shapes that its header claims")
    if not all(tensor.dtype == np.float32 and np.isfinite(tensor).all() for tensor in (*weights, *biases)):
        raise EtudeError(f"{path} is damaged: a tensor holds values that are not finite 32-bit numbers")
    if any(np.abs(tensor).max(initial=0.0) > MAX_WEIGHT for tensor in (*weights, *biases)):
        raise EtudeError(f"{path} is damaged or was changed: a weight is above {MAX_WEIGHT:.0f}; train it again")
    return Policy(weights, biases, header, path)
