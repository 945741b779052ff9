#!/usr/bin/env python3
"""What the excitation `keys` measures of the keyboards of the twin's truths, beside what the truths imply.

    python3 scripts/presses_table.py [TRUTH ...]
"""

import json
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

ROOT = Path(__file__).parent.parent
ETUDE = ROOT / "target/release/etude"


def implied(truth: str) -> dict[str, float]:
    """The rows of the simulator that the truth has. Places count from the bottom, since a simulated key has the nominal travel."""
    numbers = tomllib.loads((ROOT / f"configs/truths/{truth}.toml").read_text())
    physics, keys = numbers.get("physics", {}), numbers.get("keys", {})
    travel = keys.get("travel", 1.0)
    sounds = 1.0 - travel * (1.0 - physics.get("key.threshold", 0.5))
    silent = 1.0 - travel * (1.0 - keys.get("first_contact", 0.3))
    rows = {"key.threshold": sounds, "key.hysteresis": 1.0 - silent / sounds}
    defaults = {"key.preload": 0.0, "key.stiffness": 1.0, "keyboard.height": 0.0, "keyboard.lateral": 0.0, "keyboard.depth": 0.0}
    biases = {f"joint.{finger}_{joint}.encoder_bias": 0.0 for finger in ("index", "middle", "ring") for joint in range(3)}
    for row, default in (defaults | biases).items():
        rows[row] = physics.get(row, default)
    # Longer travel looks like a lower keyboard; fingers press 0.69 of a key's length from its hinge.
    rows["keyboard.height"] -= (travel - 1.0) * 0.0069
    return rows


def measured(truth: str, folder: Path) -> list[dict]:
    recording = folder / "keys.mcap"
    twin = ["--robot", "twin", "--truth", truth, "--excitation", "keys", "-o", recording]
    subprocess.run([ETUDE, "record", *twin], check=True, stdout=subprocess.DEVNULL)
    fit = subprocess.run([ETUDE, "identify", recording, "-o", folder / truth, "--json"], check=True, capture_output=True)
    return json.loads(fit.stdout)["identified"]["measured"]


def main() -> None:
    print("| truth | row | measured (95 %) | implied |\n|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for truth in sys.argv[1:] or ["ideal", "mild", "standard", "worn"]:
            known = implied(truth)
            for one in measured(truth, Path(folder)):
                if one["path"] in known:
                    low, high = one["interval"]
                    # In mm and mrad.
                    scale = 1e3 if one["path"].startswith("keyboard.") or one["path"].endswith("bias") else 1.0
                    value = f"{scale * one['value']:.2f} ({scale * low:.2f} … {scale * high:.2f})"
                    print(f"| {truth} | `{one['path']}` | {value} | {scale * known[one['path']]:.2f} |")


if __name__ == "__main__":
    main()
