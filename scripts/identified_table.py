"""Compares the estimates of `etude identify` on the twin with the twin's truth, for docs/results/identification.md.

    etude identify … -o out/identified && python3 scripts/identified_table.py out/identified configs/truths/standard.toml

Implied are: a joint's gains, the rig's (duty a radian) times the torque of full duty; its dry friction, that of the truth on its
way and the torque of the drive's dead band; its viscosity, the truth's and its motor's back-EMF; the keyboard's rows, as the truth has them. Armature, low-pass, delay and jerk limit
have no counterpart: in the twin a velocity filter, a servo and wires stand in their place.
"""

import json
import pathlib
import statistics
import sys
import tomllib

FULL_PWM = 1200
KP = 3600  # duty a radian: the rig's default gain
DEFAULT_VISCOSITY = 0.01
KEYBOARD = {"key.threshold": 0.5, "key.stiffness": 1.0, "key.damping": None, "keyboard.height": 0.0, "keyboard.lateral": 0.0}


def implied(truth):
    """Value by path."""
    physics, hand = truth.get("physics", {}), truth.get("hand", {})
    torque = hand.get("full_torque_nm", [1.0] * 4)
    values = {path: physics.get(path, default) for path, default in KEYBOARD.items()}
    # Where the second contact closes. The key's travel differs too, and the simulator's fraction refers to its own travel.
    values["key.threshold"] *= truth.get("keys", {}).get("travel", 1.0)
    for finger in ("index", "middle", "ring"):
        for joint in range(4):
            name = f"joint.{finger}_{joint}"
            own = lambda row, default: physics.get(f"{name}.{row}", physics.get(f"joint.fingers.{row}", default))
            values[f"{name}.stiffness"] = KP / FULL_PWM * torque[joint]
            back_emf = torque[joint] / hand["no_load_rad_per_sec"] if "no_load_rad_per_sec" in hand else 0.0
            values[f"{name}.viscosity"] = own("viscosity", DEFAULT_VISCOSITY) + back_emf
            values[f"{name}.friction"] = own("friction", 0.0) + hand.get("dead_pwm", 0) / FULL_PWM * torque[joint]
    return values


def main():
    folder, truth = pathlib.Path(sys.argv[1]), tomllib.loads(pathlib.Path(sys.argv[2]).read_text())
    report = json.loads((folder / "identification.json").read_text())
    wanted = implied(truth)
    errors = {}
    print("| number | implied | found | 95 % interval | off | identifiable |\n|---|---|---|---|---|---|")
    for _, estimate in report["identified"]["estimates"]:
        for parameter in estimate["parameters"]:
            path, target = parameter["path"], wanted.get(parameter["path"])
            if target is None:
                continue
            low, high = parameter["interval"]
            off = abs(parameter["value"] / target - 1) if target else float("nan")
            told = "yes" if parameter["is_identifiable"] else "no"
            print(f"| {path} | {target:.4g} | {parameter['value']:.4g} | {low:.4g} … {high:.4g} | {100 * off:.0f} % | {told} |")
            if target:
                for group in (path.rsplit(".", 1)[-1], "all", *(["identifiable"] if parameter["is_identifiable"] else [])):
                    errors.setdefault(group, []).append(off)
    print()
    for group, values in errors.items():
        print(f"{group}: median error {100 * statistics.median(values):.1f} % of {len(values)}")


if __name__ == "__main__":
    main()
