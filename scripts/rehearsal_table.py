"""Plays the policy of each round of rehearsals on the twin in every mode and prints the table of docs/results/rehearsals.md.

    etude rehearse SONG --robot twin --rounds 2 -o runs/rehearse/SONG     # for each song
    python3 scripts/rehearsal_table.py runs/rehearse/SONG… [--runs 4] [--truth standard]
"""

import argparse
import json
import pathlib
import statistics
import subprocess

ROOT = pathlib.Path(__file__).resolve().parent.parent
MODES = ["joint-mirroring", "hybrid", "real"]


def perform(etude, song, mode, policy, truth, runs, out):
    command = [
        etude, "perform", song, "--mode", mode, "--robot", "twin", "--truth", truth, "--policy", policy,
        "--runs", str(runs), "--out", out, "--json",
    ]
    done = subprocess.run([str(word) for word in command], cwd=ROOT, check=True, capture_output=True, text=True)
    return json.loads(done.stdout)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("rehearsals", nargs="+", type=pathlib.Path)
    parser.add_argument("--runs", type=int, default=4)
    parser.add_argument("--truth", default="standard")
    parser.add_argument("--etude", default=ROOT / "target" / "release" / "etude")
    options = parser.parse_args()
    means = {}
    print("| song | mode | round | simulation | twin | gap |\n|---|---|---|---|---|---|")
    for folder in options.rehearsals:
        song = json.loads((folder / "rehearsal.json").read_text())["song"]
        rounds = [json.loads(path.read_text()) for path in sorted(folder.glob("round-*/round.json"))]
        for mode in MODES:
            for entry in rounds:
                index = entry["round"]
                out = folder / "table" / f"{mode}-{index}"
                report = perform(options.etude, song, mode, entry["policy"], options.truth, options.runs, out)
                sim, twin, gap = report["sim_f1"], report["robot_f1"], report["gap"]
                means.setdefault((mode, index), []).append((sim, twin, gap))
                print(f"| {song} | {mode} | {index} | {sim:.3f} | {twin:.3f} ± {report['robot_f1_std']:.3f} | {gap:.3f} |", flush=True)
    for (mode, index), values in sorted(means.items()):
        sim, twin, gap = (statistics.mean(column) for column in zip(*values))
        print(f"| mean of {len(values)} | {mode} | {index} | {sim:.3f} | {twin:.3f} | {gap:.3f} |")


if __name__ == "__main__":
    main()
