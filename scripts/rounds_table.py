"""Prints the tables of docs/results/rehearsals.md from the folders of rehearsals of one round: notes right of those due and wrong ones, onset F1, the
paper's F1 in simulation and on the twin, before and after the round; and their means, as they are, and with the better of both kept. Cells that
docs/results/adaptation.md has adapted too are counted with the best of the three.

    etude rehearse twinkle --robot twin --truth random:1 --rounds 1 --runs 2 -o runs/rounds/random-1/twinkle    # and so on
    python3 scripts/rounds_table.py runs/rounds/*/*
"""

import json
import pathlib
import re
import statistics
import sys

SUMS, MEANS = ("notes_right", "notes_due", "notes_wrong"), ("onset_f1", "sim_f1", "robot_f1")
ADAPTED = pathlib.Path(__file__).parent.parent / "docs/results/adaptation.md"


def cell(entry):
    notes = f"{entry['notes_right']:g} of {entry['notes_due']}, {entry['notes_wrong']:g}"
    return f"{notes}; {entry['onset_f1']:.3f}; {entry['sim_f1']:.3f}, {entry['robot_f1']:.3f}"


def worth(entry):
    """What `rehearse` chooses by."""
    return entry["robot_f1"] + entry["onset_f1"]


def means(rounds):
    total = {key: sum(entry[key] for entry in rounds) for key in SUMS}
    return total | {key: statistics.mean(entry[key] for entry in rounds) for key in MEANS}


def adapted_cells():
    """What scripts/adapt_table.py has printed in joint mirroring, by truth and song."""
    cells = {}
    for line in ADAPTED.read_text().partition("## Named truths")[2].splitlines():
        if line.startswith("| `"):
            truth, song, _, _, adapted = (part.strip() for part in line.split("|")[1:6])
            right, due, wrong, onset, f1 = map(float, re.fullmatch(r"(.*) of (.*), (.*); (.*); (.*)", adapted).groups())
            numbers = {"notes_right": right, "notes_due": due, "notes_wrong": wrong, "onset_f1": onset, "robot_f1": f1}
            cells[truth.strip("`"), song] = numbers
    return cells


def summary(name, cells):
    right, due, wrong = (sum(entry[key] for _, entry in cells) for key in SUMS)
    onset, f1 = (statistics.mean(entry[key] for _, entry in cells) for key in ("onset_f1", "robot_f1"))
    (truth, song), worst = min(cells, key=lambda one: one[1]["robot_f1"])
    print(f"| {name} | {right:g} of {due:g}, {wrong:g} | {onset:.3f} | {f1:.3f} | {worst['robot_f1']:.3f} ({song} on `{truth}`) |")


def main():
    rehearsals = []
    for folder in map(pathlib.Path, sys.argv[1:]):
        config = json.loads((folder / "rehearsal.json").read_text())
        before, after = (json.loads((folder / f"round-{index}" / "round.json").read_text()) for index in range(2))
        rehearsals.append(((config["truth"] or config["rig"], config["song"]), before, after, max(before, after, key=worth)))
    rehearsals.sort(key=lambda one: (one[0][0].partition(":")[0], int(one[0][0].partition(":")[2] or 0), one[0][1]))
    where, before, after, kept = zip(*rehearsals)
    print("| cells | notes right, wrong | onset F1 | F1 on the twin | worst F1 |\n|---|---|---|---|---|")
    for name, column in [("nothing fitted", before), ("after one round", after), ("the better of both", kept)]:
        summary(name, list(zip(where, column)))
    adapted = adapted_cells()
    if all(one in adapted for one in where):
        summary("adapted, without a round", [(one, adapted[one]) for one in where])
        summary("at the end", [(one, max(best, adapted[one], key=worth)) for one, best in zip(where, kept)])
    print("\n| truth | song | before | after one round | kept |\n|---|---|---|---|---|")
    for (truth, song), *columns in rehearsals:
        print(f"| `{truth}` | {song} | {cell(columns[0])} | {cell(columns[1])} | {0 if columns[2] is columns[0] else 1} |")
    columns = (before, after, kept)
    print(f"| **sum; mean of {len(rehearsals)}** | | " + " | ".join(f"**{cell(means(column))}**" for column in columns) + " |")
    worst = (min(entry["robot_f1"] for entry in column) for column in columns)
    print("| worst F1 | | " + " | ".join(f"{f1:.3f}" for f1 in worst) + " |")


if __name__ == "__main__":
    main()
