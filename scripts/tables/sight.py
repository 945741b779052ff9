"""What the sight-reader plays, and what is predicted of it."""

import pathlib
import statistics
import struct
import sys
import tempfile

from tables.common import (
    MEASURE, PAPER_SONGS, ROOT, ROWS, argument, command, etude, groups, head, mean_of, melodies, played, policy, read,
    row, rows_of, say, songs, sum_of, write,
)
from tables.learning import column, frame_f1

READER = argument("--policy", default="policies/sight-reader.safetensors")
STEP_SECS = 0.05
PLAYERS = ["sight-reader", "scripted baseline", "policy of the song"]


def played_row(pieces, piece, player, song, who):
    """Notes and scores of one performance in simulation."""
    with played(song, *who) as (report, folder):
        pressed = column(folder, "pressed")
    with played(song, *who, "--set", "task.plan.rule=robopianist") as (_, folder):
        due = column(folder, "due")
    # By the two rules a piece may end in different control steps.
    pressed = pressed[: len(due)] + [set()] * (len(due) - len(pressed))
    return {
        "pieces": pieces,
        "piece": piece,
        "player": player,
        "notes_right": report["matched"],
        "notes_due": report["matched"] + report["missed"],
        "notes_wrong": report["wrong"],
        "onset_f1": report["onset_f1"],
        "f1": report["f1"],
        "f1_robopianist": frame_f1(due, pressed),
    }


def summary(rows):
    """Notes, onset F1 and F1 of one performance or several."""
    right, due, wrong = (f"{sum_of(rows, f'notes_{key}'):g}" for key in ("right", "due", "wrong"))
    lowest = f" (lowest {min(float(entry['f1']) for entry in rows):.3f})" if len(rows) > 1 else ""
    scores = (f"{mean_of(rows, key):.3f}" for key in ("onset_f1", "f1", "f1_robopianist"))
    onset, f1, by_rule = scores
    return f"{right} of {due}, {wrong} wrong; {onset}; {f1}{lowest}; {by_rule}"


@command(
    "sight",
    ROWS,
    MEASURE,
    READER,
    argument("--melodies", type=int, default=20, help="how many of the first test melodies"),
    argument("--folder", type=pathlib.Path, help="measures these MIDI files and keeps the other rows"),
)
def sight(options):
    """What the sight-reader, the scripted baseline and the policies of the songs play in simulation.

    Of several pieces the sum of the notes, the means of the scores and the lowest F1.
    """
    players = dict(zip(PLAYERS, (["--policy", options.policy], ["--scripted"])))

    def of(pieces, paths):
        return [
            played_row(pieces, pathlib.Path(path).stem, player, path, who)
            for path in paths
            for player, who in players.items()
        ]

    def measured():
        for song in songs():
            for player, who in (players | {PLAYERS[2]: policy(song)}).items():
                yield played_row("songs", song, player, song, who)
        yield from of("files", sorted((ROOT / "songs").glob("*.mid")))
        with tempfile.TemporaryDirectory() as folder:
            yield from of("test melodies", list(melodies("test", options.melodies, pathlib.Path(folder))))

    if options.folder:
        before = [entry for entry in read(options.rows) if entry["pieces"] != "folk songs"]
        write(options.rows, [*before, *of("folk songs", sorted(options.folder.resolve().glob("*.mid")))])
        options.measure = False
    rows = rows_of(options, measured)
    cell = "notes; onset F1; F1 (articulated plan); F1 (RoboPianist's rule)"
    head("piece", f"sight-reader: {cell}", *PLAYERS[1:])
    single = {name: of_piece for name, of_piece in groups(rows, "piece").items() if of_piece[0]["pieces"] in ("songs", "files")}
    single["the paper's five songs"] = [entry for entry in rows if entry["piece"] in PAPER_SONGS]
    several = groups([entry for entry in rows if entry["pieces"] not in ("songs", "files")], "pieces")
    for pieces, of_pieces in several.items():
        single[f"{len(groups(of_pieces, 'piece'))} {pieces}"] = of_pieces
    for name, of_name in single.items():
        by_player = groups(of_name, "player")
        row(name, *(summary(by_player[player]) if player in by_player else "–" for player in PLAYERS))


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


