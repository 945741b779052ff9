"""How far `etude songs show` predicts what the sight-reader plays, as Markdown: make build && python3 scripts/sight_prediction.py [POLICY]

First the constant of crates/lab/src/at_sight.rs, from forty validation melodies. Then, of the built-in songs and those in songs/ at three
tempi, and of forty test melodies: predicted and played F1 and notes. Then pieces that are too hard, one by one.
"""

import struct
import subprocess
import sys
from statistics import correlation, mean

from robot_table import ETUDE, ROOT, etude, melodies

POLICY = sys.argv[1] if len(sys.argv) > 1 else "policies/sight-reader.safetensors"
OUT = ROOT / "out" / "sight-prediction"
MELODIES = 40
STRETCHES = (1.0, 0.7, 0.5)

SCALE, BLACK = [0, 2, 4, 5, 7, 9, 11, 12], [1, 3, 6, 8, 10]
UP_AND_DOWN = SCALE + SCALE[-2:0:-1]
# What is played, the time from onset to onset (s), the chords as MIDI numbers, and the share of the time for which they sound, if not all.
HARD = [
    ("a scale, one note in 0.25 s", 0.25, [[60 + step] for step in 2 * UP_AND_DOWN]),
    ("a scale, one note in 0.15 s", 0.15, [[60 + step] for step in 2 * UP_AND_DOWN]),
    ("a scale, one note in 0.1 s", 0.1, [[60 + step] for step in 2 * UP_AND_DOWN]),
    ("a chromatic scale, one note in 0.25 s", 0.25, [[60 + step] for step in 2 * [*range(13), *range(11, 0, -1)]]),
    ("black keys up and down, one note in 0.3 s", 0.3, [[60 + step] for step in 3 * (BLACK + BLACK[-2:0:-1])]),
    ("the same key again after 0.3 s", 0.3, [[60]] * 24),
    ("the same key again after 0.2 s", 0.2, [[60]] * 24),
    ("the same key again after 0.1 s", 0.1, [[60]] * 24),
    ("a trill, one note in 0.15 s", 0.15, [[60], [62]] * 12),
    ("octaves up and down, 0.5 s each", 0.5, [[48], [60]] * 12),
    ("octaves up and down, 0.3 s each", 0.3, [[48], [60]] * 12),
    ("two octaves up and down, 0.5 s each", 0.5, [[48], [72]] * 12),
    ("two octaves up and down, 0.75 s each", 0.75, [[48], [72]] * 12),
    ("thirds in a scale, 0.4 s each", 0.4, [[60 + low, 60 + high] for low, high in zip(2 * SCALE, 2 * (SCALE[2:] + [14, 16]))]),
    ("triads in root position, 1 s each", 1.0, [[60 + step + at for at in chord] for step, chord in 3 * [(0, (0, 4, 7)), (5, (0, 4, 7)), (7, (0, 4, 7)), (9, (0, 3, 7))]]),
    ("the same with the octave, four notes", 1.0, [[60 + step + at for at in (0, 4, 7, 12)] for step in 4 * [0, 5, 7]]),
    ("fifths, 1 s each", 1.0, [[60 + step, 67 + step] for step in 4 * [0, 2, 4, 5]]),
    ("the same, silent for a tenth of the time", 1.0, [[60 + step, 67 + step] for step in 4 * [0, 2, 4, 5]], 0.9),
    ("inverted triads, 1 s each", 1.0, 4 * [[60, 64, 67], [60, 65, 69], [59, 62, 67], [60, 64, 67]]),
    ("the same, silent for a tenth of the time", 1.0, 4 * [[60, 64, 67], [60, 65, 69], [59, 62, 67], [60, 64, 67]], 0.9),
    ("sixths, 1 s each", 1.0, [[60 + step, 69 + step] for step in 4 * [0, 2, 4]]),
    ("octaves as chords, 1 s each", 1.0, [[60 + step, 72 + step] for step in 4 * [0, 2, 4]]),
]


