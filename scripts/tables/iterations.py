"""Sim2Real2Sim on the twin: experiments after one iteration."""

import collections
import csv
import itertools
import json
import pathlib
import random
import statistics
import sys
import tomllib

from tables.common import ROOT, Stopped, argument, command, head, number, read, row, say

NOTES = ("notes_right", "notes_due", "notes_wrong")
LABELS = ["variant", "mode", "twin_params", "song", "seed", "iteration"]
SCORES = ["sim_f1", "f1", "gap", "precision", "recall", "onset_f1"]
VALUES = [*SCORES, *NOTES, "latency_compensation_secs"]


def go_on(*arguments):
    """Runs `etude`. A twin that stops itself ends a rehearsal; the others are done all the same."""
    print("etude", *arguments, flush=True)
    try:
        say(*arguments)
    except Stopped as stopped:
        print(f"  {stopped}", flush=True)


def variants(experiment, intensities):
    """Name, settings and modes of each variant; of a grid each value."""
    grid = experiment.get("grid", {})
    cells = [list(zip(grid, values)) for values in itertools.product(*grid.values())]
    for variant, cell in itertools.product(experiment.get("variants", [{}]), cells):
        if intensities and cell and cell[0][1] not in intensities:
            continue
        names = [f"{path.rsplit('.')[-1]} {value:g}" for path, value in cell]
        # As in the experiment's file, a setting at its default makes no other training.
        settings = variant.get("set", []) + [f"{path}={value}" for path, value in cell if value != 0]
        modes = variant.get("modes", experiment["perform"]["modes"])
        yield ", ".join([variant["name"], *names] if "name" in variant else names), settings, modes


def slug(text):
    return "".join(c if c.isalnum() or c in "-._" else "-" for c in text)


class Trial:
    """A song, a variant and a seed in their folder."""

    def __init__(self, options, experiment, settings, song, seed):
        preset = experiment.get("preset", "fast")
        self.song, self.steps, self.runs = song, options.steps, experiment["perform"]["runs"]
        settings = experiment.get("set", []) + settings
        self.folder = options.out / slug("-".join([experiment["name"], *settings])) / str(seed) / song
        self.drives = options.out / slug(experiment["name"]) / "drives" / str(seed)
        settings += ["trainer.threads=1", f"trainer.seed={seed}"]
        self.settings = ["--preset", preset, *(word for setting in settings for word in ("--set", setting))]

    def iterated(self, twin_params, mode):
        return self.folder / f"{twin_params}-{mode}"

    def report(self, twin_params, mode, rehearsed, number):
        """The report of the performances before (0) or after (1) the iteration."""
        if mode == rehearsed:
            return self.iterated(twin_params, mode) / f"iteration-{number}" / "performance" / "latest" / "report.json"
        return self.folder / f"{twin_params}-{mode}-{number}" / "latest" / "report.json"

    def train(self):
        folder = self.folder / "training"
        if (folder / "checkpoints/last.safetensors").is_file():
            # A training that is complete ends at once.
            go_on("train", "--resume", folder)
        else:
            go_on("train", self.song, *self.settings, "-o", folder)

    def rehearse(self, twin_params, mode):
        folder, drives = self.iterated(twin_params, mode), self.drives / f"{twin_params}.toml"
        if self.report(twin_params, mode, mode, 1).is_file():
            config = (folder / "iteration-1/training/config.toml").read_text()
            done = tomllib.loads(config)["trainer"]["total_steps"]
            if self.steps and done != self.steps:
                raise Stopped(f"{folder} has an iteration of {done} steps: name another folder with -o")
            return
        steps = ["--set", f"trainer.total_steps={self.steps}"] if self.steps else []
        fitted = ["--simulator", drives] if drives.is_file() else []
        go_on(
            "rehearse", self.song, *self.settings, *steps, "--robot", "twin", "--twin-params", twin_params,
            "--mode", mode, "--iterations", 1, "--runs", self.runs, "--policy", self.folder / "training", *fitted,
            "-o", folder,
        )
        found = folder / "iteration-1/identified/identified.toml"
        if not fitted and found.is_file():
            drives.parent.mkdir(parents=True, exist_ok=True)
            drives.write_bytes(found.read_bytes())

    def perform(self, twin_params, mode, rehearsed):
        policies = [self.folder / "training", self.iterated(twin_params, rehearsed) / "iteration-1" / "training"]
        for number, policy in enumerate(policies):
            report = self.report(twin_params, mode, rehearsed, number)
            if not report.is_file():
                twin = ["--robot", "twin", "--twin-params", twin_params, "--mode", mode]
                out = report.parent.parent
                go_on("perform", self.song, *twin, "--runs", self.runs, "--policy", policy, "-o", out)


