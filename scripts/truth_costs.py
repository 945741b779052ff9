"""What each change of the twin alone costs: three songs in three modes on the truth `mild` with one thing changed at a time, and the table of
docs/results/robot.md: onset F1 aligned by the median lag, the measured lead (how late the robot is), and the paper's F1, as means over the songs
(and runs). With --drawn the same of so many truths that are drawn, random:1 and so on.

    make build && python3 scripts/truth_costs.py [--runs 1] [--songs twinkle,ode-to-joy,c-major-scale] [--drawn 20] [--modes real]
"""

import argparse
import json
import pathlib
import subprocess
import tomllib

ROOT = pathlib.Path(__file__).resolve().parent.parent
ETUDE = ROOT / "target" / "release" / "etude"
TRUTHS = ROOT / "configs" / "truths"
MODES = ["joint-mirroring", "hybrid", "real"]
BASE = "mild"
WORN = tomllib.loads((TRUTHS / "worn.toml").read_text())["physics"]
BIASES = {path: value for path, value in WORN.items() if path.endswith(".encoder_bias")}
KEYS = {f"key.{name}": WORN[f"key.{name}"] for name in ["stiffness", "damping", "friction", "threshold"]}
# Each changes `mild` in these tables alone. The numbers of the second group are those of `standard` and `worn`.
CHANGES = [
    ("nothing", {}),
    ("back-EMF: no-load speed 10.5 rad/s (`standard`)", {"hand": {"no_load_rad_per_sec": 10.5}}),
    ("back-EMF: 8 rad/s (`worn`)", {"hand": {"no_load_rad_per_sec": 8.0}}),
    ("weaker motors: full torque of `worn`", {"hand": {"full_torque_nm": [0.8, 0.76, 0.78, 0.82]}}),
    ("stiction: dead band of about 42 of 1200", {"hand": {"dead_pwm": 8}, "physics": {"joint.fingers.friction": 0.019}}),
    ("stiction: about 62 of 1200", {"hand": {"dead_pwm": 12}, "physics": {"joint.fingers.friction": 0.028}}),
    ("play that torque crosses: 6 mrad (`standard`)", {"hand": {"play_rad": 0.006}}),
    ("play: 12 mrad (`worn`)", {"hand": {"play_rad": 0.012}}),
    ("no play between joint and encoder, instead of 4 mrad", {"hand": {"backlash_rad": 0.0}}),
    ("biases of the encoders (`worn`)", {"physics": BIASES}),
    ("noise of the encoders: 3 counts, and a clock that is 0.02 % fast (`worn`)", {"hand": {"noise_counts": 3, "clock_skew": 0.0002}}),
    ("the fingers' weight", {"world": {"gravity": True}}),
    ("arm: lag 43 ms, 5 % too far (`standard`)", {"arm": {"delay_secs": 0.015, "bandwidth_hz": 8.0, "damping_ratio": 0.7}}),
    ("arm: 62 ms, 13 % (`worn`)", {"arm": {"delay_secs": 0.03, "bandwidth_hz": 5.5, "damping_ratio": 0.55}}),
    ("arm: 94 ms, 2 % (slowest of the ranges)", {"arm": {"delay_secs": 0.03, "bandwidth_hz": 4.0, "damping_ratio": 0.8}}),
    ("a ringing arm: 16 % too far after a small step (most of the ranges)", {"arm": {"damping_ratio": 0.5}}),
    ("tilt of the hand: 8 and 7 mrad (`worn`)", {"arm": {"tilt_rad": [-0.008, 0.007]}}),
    ("sag: 0.9 mm at the ends (`worn`)", {"arm": {"sag_m": 0.0009}}),
    ("kinematic error: 0.4 mm (`worn`)", {"arm": {"error_m": 0.0004, "error_period_m": 0.11}}),
    ("preload of the keys: 0.6 N (`standard`)", {"physics": {"key.preload": 0.6}}),
    ("preload: 0.8 N (highest of the ranges)", {"physics": {"key.preload": 0.8}}),
    ("springs, damping, friction and threshold of the keys (`worn`)", {"physics": KEYS}),
    ("keys that differ: thresholds by 15 %, springs by 25 % (`worn`)", {"keys": {"threshold_spread": 0.15, "stiffness_spread": 0.25}}),
    ("MIDI: 3 ms, jitter 2 ms (`standard`)", {"links": {"midi": {"delay_secs": 0.003, "jitter_secs": 0.002}}}),
    ("MIDI: 6 ms, jitter 4 ms (highest)", {"links": {"midi": {"delay_secs": 0.006, "jitter_secs": 0.004}}}),
    ("keyboard 3 mm beside its place", {"physics": {"keyboard.lateral": 0.003}}),
    ("keyboard 3 mm too deep", {"physics": {"keyboard.depth": 0.003}}),
    ("keyboard 2 mm too high", {"physics": {"keyboard.height": 0.002}}),
    ("keyboard 2 mm too low", {"physics": {"keyboard.height": -0.002}}),
    ("keyboard turned by 6 mrad (`worn`)", {"world": {"keyboard_yaw_rad": -0.006}}),
]
# In these a row of one joint would override that of all fingers.
GROUPS = ["joint.fingers."]


