"""What identification finds on the twin, beside what the twin's parameters imply."""

import json
import pathlib
import statistics
import tempfile
import tomllib

from tables.common import ROOT, argument, command, etude, head, row, say

FULL_PWM = 1200
# Duty a radian: the rig's default gain.
KP = 3600
DEFAULT_VISCOSITY = 0.01
KEYBOARD = {
    "key.threshold": 0.5,
    "key.stiffness": 1.0,
    "key.damping": None,
    "keyboard.height": 0.0,
    "keyboard.lateral": 0.0,
}
# Fingers press this far from a key's hinge, as a share of its travel, m.
PRESSED_AT_M = 0.0069


def twin_params(name):
    """The tables of a parameter set: a name or a file."""
    path = pathlib.Path(name)
    return tomllib.loads((path if path.suffix else ROOT / f"configs/twin-params/{name}.toml").read_text())


def implied_drives(params):
    """Value by path."""
    physics, hand = params.get("physics", {}), params.get("hand", {})
    torque = hand.get("full_torque_nm", [1.0] * 4)
    values = {path: physics.get(path, default) for path, default in KEYBOARD.items()}
    # Where the second contact closes, as a fraction of the simulator's travel.
    values["key.threshold"] *= params.get("keys", {}).get("travel", 1.0)
    for finger in ("index", "middle", "ring"):
        for joint in range(4):
            name = f"joint.{finger}_{joint}"
            own = lambda row, default: physics.get(f"{name}.{row}", physics.get(f"joint.fingers.{row}", default))
            values[f"{name}.stiffness"] = KP / FULL_PWM * torque[joint]
            back_emf = torque[joint] / hand["no_load_rad_per_sec"] if "no_load_rad_per_sec" in hand else 0.0
            values[f"{name}.viscosity"] = own("viscosity", DEFAULT_VISCOSITY) + back_emf
            values[f"{name}.friction"] = own("friction", 0.0) + hand.get("dead_pwm", 0) / FULL_PWM * torque[joint]
    return values


@command(
    "identified",
    argument("folder", type=pathlib.Path, help="of `etude identify`"),
    argument("twin_params", help="name or file of the set that the recordings were made with"),
)
def identified(options):
    """Estimates of `etude identify` and what the twin's parameters imply.

    A joint's gains are the rig's (duty a radian) times the torque of full duty. Its dry friction is
    that of the twin and the torque of the drive's dead band. Its viscosity is the twin's and its
    motor's back-EMF. Armature, low-pass, delay and jerk limit have no counterpart: the twin has a
    velocity filter, a servo and wires there.
    """
    report = json.loads((options.folder / "identification.json").read_text())
    implied = implied_drives(twin_params(options.twin_params))
    errors = {}
    head("number", "implied", "found", "95 % interval", "off", "identifiable")
    for _, estimate in report["identified"]["estimates"]:
        for parameter in estimate["parameters"]:
            path, value = parameter["path"], parameter["value"]
            target = implied.get(path)
            if target is None:
                continue
            low, high = parameter["interval"]
            off = abs(value / target - 1) if target else float("nan")
            is_identifiable = parameter["is_identifiable"]
            interval = f"{low:.4g} … {high:.4g}"
            answer = "yes" if is_identifiable else "no"
            row(path, f"{target:.4g}", f"{value:.4g}", interval, f"{100 * off:.0f} %", answer)
            if target:
                groups = [path.rsplit(".", 1)[-1], "all", *(["identifiable"] if is_identifiable else [])]
                for group in groups:
                    errors.setdefault(group, []).append(off)
    print()
    for group, values in errors.items():
        print(f"{group}: median error {100 * statistics.median(values):.1f} % of {len(values)}")


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