def values(report):
    """Means over the runs."""
    means = {key: statistics.mean(run[key] for run in report["runs"]) for key in ("precision", "recall")}
    found = report | means | {"f1": report["robot_f1"]}
    return {key: f"{found[key]:.6g}" for key in VALUES}


def measure(options):
    """The rows of an experiment, each policy before and after one iteration, by their labels."""
    experiment = tomllib.loads((ROOT / "configs/experiments" / f"{options.measure}.toml").read_text())
    experiment["name"] = options.measure
    sets = options.twin_params or experiment["perform"]["twin_params"]
    rows = {}
    for seed, twin_params, song in itertools.product(options.seeds, sets, experiment["songs"]):
        for name, settings, modes in variants(experiment, options.intensities):
            trial, rehearsed = Trial(options, experiment, settings, song, seed), modes[-1]
            trial.train()
            trial.rehearse(twin_params, rehearsed)
            for mode in modes:
                if mode != rehearsed:
                    trial.perform(twin_params, mode, rehearsed)
                for number in range(2):
                    path = trial.report(twin_params, mode, rehearsed, number)
                    report = json.loads(path.read_text()) if path.is_file() else {"runs": []}
                    if report["runs"]:
                        labels = dict(zip(LABELS, [name, mode, twin_params, song, str(seed), str(number)]))
                        rows[tuple(labels.values())] = labels | values(report)
    return rows


def read_rows(path):
    with path.open(newline="") as file:
        return {tuple(row[key] for key in LABELS): row for row in csv.DictReader(file)}


def performance(row):
    """Which performance, before or after the iteration."""
    return tuple(row[key] for key in LABELS[:5])


def by_song(rows):
    songs = collections.defaultdict(list)
    for row in rows:
        songs[row["song"]].append(row)
    return songs


def mean_of_songs(rows, key):
    """Each song counts once, also where it has fewer seeds than the others."""
    means = (statistics.mean(float(row[key]) for row in song) for song in by_song(rows).values())
    return statistics.mean(means)


def rise(before, after):
    """The mean rise of F1 and, of several seeds, its 95 % bootstrap interval within songs."""
    f1 = {performance(row): float(row["f1"]) for row in before}
    rises = [[float(row["f1"]) - f1[performance(row)] for row in song] for song in by_song(after).values()]
    text = f"{statistics.mean(map(statistics.mean, rises)):+.3f}"
    if min(map(len, rises)) > 1:
        draw = random.Random(0)
        resampled = lambda: statistics.mean(statistics.mean(draw.choices(song, k=len(song))) for song in rises)
        means = sorted(resampled() for _ in range(10_000))
        text += f" [{means[250]:+.3f}, {means[9749]:+.3f}]"
    return text


