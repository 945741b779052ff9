"""Learning on the robot itself, tried on the twin."""

import itertools
import pathlib
import tempfile

from tables.common import (
    MEASURE, PAPER_SONGS, ROWS, TWIN_PARAMS, argument, command, etude, groups, head, mean_of, right_of_due, row,
    rows_of, runs,
)

NOTES = ["notes_right", "notes_due", "notes_wrong", "onset_f1"]
REAL, BEFORE, ADAPTED = "real execution", "joint mirroring, before", "joint mirroring, adapted"
SET_POINTS_A_STEP = 13 * 10


def performances(twin_params, song, options, steps):
    """Rows of a song: real execution, and joint mirroring before and after the adaptation."""
    with tempfile.TemporaryDirectory() as folder:
        report = etude(
            "rehearse", song, "--robot", "twin", "--twin-params", twin_params,
            "--policy", f"policies/{song}.safetensors", "--iterations", 0, "--runs", options.runs,
            "--adapt", options.minutes, "--seed", options.seed, "-o", pathlib.Path(folder) / "rehearsal",
        )
    first, adapted = report["iterations"][0], report["adapted"]
    # The first run measures how late the notes are.
    before, best = adapted["adapting"][1], adapted["adapting"][adapted["best"]]
    clamped = best["clamped"] / (SET_POINTS_A_STEP * steps)
    for what, entry, f1, count, share in [
        (REAL, first, first["robot_f1"], options.runs, ""),
        (BEFORE, before, before["robot_f1"], 1, ""),
        (ADAPTED, adapted, adapted["robot_f1"], options.runs, clamped),
    ]:
        labels = {"twin_params": twin_params, "song": song, "seed": options.seed, "what": what, "runs": count}
        yield labels | {key: entry[key] for key in NOTES} | {"f1": f1, "adapting_runs": len(adapted["adapting"]), "clamped": share}


@command(
    "adapt",
    ROWS,
    MEASURE,
    TWIN_PARAMS,
    argument("--songs", nargs="+", default=[*PAPER_SONGS, "d-major-scale", "chord-progression"]),
    argument("--minutes", type=float, default=10),
    runs(4),
    argument("--seed", type=int, default=0, help="of the twin's noise"),
    argument("--by-song", action="store_true", help="each song apart"),
)
def adapt(options):
    """Adapts the playing of songs to twins, without a fit and without a training."""
    every = itertools.product(options.twin_params, options.songs)

    def measured():
        steps = {song["id"]: song["frames"] for song in etude("songs")}
        for twin_params, song in every:
            yield from performances(twin_params, song, options, steps[song])

    rows = rows_of(options, measured)
    head("twin parameters", "songs", "how they were played", "notes right, wrong", "onset F1", "F1 (articulated plan)")
    for twin_params, of_set in groups(rows, "twin_params").items():
        five = [entry for entry in of_set if entry["song"] in PAPER_SONGS]
        sums = [("the paper's five", five), ("all seven", of_set)]
        for name, entries in groups(of_set, "song").items() if options.by_song else sums:
            for what, some in groups(entries, "what").items():
                scores = (f"{mean_of(some, key):.3f}" for key in ("onset_f1", "f1"))
                row(f"`{twin_params}`", name, what, right_of_due(some), *scores)
