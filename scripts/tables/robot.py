"""What the shipped policies play on the twin, and how often a limit holds a set-point back."""

import collections
import json
import pathlib
import statistics
import sys
import tempfile
import tomllib

from tables.common import (
    MODES, ROOT, TWIN_PARAMS, Stopped, argument, command, etude, head, mean, notes, performed, row, runs, songs,
)

RAIL = 12
FINGERS = range(RAIL)
SETPOINT_SECS = 0.005
# A value counts as at its limit from this share of it on.
AT_LIMIT = 0.98
LIMITS = ["velocity", "acceleration", "jerk"]
SETS = ROOT / "configs" / "twin-params"
CELL = "notes right, wrong; onset F1; sent early by; F1"


def early_ms(report):
    return f"{1e3 * report['latency_compensation_secs']:.0f} ms"


@command("robot", runs(3), argument("--twin-params", default="standard"))
def robot(options):
    """Every built-in song in every mode on the twin: means over the runs.

    How much earlier commands are sent is measured in a run before.
    """
    head("song", "simulation: F1 (articulated plan)", *(f"{mode}: {CELL}" for mode in MODES))
    reports = collections.defaultdict(list)
    for song in songs():
        cells = []
        for mode in MODES:
            try:
                with performed(song, mode, options.twin_params, options.runs) as report:
                    reports[mode].append(report)
                    cells.append(f"{notes(report)}; {report['onset_f1']:.3f}; {early_ms(report)}; {report['robot_f1']:.3f}")
            except Stopped as stopped:
                # A fault, for instance. It counts in no mean.
                cells.append(str(stopped).removeprefix("etude: ").split(":")[0])
        row(song, f"{report['sim_f1']:.3f}", *cells)
    cells = []
    for mode in MODES:
        total = {key: sum(report[key] for report in reports[mode]) for key in ("notes_right", "notes_due", "notes_wrong")}
        scores = (mean(report[key] for report in reports[mode]) for key in ("onset_f1", "robot_f1"))
        cells.append("; ".join([notes(total), *scores]))
    row("sum; mean", mean(report["sim_f1"] for report in reports[MODES[0]]), *cells)


def recorded(recording, *topics):
    """Topic and content of the header and of the messages during the song."""
    from mcap.reader import make_reader

    with open(ROOT / recording, "rb") as file:
        for _, channel, message in make_reader(file).iter_messages(topics=[*topics, "/header"]):
            # Everything before the song has time 0.
            if message.log_time > 0 or channel.topic == "/header":
                yield channel.topic, json.loads(message.data)


@command("clamps", runs(1), TWIN_PARAMS)
def clamps(options):
    """How often the robot's limiter holds a set-point back, and by which limit. Needs mcap.

    A set-point counts if any joint of it is clamped while the song is played; the last column
    counts each set-point once a limit.
    """
    head("twin parameters", "mode", "clamped set-points", "the song with the most", "by limit")
    for twin_params in options.twin_params:
        for mode in MODES:
            total, shares = collections.Counter(), {}
            for song in songs():
                of_song = collections.Counter()
                with performed(song, mode, twin_params, options.runs) as report:
                    for run in report["runs"]:
                        for topic, data in recorded(run["files"]["recording"], "/setpoint"):
                            if topic == "/setpoint":
                                of_song["all"] += 1
                                of_song["clamped"] += bool(data["clamps"])
                                of_song.update({("rail" if joint == RAIL else "fingers", limit) for joint, limit in data["clamps"]})
                shares[song] = of_song["clamped"] / of_song["all"]
                total += of_song
            worst = max(shares, key=shares.get)
            limits = sorted(((count, *limit) for limit, count in total.items() if isinstance(limit, tuple)), reverse=True)
            row(
                f"`{twin_params}`",
                mode,
                f"{total['clamped']} of {total['all']}, {100 * total['clamped'] / total['all']:.2f} %",
                f"{worst}, {100 * shares[worst]:.2f} %",
                "; ".join(f"{joint}, {limit}: {count}" for count, joint, limit in limits) or "–",
            )


def limits_of(joint):
    rows = {row["path"]: row["value"] for row in etude("model", "params")}
    return [rows[f"joint.{joint}.{limit}_limit"] for limit in LIMITS]


