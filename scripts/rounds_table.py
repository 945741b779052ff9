"""Prints the tables of docs/results/rehearsals.md from the folders of rehearsals: notes right of those due and wrong ones, onset F1, the paper's F1 in
simulation and on the twin, before and after each round; and their means, as they are, and with the best round kept. Cells that were adapted, there or
in docs/results/adaptation.md, are counted with the best of all.

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


def read(folder):
    """Truth and song, each round, the round that `rehearse` names as the best, and what was adapted there, if anything."""
    config = json.loads((folder / "rehearsal.json").read_text())
    files = sorted(folder.glob("round-*/round.json"), key=lambda file: int(file.parent.name.removeprefix("round-")))
    rounds = [json.loads(file.read_text()) for file in files]
    result = folder / "adaptation/result.json"
    adapted = json.loads(result.read_text()) if result.is_file() else None
    return (config["truth"] or config["rig"], config["song"]), rounds, max(rounds, key=worth), adapted


def order(one):
    name, _, seed = one[0][0].partition(":")
    return name, int(seed or 0), one[0][1]


def main():
    rehearsals = sorted(map(read, map(pathlib.Path, sys.argv[1:])), key=order)
    where, rounds, kept, adapted = zip(*rehearsals)
    names = ["nothing fitted", "after one round", "after two rounds"][: min(map(len, rounds))]
    columns = [*zip(*(each[: len(names)] for each in rounds)), kept]
    print("| cells | notes right, wrong | onset F1 | F1 on the twin | worst F1 |\n|---|---|---|---|---|")
    for name, column in zip([*names, "the best of these"], columns):
        summary(name, list(zip(where, column)))
    if not all(adapted):
        cells = adapted_cells()
        adapted = [cells.get(one) for one in where]
    if all(adapted):
        summary("adapted, without a round", list(zip(where, adapted)))
        summary("at the end", [(one, max(best, last, key=worth)) for one, best, last in zip(where, kept, adapted)])
    print("\n| truth | song | " + " | ".join([*names, "kept"]) + " |\n|" + "---|" * (len(names) + 3))
    for (truth, song), each, best, _ in rehearsals:
        print(f"| `{truth}` | {song} | " + " | ".join(map(cell, each[: len(names)])) + f" | {best['round']} |")
    print(f"| **sum; mean of {len(rehearsals)}** | | " + " | ".join(f"**{cell(means(column))}**" for column in columns) + " |")
    worst = (min(entry["robot_f1"] for entry in column) for column in columns)
    print("| worst F1 | | " + " | ".join(f"{f1:.3f}" for f1 in worst) + " |")


if __name__ == "__main__":
    main()
