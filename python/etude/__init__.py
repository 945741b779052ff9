"""Étude: a robot hand at the piano.

>>> import gymnasium, etude
>>> env = gymnasium.make("etude/Twinkle-v0")

Every built-in song is registered under its name (`etude.SONGS`), any MIDI file is played by
`gymnasium.make("etude/Piano-v0", song="my.mid")`.
"""

import gymnasium
import mujoco  # noqa: F401  Loads the library that the extension needs.

from ._native import CONTROL_HZ, EtudeError, __version__
from ._native import songs as _songs
from .env import PianoEnv
from .policy import Policy, load_policy
from .vector import PianoVectorEnv

SONGS: dict[str, str] = dict(_songs())
"""Ids and titles of the built-in songs."""

__all__ = [
    "CONTROL_HZ",
    "EtudeError",
    "PianoEnv",
    "PianoVectorEnv",
    "Policy",
    "SONGS",
    "__version__",
    "env_id",
    "load_policy",
]


def env_id(song: str) -> str:
    """The Gymnasium id of a built-in song: `etude/Twinkle-v0` for `twinkle`."""
    return "etude/" + "".join(word.capitalize() for word in song.split("-")) + "-v0"


def _register() -> None:
    ids: dict[str, dict[str, str]] = {"etude/Piano-v0": {}} | {env_id(song): {"song": song} for song in SONGS}
    for name, keywords in ids.items():
        gymnasium.register(
            id=name,
            entry_point="etude.env:PianoEnv",
            vector_entry_point="etude.vector:PianoVectorEnv",
            kwargs=keywords,
        )


_register()
