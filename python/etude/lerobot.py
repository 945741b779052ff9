"""Recordings as a LeRobot dataset (layout v3.0); needs `mcap`, `pandas` and `pyarrow`.

    python -m etude.lerobot out/twinkle … -o dataset

An episode is a recording, a frame a control step. `observation.state` are the joints as the step
began, `observation.keys` the keys that sounded then, `observation.due` those due in it, `action`
the targets that were chosen, `next.reward` what the step earned (of simulations), `next.done`
whether the song ended with it. Recordings hold what a step has led to: their first step has nothing
before it, and is no frame. Rad, the rail in m.
"""

from __future__ import annotations

import argparse
import json
import os
import pathlib
import shutil
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from ._native import EtudeError
from .recordings import KEY_COUNT, LOWEST_PITCH, Recording, read_recording

VERSION = "v3.0"
FILES_A_CHUNK = 1000
DATA_FILE_MB = 100
PATH = "chunk-{chunk_index:03d}/file-{file_index:03d}"
PERCENTILES = (1, 10, 50, 90, 99)
# Columns that every dataset of this layout has.
COUNTERS = {"timestamp": "float32", "frame_index": "int64", "episode_index": "int64", "index": "int64", "task_index": "int64"}

Columns = dict[str, np.ndarray]


def _frames(recording: Recording) -> Columns:
    """The frames of an episode, `[frames]` or `[frames, width]` each."""
    # In recordings of a robot the targets of a step are the last waypoints; the chosen targets have
    # a separate topic.
    chosen = recording.topics.get("/target", {"targets": recording["targets"]})["targets"]
    rewards = recording.rewards
    # An interrupted recording may end between the messages of a step.
    steps = min([len(recording), len(chosen), len(recording.due), *map(len, rewards.values())])
    columns = {
        "observation.state": recording["positions"][: steps - 1].astype(np.float32),
        "observation.keys": recording.pressed[: steps - 1].astype(np.float32),
        "observation.due": recording.due[1:steps].astype(np.float32),
        "action": chosen[1:steps].astype(np.float32),
        "next.done": np.arange(1, steps) == len(recording.due) - 1,
    }
    if rewards:
        columns["next.reward"] = np.sum([terms[1:steps] for terms in rewards.values()], axis=0).astype(np.float32)
    columns["timestamp"] = (np.arange(steps - 1) / recording.header["control_hz"]).astype(np.float32)
    columns["frame_index"] = np.arange(steps - 1)
    return columns


def _features(columns: Columns, joints: list[str]) -> dict[str, dict[str, Any]]:
    """The columns as `info.json` describes them."""
    pitches = [f"midi_{LOWEST_PITCH + key}" for key in range(KEY_COUNT)]
    names = {"observation.state": joints, "action": joints, "observation.keys": pitches, "observation.due": pitches}
    features = {
        name: {"dtype": str(values.dtype), "shape": list(values.shape[1:]) or [1], "names": names.get(name)}
        for name, values in columns.items()
        if name not in COUNTERS
    }
    return features | {name: {"dtype": kind, "shape": [1], "names": None} for name, kind in COUNTERS.items()}


def _statistics(columns: Columns) -> dict[str, dict[str, list[float]]]:
    statistics: dict[str, dict[str, list[float]]] = {}
    for name, values in columns.items():
        rows = values.reshape(len(values), -1).astype(np.float64)
        parts = {"min": rows.min(0), "max": rows.max(0), "mean": rows.mean(0), "std": rows.std(0)}
        parts |= {f"q{percent:02}": np.percentile(rows, percent, axis=0) for percent in PERCENTILES}
        statistics[name] = {part: value.tolist() for part, value in parts.items()}
        statistics[name]["count"] = [len(rows)]
    return statistics


def _table(columns: Columns, features: dict[str, dict[str, Any]]) -> pa.Table:
    arrays = {}
    for name, feature in features.items():
        values = columns[name]
        if values.ndim == 1:
            arrays[name] = pa.array(values.astype(feature["dtype"]))
        else:
            arrays[name] = pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), values.shape[1])
    return pa.table(arrays)


def _files(sizes: Iterable[int]) -> Iterator[tuple[int, int]]:
    """Chunk and file of each episode: a file is full before it would exceed its size."""
    number, filled = 0, 0
    for size in sizes:
        if filled and filled + size > DATA_FILE_MB * 2**20:
            number, filled = number + 1, 0
        filled += size
        yield divmod(number, FILES_A_CHUNK)


