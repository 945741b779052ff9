"""Plays every built-in song in simulation and prints a table of scores and notes: make build && notes_table.py [--scripted]

Without --scripted, the shipped policies play (policies/).
"""

import sys

from robot_table import etude



def median_ms(scores):
    """The median onset error of a performance, in ms."""
    secs = scores["onset_error_median_secs"]
    return "–" if secs is None else f"{1e3 * secs:+.0f} ms"


scripted = "--scripted" in sys.argv
limits = " limits |" if scripted else ""
print("| song | notes right | wrong | onset F1 | onset + offset F1 | median onset error | F1 | precision | recall |" + limits)
print("|---|---|---|---|---|---|---|---|---|" + "---|" * scripted)
for song in etude("songs", "--json"):
    song = song["id"]
    who = ["--scripted"] if scripted else ["--policy", f"policies/{song}.safetensors"]
    report = etude("play", song, *who, "-o", f"out/notes-table/{song}", "--json")
    cells = [
        song,
        f"{report['matched']} of {report['matched'] + report['missed']}",
        report["wrong"],
        *(f"{report[key]:.3f}" for key in ("onset_f1", "onset_offset_f1")),
        median_ms(report),
        *(f"{report[key]:.3f}" for key in ("f1", "precision", "recall")),
        *([report["limits"]] if scripted else []),
    ]
    print("| " + " | ".join(map(str, cells)) + " |", flush=True)
