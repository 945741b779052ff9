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
    """Seconds after which a curve first reached a goal, None if it never did."""
    return next((float(row["secs"]) for row in rows if float(row["f1"]) >= goal), None)


def seconds(times):
    """The mean of the times, and how many there are if some are missing."""
    reached = [time for time in times if time is not None]
    missing = f" ({len(reached)} of {len(times)})" if len(reached) < len(times) else ""
    return f"{statistics.mean(reached):.0f} s{missing}" if reached else "never"


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

early = "" if name == "song" else " F1 at 40,000 |"
goals = " | ".join(f"F1 {goal} after" for goal in GOALS)
print(f"| {name} | seeds | best F1: mean (each) |{early} last F1 | {goals} | steps | time |")
print("|---|---|---|---|" + "---|" * bool(early) + "---|" * len(GOALS) + "---|---|")
means = []
for what, runs in curves.items():
    best = [max(float(row["f1"]) for row in rows) for rows in runs]
    last = statistics.mean(float(rows[-1]["f1"]) for rows in runs)
    means.append(statistics.mean(best))
    cells = [
        what,
        len(runs),
        f"{means[-1]:.3f} ({', '.join(f'{f1:.3f}' for f1 in best)})",
        *([f"{statistics.mean(float(row['f1']) for rows in runs for row in rows if row['step'] == '40000'):.3f}"] if early else []),
        f"{last:.3f}",
        *(seconds([first(rows, goal) for rows in runs]) for goal in GOALS),
        f"{int(runs[0][-1]['step']):,}",
        f"{statistics.mean(float(rows[-1]['secs']) for rows in runs):.0f} s",
    ]
    print("| " + " | ".join(map(str, cells)) + " |")
if name == "song":
    print(f"\nMean over these {len(means)} songs of the mean best F1: {statistics.mean(means):.3f}")
