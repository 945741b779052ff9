#!/usr/bin/env python3
"""Golden values for the tests of crates/music, made by independent implementations.

    python3 -m venv /tmp/venv-music
    /tmp/venv-music/bin/pip install scikit-learn==1.9.1 mir_eval==0.8.2 mido==1.3.3 numpy==2.4.6
    /tmp/venv-music/bin/python scripts/golden_music.py

It writes crates/music/tests/golden/: `metrics.json` (scikit-learn and mir_eval), `rolls.json`
(RoboPianist's piano-roll rules in exact fractions) and `midi.json` with the files in `midi/` (times
by mido). Seeds are fixed: running it again changes nothing, unless a package has changed.
"""

import json
import random
import struct
import warnings
from fractions import Fraction
from math import ceil, floor
from pathlib import Path

import mido
import mir_eval
import numpy as np
from sklearn.metrics import precision_recall_fscore_support

KEY_COUNT, LOWEST, PERCUSSION = 49, 36, 9
OUT = Path(__file__).resolve().parent.parent / "crates" / "music" / "tests" / "golden"


# ---- scores by frame


def bits(keys):
    return sum(1 << key for key in keys)


def row(word):
    return [(word >> key) & 1 for key in range(KEY_COUNT)]


def sklearn_scores(due, pressed):
    return precision_recall_fscore_support(due, pressed, average="binary", zero_division=1)[:3]


def frame_case(name, due, pressed):
    steps = np.array([sklearn_scores(row(d), row(p)) for d, p in zip(due, pressed)])
    pooled = sklearn_scores(np.ravel([row(d) for d in due]), np.ravel([row(p) for p in pressed]))
    names = ["precision", "recall", "f1", "pooled_precision", "pooled_recall", "pooled_f1"]
    values = [*steps.mean(axis=0), *pooled]
    return {"name": name, "due": due, "pressed": pressed, "scores": dict(zip(names, map(float, values)))}


def frame_cases():
    rng = random.Random(20)
    one, two, other = bits([24]), bits([24, 28]), bits([30])
    corner = [(0, 0), (0, one), (one, 0), (one, one), (one, other), (one, bits([24, 25])), (two, one), (two, bits([24, 25]))]
    cases = [frame_case(f"corner {i}", [d], [p]) for i, (d, p) in enumerate(corner)]
    cases.append(frame_case("all corners", [d for d, _ in corner], [p for _, p in corner]))
    cases.append(frame_case("all keys", [bits(range(KEY_COUNT))] * 3, [bits(range(KEY_COUNT)), 0, bits([0, 48])]))
    cases.append(frame_case("silent song, busy hand", [0] * 5, [one, 0, two, other, 0]))
    for i in range(20):
        density, noise = rng.choice([0.01, 0.05, 0.3]), rng.choice([0.0, 0.02, 0.2])
        due = [bits(k for k in range(KEY_COUNT) if rng.random() < density) for _ in range(rng.randint(1, 60))]
        pressed = [d ^ bits(k for k in range(KEY_COUNT) if rng.random() < noise) for d in due]
        cases.append(frame_case(f"random {i}", due, pressed))
    return cases


# ---- scores by note


def mir_arrays(notes):
    intervals = np.array([[start, end] for _, start, end in notes], dtype=float).reshape(-1, 2)
    return intervals, mir_eval.util.midi_to_hz(np.array([pitch for pitch, _, _ in notes], dtype=float))


def note_case(name, reference, played):
    ref, est = mir_arrays(reference), mir_arrays(played)
    onset = mir_eval.transcription.precision_recall_f1_overlap(*ref, *est, offset_ratio=None)[:3]
    offset = mir_eval.transcription.precision_recall_f1_overlap(*ref, *est)[:3]
    names = [f"{kind}_{rate}" for kind in ("onset", "onset_offset") for rate in ("precision", "recall", "f1")]
    scores = dict(zip(names, map(float, [*onset, *offset])))
    return {"name": name, "reference": reference, "played": played, "scores": scores}


