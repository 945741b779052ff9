"""Experiments from their committed rows."""

import collections
import pathlib
import random
import statistics

from tables.common import argument, command, head, read, row

RESAMPLES = 10_000


def by_training(rows, measure):
    """The mean of a measure for each song and seed."""
    values = collections.defaultdict(list)
    for entry in rows:
        values[entry["song"], entry["seed"]].append(float(entry[measure]))
    return {key: statistics.mean(group) for key, group in values.items()}


def last_five(course, measure):
    """The mean of the last five evaluations of each song and seed."""
    values = collections.defaultdict(list)
    for entry in sorted(course, key=lambda entry: int(entry["step"])):
        values[entry["song"], entry["seed"]].append(float(entry[measure]))
    return {key: statistics.mean(group[-5:]) for key, group in values.items()}


def best(course, measure):
    """A measure at the evaluation whose policy is kept, of each song and seed."""
    kept = {}
    for entry in sorted(course, key=lambda entry: int(entry["step"])):
        key = entry["song"], entry["seed"]
        if key not in kept or float(entry["overall"]) > float(kept[key]["overall"]):
            kept[key] = entry
    return {key: float(entry[measure]) for key, entry in kept.items()}


def by_song(trainings):
    songs = collections.defaultdict(list)
    for (song, _), value in trainings.items():
        songs[song].append(value)
    return list(songs.values())


def mean(trainings):
    """Each song counts once."""
    return statistics.mean(map(statistics.mean, by_song(trainings)))


def notes(rows, of):
    """Notes right and wrong, summed over the songs."""
    sums = (sum(map(statistics.mean, by_song(of(rows, measure)))) for measure in ("notes_right", "notes_wrong"))
    return ", ".join(f"{count:.1f}" for count in sums)


def difference(trainings, first):
    """The mean difference, paired by song and seed, and its 95 % bootstrap interval."""
    groups = by_song({key: value - first[key] for key, value in trainings.items()})
    draw = random.Random(0)
    resampled = lambda: statistics.mean(statistics.mean(draw.choices(group, k=len(group))) for group in groups)
    means = sorted(resampled() for _ in range(RESAMPLES))
    low, high = means[RESAMPLES // 40], means[-RESAMPLES // 40 - 1]
    return f"{statistics.mean(map(statistics.mean, groups)):+.3f} [{low:+.3f}, {high:+.3f}]"


@command(
    "experiment",
    argument("rows", type=pathlib.Path, help="folder with results.csv and course.csv, or one file of rows"),
    argument("--rule", default="articulated plan", help="by which F1 is counted, for the heading"),
    argument("--by", nargs="+", help="a row for each combination of these columns"),
    argument("--after", type=int, nargs="+", default=[], metavar="STEPS", help="also F1 after so many steps"),
    argument("--player", help="only the performances of this player"),
    argument("--simulation", action="store_true", help="leave out the twin"),
)
def experiment(options):
    """Scores of an experiment's variants, or of its pieces or songs.

    A training counts once: its performances are averaged, then the seeds of a song, then the songs.
    Differences are those of F1 from the first variant. With --by only songs and seeds count which no
    safety stop has ended on that twin.
    """
    is_folder = options.rows.is_dir()
    rows = read(options.rows / "results.csv" if is_folder else options.rows)
    course = options.rows / "course.csv"
    course = read(course) if is_folder and course.is_file() else []
    rows = [entry for entry in rows if options.player in (None, entry.get("player"))]
    place = lambda entry: (entry.get("twin_params"), entry["song"], entry["seed"])
    stopped = {place(entry) for entry in rows if entry.get("complete") == "0"} if options.by else set()
    rows = [entry for entry in rows if place(entry) not in stopped]
    by = options.by or [next(label for label in ("variant", "pieces", "song") if label in rows[0])]
    label = lambda entry: ", ".join(entry[name] for name in by)
    twins = list(dict.fromkeys(entry["twin_params"] for entry in rows if entry.get("twin_params")))
    twins = [] if options.simulation else twins
    onset = next((measure for measure in ("onset_f1_without_lag", "onset_f1") if measure in rows[0]), None)
    has_notes = "notes_right" in rows[0]
    # A short course has no end that would say more than the best policy.
    is_long = len({entry["step"] for entry in course}) >= 10
    of_twin = ["gap", *["onset F1"] * bool(onset), *["notes right, wrong"] * has_notes]
    cells = [", ".join(by).replace("_", " "), *(f"F1 after {steps:,} steps" for steps in options.after)]
    cells += [f"F1 ({options.rule})", *["onset F1"] * ("sim_onset_f1" in rows[0])]
    cells += ["its notes right, wrong", "last five: F1", "notes right, wrong"] * is_long
    cells += [text for twin in twins for text in (f"`{twin}`: F1", *of_twin)]
    compared = by == ["variant"] and len({label(entry) for entry in rows}) > 1
    cells += ["difference of F1", *(f"`{twin}`: difference of F1" for twin in twins)] * compared
    head(*cells)
    first = []
    for name in [*dict.fromkeys(map(label, rows)), *["all"] * (by == ["song"])]:
        mine, curve = ([entry for entry in table if name in (label(entry), "all")] for table in (rows, course))
        simulation = by_training(mine, "sim_f1")
        cells = [name]
        for steps in options.after:
            cells.append(f"{mean(by_training([entry for entry in curve if int(entry['step']) == steps], 'f1')):.3f}")
        cells.append(f"{mean(simulation):.3f}")
        if "sim_onset_f1" in rows[0]:
            cells.append(f"{mean(by_training(mine, 'sim_onset_f1')):.3f}")
        if is_long:
            cells += [notes(curve, best), f"{mean(last_five(curve, 'f1')):.3f}", notes(curve, last_five)]
        scores = [simulation]
        for twin in twins:
            there = [entry for entry in mine if entry["twin_params"] == twin]
            scores.append(by_training(there, "f1"))
            f1 = mean(scores[-1])
            cells += [f"{f1:.3f}", f"{100 * (1 - f1 / mean(by_training(there, 'sim_f1'))):.1f} %"]
            cells += [f"{mean(by_training(there, onset)):.3f}"] if onset else []
            cells += [notes(there, by_training)] if has_notes else []
        if compared:
            cells += [difference(*pair) for pair in zip(scores, first)] or [""] * len(scores)
            first = first or scores
        row(*cells)


@command(
    "course",
    argument("rows", type=pathlib.Path, help="folder with course.csv"),
    argument("--rule", default="articulated plan", help="by which F1 is counted, for the heading"),
    argument("--between", type=int, nargs=2, required=True, metavar="STEPS", help="the first and the last evaluation"),
)
def course(options):
    """How F1 rises: the mean of the evaluations between two numbers of steps, by variant.

    Differences are from the first variant, paired by song and seed. The last column is the share of
    the control steps with a collision.
    """
    low, high = options.between
    curves = collections.defaultdict(list)
    for entry in read(options.rows / "course.csv"):
        curves[entry["variant"]].append(entry)
    between = f"from {low:,} to {high:,} steps"
    head("variant", f"F1 ({options.rule}) {between}", f"difference of F1 {between}", "last five: steps with a collision")
    first = None
    for variant, curve in curves.items():
        f1 = by_training([entry for entry in curve if low <= int(entry["step"]) <= high], "f1")
        collided = 100 * (1 - mean(last_five(curve, "collision_free")))
        row(variant, f"{mean(f1):.3f}", difference(f1, first) if first else "", f"{collided:.2f} %")
        first = first or f1
