"""Recordings as a LeRobot dataset, read back by Hugging Face's `datasets` as LeRobot does."""

import json
import subprocess
import sys

import datasets
import numpy as np
import pandas as pd
import pytest

import etude
from etude.lerobot import _files, export_dataset
from etude.recordings import read_recording


def load(folder, split, features=None):
    files = sorted(map(str, (folder / split).glob("*/*.parquet")))
    return datasets.Dataset.from_parquet(files, features=features, cache_dir=str(folder / "cache"))


def promised(info):
    """The types that `info.json` promises, which the files must have."""
    values = {name: (datasets.Value(feature["dtype"]), feature["shape"]) for name, feature in info["features"].items()}
    return datasets.Features(
        {name: value if shape == [1] else datasets.Sequence(value, length=shape[0]) for name, (value, shape) in values.items()}
    )


def test_a_dataset_holds_what_was_played(played, tmp_path):
    path = played / "latest" / "recording.mcap"
    folder = export_dataset([path, path], tmp_path / "set")
    recording = read_recording(path)
    info = json.loads((folder / "meta/info.json").read_text())
    frames = len(recording) - 1
    assert (info["codebase_version"], info["fps"], info["total_episodes"]) == ("v3.0", 20, 2)
    assert info["total_frames"] == 2 * frames and info["splits"] == {"train": "0:2"}
    assert info["features"]["action"]["names"] == recording.header["joints"]

    data = load(folder, "data", promised(info)).with_format("numpy")
    assert len(data) == 2 * frames and set(data.column_names) == set(info["features"])
    for name, feature in info["features"].items():
        value = data[0][name]
        assert list(np.shape(value) or (1,)) == feature["shape"] and np.asarray(value).dtype == feature["dtype"]
    second = data[frames:]
    np.testing.assert_array_equal(second["action"], recording["targets"][1:].astype(np.float32))
    np.testing.assert_array_equal(second["observation.state"], recording["positions"][:-1].astype(np.float32))
    np.testing.assert_array_equal(second["observation.keys"], recording.pressed[:-1])
    np.testing.assert_array_equal(second["observation.due"], recording.due[1:])
    np.testing.assert_allclose(second["next.reward"], sum(recording.rewards.values())[1:], rtol=1e-6)
    assert second["next.done"].tolist() == [False] * (frames - 1) + [True]
    np.testing.assert_array_equal(data["index"], np.arange(2 * frames))
    np.testing.assert_array_equal(second["frame_index"], np.arange(frames))

    episodes = load(folder, "meta/episodes")
    assert [row["length"] for row in episodes] == [frames, frames]
    assert [row["dataset_to_index"] for row in episodes] == [frames, 2 * frames]
    assert info["data_path"].format(**{key: episodes[1][f"data/{key}"] for key in ("chunk_index", "file_index")}) == (
        "data/chunk-000/file-000.parquet"
    )
    tasks = pd.read_parquet(folder / "meta/tasks.parquet")
    task = f"play {recording.header['song']}"
    assert tasks.loc[task].task_index == 0 and episodes[0]["tasks"] == [task]
    stats = json.loads((folder / "meta/stats.json").read_text())
    np.testing.assert_allclose(stats["action"]["mean"], np.mean(data["action"], axis=0), atol=1e-5)
    np.testing.assert_allclose(stats["action"]["q50"], np.median(data["action"], axis=0), atol=1e-5)
    np.testing.assert_allclose(stats["action"]["std"], np.std(data["action"], axis=0), atol=1e-5)


def test_of_half_a_recording_what_is_whole_is_written(played, tmp_path):
    whole = (played / "latest" / "recording.mcap").read_bytes()
    frames = set()
    for share in (0.5, 0.7, 0.9):
        (tmp_path / "half.mcap").write_bytes(whole[: int(share * len(whole))])
        recording = read_recording(tmp_path / "half.mcap")
        folder = export_dataset([tmp_path / "half.mcap"], tmp_path / f"set-{share}")
        data = load(folder, "data").with_format("numpy")
        assert 0 < len(data) < len(recording) and not data["next.done"][-1]
        frames.add(len(data))
    assert len(frames) > 1


def test_files_are_full_before_they_are_too_large():
    third = 35 * 2**20
    assert list(_files([third] * 5)) == [(0, 0), (0, 0), (0, 1), (0, 1), (0, 2)]
    assert list(_files([200 * 2**20] * 2)) == [(0, 0), (0, 1)]
    assert list(_files([200 * 2**20] * 1001))[-1] == (1, 0)


def test_whole_or_not_at_all(played, tmp_path):
    (tmp_path / "there").mkdir()
    path = str(played / "latest" / "recording.mcap")
    with pytest.raises(etude.EtudeError, match="already"):
        export_dataset([path], tmp_path / "there")
    with pytest.raises(etude.EtudeError, match="no recording"):
        export_dataset([], tmp_path / "new")
    with pytest.raises(etude.EtudeError, match="cannot read"):
        export_dataset([path, tmp_path / "nothing.mcap"], tmp_path / "new")
    command = [sys.executable, "-m", "etude.lerobot", path, "-o"]
    refused = subprocess.run([*command, str(tmp_path / "there")], capture_output=True, text=True)
    assert refused.returncode == 1 and "already" in refused.stderr
    assert subprocess.run([*command, str(tmp_path / "new")], check=True, capture_output=True).stdout
    assert {entry.name for entry in tmp_path.iterdir()} == {"there", "new"}
