"""Prints the table of an experiment from its committed rows: experiment_table.py FOLDER | ROWS.csv [--rule RULE] [--after STEPS]

FOLDER holds results.csv, one row a performance, and may hold course.csv, one row an evaluation. ROWS.csv is that of `after-iteration`.
A row of the table is a variant,
or without variants a kind of pieces or a song. A training counts once: its performances are averaged first, then the seeds of a song, then the
songs. Differences are those of F1 from the first variant, paired by song and seed, with 95 % bootstrap intervals
that are drawn within each song.
"""

import argparse
import collections
import csv
import pathlib
import random
import statistics


def read(path):
    if not path.is_file():
        return []
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def by_training(rows, measure):
    """The mean of a measure for each song and seed."""
    values = collections.defaultdict(list)
    for row in rows:
        if row[measure]:
            values[row["song"], row["seed"]].append(float(row[measure]))
    return {key: statistics.mean(group) for key, group in values.items()}


def of_songs(trainings):
    """The values of each song."""
    songs = collections.defaultdict(list)
    for (song, _), value in trainings.items():
        songs[song].append(value)
    return list(songs.values())


def mean(trainings):
    return statistics.mean(map(statistics.mean, of_songs(trainings)))


def difference(trainings, first):
    """The mean difference and its interval."""
    groups = of_songs({key: trainings[key] - first[key] for key in trainings if key in first})
    draw = random.Random(0)
    resample = lambda: statistics.mean(statistics.mean(draw.choices(group, k=len(group))) for group in groups)
    means = sorted(resample() for _ in range(10_000))
    return f"{statistics.mean(map(statistics.mean, groups)):+.3f} [{means[250]:+.3f}, {means[9749]:+.3f}]"


def last_five(course, measure):
    """For each training the mean of its last five evaluations."""
    trainings = collections.defaultdict(list)
    for row in sorted(course, key=lambda row: int(row["step"])):
        trainings[row["song"], row["seed"]].append(float(row[measure]))
    return {key: statistics.mean(values[-5:]) for key, values in trainings.items()}


def notes(rows, of=by_training):
    """Notes right and wrong, summed over the songs."""
    sums = (sum(map(statistics.mean, of_songs(of(rows, measure)))) for measure in ("notes_right", "notes_wrong"))
    return ", ".join(f"{notes:.1f}" for notes in sums)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("rows", type=pathlib.Path, metavar="FOLDER | ROWS.csv")
    parser.add_argument("--rule", default="articulated plan", help="by which F1 is counted, for the header")
    parser.add_argument("--after", type=int, action="append", default=[], help="also F1 after so many steps")
    parser.add_argument("--by", type=lambda names: names.split(","), help="a row for each combination of these columns")
    parser.add_argument("--player", help="only the performances of this player")
    options = parser.parse_args()
    of_file = options.rows.is_file()
    rows = read(options.rows if of_file else options.rows / "results.csv")
    course = [] if of_file else read(options.rows / "course.csv")
    rows = [row for row in rows if options.player in (None, row.get("player"))]
    # The last five evaluations say something only of a long course.
    course_is_long = len({row["step"] for row in course}) >= 10
    # Modes are compared on the same songs and seeds: on those where the twin never stopped.
    where = lambda row: (row.get("twin_params"), row["song"], row["seed"])
    stopped = {where(row) for row in rows if row.get("complete") == "0"} if options.by else set()
    rows = [row for row in rows if where(row) not in stopped]
    by = options.by or [next(label for label in ("variant", "pieces", "song") if label in rows[0])]
    of = lambda row: ", ".join(row[label] for label in by)
    twins = list(dict.fromkeys(row["twin_params"] for row in rows if row.get("twin_params")))
    onset = next((measure for measure in ("onset_f1_without_lag", "onset_f1") if measure in rows[0]), None)
    head = [", ".join(by), *(f"F1 after {steps:,} steps" for steps in options.after), f"F1 ({options.rule})"]
    head += ["onset F1"] * ("sim_onset_f1" in rows[0]) + ["last five: F1", "notes right, wrong"] * course_is_long
    for twin in twins:
        head += [f"`{twin}`: F1", "gap", *["onset F1"] * bool(onset), *["notes right, wrong"] * ("notes_right" in rows[0])]
    if by == ["variant"]:
        head += ["difference of F1", *(f"`{twin}`: difference of F1" for twin in twins)]
    names = list(dict.fromkeys(map(of, rows)))
    print("| " + " | ".join(head) + " |")
    print("|" + "---|" * len(head))
    first = None
    for name in names + ["all"] * (by == ["song"]):
        mine, curve = ([row for row in table if name in (of(row), "all")] for table in (rows, course))
        simulation = by_training(mine, "sim_f1")
        cells = [name]
        cells += [f"{mean(by_training([row for row in curve if int(row['step']) == steps], 'f1')):.3f}" for steps in options.after]
        cells.append(f"{mean(simulation):.3f}")
        if "sim_onset_f1" in rows[0]:
            cells.append(f"{mean(by_training(mine, 'sim_onset_f1')):.3f}")
        if course_is_long:
            cells += [f"{mean(last_five(curve, 'f1')):.3f}", notes(curve, last_five)]
        for twin in twins:
            there = [row for row in mine if row["twin_params"] == twin]
            if not there:
                cells += [""] * (2 + bool(onset) + ("notes_right" in rows[0]))
                continue
            f1 = mean(by_training(there, "f1"))
            cells += [f"{f1:.3f}", f"{100 * (1 - f1 / mean(by_training(there, 'sim_f1'))):.1f} %"]
            cells += [f"{mean(by_training(there, onset)):.3f}"] if onset else []
            cells += [notes(there)] if "notes_right" in rows[0] else []
        if by == ["variant"]:
            there = [by_training([row for row in mine if row["twin_params"] == twin], "f1") for twin in twins]
            first = first or [simulation, *there]
            cells += [difference(*pair) if name != names[0] else "" for pair in zip([simulation, *there], first)]
        print("| " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main()
