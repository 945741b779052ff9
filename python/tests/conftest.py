"""What the tests share."""

import os
import pathlib
import struct
import subprocess

import pytest


def midi(notes):
    """A MIDI file of one voice: (pitch, beats) each, 120 beats a minute."""
    track = b""
    for pitch, beats in notes:
        ticks = int(beats * 96)
        delta = bytes([0x80 | ticks >> 7, ticks & 0x7F]) if ticks > 127 else bytes([ticks])
        track += bytes([0, 0x90, pitch, 80]) + delta + bytes([0x80, pitch, 0])
    track += bytes([0, 0xFF, 0x2F, 0])
    return struct.pack(">4sIHHH4sI", b"MThd", 6, 0, 1, 96, b"MTrk", len(track)) + track


@pytest.fixture(scope="session")
def short_song(tmp_path_factory):
    """A song of four notes in two seconds."""
    path = tmp_path_factory.mktemp("songs") / "short.mid"
    path.write_bytes(midi([(60, 1), (64, 1), (62, 0.5), (66, 0.5)]))
    return path


def needed(what):
    """Where everything is installed nothing may be skipped."""
    if os.environ.get("ETUDE_NEEDS_ALL"):
        pytest.fail(what)
    pytest.skip(what)


def etude_command(folder, *arguments):
    """Runs the command, which writes to the folder; gives the folder."""
    program = pathlib.Path(os.environ.get("ETUDE_COMMAND", "target/debug/etude")).absolute()
    if not program.is_file():
        needed(f"{program} is not built")
    subprocess.run([program, *arguments, "-o", folder], check=True, capture_output=True)
    return folder


@pytest.fixture(scope="session")
def played(tmp_path_factory):
    """The folder of `etude play c-major-scale --scripted`."""
    return etude_command(tmp_path_factory.mktemp("played"), "play", "c-major-scale", "--scripted")


@pytest.fixture(scope="session")
def performed(tmp_path_factory):
    """The folder of a performance of that on the twin, more than a control step early."""
    setting = "task.plan.latency_compensation_secs=0.07"
    arguments = f"perform c-major-scale --scripted --robot twin --mode real --set {setting}".split()
    return etude_command(tmp_path_factory.mktemp("performed"), *arguments)