@command(
    "after-iteration",
    argument("rows", type=pathlib.Path, help="CSV with one row a performance"),
    argument("--rule", default="RoboPianist's rule", help="by which F1 is counted, for the heading"),
    argument("--by-song", action="store_true"),
    argument("--variant", help="only this variant"),
    argument("--measure", metavar="EXPERIMENT", help="first extend ROWS: a name in configs/experiments"),
    argument("--seeds", type=int, nargs="+", default=[0, 1, 2]),
    argument("--intensities", type=float, nargs="+", help="of a grid; all if not given"),
    argument("--twin-params", nargs="+", help="those of the experiment if not given"),
    argument("--steps", type=int, help="of the iteration's training; those of the first training if not given"),
    argument("-o", "--out", type=pathlib.Path, default=pathlib.Path("runs/after-iteration")),
)
def after_iteration(options):
    """An experiment on the twin before and after one iteration of identification.

    Means over songs and seeds.

    With --measure each policy is learned as in the experiment, plays on the twin, and is trained
    further in the simulator that was fitted to it. The drives are fitted once for each parameter
    set and seed, by the first song. A variant with several modes is rehearsed in the last one, and
    the same policies play in the others. What is done is not done again, except rehearsals that a
    safety stop has ended. Other rows stay in the file.
    """
    if options.measure:
        rows = measure(options)
        # Read late, since another process may have written its seeds meanwhile.
        rows = (read_rows(options.rows) if options.rows.is_file() else {}) | rows
        with options.rows.open("w", newline="") as file:
            writer = csv.DictWriter(file, [*LABELS, *VALUES], lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows[key] for key in sorted(rows))
    rows = [row for row in read_rows(options.rows).values() if options.variant in (None, row["variant"])]
    # After a safety stop there is nothing to compare.
    both = set.intersection(*({performance(row) for row in rows if row["iteration"] == number} for number in "01"))
    rows = [row for row in rows if performance(row) in both]
    labels = LABELS[1 if options.variant else 0 : 4 if options.by_song else 3]
    columns = [f"F1 ({options.rule}), simulation", "twin", "gap", "precision, recall", "onset F1", "notes right, wrong"]
    head(", ".join(labels).replace("_", " "), "seeds", "", *columns)
    groups = collections.defaultdict(list)
    for entry in rows:
        groups[tuple(entry[key] for key in labels)].append(entry)
    for group, entries in groups.items():
        seeds = len({entry["seed"] for entry in entries})
        pair = [[entry for entry in entries if entry["iteration"] == number] for number in "01"]
        for name, part in zip(["before", "after"], pair):
            right, due, wrong = (len(by_song(part)) * mean_of_songs(part, key) for key in NOTES)
            sim_f1, f1, _, precision, recall, onset_f1 = (mean_of_songs(part, key) for key in SCORES)
            row(
                ", ".join(group),
                seeds,
                name,
                f"{sim_f1:.3f}",
                f"{f1:.3f}" + (f" ({rise(*pair)})" if name == "after" else ""),
                f"{100 * (1 - f1 / sim_f1):.1f} %",
                f"{precision:.3f}, {recall:.3f}",
                f"{onset_f1:.3f}",
                f"{right:.1f} of {due:.0f}, {wrong:.1f}",
            )


LOOP = ["notes_right", "notes_due", "notes_wrong", "sim_robopianist_f1", "robot_robopianist_f1"]
FIT = [("held_out_before", "held_out_after"), ("before_fit_f1", "after_fit_f1")]


@command("loop-rows", argument("rehearsals", nargs="+", type=pathlib.Path, help="folders of `etude rehearse`"))
def loop_rows(options):
    """The iterations of rehearsals as CSV, in the order of the folders."""
    rows = []
    for folder in options.rehearsals:
        config = json.loads((folder / "rehearsal.json").read_text())
        labels = {key: config[key] for key in ("song", "twin_params", "fit", "seed", "runs")}
        for iteration in range(config["iterations"] + 1):
            if not (file := folder / f"iteration-{iteration}" / "iteration.json").is_file():
                break
            result = json.loads(file.read_text())
            errors = result["held_out_rad"] or ["", ""]
            predicted = result["prediction"] or {}
            entry = labels | {"iteration": iteration} | {key: result[key] for key in LOOP}
            rows.append(entry | dict(zip(FIT[0], errors)) | {key: predicted.get(key, "") for key in FIT[1]})
    writer = csv.DictWriter(sys.stdout, rows[0], lineterminator="\n")
    writer.writeheader()
    writer.writerows({key: number(value) for key, value in entry.items()} for entry in rows)


@command("loop", argument("rows", type=pathlib.Path, help="CSV file of loop-rows"))
def loop(options):
    """F1 on the twin iteration by iteration, and what the fit before it was worth.

    A prediction is of the policy of the iteration before.
    """
    head(
        "twin parameters, song", "fit", "iteration", "F1 (RoboPianist's rule), simulation", "twin", "notes right, wrong",
        "held-out error before and after the fit, mrad", "unfitted", "fitted",
    )
    begun = []
    for entry in read(options.rows):
        # Before the first fit all of them are one performance.
        if entry["iteration"] == "0":
            entry["fit"] = "before"
            if entry in begun:
                continue
            begun.append(entry)
        numbers = {key: float(value) for key, value in entry.items() if key in (*LOOP, *FIT[0], *FIT[1]) and value}
        f1 = (f"{numbers[key]:.3f}" for key in LOOP[3:])
        error, guess = ([numbers.get(key) for key in keys] for keys in FIT)
        errors = "–" if None in error else "{:.1f}, {:.1f}".format(*(1e3 * value for value in error))
        guesses = ("–" if value is None else f"{value:.3f}" for value in guess)
        notes = f"{numbers['notes_right']:g} of {numbers['notes_due']:g}, {numbers['notes_wrong']:g}"
        labels = (f"`{entry['twin_params']}`, {entry['song']}", f"`{entry['fit']}`", entry["iteration"])
        row(*labels, *f1, notes, errors, *guesses)
