"""MuJoCo's own window, which follows an environment."""

from __future__ import annotations

import threading
import time
import warnings

import mujoco

from ._native import EtudeError


class Window:
    """Shows joint positions of one world, no faster than they are played."""

    def __init__(self, mjcf: str, fps: float):
        import glfw
        import mujoco.viewer

        # Without a screen MuJoCo's viewer ends in its own thread, and the thread that opened it
        # waits forever.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            if not glfw.init():
                raise EtudeError(
                    "no window: it needs a screen with OpenGL (DISPLAY or WAYLAND_DISPLAY); the mode rgb_array needs none"
                )
        self._model = mujoco.MjModel.from_xml_string(mjcf)
        self._data = mujoco.MjData(self._model)
        others = set(threading.enumerate())
        self._viewer = mujoco.viewer.launch_passive(self._model, self._data, show_left_ui=False, show_right_ui=False)
        self._threads = set(threading.enumerate()) - others
        with self._viewer.lock():
            # As the view `player` of the pictures.
            camera = self._viewer.cam
            camera.lookat[:], camera.distance, camera.azimuth, camera.elevation = (0.0, 0.0, 0.04), 0.62, 180.0, -50.0
        self._frame_secs = 1.0 / fps
        self._next = time.monotonic()

    def show(self, qpos: list[float]) -> None:
        """Shows the world with these positions; a window that was closed stays closed."""
        if not self._viewer.is_running():
            return
        time.sleep(max(0.0, self._next - time.monotonic()))
        self._next = max(self._next, time.monotonic() - self._frame_secs) + self._frame_secs
        with self._viewer.lock():
            self._data.qpos[:] = qpos
            mujoco.mj_kinematics(self._model, self._data)
        self._viewer.sync()

    def close(self) -> None:
        """Closes it, and waits for its threads, which draw until then."""
        self._viewer.close()
        for thread in self._threads:
            thread.join(timeout=2.0)
