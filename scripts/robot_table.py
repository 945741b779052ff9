"""Plays every built-in song on the twin in every mode and prints the table of docs/results/robot.md, as means over the runs: notes right of
those due and wrong ones; onset F1; the lead of the plan, which `etude perform` measures in a run before; and the paper's F1.

    make build && python3 scripts/robot_table.py [--runs 3] [--truth standard]
"""

import argparse
import json
import pathlib
import subprocess

ROOT = pathlib.Path(__file__).resolve().parent.parent
ETUDE = ROOT / "target" / "release" / "etude"
MODES = ["joint-mirroring", "hybrid", "real"]


def etude(*arguments):
    done = subprocess.run([ETUDE, *arguments], cwd=ROOT, check=True, capture_output=True, text=True)
    return json.loads(done.stdout)


def melodies(part, count, folder):
    """MIDI files of the first melodies of a part, written into `folder`."""
    seed = 0
    for number in range(count):
        path = folder / f"{part}-{number}.mid"
        # Another generator wrote other melodies.
        path.unlink(missing_ok=True)
        seed = etude("songs", "make", "--part", part, "--seed", str(seed), "-o", str(path), "--json")["seed"] + 1
        yield path


def perform(song, mode, truth, runs):
    """The report of performances on the twin."""
    return etude(
        "perform", song, "--mode", mode, "--robot", "twin", "--truth", truth, "--policy", f"policies/{song}.safetensors", "--runs", runs,
        "--out", f"out/robot-table/{truth}/{song}-{mode}", "--json",
    )


def truths_and_runs(doc):
    """The options of the tables of several truths."""
    parser = argparse.ArgumentParser(description=doc.splitlines()[0])
    parser.add_argument("--truth", action="append")
    parser.add_argument("--runs", default="1")
    options = parser.parse_args()
    return options.truth or ["standard", "worn"], options.runs


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", default="3")
    parser.add_argument("--truth", default="standard")
    options = parser.parse_args()
    songs = [song["id"] for song in etude("songs", "--json")]
    print("| song | simulation | " + " | ".join(MODES) + " |")
    print("|---|---|" + "---|" * len(MODES))
    columns, onsets = {mode: [] for mode in MODES}, {mode: [] for mode in MODES}
    simulation = []
    right, wrong = {mode: 0 for mode in MODES}, {mode: 0 for mode in MODES}
    due = 0
    for song in songs:
        cells = []
        for mode in MODES:
            try:
                report = perform(song, mode, options.truth, options.runs)
            except subprocess.CalledProcessError as ended:
                # A fault, for instance: the robot has stopped itself. It counts in no mean.
                cells.append(ended.stderr.strip().splitlines()[-1].removeprefix("etude: ").split(":")[0])
                continue
            onset = report["onset_f1"]
            notes = f"{report['notes_right']:g} of {report['notes_due']}, {report['notes_wrong']:g}"
            cells.append(f"{notes}; {onset:.3f}; {1e3 * report['lead_secs']:.0f} ms; {report['robot_f1']:.3f}")
            columns[mode].append(report["robot_f1"])
            onsets[mode].append(onset)
            right[mode] += report["notes_right"]
            wrong[mode] += report["notes_wrong"]
        due += report["notes_due"]
        simulation.append(report["sim_f1"])
        print(f"| {song} | {report['sim_f1']:.3f} | " + " | ".join(cells) + " |", flush=True)
    mean = lambda values: f"{sum(values) / len(values):.3f}"
    sums = (f"{right[mode]:g} of {due}, {wrong[mode]:g}; {mean(onsets[mode])}; {mean(columns[mode])}" for mode in MODES)
    print(f"| sum; mean | {mean(simulation)} | " + " | ".join(sums) + " |")


if __name__ == "__main__":
    main()
