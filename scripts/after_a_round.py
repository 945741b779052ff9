"""Does an experiment of the paper before and after one round of identification on the twin, and prints the table of docs/results/experiments.md: means
over songs and seeds of the paper's F1 on the twin, its gap, precision, recall, onset F1, and notes right of those due.

Each policy is learned as in the experiment, plays on the twin, and is trained further in the simulator that was fitted to it. The drives are fitted
once for each truth and seed, by the first song. A variant with several modes is rehearsed in the last one, and the same policies play in the others.
What is done is not done again, but for rehearsals in which the twin stopped itself. The rows of other machines stay in the file of rows.

    make build && python3 scripts/after_a_round.py modes --seeds 0 1 2 -o runs/after --rows docs/results/experiments/modes/after-a-round.csv
"""

import argparse
import csv
import itertools
import json
import os
import pathlib
import random
import statistics
import subprocess
import tomllib

ROOT = pathlib.Path(__file__).resolve().parent.parent
ETUDE = os.environ.get("ETUDE", ROOT / "target" / "release" / "etude")
LABELS = ["variant", "mode", "truth", "song", "seed", "round"]
VALUES = ["sim_f1", "f1", "gap", "precision", "recall", "onset_f1", "notes_right", "notes_due", "notes_wrong", "lead_secs"]


