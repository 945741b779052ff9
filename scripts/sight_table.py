"""Who plays what at sight, as a Markdown table: make build && sight_table.py [POLICY] [MELODIES]

Plays the built-in songs, those in songs/ and the first test melodies (20) by POLICY (policies/sight-reader.safetensors), by the scripted player
and, where there is one, by the shipped policy of the song. Of the melodies it prints the sums of the notes, the means of the scores and the lowest F1.
"""

import sys
from pathlib import Path

from robot_table import etude

POLICY = sys.argv[1] if len(sys.argv) > 1 else "policies/sight-reader.safetensors"
MELODIES = int(sys.argv[2]) if len(sys.argv) > 2 else 20
OUT = Path("out/sight-table")


def play(song, *who):
    """The report of a performance."""
    return etude("play", str(song), *who, "-o", str(OUT / "play"), "--json")


def cell(reports):
    """Notes, onset F1 and F1 of one performance or several."""
    total = lambda key: sum(report[key] for report in reports)
    mean = lambda key: total(key) / len(reports)
    right, due = total("matched"), total("matched") + total("missed")
    lowest = f" (lowest {min(report['f1'] for report in reports):.3f})" if len(reports) > 1 else ""
    return f"{right} of {due}, {total('wrong')} wrong; {mean('onset_f1'):.3f}; {mean('f1'):.3f}{lowest}"


def row(name, songs, own=None):
    """A line of the table: the songs by the sight-reader, by the script and by their own policy."""
    players = [["--policy", POLICY], ["--scripted"]] + ([["--policy", own]] if own else [])
    cells = [cell([play(song, *who) for song in songs]) for who in players]
    print("| " + " | ".join([name, *cells] + ["–"] * (3 - len(cells))) + " |", flush=True)


OUT.mkdir(parents=True, exist_ok=True)
print("| piece | sight-reader: notes; onset F1; F1 | scripted player | policy of the song |")
print("|---|---|---|---|")
for song in etude("songs", "--json"):
    row(song["id"], [song["id"]], f"policies/{song['id']}.safetensors")
for song in sorted(Path("songs").glob("*.mid")):
    row(song.stem, [song])
melodies, seed = [], 0
while len(melodies) < MELODIES:
    path = OUT / f"melody-{len(melodies)}.mid"
    seed = etude("songs", "make", "--part", "test", "--seed", str(seed), "-o", str(path), "--json")["seed"] + 1
    melodies.append(path)
row(f"{MELODIES} test melodies", melodies)
