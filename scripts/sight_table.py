"""Who plays what at sight, as two Markdown tables: make build && python3 scripts/sight_table.py [POLICY] [MELODIES] [FOLDER]

The first has the built-in songs, those in songs/ and the first test melodies (20), played by POLICY (policies/sight-reader.safetensors), by the scripted
player and, where there is one, by the shipped policy of the song, and those of FOLDER, if it is given. Of the melodies and of the folder it has the sums of the notes, the means of the scores and the lowest F1. The second
has the share of the melodies' notes that begin in time (in their control step or one beside it), by kind of note.
"""

import csv
import sys
from collections import defaultdict
from pathlib import Path

from robot_table import ROOT, etude, melodies

POLICY = sys.argv[1] if len(sys.argv) > 1 else "policies/sight-reader.safetensors"
MELODIES = int(sys.argv[2]) if len(sys.argv) > 2 else 20
FOLDER = Path(sys.argv[3]).resolve() if len(sys.argv) > 3 else None
OUT = ROOT / "out" / "sight-table"
BLACK = (1, 3, 6, 8, 10)


def play(song, *who):
    """The report of a performance, whose files are in OUT / "play"."""
    return etude("play", str(song), *who, "-o", str(OUT / "play"), "--json")


def cell(reports):
    """Notes, onset F1 and F1 of one performance or several."""
    total = lambda key: sum(report[key] for report in reports)
    mean = lambda key: total(key) / len(reports)
    right, due = total("matched"), total("matched") + total("missed")
    lowest = f" (lowest {min(report['f1'] for report in reports):.3f})" if len(reports) > 1 else ""
    return f"{right} of {due}, {total('wrong')} wrong; {mean('onset_f1'):.3f}; {mean('f1'):.3f}{lowest}"


def line(name, cells):
    print("| " + " | ".join([name, *cells] + ["–"] * (3 - len(cells))) + " |", flush=True)


def keys(text):
    return set(map(int, text.split()))


def notes(frames):
    """Of each note that is due: its kinds, and whether its key goes down in time."""
    rows = list(csv.DictReader(frames.open()))
    due, pressed = ([keys(row[name]) for row in rows] for name in ("due", "pressed"))
    before = None
    for step in range(1, len(due)):
        new = due[step] - due[step - 1]
        for key in new:
            near = range(step - 1, min(step + 2, len(due)))
            in_time = any(key in pressed[at] and key not in pressed[at - 1] for at in near)
            kinds = ["all", "black key" if key % 12 in BLACK else "white key"]
            kinds.append({1: "alone", 2: "two keys at once"}.get(len(due[step]), "three keys at once"))
            if before:
                wait = 0.05 * (step - before[0])
                kinds.append(f"{'less' if wait < 0.3 else 'more'} than 0.3 s after the note before")
                way = min(abs(key - other) for other in before[1])
                kinds.append("the same key again" if way == 0 else "more than 5 semitones away" if way > 5 else "1 to 5 semitones away")
            yield kinds, in_time
        if new:
            before = (step, new)


OUT.mkdir(parents=True, exist_ok=True)
READER, SCRIPT = ["--policy", POLICY], ["--scripted"]
print("| piece | sight-reader: notes; onset F1; F1 | scripted player | policy of the song |")
print("|---|---|---|---|")
for song in etude("songs", "--json"):
    own = ["--policy", f"policies/{song['id']}.safetensors"]
    line(song["id"], [cell([play(song["id"], *who)]) for who in (READER, SCRIPT, own)])
for song in sorted((ROOT / "songs").glob("*.mid")):
    line(song.stem, [cell([play(song, *who)]) for who in (READER, SCRIPT)])
test_melodies = list(melodies("test", MELODIES, OUT))
cells, shares = [], []
for who in (READER, SCRIPT):
    reports, counts = [], defaultdict(list)
    for melody in test_melodies:
        reports.append(play(melody, *who))
        for kinds, in_time in notes(OUT / "play" / "frames.csv"):
            for kind in kinds:
                counts[kind].append(in_time)
    cells.append(cell(reports))
    shares.append(counts)
line(f"{MELODIES} test melodies", cells)
if FOLDER:
    files = sorted(FOLDER.glob("*.mid"))
    line(f"{len(files)} files of {FOLDER.name}", [cell([play(song, *who) for song in files]) for who in (READER, SCRIPT)])
print("\n| notes of the test melodies | number | sight-reader | scripted player |\n|---|---|---|---|")
for kind, found in sorted(shares[0].items()):
    print(f"| {kind} | {len(found)} | " + " | ".join(f"{sum(counts[kind]) / len(counts[kind]):.2f}" for counts in shares) + " |")