def etude(*arguments):
    print("etude", *arguments, flush=True)
    done = subprocess.run([ETUDE, *map(str, arguments)], cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    if done.returncode != 0:
        # A twin that stops itself ends a rehearsal; the others are done all the same.
        print(f"  {(done.stderr.strip().splitlines() or ['ended without a message'])[-1]}", flush=True)


def variants(experiment, intensities):
    """Name, settings and modes of each variant; of a grid each value."""
    grid = experiment.get("grid", {})
    cells = [list(zip(grid, values)) for values in itertools.product(*grid.values())]
    for variant in experiment.get("variants", [{}]):
        for cell in cells:
            if intensities and cell and cell[0][1] not in intensities:
                continue
            name = ([variant["name"]] if "name" in variant else []) + [f"{path.rsplit('.')[-1]} {value:g}" for path, value in cell]
            # As in the experiment's file, a setting at its default makes no other training.
            settings = variant.get("set", []) + [f"{path}={value}" for path, value in cell if value != 0]
            yield ", ".join(name), settings, variant.get("modes", experiment["perform"]["modes"])


def slug(text):
    return "".join(c if c.isalnum() or c in "-._" else "-" for c in text)


class Trial:
    """A song, a variant and a seed in their folder."""

    def __init__(self, out, experiment, settings, song, seed, steps):
        self.preset, self.song, self.seed = experiment.get("preset", "fast"), song, seed
        self.settings = experiment.get("set", []) + settings
        self.folder = out / slug("-".join([self.preset, *self.settings])) / str(seed) / song
        self.drives = out / slug(self.preset) / "drives" / str(seed)
        self.runs = experiment["perform"]["runs"]
        self.steps = steps

    def configured(self, more=()):
        settings = [*self.settings, "trainer.threads=1", f"trainer.seed={self.seed}", *more]
        return ["--preset", self.preset, *(word for setting in settings for word in ("--set", setting))]

    def report(self, truth, mode, rehearsed, number):
        """The report of the performances before (0) or after (1) the round."""
        if mode == rehearsed:
            return self.folder / f"{truth}-{mode}" / f"round-{number}" / "performance" / "report.json"
        return self.folder / f"{truth}-{mode}-{number}" / "report.json"

    def train(self):
        folder = self.folder / "training"
        if (folder / "checkpoints/last.safetensors").is_file():
            # A training that is complete ends at once.
            etude("train", "--resume", folder)
        else:
            etude("train", self.song, *self.configured(), "-o", folder)

    def rehearse(self, truth, mode):
        report = self.report(truth, mode, mode, 1)
        if report.is_file():
            done = tomllib.loads((report.parents[1] / "training/config.toml").read_text())["trainer"]["total_steps"]
            if self.steps and done != self.steps:
                raise SystemExit(f"{report.parents[2]} has a round of {done} steps: name another folder with -o")
            return
        folder, drives = self.folder / f"{truth}-{mode}", self.drives / f"{truth}.toml"
        configured = self.configured([f"trainer.total_steps={self.steps}"] if self.steps else [])
        fitted = ["--simulator", drives] if drives.is_file() else []
        etude(
            "rehearse", self.song, *configured, "--robot", "twin", "--truth", truth, "--mode", mode, "--rounds", 1, "--runs", self.runs,
            "--policy", self.folder / "training", *fitted, "-o", folder,
        )
        if not fitted and (folder / "round-1/identified/identified.toml").is_file():
            drives.parent.mkdir(parents=True, exist_ok=True)
            drives.write_bytes((folder / "round-1/identified/identified.toml").read_bytes())

    def perform(self, truth, mode, rehearsed):
        policies = [self.folder / "training", self.folder / f"{truth}-{rehearsed}" / "round-1" / "training"]
        for number, policy in enumerate(policies):
            report = self.report(truth, mode, rehearsed, number)
            if not report.is_file():
                performance = ["--robot", "twin", "--truth", truth, "--mode", mode, "--runs", self.runs, "--policy", policy]
                etude("perform", self.song, *performance, "-o", report.parent)


def values(report):
    """Means over the runs."""
    runs = report["runs"]
    means = {key: statistics.mean(run[key] for run in runs) for key in ("precision", "recall")}
    found = {"sim_f1": report["sim_f1"], "f1": report["robot_f1"], "gap": report["gap"], **means}
    found |= {key: report[key] for key in ("onset_f1", "notes_right", "notes_due", "notes_wrong", "lead_secs")}
    return {key: f"{found[key]:.6g}" for key in VALUES}


def cell(row):
    """Which performances, before and after the round."""
    return tuple(row[key] for key in LABELS[:5])


def mean(rows, key):
    return statistics.mean(float(row[key]) for row in rows)


def mean_of_songs(rows, key):
    """Each song counts once, also where it has fewer seeds than the others."""
    return statistics.mean(mean([row for row in rows if row["song"] == song], key) for song in dict.fromkeys(row["song"] for row in rows))


def rise(before, after, songs):
    """The mean rise of F1 and, of several seeds, its 95 % bootstrap interval, drawn within each song."""
    of = {cell(row): float(row["f1"]) for row in before}
    rises = {song: [] for song in songs}
    for row in after:
        rises[row["song"]].append(float(row["f1"]) - of[cell(row)])
    text = f"{statistics.mean(map(statistics.mean, rises.values())):+.3f}"
    if min(map(len, rises.values())) > 1:
        draw = random.Random(0)
        means = sorted(
            statistics.mean(statistics.mean(draw.choices(group, k=len(group))) for group in rises.values()) for _ in range(10_000)
        )
        text += f" [{means[250]:+.3f}, {means[9749]:+.3f}]"
    return text


def table(rows, labels):
    # Where the twin stopped itself there is nothing to compare.
    before, after = ({cell(row) for row in rows if row["round"] == number} for number in "01")
    rows = [row for row in rows if cell(row) in before & after]
    print(f"| {', '.join(labels)} | seeds | | F1 simulation | F1 twin | gap | precision, recall | onset F1 | notes right, wrong |")
    print("|---|---|---|---|---|---|---|---|---|")
    for group in dict.fromkeys(tuple(row[key] for key in labels) for row in rows):
        of_group = [row for row in rows if tuple(row[key] for key in labels) == group]
        songs = list(dict.fromkeys(row["song"] for row in of_group))
        both = [[row for row in of_group if row["round"] == number] for number in "01"]
        seeds = len({row["seed"] for row in of_group})
        for name, part in zip(["before", "after"], both):
            if part:
                right, due, wrong = (len(songs) * mean_of_songs(part, key) for key in ("notes_right", "notes_due", "notes_wrong"))
                sim_f1, twin_f1, precision, recall, onset_f1 = (
                    mean_of_songs(part, key) for key in ("sim_f1", "f1", "precision", "recall", "onset_f1")
                )
                f1 = f"{twin_f1:.3f}"
                if name == "after":
                    f1 += f" ({rise(*both, songs)})"
                gap = 1 - twin_f1 / sim_f1
                print(
                    f"| {', '.join(group)} | {seeds} | {name} | {sim_f1:.3f} | {f1} | {100 * gap:.1f} % | {precision:.3f}, {recall:.3f} "
                    f"| {onset_f1:.3f} | {right:.1f} of {due:.0f}, {wrong:.1f} |"
                )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("experiment", help="a name in configs/experiments")
    parser.add_argument("--seeds", nargs="*", type=int, default=[0, 1, 2], help="none: only tables of the file of rows")
    parser.add_argument("--truths", nargs="*", help="instead of those of the experiment")
    parser.add_argument("--intensities", nargs="*", type=float, help="of a grid, only these values")
    of_steps = "of the training of the round, instead of those of the experiment; the file of rows should have no others"
    parser.add_argument("--steps", type=int, help=of_steps)
    parser.add_argument("--by-song", action="store_true", help="the table has a row for each song")
    parser.add_argument("-o", "--out", type=pathlib.Path, default=pathlib.Path("runs/after"))
    parser.add_argument("--rows", type=pathlib.Path, required=True, help="the file of rows, which is extended")
    options = parser.parse_args()
    experiment = tomllib.loads((ROOT / "configs/experiments" / f"{options.experiment}.toml").read_text())
    truths = options.truths or experiment["perform"]["truths"]
    rows = {}
    for seed in options.seeds:
        for truth in truths:
            for song in experiment["songs"]:
                for name, settings, modes in variants(experiment, options.intensities):
                    trial, rehearsed = Trial(options.out, experiment, settings, song, seed, options.steps), modes[-1]
                    trial.train()
                    trial.rehearse(truth, rehearsed)
                    for mode in modes:
                        if mode != rehearsed:
                            trial.perform(truth, mode, rehearsed)
                        for number in range(2):
                            path = trial.report(truth, mode, rehearsed, number)
                            report = json.loads(path.read_text()) if path.is_file() else {"runs": []}
                            if not report["runs"]:
                                continue
                            labels = dict(zip(LABELS, [name, mode, truth, song, str(seed), str(number)]))
                            rows[tuple(labels.values())] = labels | values(report)
    # Read late, since another process may have written its seeds meanwhile.
    if options.rows.is_file():
        with options.rows.open(newline="") as file:
            rows = {tuple(row[key] for key in LABELS): row for row in csv.DictReader(file)} | rows
    ordered = [rows[key] for key in sorted(rows)]
    with options.rows.open("w", newline="") as file:
        writer = csv.DictWriter(file, [*LABELS, *VALUES], lineterminator="\n")
        writer.writeheader()
        writer.writerows(ordered)
    table(ordered, LABELS[: 4 if options.by_song else 3])


if __name__ == "__main__":
    main()
