"""Recordings of the command, read as arrays."""

import json

import numpy as np
import pytest
from sklearn.metrics import f1_score

import etude
from etude.recordings import read_recording


def test_it_is_what_the_command_says(played):
    recording = read_recording(played / "latest" / "recording.mcap")
    report = json.loads((played / "latest" / "report.json").read_text())
    assert recording.incomplete is None and len(recording) == report["steps"] == len(recording.due)
    for field in ("targets", "positions", "velocities", "torques"):
        assert recording[field].shape == (len(recording), 13)
    assert recording["fingertips"].shape == (len(recording), 3, 3)
    f1 = [f1_score(due, pressed, zero_division=1) for due, pressed in zip(recording.due, recording.pressed)]
    assert np.mean(f1) == pytest.approx(report["f1"])
    assert sum(map(np.sum, recording.rewards.values())) == pytest.approx(report["reward"], rel=1e-4)
    np.testing.assert_allclose(np.diff(recording["log_secs"]), 0.05, atol=1e-6)


def test_a_folder_means_its_latest_result(played, performed, tmp_path):
    whole = (played / "1" / "recording.mcap").read_bytes()
    for folder in (played, played / "1", played / "latest"):
        assert read_recording(folder).header["rig"] == "simulation"
    assert read_recording(performed).header["activity"]["kind"] == "mode"
    with pytest.raises(etude.EtudeError, match="no recording in"):
        read_recording(tmp_path)
    for name in ("a.mcap", "b.mcap"):
        (tmp_path / name).write_bytes(whole)
    with pytest.raises(etude.EtudeError, match="2 recordings; name one"):
        read_recording(tmp_path)


def test_a_robot_is_heard_later(performed):
    recording = read_recording(performed / "latest" / "run-1.mcap")
    report = json.loads((performed / "latest" / "report.json").read_text())
    assert recording.header["late_secs"] == pytest.approx(0.045)
    f1 = [f1_score(due, heard, zero_division=1) for due, heard in zip(recording.due, recording.heard)]
    assert np.mean(f1) == pytest.approx(report["robot_f1"])
    at_the_ends = [f1_score(due, pressed, zero_division=1) for due, pressed in zip(recording.due, recording.pressed)]
    assert abs(np.mean(at_the_ends) - report["robot_f1"]) > 0.01


def test_a_topic_is_a_frame(played):
    recording = read_recording(played / "latest" / "recording.mcap")
    frame = recording.frame()
    assert len(frame) == len(recording)
    name = recording.header["joints"][0]
    np.testing.assert_array_equal(frame[f"positions_{name}"], recording["positions"][:, 0])
    assert set(recording.frame("/key").columns) == {"log_secs", "secs", "pitch", "velocity"}
    with pytest.raises(KeyError, match="/step"):
        recording.frame("/nothing")
    with pytest.raises(KeyError, match="targets"):
        recording["nothing"]


def test_half_a_recording_is_read_as_far_as_it_goes(played, tmp_path):
    whole = (played / "latest" / "recording.mcap").read_bytes()
    lengths = set()
    # A record may be cut anywhere, in its length too.
    for share in [step / 100 for step in range(1, 100)]:
        half = tmp_path / "half.mcap"
        half.write_bytes(whole[: int(share * len(whole))])
        try:
            recording = read_recording(half)
        except etude.EtudeError:
            lengths.add(0)
            continue
        assert recording.incomplete
        lengths.add(len(recording))
    assert max(lengths) > 0
    # What a program leaves that is killed: an end that names no index.
    footer = whole[-37:]
    half.write_bytes(whole[:-37] + footer[:9] + bytes(20) + footer[29:])
    assert read_recording(half).incomplete == "the program that wrote it was killed"
    for content in (b"", b"nonsense", whole[:8]):
        half.write_bytes(content)
        with pytest.raises(etude.EtudeError, match="not a recording"):
            read_recording(half)
    with pytest.raises(etude.EtudeError, match="cannot read"):
        read_recording(tmp_path / "nothing.mcap")