def prediction(pieces, name, song, who):
    """What was predicted of a piece, and what was played."""
    shown = etude("songs", "show", song, "--preset", "sight-reader")
    with played(song, "--policy", who) as (report, _):
        return {
            "pieces": pieces,
            "piece": name,
            "notes": shown["notes"],
            "predicted": shown["zero_shot"]["notes_right"],
            "right": report["matched"],
            "wrong": report["wrong"],
            "f1_predicted": shown["zero_shot"]["f1"],
            "f1": report["f1"],
            "onsets_per_sec": sum(len(bar["chords"]) for bar in shown["bars"]) / (STEP_SECS * shown["frames"]),
            "fingering": shown["fingering"]["summary"],
        }


FITTED = "validation melodies"


@command(
    "sight-prediction",
    ROWS,
    MEASURE,
    READER,
    argument("--melodies", type=int, default=40),
    argument("--hard", action="store_true", help="instead the hard pieces, one by one"),
)
def sight_prediction(options):
    """How well `etude songs show` predicts what the sight-reader plays.

    Songs at three tempi and test melodies: predicted and played. Then pieces that are too hard. The
    row of validation melodies is for the constant of crates/lab/src/zero_shot.rs.
    """

    def measured():
        with tempfile.TemporaryDirectory() as folder:
            folder = pathlib.Path(folder)
            every = [(FITTED, path.stem, path) for path in melodies("validation", options.melodies, folder)]
            all_songs = songs() + sorted(str(path) for path in (ROOT / "songs").glob("*.mid"))
            for stretch in STRETCHES:
                for song in all_songs:
                    name, path = pathlib.Path(song).stem, song
                    if stretch != 1:
                        path = folder / f"{name}-{stretch}.mid"
                        say("songs", "arrange", song, "--stretch", stretch, "-o", path)
                    every.append(("songs" if stretch == 1 else f"songs, {1 / stretch:.1f} times as fast", name, path))
            every += [("test melodies", path.stem, path) for path in melodies("test", options.melodies, folder)]
            for number, (name, secs, chords, *sounding) in enumerate(HARD):
                path = folder / f"hard-{number}.mid"
                midi(path, secs, chords, *sounding)
                every.append(("hard pieces", name, path))
            for pieces, name, path in every:
                yield prediction(pieces, name, path, options.policy)

    rows = rows_of(options, measured)
    if options.hard:
        head("piece", "notes predicted", "played", "F1 (articulated plan) predicted", "played", "fingering")
        for one in (entry for entry in rows if entry["pieces"] == "hard pieces"):
            wrong = f", {one['wrong']} wrong" if one["wrong"] != "0" else ""
            scores = f"{float(one['f1_predicted']):.2f}", f"{float(one['f1']):.2f}"
            row(one["piece"], f"{one['predicted']} of {one['notes']}", f"{one['right']}{wrong}", *scores, one["fingering"])
        return
    scores = "F1 (articulated plan), predicted", "played", "mean difference", "largest"
    head("pieces", "number", "correlation of F1", *scores, "notes predicted and played")
    for name, pieces in groups([entry for entry in rows if entry["pieces"] != FITTED], "pieces").items():
        predicted, found = ([float(piece[key]) for piece in pieces] for key in ("f1_predicted", "f1"))
        away = [abs(one - other) for one, other in zip(predicted, found)]
        values = *map(statistics.mean, (predicted, found, away)), max(away)
        right = "{:g} and {:g} of {:g}".format(*(sum_of(pieces, key) for key in ("predicted", "right", "notes")))
        correlation = f"{statistics.correlation(predicted, found):.2f}"
        row(name, len(pieces), correlation, *(f"{value:.3f}" for value in values), right)
    # What each onset loses beyond the constant, by least squares.
    fitted = [entry for entry in rows if entry["pieces"] == FITTED]
    onsets = [float(entry["onsets_per_sec"]) for entry in fitted]
    lost = sum(rate * (float(entry["f1_predicted"]) - float(entry["f1"])) for rate, entry in zip(onsets, fitted))
    print(f"\nMore lost at an onset than zero_shot.rs says, by {FITTED}: {1e3 * lost / sum(rate**2 for rate in onsets):.1f} ms")


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