def note_cases():
    rng = random.Random(50)
    tune = [(60 + i % 5, 0.5 * i, 0.5 * i + 0.4) for i in range(12)]
    late = lambda by, longer=0.0: [(p, round(s + by, 6), round(e + by + longer, 6)) for p, s, e in tune]
    cases = [
        note_case("nothing at all", [], []),
        note_case("nothing played", tune, []),
        note_case("nothing due", [], tune),
        note_case("perfect", tune, tune),
        note_case("at the tolerance", tune, late(0.05)),
        note_case("past the tolerance", tune, late(0.0501)),
        note_case("early at the tolerance", tune, [(p, s - 0.05, e) for p, s, e in tune if s > 0.05]),
        note_case("late releases", tune, late(0.0, 0.08)),
        note_case("later releases", tune, late(0.0, 0.0801)),
        note_case("an octave off", tune, [(p + 12, s, e) for p, s, e in tune]),
        note_case("each played twice", tune, tune + late(0.01)),
        note_case("half of them", tune, tune[::2]),
        note_case("greedy goes wrong", [(60, 1.0, 1.2), (60, 1.04, 1.3)], [(60, 0.96, 1.2), (60, 1.01, 1.3)]),
    ]
    for i in range(25):
        # Few pitches and short gaps, so that several matchings compete.
        reference, now = [], 0.0
        for _ in range(rng.randint(0, 40)):
            now = round(now + rng.choice([0.0, 0.02, 0.05, 0.3]), 4)
            reference.append((rng.choice([60, 61, 64]), now, round(now + rng.uniform(0.03, 0.6), 4)))
        played = []
        for pitch, start, end in reference:
            if rng.random() < 0.15:
                continue
            start = max(0.0, round(start + rng.gauss(0.0, 0.04), 4))
            end = max(start + 0.01, round(end + rng.gauss(0.0, 0.06), 4))
            played.append((pitch if rng.random() < 0.9 else pitch + 1, start, end))
        played += [(60, round(rng.uniform(0, 3), 4), 4.0) for _ in range(rng.randint(0, 4))]
        cases.append(note_case(f"random {i}", reference, played))
    return cases


def velocity_case(name, reference, played):
    """Notes are (pitch, velocity, start, end)."""
    arrays = []
    for notes in (reference, played):
        intervals, pitches = mir_arrays([(pitch, start, end) for pitch, _, start, end in notes])
        arrays += [intervals, pitches, np.array([velocity for _, velocity, _, _ in notes])]
    f1 = mir_eval.transcription_velocity.precision_recall_f1_overlap(*arrays, offset_ratio=None)[2]
    return {"name": name, "reference": reference, "played": played, "scores": {"onset_velocity_f1": float(f1)}}


def velocity_cases():
    rng = random.Random(60)
    # Notes of a pitch are far apart, so that there is one matching.
    line = lambda velocities: [(60 + i % 5, v, 0.5 * i, 0.5 * i + 0.4) for i, v in enumerate(velocities)]
    crescendo = list(range(40, 100, 5))
    cases = [
        velocity_case("as written", line(crescendo), line(crescendo)),
        velocity_case("louder by the same", line(crescendo), line([v + 20 for v in crescendo])),
        velocity_case("all as loud as can be", line(crescendo), line([127] * 12)),
        velocity_case("the other way round", line(crescendo), line(crescendo[::-1])),
        velocity_case("no dynamics written", line([64] * 12), line(crescendo)),
        velocity_case("one note", line([64]), line([20])),
    ]
    for i in range(20):
        due, played = line([rng.randint(1, 127) for _ in range(rng.randint(1, 30))]), []
        spread = rng.choice([3, 10, 30])
        for pitch, velocity, start, end in due:
            heard = min(127, max(1, round(0.6 * velocity + 30 + rng.gauss(0.0, spread))))
            start = max(0.0, round(start + rng.gauss(0.0, 0.03), 4))
            played.append((pitch if rng.random() < 0.9 else pitch + 7, heard, start, end))
        cases.append(velocity_case(f"random {i}", due, played))
    return cases


