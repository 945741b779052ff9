"""What is measured of the twin's keyboard, beside what the twin's parameters imply."""

import pathlib
import tempfile
import tomllib

from tables.common import ROOT, argument, command, etude, head, row, say

# Fingers press this far from a key's hinge, as a share of its travel, m.
PRESSED_AT_M = 0.0069


def twin_params(name):
    """The tables of a parameter set: a name or a file."""
    path = pathlib.Path(name)
    return tomllib.loads((path if path.suffix else ROOT / f"configs/twin-params/{name}.toml").read_text())


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


@command("presses", argument("twin_params", nargs="*", default=["ideal", "mild", "standard", "worn"]))
def presses(options):
    """What the excitation `keys` measures of the keyboard (95 %), and what the twin's parameters imply.

    Lengths are in mm.
    """
    columns = []
    for name in options.twin_params:
        implied = implied_keyboard(twin_params(name))
        with tempfile.TemporaryDirectory() as folder:
            folder = pathlib.Path(folder)
            recording = folder / "keys.mcap"
            say("record", "--robot", "twin", "--twin-params", name, "--excitation", "keys", "-o", recording)
            found = etude("identify", recording, "-o", folder / "identified")["identified"]["measured"]
        columns.append({})
        for measure in (measure for measure in found if measure["path"] in implied):
            path = measure["path"]
            scale = 1e3 if path.startswith("keyboard.") else 1.0
            value, low, high, target = (scale * one for one in (measure["value"], *measure["interval"], implied[path]))
            columns[-1][path] = f"{value:.2f} ({low:.2f} … {high:.2f}); {target:.2f}"
    head("parameter", *(f"`{name}`" for name in options.twin_params))
    for path in sorted(columns[0]):
        row(f"`{path}`", *(column[path] for column in columns))
