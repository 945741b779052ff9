"""Prints a Markdown table of the scores and times of trainings: learning_table.py FOLDER | COURSE.csv

FOLDER holds curves called SONG-SEED.csv; COURSE.csv is that of `etude experiment report`, and its variants are told apart.
Times are of the training that made the curve, start and evaluations included."""

import collections
import csv
import pathlib
import statistics
import sys

GOALS = [0.90, 0.946]


def first(rows, goal):
    """Steps and seconds after which a curve first reached a goal, None if it never did."""
    return next(((int(row["step"]), float(row["secs"])) for row in rows if float(row["f1"]) >= goal), None)


def reached(firsts):
    """The means of steps and seconds, and how many there are if some are missing."""
    there = [first for first in firsts if first is not None]
    missing = f" ({len(there)} of {len(firsts)})" if len(there) < len(firsts) else ""
    return "{:,.0f}; {:.0f} s".format(*map(statistics.mean, zip(*there))) + missing if there else "never"


source = pathlib.Path(sys.argv[1])
curves = collections.defaultdict(list)
if source.is_dir():
    name = "song"
    for path in sorted(source.glob("*-*.csv")):
        curves[path.stem.rsplit("-", 1)[0]].append(list(csv.DictReader(path.open())))
else:
    name = "variant"
    trainings = collections.defaultdict(list)
    for row in csv.DictReader(source.open()):
        trainings[row["variant"], row["song"], row["seed"]].append(row)
    for (variant, _, _), rows in trainings.items():
        curves[variant].append(sorted(rows, key=lambda row: int(row["step"])))


def best(rows):
    """The evaluation whose policy is kept: by the mean of F1 and onset F1 if the curve has it, else by F1."""
    return max(rows, key=lambda row: float(row.get("overall") or row["f1"]))


def mean(values):
    return f"{statistics.mean(values):.3f}"


goals = " | ".join(f"F1 {goal} after" for goal in GOALS)
print(f"| {name} | seeds | F1 of the best policy: mean (each) | its onset F1 | mean F1 of the last five | {goals} | steps | time |")
print("|---|---|---|---|---|" + "---|" * len(GOALS) + "---|---|")
means = []
for what, runs in curves.items():
    kept = [float(best(rows)["f1"]) for rows in runs]
    means.append(statistics.mean(kept))
    cells = [
        what,
        len(runs),
        f"{means[-1]:.3f} ({', '.join(f'{f1:.3f}' for f1 in kept)})",
        mean([float(best(rows)["onset_f1"]) for rows in runs]),
        mean([float(row["f1"]) for rows in runs for row in rows[-5:]]),
        *(reached([first(rows, goal) for rows in runs]) for goal in GOALS),
        f"{int(runs[0][-1]['step']):,}",
        f"{statistics.mean(float(rows[-1]['secs']) for rows in runs):.0f} s",
    ]
    print("| " + " | ".join(map(str, cells)) + " |")
if name == "song":
    print(f"\nMean over these {len(means)} songs: {statistics.mean(means):.3f}")