# ---- piano rolls


def roll(notes, total, hz):
    """RoboPianist's rules (music/midi_file.py, music/piano_roll.py) in fractions, for which int()
    and ceil() are exact."""
    frames = [set() for _ in range(int(total * hz + 1))]
    onsets = [set() for _ in frames]
    for pitch, start, end in notes:
        first = floor(start * hz)
        onsets[first].add(pitch)
        for frame in range(first, max(first + 1, ceil(end * hz))):
            if frame < len(frames):
                frames[frame].add(pitch)
    kept = []
    for t, sounding in enumerate(frames):
        before = frames[t - 1] if t else set()
        kept.append(bits(pitch - LOWEST for pitch in sounding if not (pitch in before and pitch in onsets[t])))
    return kept


def roll_cases():
    rng = random.Random(7)
    cases = []
    for i in range(24):
        # Seconds in these units; several put most borders of notes exactly on borders of frames.
        unit = [Fraction(1, 20), Fraction(1, 10), Fraction(7, 10), Fraction(1, 1000), Fraction(1, 3), Fraction(1, 48)][i % 6]
        hz = [20, 20, 10, 100][i % 4]
        notes, now = [], Fraction(0)
        for _ in range(rng.randint(1, 40)):
            now += unit * rng.choice([0, 1, 1, 2, 5])
            notes.append((rng.choice([36, 60, 61, 64, 84]), now, now + unit * rng.choice([0, 1, 1, 3, 8])))
        total = max(end for _, _, end in notes)
        floats = [(pitch, float(start), float(end)) for pitch, start, end in notes]
        cases.append({"hz": hz, "notes": floats, "duration": float(total), "frames": roll(notes, total, hz)})
    return cases


# ---- MIDI files


def on(pitch, velocity=64, time=0, channel=0):
    return mido.Message("note_on", note=pitch, velocity=velocity, time=time, channel=channel)


def off(pitch, time=0, channel=0):
    return mido.Message("note_off", note=pitch, velocity=30, time=time, channel=channel)


def meta(kind, **values):
    return mido.MetaMessage(kind, **values)


def midi_file(format, ppq, *tracks):
    file = mido.MidiFile(type=format, ticks_per_beat=ppq)
    file.tracks.extend(mido.MidiTrack(track) for track in tracks)
    return file


def seconds_by_tick(file):
    """mido's own conversion: its merged playback in ticks and in seconds side by side."""
    table, tick, secs = {0: 0.0}, 0, 0.0
    for in_ticks, in_secs in zip(mido.merge_tracks(file.tracks), file):
        tick += in_ticks.time
        secs += in_secs.time
        table[tick] = secs
    return table


def expected_notes(tracks, secs):
    """Pairs strokes and releases, then removes overlaps of notes of one pitch."""
    last = max((sum(m.time for m in track) for track in tracks), default=0)
    notes = []
    for track in tracks:
        tick, sounding = 0, {}
        for message in track:
            tick += message.time
            if message.type not in ("note_on", "note_off") or message.channel == PERCUSSION:
                continue
            where = (message.channel, message.note)
            if where in sounding:
                start, velocity = sounding.pop(where)
                notes.append([message.note, velocity, start, tick])
            if message.type == "note_on" and message.velocity > 0:
                sounding[where] = (tick, message.velocity)
        notes += [[pitch, velocity, start, last] for (_, pitch), (start, velocity) in sounding.items()]
    merged = []
    for pitch in {note[0] for note in notes}:
        same = [note for note in notes if note[0] == pitch]
        onsets = sorted({note[2] for note in same})
        for i, onset in enumerate(onsets):
            # The key is down while any note that began so far lasts, until the next onset.
            end = max(note[3] for note in same if note[2] <= onset)
            end = min(end, onsets[i + 1]) if i + 1 < len(onsets) else end
            velocity = max(note[1] for note in same if note[2] == onset)
            merged.append((pitch, velocity, secs(onset), secs(max(end, onset))))
    return sorted(merged, key=lambda note: (note[2], note[0]))