def midi(path, secs, chords, sounding=1.0):
    """A MIDI file of chords, each of which lasts until the next one, or for a share of that."""
    track, delta = b"", 0
    for chord in chords:
        for pitch in chord:
            track += variable(delta) + bytes([0x90, pitch, 80])
            delta = 0
        delta = round(1000 * secs * sounding)
        for pitch in chord:
            track += variable(delta) + bytes([0x80, pitch, 0])
            delta = 0
        delta = round(1000 * secs) - round(1000 * secs * sounding)
    track += bytes([0, 0xFF, 0x2F, 0])
    # 500 ticks a beat of 0.5 s.
    path.write_bytes(struct.pack(">4sIHHH4sI", b"MThd", 6, 0, 1, 500, b"MTrk", len(track)) + track)


def variable(number):
    """A number in bytes of seven bits, as MIDI files have it."""
    digits = [number & 0x7F]
    while number := number >> 7:
        digits.append(0x80 | number & 0x7F)
    return bytes(reversed(digits))


class Piece:
    """What was predicted and what was played."""

    def __init__(self, song):
        shown = etude("songs", "show", str(song), "--preset", "sight-reader", "--json")
        played = etude("play", str(song), "--policy", POLICY, "-o", str(OUT / "play"), "--json")
        self.notes, self.predicted, self.notes_predicted = shown["notes"], shown["at_sight"]["f1"], shown["at_sight"]["notes_right"]
        self.f1, self.right, self.wrong, self.onset_f1 = (played[name] for name in ("f1", "matched", "wrong", "onset_f1"))
        self.summary = shown["fingering"]["summary"]
        self.onsets_per_sec = sum(len(bar["chords"]) for bar in shown["bars"]) / (0.05 * shown["frames"])


def line(name, pieces):
    predicted, played = [piece.predicted for piece in pieces], [piece.f1 for piece in pieces]
    away = [abs(one - other) for one, other in zip(predicted, played)]
    notes = [sum(getattr(piece, name) for piece in pieces) for name in ("notes_predicted", "right", "notes")]
    print(
        f"| {name} | {len(pieces)} | {correlation(predicted, played):.2f} | {mean(predicted):.3f} | {mean(played):.3f} | {mean(away):.3f} | {max(away):.3f} "
        f"| {notes[0]} and {notes[1]} of {notes[2]} |",
        flush=True,
    )


def arranged(song, stretch):
    path = OUT / f"{song.replace('/', '-')}-{stretch}.mid"
    subprocess.run([ETUDE, "songs", "arrange", song, "--stretch", str(stretch), "-o", path], cwd=ROOT, check=True, capture_output=True)
    return path


def main():
    OUT.mkdir(parents=True, exist_ok=True)
    pieces = [Piece(path) for path in melodies("validation", MELODIES, OUT)]
    lost = sum(piece.onsets_per_sec * (piece.predicted - piece.f1) for piece in pieces) / sum(piece.onsets_per_sec**2 for piece in pieces)
    print(f"More lost at an onset than at_sight.rs says, by {MELODIES} validation melodies: {1e3 * lost:.1f} ms\n")
    print("| pieces | number | correlation of F1 | F1 predicted | F1 played | mean difference | largest | notes predicted and played |")
    print("|---|---|---|---|---|---|---|---|")
    songs = [song["id"] for song in etude("songs", "--json")] + sorted(str(path) for path in (ROOT / "songs").glob("*.mid"))
    for stretch in STRETCHES:
        name = "songs" if stretch == 1 else f"songs, {1 / stretch:.1f} times as fast"
        line(name, [Piece(song if stretch == 1 else arranged(song, stretch)) for song in songs])
    line("test melodies", [Piece(path) for path in melodies("test", MELODIES, OUT)])
    hard = []
    for number, (name, secs, chords, *sounding) in enumerate(HARD):
        path = OUT / f"hard-{number}.mid"
        midi(path, secs, chords, *sounding)
        hard.append((name, Piece(path)))
    line("hard pieces below", [piece for _, piece in hard])
    print("\n| piece | notes predicted | played | F1 predicted | played | what the plan says |")
    print("|---|---|---|---|---|---|")
    for name, piece in hard:
        wrong = f", {piece.wrong} wrong" if piece.wrong else ""
        print(
            f"| {name} | {piece.notes_predicted} of {piece.notes} | {piece.right}{wrong} | {piece.predicted:.2f} | {piece.f1:.2f} | {piece.summary} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