def merged(base, change):
    """`base` with the entries of `change`, table by table."""
    both = dict(base)
    for key, value in change.items():
        both[key] = merged(base.get(key, {}), value) if isinstance(value, dict) else value
    return both


def changed(change):
    truth = tomllib.loads((TRUTHS / f"{BASE}.toml").read_text())
    for path in change.get("physics", {}):
        for group in GROUPS:
            if path.startswith(group):
                last = path.rsplit(".", 1)[1]
                truth["physics"] = {k: v for k, v in truth["physics"].items() if not (k.startswith("joint.") and k.endswith(f".{last}"))}
    return merged(truth, change)


def toml(table, path=()):
    """The table as TOML: numbers, texts, lists and tables, which is what a truth is made of."""
    own = [f"{json.dumps(key)} = {json.dumps(value)}" for key, value in table.items() if not isinstance(value, dict)]
    below = [toml(value, (*path, key)) for key, value in table.items() if isinstance(value, dict)]
    head = [f"[{'.'.join(path)}]"] if path and own else []
    return "\n".join(head + own + below) + "\n"


def perform(song, mode, truth, runs):
    done = subprocess.run(
        [
            ETUDE, "perform", song, "--mode", mode, "--robot", "twin", "--truth", truth, "--runs", str(runs),
            "--policy", f"policies/{song}.safetensors", "--out", f"out/truth-costs/{song}-{mode}", "--json",
        ],
        cwd=ROOT, check=True, capture_output=True, text=True,
    )
    return json.loads(done.stdout)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=1)
    parser.add_argument("--songs", default="twinkle,ode-to-joy,c-major-scale")
    parser.add_argument("--drawn", type=int)
    parser.add_argument("--modes", default=",".join(MODES))
    options = parser.parse_args()
    songs, modes = options.songs.split(","), options.modes.split(",")
    folder = ROOT / "out" / "truth-costs"
    folder.mkdir(parents=True, exist_ok=True)
    print("| what is changed | " + " | ".join(modes) + " |")
    print("|---|" + "---|" * len(modes), flush=True)
    if options.drawn:
        rows = [(f"`random:{seed}`", f"random:{seed}") for seed in range(1, options.drawn + 1)]
    else:
        rows = []
        for number, (name, change) in enumerate(CHANGES):
            file = folder / f"{number}.toml"
            file.write_text(toml(changed(change)))
            rows.append((name, file))
        rows += [(f"all of `{name}`", name) for name in ["standard", "worn"]]
    for name, truth in rows:
        cells = []
        for mode in modes:
            reports = [perform(song, mode, truth, options.runs) for song in songs]
            mean = lambda key: sum(report.get(key, float("nan")) for report in reports) / len(reports)
            cells.append(f"{mean('onset_f1_without_lag'):.3f}; {1e3 * mean('lead_secs'):.0f} ms; {mean('robot_f1'):.3f}")
        print(f"| {name} | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