def random_file(rng):
    ppq = rng.choice([24, 96, 120, 480, 960, 997])
    format = rng.choice([0, 1])
    tracks = []
    for number in range(1 if format == 0 else rng.randint(2, 5)):
        track = []
        if number == 0 or rng.random() < 0.2:
            track.append(meta("time_signature", numerator=rng.randint(2, 7), denominator=rng.choice([2, 4, 8])))
        down = set()
        for _ in range(rng.randint(1, 60)):
            wait = rng.choice([0, 0, 1, ppq // 4, ppq // 3, ppq, 3 * ppq])
            draw, channel = rng.random(), rng.choice([0, 0, 1, PERCUSSION])
            if draw < 0.5 or not down:
                pitch = rng.randint(40, 80)
                down.add((pitch, channel))
                track.append(on(pitch, rng.randint(1, 127), wait, channel))
            elif draw < 0.9:
                pitch, channel = rng.choice(sorted(down))
                down.discard((pitch, channel))
                track.append(off(pitch, wait, channel) if rng.random() < 0.5 else on(pitch, 0, wait, channel))
            elif draw < 0.95:
                track.append(meta("set_tempo", tempo=rng.randint(200_000, 1_500_000), time=wait))
            else:
                track.append(mido.Message("control_change", control=64, value=rng.randint(0, 127), time=wait))
        track.append(meta("end_of_track", time=rng.randint(0, 4 * ppq)))
        tracks.append(track)
    return midi_file(format, ppq, *tracks)


def mido_files():
    end = lambda time=0: meta("end_of_track", time=time)
    tempo = lambda micros, time=0: meta("set_tempo", tempo=micros, time=time)
    yield "format0", midi_file(0, 480, [on(60), off(60, 480), on(62), off(62, 240), end()])
    yield "velocity-zero", midi_file(0, 480, [on(60), on(60, 0, 480), on(60, 1), on(60, 0, 100), end()])
    yield "format1", midi_file(
        1, 96, [tempo(1_000_000), end()], [on(72, 90), off(72, 96), end()], [on(48, 40, 48, 3), off(48, 96, 3), end()]
    )
    yield "tempo-within-note", midi_file(
        1, 480, [tempo(600_000), tempo(300_000, 720), tempo(900_000, 333), end()], [on(60, time=100), off(60, 1500), end()]
    )
    yield "tempo-in-late-track", midi_file(1, 480, [on(60), off(60, 960), end()], [tempo(250_000, 480), end()])
    yield "percussion", midi_file(0, 480, [on(36, channel=9), on(64), off(36, 100, 9), off(64, 100), end()])
    yield "struck-again-while-down", midi_file(0, 480, [on(60), on(60, 90, 240), off(60, 240), off(60, 240), end()])
    yield "two-voices-one-key", midi_file(
        0, 480, [on(60), on(60, 100, 240, 1), off(60, 120, 1), off(60, 600), on(60, 20), on(60, 80, 0, 1), off(60, 50), off(60, 50, 1), end()]
    )
    yield "never-closed", midi_file(1, 480, [on(60), on(64, time=480), off(60, 10), end(950)], [on(67, time=100), end(2000)])
    yield "no-length", midi_file(0, 480, [on(60), off(60), on(62, time=480), off(62, 480), on(62), off(62), end()])
    yield "releases-of-nothing", midi_file(0, 480, [off(60), on(61, 0, 10), on(60, time=10), off(60, 10), off(60, 10), end()])
    yield "signatures", midi_file(
        0, 480,
        [meta("time_signature", numerator=3, denominator=4), on(60), off(60, 1440),
         meta("time_signature", numerator=6, denominator=8), on(62), off(62, 1440),
         tempo(250_000), on(64), off(64, 480), meta("time_signature", numerator=5, denominator=4), on(65), off(65, 480), end()],
    )
    yield "coarse-ticks", midi_file(0, 1, [on(60), off(60, 3), on(61, time=1), off(61, 1), end()])
    yield "fine-ticks", midi_file(0, 32767, [tempo(123_457), on(60, time=7), off(60, 1_000_003), end()])
    yield "everything-else", midi_file(
        0, 480,
        [meta("track_name", name="Lied"), meta("text", text="x" * 300), mido.Message("sysex", data=[1, 2, 3]),
         mido.Message("program_change", program=5), on(60), mido.Message("pitchwheel", pitch=-8192, time=3),
         mido.Message("aftertouch", value=9, time=3), mido.Message("polytouch", note=60, value=9, time=3),
         mido.Message("control_change", control=64, value=127), meta("lyrics", text="la"), off(60, 100),
         meta("key_signature", key="Eb"), meta("smpte_offset", frame_rate=24), meta("sequencer_specific", data=(1, 2)), end()],
    )
    rng = random.Random(88)
    for i in range(12):
        yield f"random-{i}", random_file(rng)


def chunk(kind, body):
    return kind + struct.pack(">I", len(body)) + bytes(body)


def handmade_files():
    """Bytes that mido does not write; the notes follow from the numbers in the bytes."""
    header = lambda format, tracks, division: chunk(b"MThd", struct.pack(">HHH", format, tracks, division))
    running = [0, 0x90, 60, 64, 0x60, 60, 0, 0, 62, 64, 0x60, 62, 0, 0, 0xFF, 0x2F, 0]
    notes = lambda tick: [[60, 64, 0.0, 0x60 * tick], [62, 64, 0x60 * tick, 2 * 0x60 * tick]]
    yield "running-status", header(0, 1, 96) + chunk(b"MTrk", running), notes(0.5 / 96)
    yield "smpte-25", header(0, 1, 0xE728) + chunk(b"MTrk", running), notes(1 / 25 / 40)
    yield "smpte-drop-frame", header(0, 1, 0xE364) + chunk(b"MTrk", running), notes(1.001 / 30 / 100)
    yield "smpte-ignores-tempo", header(0, 1, 0xE804) + chunk(b"MTrk", [0, 0xFF, 0x51, 3, 1, 1, 1] + running), notes(1 / 24 / 4)
    yield "other-chunks", (
        chunk(b"MThd", struct.pack(">HHH", 1, 1, 96) + b"more") + chunk(b"XFIH", b"hello") + chunk(b"MTrk", running) + b"junk"
    ), notes(0.5 / 96)
    yield "no-end-of-track", header(0, 1, 96) + chunk(b"MTrk", running[:-4]), notes(0.5 / 96)


def midi_cases():
    folder = OUT / "midi"
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("*.mid"):
        old.unlink()
    cases = []
    for name, file in mido_files():
        file.save(folder / f"{name}.mid")
        file = mido.MidiFile(folder / f"{name}.mid")
        table = seconds_by_tick(file)
        cases.append({"file": f"{name}.mid", "notes": expected_notes(file.tracks, table.__getitem__)})
    for name, content, notes in handmade_files():
        (folder / f"{name}.mid").write_bytes(content)
        cases.append({"file": f"{name}.mid", "notes": notes})
    return cases


def write(name, value):
    text = json.dumps(value, separators=(",", ":"))
    (OUT / name).write_text(text.replace('{"', '\n{"') + "\n")


if __name__ == "__main__":
    warnings.filterwarnings("ignore", message="(Reference|Estimated) notes are empty", module="mir_eval")
    OUT.mkdir(parents=True, exist_ok=True)
    write("metrics.json", {"frames": frame_cases(), "notes": note_cases(), "velocities": velocity_cases()})
    write("rolls.json", roll_cases())
    write("midi.json", midi_cases())
