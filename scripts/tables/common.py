"""What the tables share: the list of subcommands, the `etude` command, Markdown."""

import contextlib
import csv
import json
import os
import pathlib
import statistics
import subprocess
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
ETUDE = pathlib.Path(os.environ.get("ETUDE", ROOT / "target" / "release" / "etude"))
MODES = ["joint-mirroring", "hybrid", "real"]
# The five songs that the paper reports.
PAPER_SONGS = ["are-you-sleeping", "happy-birthday", "ode-to-joy", "twinkle", "c-major-scale"]
# Function and arguments of each subcommand, by name.
COMMANDS = {}


class Stopped(Exception):
    """`etude` has failed; the message is the last line that it wrote."""


def argument(*names, **settings):
    """As for `add_argument` of argparse."""
    return names, settings


def command(name, *arguments):
    """Makes a subcommand of a function, whose docstring is the help."""

    def register(function):
        COMMANDS[name] = function, arguments
        return function

    return register


SCRIPTED = argument("--scripted", action="store_true", help="the scripted baseline plays, not the shipped policies")
TWIN_PARAMS = argument("--twin-params", nargs="+", default=["standard", "worn"])
ROWS = argument("rows", type=pathlib.Path, help="CSV file")
MEASURE = argument("--measure", action="store_true", help="first measure the rows and write the file")


def runs(default):
    return argument("--runs", type=int, default=default, help="performances of each song")


def say(*arguments):
    """What `etude` writes to standard output."""
    words = [ETUDE, *map(str, arguments)]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True)
    if done.returncode:
        raise Stopped((done.stderr.strip().splitlines() or ["it stopped without a message"])[-1])
    return done.stdout


def etude(*arguments):
    """The JSON that `etude … --json` writes."""
    return json.loads(say(*arguments, "--json"))


def songs():
    """The ids of the built-in songs."""
    return [song["id"] for song in etude("songs")]


def policy(song):
    return ["--policy", f"policies/{song}.safetensors"]


@contextlib.contextmanager
def played(song, *who):
    """The report of a performance in simulation, and the folder of its files."""
    with tempfile.TemporaryDirectory() as folder:
        report = etude("play", song, *who, "-o", folder)
        yield report, pathlib.Path(folder) / "latest"


@contextlib.contextmanager
def performed(song, mode, twin_params, runs, run=None):
    """The report of performances on the twin, whose recordings are there while the block lasts.

    The shipped policy plays, or that of a training's folder `run`.
    """
    with tempfile.TemporaryDirectory() as folder:
        twin = ["--robot", "twin", "--twin-params", twin_params]
        player = ["--policy", run] if run else policy(song)
        yield etude("perform", song, "--mode", mode, *twin, *player, "--runs", runs, "-o", folder)


def melodies(part, count, folder):
    """MIDI files of the first melodies of a part, written into `folder`."""
    seed = 0
    for number in range(count):
        path = folder / f"{part}-{number}.mid"
        seed = etude("songs", "make", "--part", part, "--seed", seed, "-o", path)["seed"] + 1
        yield path


def read(path):
    """The rows of a CSV file; all values are text."""
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def number(value):
    """Six digits are more than any table shows."""
    return f"{value:.6g}" if isinstance(value, float) else value


def write(path, rows):
    """Rows with the same columns."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0], lineterminator="\n")
        writer.writeheader()
        writer.writerows({key: number(value) for key, value in row.items()} for row in rows)


def rows_of(options, measured):
    """The rows of `options.rows`, which with --measure are first those of `measured()`."""
    if options.measure:
        write(options.rows, list(measured()))
    return read(options.rows)


def mean_of(rows, key):
    return statistics.mean(float(row[key]) for row in rows)


def sum_of(rows, key):
    return sum(float(row[key]) for row in rows)


def groups(rows, key):
    """Rows by the value of a column, in the order of the file."""
    found = {}
    for entry in rows:
        found.setdefault(entry[key], []).append(entry)
    return found


def right_of_due(rows):
    """Notes right of those due, and wrong ones, summed over rows."""
    right, due, wrong = (sum_of(rows, f"notes_{key}") for key in ("right", "due", "wrong"))
    return f"{right:g} of {due:g}, {wrong:g}"


def head(*cells):
    """Prints the head of a table."""
    row(*cells)
    print("|" + "---|" * len(cells), flush=True)


def row(*cells):
    """Prints a row of a table."""
    print("| " + " | ".join(map(str, cells)) + " |", flush=True)


def notes(entry):
    """Notes right of those due, and wrong ones."""
    return f"{entry['notes_right']:g} of {entry['notes_due']:g}, {entry['notes_wrong']:g}"


def mean(values):
    return f"{statistics.mean(values):.3f}"
