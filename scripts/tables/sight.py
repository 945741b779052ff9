"""What the sight-reader plays, and what is predicted of it."""

import collections
import csv
import pathlib
import statistics
import struct
import sys
import tempfile

from tables.common import ROOT, argument, command, etude, head, melodies, played, policy, row, say, songs

READER = argument("--policy", default="policies/sight-reader.safetensors")
STEP_SECS = 0.05
BLACK = (1, 3, 6, 8, 10)


def summary(reports):
    """Notes, onset F1 and F1 of one performance or several."""
    total = lambda key: sum(report[key] for report in reports)
    right, due = total("matched"), total("matched") + total("missed")
    lowest = f" (lowest {min(report['f1'] for report in reports):.3f})" if len(reports) > 1 else ""
    scores = (f"{total(key) / len(reports):.3f}" for key in ("onset_f1", "f1"))
    return f"{right} of {due}, {total('wrong')} wrong; {'; '.join(scores)}{lowest}"


def line(name, cells):
    row(name, *cells, *["–"] * (3 - len(cells)))


def kinds_of_notes(frames):
    """Of each note due: its kinds, and whether its key goes down at most one control step away."""
    rows = list(csv.DictReader(frames.open()))
    due, pressed = ([set(map(int, row[name].split())) for row in rows] for name in ("due", "pressed"))
    before = None
    for step in range(1, len(due)):
        new = due[step] - due[step - 1]
        for key in new:
            near = range(step - 1, min(step + 2, len(due)))
            in_time = any(key in pressed[at] and key not in pressed[at - 1] for at in near)
            kinds = ["all", "black key" if key % 12 in BLACK else "white key"]
            kinds.append({1: "alone", 2: "two keys at once"}.get(len(due[step]), "three keys at once"))
            if before:
                wait = STEP_SECS * (step - before[0])
                kinds.append(f"{'less' if wait < 0.3 else 'more'} than 0.3 s after the note before")
                leap = min(abs(key - other) for other in before[1])
                far = "more than 5 semitones away" if leap > 5 else "1 to 5 semitones away"
                kinds.append("the same key again" if leap == 0 else far)
            yield kinds, in_time
        if new:
            before = (step, new)


@command(
    "sight",
    READER,
    argument("--melodies", type=int, default=20, help="how many of the first test melodies"),
    argument("--folder", type=pathlib.Path, help="more MIDI files"),
)
def sight(options):
    """What the sight-reader, the scripted baseline and the policies of the songs play.

    First pieces: of melodies and of the folder sums of the notes, means of the scores and the
    lowest F1. Then the share of the melodies' notes that begin in time, by kind of note.
    """
    players = ["--policy", options.policy], ["--scripted"]

    def report_of(song, who):
        with played(song, *who) as (report, _):
            return report

    head("piece", "sight-reader: notes; onset F1; F1 (articulated plan)", "scripted baseline", "policy of the song")
    for song in songs():
        line(song, [summary([report_of(song, who)]) for who in (*players, policy(song))])
    for song in sorted((ROOT / "songs").glob("*.mid")):
        line(song.stem, [summary([report_of(song, who)]) for who in players])
    cells, in_time_by_kind = [], []
    with tempfile.TemporaryDirectory() as folder:
        test_melodies = list(melodies("test", options.melodies, pathlib.Path(folder)))
        for who in players:
            reports, in_time = [], collections.defaultdict(list)
            for melody in test_melodies:
                with played(melody, *who) as (report, files):
                    reports.append(report)
                    for kinds, one in kinds_of_notes(files / "frames.csv"):
                        for kind in kinds:
                            in_time[kind].append(one)
            cells.append(summary(reports))
            in_time_by_kind.append(in_time)
    line(f"{options.melodies} test melodies", cells)
    if options.folder:
        files = sorted(options.folder.resolve().glob("*.mid"))
        cells = [summary([report_of(song, who) for song in files]) for who in players]
        line(f"{len(files)} files of {options.folder.name}", cells)
    print()
    head("notes of the test melodies", "number", "sight-reader", "scripted baseline")
    for kind, found in sorted(in_time_by_kind[0].items()):
        row(kind, len(found), *(f"{statistics.mean(in_time[kind]):.2f}" for in_time in in_time_by_kind))


