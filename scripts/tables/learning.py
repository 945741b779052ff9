"""Curves of trainings, and what the shipped policies play in simulation."""

import collections
import csv
import json
import pathlib
import statistics
import sys

from tables.common import (
    MEASURE, PAPER_SONGS, ROWS, SCRIPTED, argument, command, head, mean, mean_of, played, policy, read, row, rows_of,
    songs, sum_of,
)

# Control steps in the second before a song.
SILENT_STEPS = 20


@command("learning-curve", argument("run", type=pathlib.Path, help="folder of a training"))
def learning_curve(options):
    """The evaluations of a training as CSV."""
    rows, elapsed = [], 0.0
    for line in (options.run / "metrics.jsonl").read_text().splitlines():
        metrics = json.loads(line)
        elapsed = metrics.get("perf/elapsed_secs", elapsed)
        scores = {key.removeprefix("eval/"): value for key, value in metrics.items() if key.startswith("eval/")}
        if scores:
            scores = {name: round(value, 4) for name, value in scores.items()}
            rows.append({"step": metrics["step"], "secs": round(elapsed, 1)} | scores)
    writer = csv.DictWriter(sys.stdout, rows[0].keys(), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)


def curves_of(source):
    """Curves by name: of the files SONG-SEED.csv of a folder, or of the variants in a file."""
    curves = collections.defaultdict(list)
    if source.is_dir():
        for path in sorted(source.glob("*-*.csv")):
            curves[path.stem.rsplit("-", 1)[0]].append(list(csv.DictReader(path.open())))
        return "song", curves
    trainings = collections.defaultdict(list)
    for line in csv.DictReader(source.open()):
        trainings[line["variant"], line["song"], line["seed"]].append(line)
    for (variant, _, _), rows in trainings.items():
        curves[variant].append(sorted(rows, key=lambda row: int(row["step"])))
    return "variant", curves


def best(rows, score):
    """The evaluation whose policy is kept."""
    return max(rows, key=lambda row: float(row.get(score) or row["f1"]))


def notes_of(evaluations):
    """Means of the notes right and wrong."""
    means = {key: statistics.mean(float(row[key]) for row in evaluations) for key in ("notes_right", "notes_missed", "notes_wrong")}
    right, missed, wrong = (round(value, 1) for value in means.values())
    return f"{right:g} of {right + missed:g}, {wrong:g}"


NUMBERS = {5: "five", 20: "twenty"}


def time_to(level, curves):
    """Mean steps and seconds until the curves reach a level, and how many do if not all."""
    firsts = []
    for rows in curves:
        reached = (row for row in rows if float(row["f1"]) >= level)
        firsts += [(int(row["step"]), float(row["secs"])) for row in [next(reached, None)] if row]
    if not firsts:
        return "never"
    some = f" ({len(firsts)} of {len(curves)})" if len(firsts) < len(curves) else ""
    return "{:,.0f}; {:.0f} s".format(*map(statistics.mean, zip(*firsts))) + some


@command(
    "learning",
    argument("source", type=pathlib.Path, help="folder of SONG-SEED.csv, or a report's course.csv"),
    argument("--rule", default="articulated plan", help="by which F1 is counted, for the heading"),
    argument("--best-by", default="overall", help="the score that chooses the policy: overall (F1 and onset F1) or f1"),
    argument("--level", type=float, default=0.9, help="the F1 whose first evaluation is counted"),
    argument("--last", type=int, default=5, help="how many of the last evaluations are averaged"),
    argument("--all", action="store_true", help="a last row with the means of all trainings"),
)
def learning(options):
    """Scores and times of trainings, from their curves. Times include start and evaluations."""
    name, curves = curves_of(options.source)
    head(
        name, "seeds", f"F1 ({options.rule}) of the best policy: mean (each)", "its notes right, wrong", "its onset F1",
        f"last {NUMBERS.get(options.last, options.last)}: F1", f"F1 {options.level:g} after", "steps", "time",
    )
    means = [("all", sum(curves.values(), []))] if options.all else []
    for label, runs in [*curves.items(), *means]:
        kept = [best(rows, options.best_by) for rows in runs]
        f1 = [float(row["f1"]) for row in kept]
        row(
            label,
            len(runs),
            f"{statistics.mean(f1):.3f} ({', '.join(f'{one:.3f}' for one in f1)})" if 1 < len(f1) and label != "all" else mean(f1),
            notes_of(kept),
            mean(float(row["onset_f1"]) for row in kept),
            mean(float(row["f1"]) for rows in runs for row in rows[-options.last :]),
            time_to(options.level, runs),
            f"{int(runs[0][-1]['step']):,}",
            f"{statistics.mean(float(rows[-1]['secs']) for rows in runs):.0f} s",
        )


