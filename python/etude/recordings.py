"""Recordings (MCAP) of `etude` as arrays; needs `mcap`, frames need `pandas`."""

from __future__ import annotations

import json
import os
import pathlib
import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from mcap.exceptions import McapError
from mcap.records import Channel, Footer, Message
from mcap.stream_reader import StreamReader
from numpy.typing import NDArray

from ._native import EtudeError

if TYPE_CHECKING:
    import pandas

LOWEST_PITCH, KEY_COUNT = 36, 49


@dataclass(frozen=True)
class Recording:
    """What was played.

    Attributes:
        header: `song`, `player`, `rig`, `activity` (`kind`: simulation, mode, excitation or rest;
            `name`: of the execution mode or the excitation), `joints`, `due` (the keys due at each
            control step), `late_secs` (see `heard`), `latency_compensation_secs` (how much later the
            control steps and `log_secs` are than the axis of the notes, which is that of
            `due_notes`, of `bar_secs`, and of `secs` in `/key`), `run` (the configuration of the
            player's run), `corrected` (whether a correction was added to the robot's set-points),
            `rig_config` (the rig's file), `schema` (version of the messages, 2).
        topics: The messages of each topic, a column a field. Numbers come as arrays,
            `[messages, …]`; values whose length differs from message to message come as an array of
            objects. `log_secs` is the time of each message, s. Units are those of the recording:
            rad, N·m and s, the rail in m and N.
    """

    header: dict[str, Any]
    topics: dict[str, dict[str, NDArray[Any]]]
    incomplete: str | None

    def __len__(self) -> int:
        return len(self.topics.get("/step", {}).get("step", ()))

    def __getitem__(self, field: str) -> NDArray[Any]:
        """A field of the control steps: `targets`, `positions`, `velocities`, `torques`, …"""
        steps = self.topics.get("/step", {})
        if field not in steps:
            raise KeyError(f"{field}: a control step has {', '.join(steps) or 'nothing here'}")
        return steps[field]

    @property
    def due(self) -> NDArray[np.bool_]:
        """Keys due at each control step, `[steps, 49]`, the first column being C2 (MIDI 36)."""
        return _keys(self.header["due"])

    @property
    def pressed(self) -> NDArray[np.bool_]:
        """Keys that sounded at the end of each control step, `[steps, 49]`."""
        return _keys(self["pressed"])

    @property
    def heard(self) -> NDArray[np.bool_]:
        """Keys that F1 compares with those that are due, `[steps, 49]`: in simulation those at the
        end of each control step, on a robot those `late_secs` of the header later, because
        commands are sent early."""
        late_secs = self.header.get("late_secs")
        if late_secs is None:
            return self.pressed
        ends = (np.arange(len(self)) + 1) / self.header["control_hz"] + late_secs
        strokes = self.topics.get("/key", {"log_secs": (), "pitch": (), "velocity": ()})
        heard = np.zeros((len(self), KEY_COUNT), np.bool_)
        # Each change of a key holds until its next one.
        for secs, pitch, velocity in sorted(zip(strokes["log_secs"], strokes["pitch"], strokes["velocity"]), key=lambda stroke: stroke[0]):
            heard[ends >= secs - 1e-9, pitch - LOWEST_PITCH] = velocity > 0
        return heard

    @property
    def rewards(self) -> dict[str, NDArray[np.float64]]:
        """The weighted reward terms of each control step; of simulations only."""
        terms = list(self.topics.get("/reward", {}).get("terms", []))
        names = terms[0] if terms else {}
        return {name: np.array([term[name] for term in terms]) for name in names}

    def frame(self, topic: str = "/step") -> pandas.DataFrame:
        """A topic as a pandas frame, a row a message, a column a number: `positions_<joint>` of
        what each joint has, `…_0`, … of other lists."""
        import pandas

        columns: dict[str, Any] = {}
        for field, values in self.topics.get(topic, {}).items():
            if values.ndim == 1:
                columns[field] = values
                continue
            names = self.header["joints"] if values.shape[1:] == (len(self.header["joints"]),) else None
            for index in np.ndindex(values.shape[1:]):
                name = names[index[0]] if names else "_".join(map(str, index))
                columns[f"{field}_{name}"] = values[(slice(None), *index)]
        if topic not in self.topics:
            raise KeyError(f"{topic}: this recording has {', '.join(sorted(self.topics))}")
        return pandas.DataFrame(columns)


def _keys(rows: Any) -> NDArray[np.bool_]:
    keys = np.zeros((len(rows), KEY_COUNT), np.bool_)
    for step, pitches in enumerate(rows):
        keys[step, np.asarray(pitches, int) - LOWEST_PITCH] = True
    return keys


def _column(values: list[Any]) -> NDArray[Any]:
    """Numbers as an array where all rows have the same shape, anything else as objects."""
    try:
        array = np.array(values)
    except ValueError:
        array = np.array(None)
    if array.dtype.kind in "biuf" and array.ndim > 0 and array.size > 0:
        return array
    objects = np.empty(len(values), object)
    objects[:] = values
    return objects


def _recording_in(folder: pathlib.Path) -> pathlib.Path:
    """The recording in a folder; of numbered results in the latest."""
    latest = folder / "latest"
    found = sorted((latest.resolve() if latest.is_dir() else folder).glob("*.mcap"))
    if not found:
        raise EtudeError(f"there is no recording in {folder}: `etude play`, `perform` and `record` make them (*.mcap)")
    if len(found) > 1:
        raise EtudeError(f"{folder} has {len(found)} recordings; name one of them: {', '.join(map(str, found))}")
    return found[0]


def read_recording(path: str | os.PathLike[str]) -> Recording:
    """Reads a recording; of an interrupted one the part that exists.

    Args:
        path: The file, or a folder with one recording; of numbered results the latest is read.

    Raises:
        EtudeError: If it is not a recording of Étude.
    """
    path = pathlib.Path(path)
    if path.is_dir():
        path = _recording_in(path)
    messages: dict[str, list[dict[str, Any]]] = {}
    times: dict[str, list[float]] = {}
    channels: dict[int, str] = {}
    incomplete = None
    try:
        with open(path, "rb") as file:
            for record in StreamReader(file).records:
                if isinstance(record, Channel):
                    channels[record.id] = record.topic
                elif isinstance(record, Message):
                    topic = channels[record.channel_id]
                    messages.setdefault(topic, []).append(json.loads(record.data))
                    times.setdefault(topic, []).append(record.log_time * 1e-9)
                elif isinstance(record, Footer) and record.summary_start == 0:
                    incomplete = "the program that wrote it was killed"
    except (McapError, ValueError, KeyError, EOFError, struct.error) as error:
        incomplete = f"it ends in the middle: {error or type(error).__name__}"
    except OSError as error:
        raise EtudeError(f"cannot read {path}: {error}") from error
    header = messages.pop("/header", [])
    if not header or not isinstance(header[0], dict) or "joints" not in header[0]:
        raise EtudeError(f"{path} is not a recording of Étude" + (f" ({incomplete})" if incomplete else ""))
    topics = {}
    for topic, rows in messages.items():
        fields = dict.fromkeys(field for row in rows for field in row)
        topics[topic] = {"log_secs": np.array(times[topic])}
        topics[topic] |= {field: _column([row.get(field) for row in rows]) for field in fields}
    return Recording(header[0], topics, incomplete)