def shares_at_limits(recording, finger_limits, rail_limits):
    """Of the set-points of fingers and rail at each limit, of the duties, of the time of any."""
    import numpy as np

    sent, duties = [], []
    for topic, data in recorded(recording, "/setpoint", "/hand"):
        match topic:
            case "/header":
                full = np.array(data["rig_config"]["hand"]["pwm_limit"])[FINGERS]
            case "/setpoint":
                sent.append(data["sent"])
            case _:
                duties.append(data["pwm"])
    changes = [np.array(sent)]
    for _ in LIMITS:
        changes.append(np.diff(changes[-1], axis=0) / SETPOINT_SECS)
    shares = [
        np.mean(np.abs(change[:, joints]) >= AT_LIMIT * limit)
        for joints, limits in [(list(FINGERS), finger_limits), ([RAIL], rail_limits)]
        for change, limit in zip(changes[1:], limits)
    ]
    is_full = np.abs(np.array(duties)[:, FINGERS]) >= full
    return [*shares, is_full.mean(), is_full.any(axis=1).mean()]


@command("limits", runs(1), TWIN_PARAMS)
def limits(options):
    """How often set-points and torques are at their limits in real execution. Needs mcap and NumPy.

    Set-points are shaped within the limits of the simulator.
    """
    limits = [limits_of("index_0"), limits_of("rail")]
    head("twin parameters", "fingers: velocity", *LIMITS[1:], "rail: velocity", *LIMITS[1:], "torque", "any joint")
    for twin_params in options.twin_params:
        shares = []
        for song in songs():
            try:
                with performed(song, "real", twin_params, options.runs) as report:
                    shares += [shares_at_limits(run["files"]["recording"], *limits) for run in report["runs"]]
            except Stopped as stopped:
                print(f"{song} on {twin_params}: {stopped}", file=sys.stderr)
        row(f"`{twin_params}`", *(f"{100 * statistics.mean(column):.2f} %" for column in zip(*shares)))


BASE = "mild"


def changes():
    """Each changes `mild` in these tables alone; in brackets where its numbers are from."""
    worn = tomllib.loads((SETS / "worn.toml").read_text())["physics"]
    biases = {path: value for path, value in worn.items() if path.endswith(".encoder_bias")}
    keys = {f"key.{name}": worn[f"key.{name}"] for name in ["stiffness", "damping", "friction", "threshold"]}
    arm = lambda delay, bandwidth, damping: {
        "arm": {"delay_secs": delay, "bandwidth_hz": bandwidth, "damping_ratio": damping}
    }
    stiction = lambda pwm, friction: {"hand": {"dead_pwm": pwm}, "physics": {"joint.fingers.friction": friction}}
    midi = lambda delay, jitter: {"links": {"midi": {"delay_secs": delay, "jitter_secs": jitter}}}
    return [
        ("nothing", {}),
        ("back-EMF: no-load speed 10.5 rad/s (`standard`)", {"hand": {"no_load_rad_per_sec": 10.5}}),
        ("back-EMF: 8 rad/s (`worn`)", {"hand": {"no_load_rad_per_sec": 8.0}}),
        ("full torque (`worn`)", {"hand": {"full_torque_nm": [0.8, 0.76, 0.78, 0.82]}}),
        ("stiction: dead band of about 42 of 1200", stiction(8, 0.019)),
        ("stiction: about 62 of 1200", stiction(12, 0.028)),
        ("backlash of the drives: 6 mrad (`standard`)", {"hand": {"motor_backlash_rad": 0.006}}),
        ("backlash of the drives: 12 mrad (`worn`)", {"hand": {"motor_backlash_rad": 0.012}}),
        ("no backlash between joint and encoder, instead of 4 mrad", {"hand": {"encoder_backlash_rad": 0.0}}),
        ("biases of the encoders (`worn`)", {"physics": biases}),
        ("encoder noise of 3 counts, a clock 0.02 % fast (`worn`)", {"hand": {"noise_counts": 3, "clock_skew": 0.0002}}),
        ("weight of the fingers", {"world": {"gravity": True}}),
        ("arm: lag 43 ms, overshoot 5 % (`standard`)", arm(0.015, 8.0, 0.7)),
        ("arm: 62 ms, 13 % (`worn`)", arm(0.03, 5.5, 0.55)),
        ("arm: 94 ms, 2 % (slowest of the ranges)", arm(0.03, 4.0, 0.8)),
        ("arm: overshoot 16 % (most of the ranges)", {"arm": {"damping_ratio": 0.5}}),
        ("tilt of the hand: 8 and 7 mrad (`worn`)", {"arm": {"tilt_rad": [-0.008, 0.007]}}),
        ("sag: 0.9 mm at the ends (`worn`)", {"arm": {"sag_m": 0.0009}}),
        ("kinematic error: 0.4 mm (`worn`)", {"arm": {"error_m": 0.0004, "error_period_m": 0.11}}),
        ("preload of the keys: 0.6 N (`standard`)", {"physics": {"key.preload": 0.6}}),
        ("preload: 0.8 N (highest of the ranges)", {"physics": {"key.preload": 0.8}}),
        ("springs, damping, friction and threshold of the keys (`worn`)", {"physics": keys}),
        (
            "spread of the keys: thresholds 15 %, springs 25 % (`worn`)",
            {"keys": {"threshold_spread": 0.15, "stiffness_spread": 0.25}},
        ),
        ("MIDI: 3 ms, jitter 2 ms (`standard`)", midi(0.003, 0.002)),
        ("MIDI: 6 ms, jitter 4 ms (highest of the ranges)", midi(0.006, 0.004)),
        ("keyboard 3 mm to the side", {"physics": {"keyboard.lateral": 0.003}}),
        ("keyboard 3 mm too deep", {"physics": {"keyboard.depth": 0.003}}),
        ("keyboard 2 mm too high", {"physics": {"keyboard.height": 0.002}}),
        ("keyboard 2 mm too low", {"physics": {"keyboard.height": -0.002}}),
        ("keyboard turned by 6 mrad (`worn`)", {"world": {"keyboard_yaw_rad": -0.006}}),
    ]