@command("worlds", argument("source", type=pathlib.Path, help="folder of WORLD-SEED.csv"))
def worlds(options):
    """F1 of one song in several worlds, each the mean of three evaluations up to that step."""
    steps = range(100_000, 500_000, 100_000)
    head("world", *(f"{step:,}" for step in steps), "best", "steps")
    for label, runs in curves_of(options.source)[1].items():
        for rows in runs:
            f1 = {int(entry["step"]): float(entry["f1"]) for entry in rows}
            recent = ([f1[step] for step in sorted(f1) if step <= end][-3:] for end in steps)
            cells = (f"{statistics.mean(of_end):.3f}" if end <= max(f1) else "–" for end, of_end in zip(steps, recent))
            row(label.replace("-", " "), *cells, f"{max(f1.values()):.3f}", f"{max(f1):,}")


def column(folder, name):
    """The sets of keys of a column of frames.csv, one a control step."""
    with open(folder / "frames.csv") as file:
        return [set(row[name].split()) for row in csv.DictReader(file)]


def frame_f1(due, pressed):
    """The mean of the steps' F1."""
    steps = [2 * len(d & p) / (len(d) + len(p)) if d or p else 1.0 for d, p in zip(due, pressed, strict=True)]
    return statistics.mean(steps)


SET = argument("--set", action="append", default=[], metavar="PATH=VALUE", help="changes the world when measuring")
BY_BOTH_RULES = ["f1", "f1_robopianist", "f1_robopianist_without_silence"]


def measured_song(song, who):
    """A song in simulation: its notes and F1 by the plan that is played, and F1 by RoboPianist's rule."""
    with played(song, *who) as (report, folder):
        pressed, own = column(folder, "pressed"), column(folder, "due")
    with played(song, *who, "--set", "task.plan.rule=robopianist") as (_, folder):
        due = column(folder, "due")
    return {
        "song": song,
        "notes_right": report["matched"],
        "notes_due": report["matched"] + report["missed"],
        "notes_wrong": report["wrong"],
        **{key: report[key] for key in ("onset_f1", "onset_offset_f1", "onset_error_median_secs")},
        "f1": report["f1"],
        "f1_robopianist": frame_f1(due, pressed),
        "f1_robopianist_without_silence": frame_f1(due[SILENT_STEPS:], pressed[SILENT_STEPS:]),
        "frames": len(due),
        "frames_that_differ": sum(a != b for a, b in zip(own, due, strict=True)),
    }


def five(rows):
    """Those of the paper's songs."""
    return [entry for entry in rows if entry["song"] in PAPER_SONGS]


@command("notes", ROWS, MEASURE, SCRIPTED, SET)
def notes(options):
    """Notes and scores of the built-in songs in simulation, by the articulated plan that is played.

    The last column scores the same performance by RoboPianist's rule.
    """
    settings = [word for setting in options.set for word in ("--set", setting)]
    who = lambda song: [*(["--scripted"] if options.scripted else policy(song)), *settings]
    rows = rows_of(options, lambda: (measured_song(song, who(song)) for song in songs()))
    scores = ["onset F1", "onset + offset F1", "median onset error", "F1 (articulated plan)", "F1 (RoboPianist's rule)"]
    head("song", "notes right", "wrong", *scores)
    for name, some in [*((entry["song"], [entry]) for entry in rows), ("the paper's five songs", five(rows)), ("all", rows)]:
        right, due, wrong = (sum_of(some, f"notes_{key}") for key in ("right", "due", "wrong"))
        onset, offset, f1, by_rule = (
            f"{mean_of(some, key):.3f}" for key in ("onset_f1", "onset_offset_f1", "f1", "f1_robopianist")
        )
        error = f"{1e3 * mean_of(some, 'onset_error_median_secs'):+.0f} ms"
        row(name, f"{right:g} of {due:g}", f"{wrong:g}", onset, offset, error, f1, by_rule)


@command("frames", ROWS)
def frames(options):
    """F1 of the rows of `notes` by their own plan and against RoboPianist's frames."""
    rows = read(options.rows)
    without = "the same, without the first second"
    head("song", "F1 (articulated plan)", "F1 (RoboPianist's rule)", without, "frames that differ")
    for name, some in [*((entry["song"], [entry]) for entry in rows), ("the paper's five songs", five(rows))]:
        differ = f"{sum_of(some, 'frames_that_differ'):g} of {sum_of(some, 'frames'):g}"
        row(name, *(f"{mean_of(some, key):.3f}" for key in BY_BOTH_RULES), differ)
