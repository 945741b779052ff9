"""How well the simulator is fitted to the twin: its keyboard and its drives."""

import pathlib
import statistics
import tempfile
import tomllib

from tables.common import MEASURE, ROOT, ROWS, argument, command, etude, groups, head, row, rows_of, say

# Fingers press this far from a key's hinge, as a share of its travel, m.
PRESSED_AT_M = 0.0069
EXCITATIONS = ["open-close", "chirp", "rail", "keys", "held-out"]


def implied_keyboard(params):
    """Value by path. Depths count from the bottom: a simulated key has the nominal travel."""
    physics, keys = params.get("physics", {}), params.get("keys", {})
    travel = keys.get("travel", 1.0)
    sounds = 1.0 - travel * (1.0 - physics.get("key.threshold", 0.5))
    silent = 1.0 - travel * (1.0 - keys.get("first_contact", 0.3))
    rows = {"key.threshold": sounds, "key.hysteresis": 1.0 - silent / sounds}
    zero = ["key.preload", "keyboard.height", "keyboard.lateral", "keyboard.depth"]
    rows["key.stiffness"] = physics.get("key.stiffness", 1.0)
    rows |= {path: physics.get(path, 0.0) for path in zero}
    # Longer travel looks like a lower keyboard.
    rows["keyboard.height"] -= (travel - 1.0) * PRESSED_AT_M
    return rows


def recordings(twin_params, excitations, folder):
    """Recordings of the twin, one an excitation."""
    for excitation in excitations:
        path = folder / f"{excitation}.mcap"
        say("record", "--robot", "twin", "--twin-params", twin_params, "--excitation", excitation, "-o", path)
        yield path


def sets(*names):
    return argument("--twin-params", nargs="+", default=names, help="to measure")


@command("presses", ROWS, MEASURE, sets("ideal", "mild", "standard", "worn"))
def presses(options):
    """What the excitation `keys` measures of the keyboard (95 %), and what the twin's parameters imply.

    Lengths are in mm.
    """

    def measured():
        for name in options.twin_params:
            implied = implied_keyboard(tomllib.loads((ROOT / f"configs/twin-params/{name}.toml").read_text()))
            with tempfile.TemporaryDirectory() as folder:
                folder = pathlib.Path(folder)
                recorded = recordings(name, ["keys"], folder)
                found = etude("identify", *recorded, "-o", folder / "identified")["identified"]["measured"]
            for measure in (measure for measure in found if measure["path"] in implied):
                low, high = measure["interval"]
                labels = {"twin_params": name, "seed": 0, "path": measure["path"]}
                yield labels | {"value": measure["value"], "low": low, "high": high, "twin": implied[measure["path"]]}

    rows = rows_of(options, measured)
    head("parameter", *(f"`{name}`" for name in groups(rows, "twin_params")))
    for path, of_path in sorted(groups(rows, "path").items()):
        scale = 1e3 if path.startswith("keyboard.") else 1.0
        cells = ((scale * float(entry[key]) for key in ("value", "low", "high", "twin")) for entry in of_path)
        row(f"`{path}`", *("{:.2f} ({:.2f} … {:.2f}); {:.2f}".format(*cell) for cell in cells))


@command("drives", ROWS, MEASURE, sets("standard", "worn"))
def drives(options):
    """How far the joints of the simulator are from the twin's in motion that was not fitted.

    Root mean squares before and after the fit of the other excitations.
    """

    def measured():
        for name in options.twin_params:
            with tempfile.TemporaryDirectory() as folder:
                folder = pathlib.Path(folder)
                report = etude("identify", *recordings(name, EXCITATIONS, folder), "-o", folder / "identified")
            errors = report["held_out_errors"]
            before, after = errors["fingers"]
            fingers = {"joint": "fingers", "noise": errors["fingers_noise"], "before": before, "after": after}
            for joint in [fingers, *errors["joints"]]:
                yield {"twin_params": name, "seed": report["seed"], "method": report["method"]} | joint

    rows = rows_of(options, measured)
    head("twin parameters", *(f"{joint}: noise, before, after" for joint in ("fingers (mrad)", "rail (mm)")))
    for twin_params, of_set in groups(rows, "twin_params").items():
        joints = {entry["joint"]: [1e3 * float(entry[key]) for key in ("noise", "before", "after")] for entry in of_set}
        row(f"`{twin_params}`", *("{:.1f}, {:.1f}, {:.1f}".format(*joints[joint]) for joint in ("fingers", "rail")))


FRESH = [f"random:{seed}" for seed in range(101, 106)]


@command(
    "predictions",
    ROWS,
    MEASURE,
    sets(*FRESH),
    argument("--songs", nargs="+", default=["twinkle", "c-major-scale"], help="to measure"),
)
def predictions(options):
    """F1 of the songs' shipped policies as predicted before and after a fit, and as played.

    The fit is that of `etude rehearse`; its training is as short as may be, and does not count.
    """

    def measured():
        for twin_params in options.twin_params:
            with tempfile.TemporaryDirectory() as folder:
                drives = []
                for song in options.songs:
                    out = pathlib.Path(folder) / song
                    rehearsal = ["--twin-params", twin_params, "--iterations", 1, "--runs", 1, *drives, "-o", out]
                    _, after = etude("rehearse", song, *rehearsal, "--set", "trainer.total_steps=5000")
                    drives = drives or ["--simulator", out / "iteration-1/identified/identified.toml"]
                    yield {"twin_params": twin_params, "song": song, "seed": 0} | after["prediction"]

    rows = rows_of(options, measured)
    head("twin parameters", "song", "F1 (articulated plan), predicted before the fit", "after it", "played")
    for entry in rows:
        f1 = (f"{float(entry[key]):.3f}" for key in ("before_fit_f1", "after_fit_f1", "played_f1"))
        row(f"`{entry['twin_params']}`", entry["song"], *f1)
    off = {key: [abs(float(entry[key]) - float(entry["played_f1"])) for entry in rows] for key in rows[0] if "fit" in key}
    row("mean, largest difference", "", *(f"{statistics.mean(of):.3f}, {max(of):.3f}" for of in off.values()), "")
