"""Adapts the playing of songs to twins and prints tables of docs/results/adaptation.md: notes right of those due and wrong ones, onset F1, the
paper's F1; before (in real execution with the measured lead, no identification), and in joint mirroring, or in hybrid, before and after the adaptation.

    make build && python3 scripts/adapt_table.py [--songs twinkle,c-major-scale] [--truths standard,random:1-20] [--mode hybrid] [--minutes 10] [--keep DIR]
"""

import argparse
import json
import pathlib
import shutil
import subprocess
import tempfile

ROOT = pathlib.Path(__file__).resolve().parent.parent
ETUDE = ROOT / "target" / "release" / "etude"
# 50 MB a minute.
RECORDINGS = shutil.ignore_patterns("*.mcap")
PAPER = "are-you-sleeping,happy-birthday,ode-to-joy,twinkle,c-major-scale"


def rehearse(etude, song, truth, mode, minutes, runs, seed, folder):
    """The JSON of a rehearsal without rounds that adapts."""
    arguments = ["rehearse", song, "--robot", "twin", "--truth", truth, "--policy", f"policies/{song}.safetensors", "--rounds", "0", "--mode", mode]
    arguments += ["--runs", str(runs), "--adapt", str(minutes), "--seed", str(seed), "--json", "-o", folder]
    done = subprocess.run([etude, *arguments], cwd=ROOT, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError((done.stderr.strip().splitlines() or ["stopped"])[-1])
    return json.loads(done.stdout)


def truths(names):
    """The truths of a list of names; `random:1-20` stands for twenty."""
    for name in names.split(","):
        first, _, last = name.removeprefix("random:").partition("-")
        yield from (f"random:{seed}" for seed in range(int(first), int(last) + 1)) if last else [name]


def cell(notes, f1):
    return f"{notes['notes_right']:g} of {notes['notes_due']}, {notes['notes_wrong']:g}; {notes['onset_f1']:.3f}; {f1:.3f}"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--songs", default=PAPER)
    parser.add_argument("--truths", default="standard,worn")
    parser.add_argument("--mode", default="real", choices=["real", "joint-mirroring", "hybrid"], help="of the round before; after one in real the adaptation is in joint mirroring")
    parser.add_argument("--minutes", type=float, default=10)
    parser.add_argument("--runs", type=int, default=4)
    parser.add_argument("--seed", type=int, default=0, help="of the twin's noise")
    parser.add_argument("--etude", default=ETUDE)
    parser.add_argument("--keep", type=pathlib.Path, help="where the folders of the rehearsals go, without recordings; they are removed if not given")
    options = parser.parse_args()
    ways = "real execution | joint mirroring, before" if options.mode == "real" else f"{options.mode} | {options.mode}, run 2"
    print(f"| truth | song | {ways} | adapted | runs, best | fingers off their path, rail | clamped |")
    print("|---|---|---|---|---|---|---|---|")
    means = {}
    for truth in truths(options.truths):
        for song in options.songs.split(","):
            with tempfile.TemporaryDirectory() as temporary:
                folder = pathlib.Path(temporary) / "rehearsal"
                try:
                    report = rehearse(options.etude, song, truth, options.mode, options.minutes, options.runs, options.seed, folder)
                except RuntimeError as error:
                    print(f"| `{truth}` | {song} | {error} |", flush=True)
                    continue
                if options.keep:
                    shutil.copytree(folder, options.keep / f"{truth}-{song}", dirs_exist_ok=True, ignore=RECORDINGS)
            real, adapted = report["rounds"][0], report["adapted"]
            before, best = adapted["adapting"][1], adapted["adapting"][adapted["best"]]
            set_points_a_step = 13 * 10
            share = best["clamped"] / (set_points_a_step * steps(options.etude, song))
            print(
                f"| `{truth}` | {song} | {cell(real, real['robot_f1'])} | {cell(before, before['f1'])} | {cell(adapted, adapted['robot_f1'])} "
                f"| {len(adapted['adapting'])}, {adapted['best'] + 1} | {1e3 * before['fingers_missed_rad']:.0f} → "
                f"{1e3 * best['fingers_missed_rad']:.0f} mrad, {1e3 * before['rail_missed_m']:.1f} → {1e3 * best['rail_missed_m']:.1f} mm "
                f"| {100 * share:.1f} % |",
                flush=True,
            )
            three = [(real, real["robot_f1"]), (before, before["f1"]), (adapted, adapted["robot_f1"])]
            # What `rehearse` names at the end: the round, unless the adaptation is better by the mean of F1 and onset F1.
            better = max(three[0], three[2], key=lambda played: played[0]["onset_f1"] + played[1])
            # All that are drawn have one row.
            means.setdefault(truth.partition(":")[0], []).append([*three, better])
    print(f"\n| truth | {ways} | adapted | the better of the first and adapted |")
    print("|---|---|---|---|---|")
    for truth, rows in means.items():
        cells = []
        for column in range(4):
            notes = [row[column] for row in rows]
            total = lambda key: sum(scores[key] for scores, _ in notes)
            onset = sum(scores["onset_f1"] for scores, _ in notes) / len(notes)
            f1 = sum(f1 for _, f1 in notes) / len(notes)
            cells.append(f"{total('notes_right'):g} of {total('notes_due')}, {total('notes_wrong'):g}; {onset:.3f}; {f1:.3f}")
        print(f"| `{truth}` | " + " | ".join(cells) + " |")


def steps(etude, song):
    """Control steps of the song."""
    songs = json.loads(subprocess.run([etude, "songs", "--json"], cwd=ROOT, check=True, capture_output=True, text=True).stdout)
    return next(entry["frames"] for entry in songs if entry["id"] == song)


if __name__ == "__main__":
    main()