def merged(base, change):
    """`base` with the entries of `change`, table by table."""
    both = dict(base)
    for key, value in change.items():
        both[key] = merged(base.get(key, {}), value) if isinstance(value, dict) else value
    return both


def changed(change):
    params = tomllib.loads((SETS / f"{BASE}.toml").read_text())
    for path in change.get("physics", {}):
        # A row of one joint would override that of all fingers.
        if path.startswith("joint.fingers."):
            last = path.rsplit(".", 1)[1]
            is_one = lambda row: row.startswith("joint.") and row.endswith(f".{last}")
            params["physics"] = {row: value for row, value in params["physics"].items() if not is_one(row)}
    return merged(params, change)


def toml(table, path=()):
    """The table as TOML: numbers, texts, lists and tables."""
    own = [f"{json.dumps(key)} = {json.dumps(value)}" for key, value in table.items() if not isinstance(value, dict)]
    below = [toml(value, (*path, key)) for key, value in table.items() if isinstance(value, dict)]
    return "\n".join(([f"[{'.'.join(path)}]"] if path and own else []) + own + below) + "\n"


@command(
    "twin-params-costs",
    runs(1),
    argument("--songs", nargs="+", default=["twinkle", "ode-to-joy", "c-major-scale"]),
    argument("--modes", nargs="+", default=MODES),
    argument("--drawn", type=int, help="instead, so many sets that are drawn: random:1 and so on"),
)
def twin_params_costs(options):
    """What each difference of the twin costs: the set `mild` with one change at a time.

    Cells are means over songs and runs.
    """
    head("what is changed", *(f"{mode}: onset F1 without the lag; sent early by; F1 (articulated plan)" for mode in options.modes))
    with tempfile.TemporaryDirectory() as folder:
        if options.drawn:
            rows = [(f"`random:{seed}`", f"random:{seed}") for seed in range(1, options.drawn + 1)]
        else:
            rows = []
            for number, (name, change) in enumerate(changes()):
                file = pathlib.Path(folder) / f"{number}.toml"
                file.write_text(toml(changed(change)))
                rows.append((name, file))
            rows += [(f"all of `{name}`", name) for name in ["standard", "worn"]]
        for name, twin_params in rows:
            cells = []
            for mode in options.modes:
                reports = []
                for song in options.songs:
                    with performed(song, mode, twin_params, options.runs) as report:
                        reports.append(report)
                secs = statistics.mean(report["latency_compensation_secs"] for report in reports)
                onset = mean(report.get("onset_f1_without_lag", float("nan")) for report in reports)
                cells.append(f"{onset}; {1e3 * secs:.0f} ms; {mean(report['robot_f1'] for report in reports)}")
            row(name, *cells)
