"""Plays every built-in song in simulation and prints a table of scores and notes: notes_table.py [--scripted] [ETUDE]

Without --scripted, the shipped policies play (policies/). ETUDE is the program; target/release/etude if it is not given.
"""

import json
import pathlib
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
scripted = "--scripted" in sys.argv
programs = [argument for argument in sys.argv[1:] if not argument.startswith("--")]
ETUDE = programs[0] if programs else str(ROOT / "target" / "release" / "etude")


def etude(*arguments):
    done = subprocess.run([ETUDE, *arguments, "--json"], cwd=ROOT, check=True, capture_output=True, text=True)
    return json.loads(done.stdout)


limits = " limits |" if scripted else ""
print("| song | notes right | wrong | onset F1 | onset + offset F1 | median onset error | F1 | precision | recall |" + limits)
print("|---|---|---|---|---|---|---|---|---|" + "---|" * scripted)
for song in etude("songs"):
    song = song["id"]
    who = ["--scripted"] if scripted else ["--policy", f"policies/{song}.safetensors"]
    report = etude("play", song, *who, "-o", f"out/notes-table/{song}")
    late = report["onset_error_median_secs"]
    cells = [
        song,
        f"{report['matched']} of {report['matched'] + report['missed']}",
        report["wrong"],
        *(f"{report[key]:.3f}" for key in ("onset_f1", "onset_offset_f1")),
        "–" if late is None else f"{1e3 * late:+.0f} ms",
        *(f"{report[key]:.3f}" for key in ("f1", "precision", "recall")),
        *([report["limits"]] if scripted else []),
    ]
    print("| " + " | ".join(map(str, cells)) + " |", flush=True)