STRETCHES = (1.0, 0.7, 0.5)
SCALE, BLACK_OCTAVE = [0, 2, 4, 5, 7, 9, 11, 12], [1, 3, 6, 8, 10]
UP_AND_DOWN = SCALE + SCALE[-2:0:-1]


def at(*chords):
    """Chords in semitones above middle C as MIDI numbers."""
    return [[60 + step for step in chord] for chord in chords]


def single(steps):
    return at(*([step] for step in steps))


FIFTHS = 4 * at([0, 7], [2, 9], [4, 11], [5, 12])
INVERTED = 4 * at([0, 4, 7], [0, 5, 9], [-1, 2, 7], [0, 4, 7])
# Name, seconds from onset to onset, chords, and the share of the time in which they sound.
HARD = [
    *((f"a scale, one note in {secs} s", secs, single(2 * UP_AND_DOWN)) for secs in (0.25, 0.15, 0.1)),
    ("a chromatic scale, one note in 0.25 s", 0.25, single(2 * [*range(13), *range(11, 0, -1)])),
    ("black keys up and down, one note in 0.3 s", 0.3, single(3 * (BLACK_OCTAVE + BLACK_OCTAVE[-2:0:-1]))),
    *((f"the same key again after {secs} s", secs, single(24 * [0])) for secs in (0.3, 0.2, 0.1)),
    ("a trill, one note in 0.15 s", 0.15, single(12 * [0, 2])),
    *((f"octaves up and down, {secs} s each", secs, single(12 * [-12, 0])) for secs in (0.5, 0.3)),
    *((f"two octaves up and down, {secs} s each", secs, single(12 * [-12, 12])) for secs in (0.5, 0.75)),
    ("thirds in a scale, 0.4 s each", 0.4, at(*zip(2 * SCALE, 2 * (SCALE[2:] + [14, 16])))),
    ("triads in root position, 1 s each", 1.0, 3 * at([0, 4, 7], [5, 9, 12], [7, 11, 14], [9, 12, 16])),
    ("the same with the octave, four notes", 1.0, 4 * at([0, 4, 7, 12], [5, 9, 12, 17], [7, 11, 14, 19])),
    ("fifths, 1 s each", 1.0, FIFTHS),
    ("the same, silent for a tenth of the time", 1.0, FIFTHS, 0.9),
    ("inverted triads, 1 s each", 1.0, INVERTED),
    ("the same, silent for a tenth of the time", 1.0, INVERTED, 0.9),
    ("sixths, 1 s each", 1.0, 4 * at([0, 9], [2, 11], [4, 13])),
    ("octaves as chords, 1 s each", 1.0, 4 * at([0, 12], [2, 14], [4, 16])),
]


def midi(path, secs, chords, sounding=1.0):
    """Writes a MIDI file of chords that sound for a share of the time until the next one."""
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


class Prediction:
    """What was predicted of a piece, and what was played."""

    def __init__(self, song, who):
        shown = etude("songs", "show", song, "--preset", "sight-reader")
        with played(song, "--policy", who) as (report, _):
            self.f1, self.right, self.wrong = (report[name] for name in ("f1", "matched", "wrong"))
        self.notes = shown["notes"]
        self.f1_predicted, self.predicted = (shown["zero_shot"][name] for name in ("f1", "notes_right"))
        self.fingering = shown["fingering"]["summary"]
        self.onsets_per_sec = sum(len(bar["chords"]) for bar in shown["bars"]) / (STEP_SECS * shown["frames"])


