#!/usr/bin/env python3
"""Checks the times and counts of a performance with a MIDI reader of its own and mir_eval.

    check_midi.py DIR

DIR is a result of `etude play` or `etude perform`. Each stroke of the MIDI file must be one of the
recording's `/key`, at the same time; and mir_eval must match as many notes of the MIDI file with
the notes that were due as the report says are right.
"""

import json
import pathlib
import struct
import sys

import mir_eval
import numpy as np
from mcap.reader import make_reader

NEAR_SECS = 1e-4


def events(track):
    """Tick, status and data of each event of a track."""
    at, tick, status = 0, 0, 0

    def number():
        nonlocal at
        value = 0
        while True:
            byte = track[at]
            at += 1
            value = value << 7 | byte & 0x7F
            if byte < 0x80:
                return value

    while at < len(track):
        tick += number()
        if track[at] >= 0x80:
            status = track[at]
            at += 1
        if status == 0xFF:
            kind = track[at]
            at += 1
            length = number()
            yield tick, (status, kind), track[at : at + length]
            at += length
        else:
            length = 1 if status >> 4 in (0xC, 0xD) else 2
            yield tick, (status, None), track[at : at + length]
            at += length


def strokes(path):
    """Onset, end and pitch of each note of a file with one track."""
    data = path.read_bytes()
    assert data[:4] == b"MThd" and data[14:18] == b"MTrk", "one track is expected"
    per_quarter, length = struct.unpack(">H", data[12:14])[0], struct.unpack(">I", data[18:22])[0]
    secs, last, quarter_secs, down, notes = 0.0, 0, 0.5, {}, []
    for tick, (status, kind), value in events(data[22 : 22 + length]):
        secs, last = secs + (tick - last) * quarter_secs / per_quarter, tick
        if kind == 0x51:
            quarter_secs = int.from_bytes(value, "big") / 1e6
        elif status >> 4 == 9 and value[1] > 0:
            down[value[0]] = secs
        elif status >> 4 in (8, 9) and value[0] in down:
            notes.append((down.pop(value[0]), secs, value[0]))
    return sorted(notes)


def matched(due, played):
    def split(notes):
        intervals = np.array([[start, max(end, start + 1e-3)] for start, end, _ in notes]).reshape(-1, 2)
        return intervals, mir_eval.util.midi_to_hz(np.array([pitch for _, _, pitch in notes], float))

    if not due or not played:
        return 0
    return len(mir_eval.transcription.match_notes(*split(due), *split(played), offset_ratio=None))


def main(folder):
    report = json.loads((folder / "report.json").read_text())
    runs = report.get("runs", [report])
    names = ["performance.mid"] if "runs" not in report else [f"run-{index + 1}.mid" for index in range(len(runs))]
    for run, name in zip(runs, names):
        recording = "recording.mcap" if "runs" not in report else name.replace(".mid", ".mcap")
        messages = {"/header": [], "/key": []}
        with open(folder / recording, "rb") as file:
            for _, channel, message in make_reader(file).iter_messages(topics=list(messages)):
                messages[channel.topic].append(json.loads(message.data))
        played = strokes(folder / name)
        header = messages["/header"][0]
        # The control steps, on the axis of the notes.
        begin = -header["latency_compensation_secs"]
        end = begin + len(header["due"]) / header["control_hz"]
        struck = [(key["secs"], key["pitch"]) for key in messages["/key"] if key["velocity"] > 0]
        keys = sorted((max(secs, 0.0), pitch) for secs, pitch in struck if begin <= secs < end)
        if len(keys) != len(played) or any(
            pitch != note[2] or abs(secs - note[0]) > NEAR_SECS for (secs, pitch), note in zip(keys, played)
        ):
            sys.exit(f"{name}: {played} and in the recording {keys}")
        due = [(note["start_secs"], note["end_secs"], note["pitch"]) for note in header["due_notes"]]
        right = matched(due, played)
        if right != run["matched"]:
            sys.exit(f"{name}: {right} notes right by mir_eval, {run['matched']} in the report")
        print(f"{folder / name}: {right} of {len(due)} notes right, at the times of the recording")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(pathlib.Path(sys.argv[1]))
