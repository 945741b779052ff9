"""Sim2Real2Sim on the twin: rehearsals, adaptation, experiments after one iteration."""

import collections
import csv
import itertools
import json
import pathlib
import random
import statistics
import tempfile
import tomllib

from tables.common import ROOT, TWIN_PARAMS, Stopped, argument, command, etude, head, mean, notes, row, runs, say

NOTES = ("notes_right", "notes_due", "notes_wrong")


def total(entries):
    return {key: sum(entry[key] for entry in entries) for key in NOTES}


def value(entry):
    """What `rehearse` chooses by."""
    return entry["robot_f1"] + entry["onset_f1"]


def read_rehearsal(folder):
    """Twin parameters and song, each iteration, and what was adapted, if anything."""
    config = json.loads((folder / "rehearsal.json").read_text())
    files = folder.glob("iteration-*/iteration.json")
    files = sorted(files, key=lambda file: int(file.parent.name.removeprefix("iteration-")))
    iterations = [json.loads(file.read_text()) for file in files]
    result = folder / "adaptation/result.json"
    adapted = json.loads(result.read_text()) if result.is_file() else None
    return (config["twin_params"] or config["rig"], config["song"]), iterations, adapted


def natural(rehearsal):
    name, _, seed = rehearsal[0][0].partition(":")
    return name, int(seed or 0), rehearsal[0][1]


def summary_row(name, where, entries):
    (twin_params, song), worst = min(zip(where, entries), key=lambda one: one[1]["robot_f1"])
    scores = (mean(entry[key] for entry in entries) for key in ("onset_f1", "robot_f1"))
    row(name, notes(total(entries)), *scores, f"{worst['robot_f1']:.3f} ({song} on `{twin_params}`)")


@command("iterations", argument("folders", type=pathlib.Path, nargs="+", help="of `etude rehearse … -o FOLDER`"))
def iterations(options):
    """Rehearsals on the twin, before and after each iteration, and with the best iteration kept.

    Notes right of those due and wrong ones, onset F1, F1 in simulation and on the twin.
    """
    rehearsals = sorted(map(read_rehearsal, options.folders), key=natural)
    where, each, adapted = zip(*rehearsals)
    kept = [max(entries, key=value) for entries in each]
    names = ["nothing fitted", "after one iteration", "after two iterations"][: min(map(len, each))]
    columns = [*zip(*(entries[: len(names)] for entries in each)), kept]
    head("rehearsals", "notes right, wrong", "onset F1", "F1 (articulated plan), twin", "worst F1")
    for name, column in zip([*names, "the best of these"], columns):
        summary_row(name, where, column)
    if all(adapted):
        summary_row("adapted, without an iteration", where, adapted)
        summary_row("at the end", where, [max(pair, key=value) for pair in zip(kept, adapted)])
    cell = lambda entry: f"{notes(entry)}; {entry['onset_f1']:.3f}; {entry['sim_f1']:.3f}, {entry['robot_f1']:.3f}"
    print()
    head("twin parameters", "song", *names, "kept")
    for (twin_params, song), entries, best in zip(where, each, kept):
        row(f"`{twin_params}`", song, *map(cell, entries[: len(names)]), best["iteration"])
    means = [
        total(column) | {key: statistics.mean(entry[key] for entry in column) for key in ("onset_f1", "sim_f1", "robot_f1")}
        for column in columns
    ]
    row(f"**sum; mean of {len(rehearsals)}**", "", *(f"**{cell(entry)}**" for entry in means))
    row("worst F1", "", *(f"{min(entry['robot_f1'] for entry in column):.3f}" for column in columns))


PAPER = ["are-you-sleeping", "happy-birthday", "ode-to-joy", "twinkle", "c-major-scale"]
SET_POINTS_A_STEP = 13 * 10


def names_of(twin_params):
    """`random:1-20` stands for twenty sets."""
    for name in twin_params:
        first, _, last = name.removeprefix("random:").partition("-")
        yield from (f"random:{seed}" for seed in range(int(first), int(last) + 1)) if last else [name]


def short(entry, f1):
    return f"{notes(entry)}; {entry['onset_f1']:.3f}; {f1:.3f}"


@command(
    "adapt",
    argument("--songs", nargs="+", default=PAPER),
    TWIN_PARAMS,
    argument("--mode", default="real", choices=["real", "joint-mirroring", "hybrid"], help="before the adaptation"),
    argument("--minutes", type=float, default=10),
    runs(4),
    argument("--seed", type=int, default=0, help="of the twin's noise"),
)
def adapt(options):
    """Adapts the playing of songs to twins.

    Columns: before, and in joint mirroring (or hybrid) before and after.

    A cell has the notes right of those due and the wrong ones, onset F1, and F1.
    """
    real = options.mode == "real"
    modes = ["real execution", "joint mirroring, before"] if real else [options.mode, f"{options.mode}, run 2"]
    head("twin parameters", "song", *modes, "adapted", "runs, best", "fingers off their path, rail", "clamped")
    steps = {song["id"]: song["frames"] for song in etude("songs")}
    played = collections.defaultdict(list)
    for twin_params, song in itertools.product(names_of(options.twin_params), options.songs):
        with tempfile.TemporaryDirectory() as folder:
            try:
                report = etude(
                    "rehearse", song, "--robot", "twin", "--twin-params", twin_params, "--mode", options.mode,
                    "--policy", f"policies/{song}.safetensors", "--iterations", 0, "--runs", options.runs,
                    "--adapt", options.minutes, "--seed", options.seed, "-o", pathlib.Path(folder) / "rehearsal",
                )
            except Stopped as stopped:
                row(f"`{twin_params}`", song, stopped)
                continue
        first, adapted = report["iterations"][0], report["adapted"]
        before, best = adapted["adapting"][1], adapted["adapting"][adapted["best"]]
        three = [(first, first["robot_f1"]), (before, before["robot_f1"]), (adapted, adapted["robot_f1"])]
        mrad, mm = (
            f"{1e3 * before[key]:.{digits}f} → {1e3 * best[key]:.{digits}f}"
            for key, digits in (("fingers_missed_rad", 0), ("rail_missed_m", 1))
        )
        share = best["clamped"] / (SET_POINTS_A_STEP * steps[song])
        row(
            f"`{twin_params}`",
            song,
            *(short(*one) for one in three),
            f"{len(adapted['adapting'])}, {adapted['best'] + 1}",
            f"{mrad} mrad, {mm} mm",
            f"{100 * share:.1f} %",
        )
        # What `rehearse` names at the end.
        better = max(three[0], three[2], key=lambda one: one[0]["onset_f1"] + one[1])
        # All that are drawn have one row.
        played[twin_params.partition(":")[0]].append([*three, better])
    print()
    head("twin parameters", *modes, "adapted", "the better of the first and adapted")
    for twin_params, rows in played.items():
        cells = []
        for column in zip(*rows):
            entries, f1 = zip(*column)
            cells.append(f"{notes(total(entries))}; {mean(entry['onset_f1'] for entry in entries)}; {mean(f1)}")
        row(f"`{twin_params}`", *cells)


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
    rows = read_rows(options.rows).values()
    # After a safety stop there is nothing to compare.
    both = set.intersection(*({performance(row) for row in rows if row["iteration"] == number} for number in "01"))
    rows = [row for row in rows if performance(row) in both]
    labels = LABELS[: 4 if options.by_song else 3]
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
