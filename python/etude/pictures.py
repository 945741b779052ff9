"""Pictures of environments, drawn off-screen."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._native import Pianos


def check_mode(mode: str | None, metadata: dict[str, Any]) -> None:
    """Refuses a render mode that the environment has not."""
    if mode is not None and mode not in metadata["render_modes"]:
        raise ValueError(f"render_mode must be one of {metadata['render_modes']}, not {mode!r}")


def picture(native: Pianos, index: int, width: int, height: int, view: str) -> NDArray[np.uint8]:
    """Environment `index`, `[height, width, 3]`."""
    pixels = native.render(index, width, height, view)
    return np.frombuffer(pixels, np.uint8).reshape(height, width, 3).copy()