def export_dataset(
    recordings: Iterable[str | os.PathLike[str]], folder: str | os.PathLike[str], *, robot_type: str = "allegro_xarm7"
) -> pathlib.Path:
    """Writes recordings as a LeRobot dataset into `folder`, which must not exist; all or nothing.

    Raises:
        EtudeError: If there is nothing to write, a recording cannot be used, or the folder exists.
    """
    folder = pathlib.Path(folder)
    if folder.exists():
        raise EtudeError(f"{folder} exists already: name a new folder")
    episodes = [(path, read_recording(path)) for path in recordings]
    if not episodes:
        raise EtudeError("no recording was given: name recordings made by `etude play` or `etude perform`")
    for path, recording in episodes:
        if not recording.header["due"]:
            raise EtudeError(f"{path} has no song: it is no episode; name recordings made by `etude play` or `etude perform`")
        if len(recording) < 3:
            raise EtudeError(f"{path} has {len(recording)} control steps: an episode needs three; name a longer recording")
        if (recording.header["joints"], recording.header["control_hz"]) != (
            episodes[0][1].header["joints"], episodes[0][1].header["control_hz"],
        ):
            raise EtudeError(f"{path} is of another robot or rate than {episodes[0][0]}: name recordings of one robot")
    scratch = folder.with_name(folder.name + ".partial")
    shutil.rmtree(scratch, ignore_errors=True)
    try:
        _write(scratch, [recording for _, recording in episodes], robot_type)
        scratch.rename(folder)
    except OSError as error:
        raise EtudeError(f"cannot write {folder}: {error}") from error
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
    return folder


def _write(folder: pathlib.Path, recordings: list[Recording], robot_type: str) -> None:
    episodes = [_frames(recording) for recording in recordings]
    if not all("next.reward" in columns for columns in episodes):
        # A robot has no rewards.
        for columns in episodes:
            columns.pop("next.reward", None)
    songs = [recording.header["song"] for recording in recordings]
    tasks = list(dict.fromkeys(f"play {song}" for song in songs))
    first = 0
    for index, (columns, song) in enumerate(zip(episodes, songs)):
        frames = len(columns["frame_index"])
        columns["episode_index"] = np.full(frames, index)
        columns["index"] = np.arange(first, first + frames)
        columns["task_index"] = np.full(frames, tasks.index(f"play {song}"))
        first += frames
    features = _features(episodes[0], recordings[0].header["joints"])
    tables = [_table(columns, features) for columns in episodes]
    rows: list[dict[str, Any]] = []
    files: dict[tuple[int, int], list[pa.Table]] = {}
    for index, (table, place) in enumerate(zip(tables, _files(table.nbytes for table in tables))):
        files.setdefault(place, []).append(table)
        columns = episodes[index]
        row = {"episode_index": index, "tasks": [f"play {songs[index]}"], "length": len(table)}
        row |= {"data/chunk_index": place[0], "data/file_index": place[1]}
        row |= {"dataset_from_index": int(columns["index"][0]), "dataset_to_index": int(columns["index"][-1]) + 1}
        row |= {"meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0}
        for name, statistics in _statistics(columns).items():
            row |= {f"stats/{name}/{part}": value for part, value in statistics.items()}
        rows.append(row)
    for (chunk, file), parts in files.items():
        path = folder / "data" / (PATH.format(chunk_index=chunk, file_index=file) + ".parquet")
        path.parent.mkdir(parents=True, exist_ok=True)
        pq.write_table(pa.concat_tables(parts), path)
    meta = folder / "meta"
    path = meta / "episodes" / (PATH.format(chunk_index=0, file_index=0) + ".parquet")
    path.parent.mkdir(parents=True)
    pq.write_table(pa.Table.from_pylist(rows), path)
    pd.DataFrame({"task_index": range(len(tasks))}, index=tasks).to_parquet(meta / "tasks.parquet")
    together = {name: np.concatenate([columns[name] for columns in episodes]) for name in features}
    (meta / "stats.json").write_text(json.dumps(_statistics(together), indent=1))
    info = {
        "codebase_version": VERSION,
        "robot_type": robot_type,
        "total_episodes": len(episodes),
        "total_frames": first,
        "total_tasks": len(tasks),
        "chunks_size": FILES_A_CHUNK,
        "data_files_size_in_mb": DATA_FILE_MB,
        "video_files_size_in_mb": 200,
        "fps": int(recordings[0].header["control_hz"]),
        "splits": {"train": f"0:{len(episodes)}"},
        "data_path": "data/" + PATH + ".parquet",
        "video_path": None,
        "features": features,
    }
    (meta / "info.json").write_text(json.dumps(info, indent=1))


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m etude.lerobot", description="Recordings as a LeRobot dataset, v3.0.")
    parser.add_argument("recordings", nargs="+", metavar="RECORDING", help="recordings (*.mcap)")
    parser.add_argument("-o", "--out", required=True, metavar="DIR", help="a folder that is not there yet")
    arguments = parser.parse_args()
    try:
        print(export_dataset(arguments.recordings, arguments.out))
    except EtudeError as error:
        parser.exit(1, f"{error}\n")


if __name__ == "__main__":
    main()
