"""Prints the tables of docs/results/rehearsals.md from the folders of rehearsals of one round: notes right of those due and wrong ones, onset F1, the
paper's F1 in simulation and on the twin, before and after the round; and their means, as they are, and with the better of both kept.

    etude rehearse twinkle --robot twin --truth random:1 --rounds 1 --runs 2 -o runs/rounds/random-1/twinkle    # and so on
    python3 scripts/rounds_table.py runs/rounds/*/*
"""

import json
import pathlib
import statistics
import sys


def cell(entry):
    notes = f"{entry['notes_right']:g} of {entry['notes_due']}, {entry['notes_wrong']:g}"
    return f"{notes}; {entry['onset_f1']:.3f}; {entry['sim_f1']:.3f}, {entry['robot_f1']:.3f}"


def worth(entry):
    """What `rehearse` chooses by."""
    return entry["robot_f1"] + entry["onset_f1"]


def means(rounds):
    total = {key: sum(entry[key] for entry in rounds) for key in ("notes_right", "notes_due", "notes_wrong")}
    return total | {key: statistics.mean(entry[key] for entry in rounds) for key in ("onset_f1", "sim_f1", "robot_f1")}


def main():
    rehearsals = []
    for folder in map(pathlib.Path, sys.argv[1:]):
        config = json.loads((folder / "rehearsal.json").read_text())
        before, after = (json.loads((folder / f"round-{index}" / "round.json").read_text()) for index in range(2))
        rehearsals.append((config["truth"] or config["rig"], config["song"], before, after, max(before, after, key=worth)))
    rehearsals.sort(key=lambda one: (one[0].partition(":")[0], int(one[0].partition(":")[2] or 0), one[1]))
    print("| truth | song | before | after one round | kept |\n|---|---|---|---|---|")
    for truth, song, before, after, kept in rehearsals:
        print(f"| `{truth}` | {song} | {cell(before)} | {cell(after)} | {0 if kept is before else 1} |")
    columns = list(zip(*rehearsals))[2:]
    print(f"| **sum; mean of {len(rehearsals)}** | | " + " | ".join(f"**{cell(means(column))}**" for column in columns) + " |")
    worst = (min(entry["robot_f1"] for entry in column) for column in columns)
    print("| worst F1 | | " + " | ".join(f"{f1:.3f}" for f1 in worst) + " |")


if __name__ == "__main__":
    main()