def prediction_row(name, pieces):
    predicted, found = [piece.f1_predicted for piece in pieces], [piece.f1 for piece in pieces]
    away = [abs(one - other) for one, other in zip(predicted, found)]
    right = [sum(getattr(piece, name) for piece in pieces) for name in ("predicted", "right", "notes")]
    scores = *map(statistics.mean, (predicted, found, away)), max(away)
    correlation = f"{statistics.correlation(predicted, found):.2f}"
    total = "{} and {} of {}".format(*right)
    row(name, len(pieces), correlation, *(f"{score:.3f}" for score in scores), total)


@command("sight-prediction", READER, argument("--melodies", type=int, default=40))
def sight_prediction(options):
    """How well `etude songs show` predicts what the sight-reader plays.

    First the constant of crates/lab/src/zero_shot.rs, from validation melodies. Then songs at three
    tempi and test melodies: predicted and played. Then pieces that are too hard, one by one.
    """
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        of = lambda song: Prediction(song, options.policy)

        def arranged(song, stretch):
            path = folder / f"{pathlib.Path(song).stem}-{stretch}.mid"
            say("songs", "arrange", song, "--stretch", stretch, "-o", path)
            return path

        pieces = [of(path) for path in melodies("validation", options.melodies, folder)]
        lost = sum(piece.onsets_per_sec * (piece.f1_predicted - piece.f1) for piece in pieces)
        lost /= sum(piece.onsets_per_sec**2 for piece in pieces)
        print(f"More lost at an onset than zero_shot.rs says, by validation melodies: {1e3 * lost:.1f} ms\n")
        scores = "F1 (articulated plan), predicted", "played", "mean difference", "largest"
        head("pieces", "number", "correlation of F1", *scores, "notes predicted and played")
        all_songs = songs() + sorted(str(path) for path in (ROOT / "songs").glob("*.mid"))
        for stretch in STRETCHES:
            name = "songs" if stretch == 1 else f"songs, {1 / stretch:.1f} times as fast"
            prediction_row(name, [of(song if stretch == 1 else arranged(song, stretch)) for song in all_songs])
        prediction_row("test melodies", [of(path) for path in melodies("test", options.melodies, folder)])
        hard = []
        for number, (name, secs, chords, *sounding) in enumerate(HARD):
            path = folder / f"hard-{number}.mid"
            midi(path, secs, chords, *sounding)
            hard.append((name, of(path)))
    prediction_row("hard pieces", [piece for _, piece in hard])
    print()
    head("piece", "notes predicted", "played", "F1 predicted", "played", "fingering")
    for name, piece in hard:
        wrong = f", {piece.wrong} wrong" if piece.wrong else ""
        scores = f"{piece.f1_predicted:.2f}", f"{piece.f1:.2f}"
        row(name, f"{piece.predicted} of {piece.notes}", f"{piece.right}{wrong}", *scores, piece.fingering)


MAX_QUARTERS = 40


@command("outside-songs", argument("out", type=pathlib.Path), argument("--count", type=int, default=3))
def outside_songs(options):
    """Writes MIDI files of folk songs of the Essen collection. Needs the package music21 (10.5.1).

    They are the first songs of the file altdeu10 that last at most 40 crotchets, at 100 a minute.
    """
    from music21 import corpus, tempo
    from music21.exceptions21 import StreamException

    options.out.mkdir(parents=True, exist_ok=True)
    scores = corpus.parse("essenFolksong/altdeu10").scores
    written = 0
    for score in (score for score in scores if score.duration.quarterLength <= MAX_QUARTERS):
        if written == options.count:
            break
        for mark in list(score.recurse().getElementsByClass(tempo.TempoIndication)):
            mark.activeSite.remove(mark)
        score.parts[0].insert(0, tempo.MetronomeMark(number=100))
        title = score.metadata.title.lower().replace(" ", "-")
        path = options.out / f"{title}-{score.metadata.number}.mid"
        try:
            score.write("midi", fp=path)
        except StreamException as error:
            print(f"{path.stem} is left out, because music21 cannot write it: {error}", file=sys.stderr)
            continue
        written += 1
        print(path, f"{len(score.flatten().notes)} notes")
