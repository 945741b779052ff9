"""Pictures of environments, drawn off-screen."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._native import EtudeError, Pianos, check_picture


def check_rendering(mode: str | None, metadata: dict[str, Any], width: int, height: int, view: str) -> None:
    """Refuses an unknown render mode, and pictures that cannot be drawn."""
    if mode is not None and mode not in metadata["render_modes"]:
        raise EtudeError(f"render_mode must be one of {metadata['render_modes']}, not {mode!r}")
    check_picture(width, height, view)


def picture(native: Pianos, index: int, width: int, height: int, view: str) -> NDArray[np.uint8]:
    """Environment `index`, `[height, width, 3]`."""
    pixels = native.render(index, width, height, view)
    return np.frombuffer(pixels, np.uint8).reshape(height, width, 3).copy()
