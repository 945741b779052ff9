"""What the shipped policies play on the twin, and how often a limit holds a set-point back."""

import collections
import json
import pathlib
import statistics
import tempfile
import tomllib

from tables.common import (
    MEASURE, MODES, ROOT, ROWS, TWIN_PARAMS, Stopped, argument, command, etude, groups, head, mean_of, performed,
    read, right_of_due, row, rows_of, runs, songs, sum_of,
)

RAIL = 12
FINGERS = range(RAIL)
SETPOINT_SECS = 0.005
# A value counts as at its limit from this share of it on.
AT_LIMIT = 0.98
LIMITS = ["velocity", "acceleration", "jerk"]
SETS = ROOT / "configs" / "twin-params"
SCORES = [
    "sim_f1", "sim_robopianist_f1", "robot_f1", "robot_robopianist_f1", "onset_f1", "onset_f1_without_lag",
    "latency_compensation_secs",
]
# Of the run that measures the lag.
UNCOMPENSATED = {"right": "matched", "wrong": "wrong", "f1": "f1", "robopianist_f1": "robopianist_f1"}
NOTES = ["notes_right", "notes_due", "notes_wrong"]
F1 = ["F1 (articulated plan)", "F1 (RoboPianist's rule)"]
# Songs of the tables of twin parameters.
THREE = ["twinkle", "ode-to-joy", "c-major-scale"]


def performance(label, song, mode, twin_params, runs, run=None, seed=0):
    """A row: means over the runs, or why a safety stop ended them."""
    labels = {"twin_params": label, "mode": mode, "song": song, "seed": seed, "runs": runs}
    try:
        with performed(song, mode, twin_params, runs, run) as report:
            before = report.get("uncompensated", {})
            before = {f"uncompensated_{key}": before.get(name, "") for key, name in UNCOMPENSATED.items()}
            return labels | {key: report.get(key, "") for key in [*SCORES, *NOTES]} | before | {"stopped": ""}
    except Stopped as stopped:
        empty = [*SCORES, *NOTES, *(f"uncompensated_{key}" for key in UNCOMPENSATED)]
        return labels | dict.fromkeys(empty, "") | {"stopped": str(stopped).removeprefix("etude: ")}


def early(rows):
    return f"{1e3 * mean_of(rows, 'latency_compensation_secs'):.0f} ms"


def complete(rows):
    return [entry for entry in rows if not entry["stopped"]]


@command(
    "robot",
    ROWS,
    MEASURE,
    runs(1),
    argument("--twin-params", nargs="+", default=["standard", "worn", "mild", "ideal"], help="to measure"),
    argument("--by-song", metavar="TWIN_PARAMS", help="the songs on this parameter set, in real execution"),
)
def robot(options):
    """Every built-in song in every mode on the twin.

    How much earlier commands are sent is measured in a run before. A performance that a safety stop
    has ended counts in no mean.
    """
    every = ((name, song, mode) for name in options.twin_params for song in songs() for mode in MODES)
    rows = rows_of(options, lambda: (performance(name, song, mode, name, options.runs) for name, song, mode in every))
    if options.by_song:
        rows = [entry for entry in rows if (entry["twin_params"], entry["mode"]) == (options.by_song, "real")]
    key, first = ("song", "song") if options.by_song else ("twin_params", "twin parameters")
    head(first, "mode", "notes right, wrong", "onset F1", "sent early by", *F1)
    for name, of_row in groups(rows, key).items():
        name = name if options.by_song else f"`{name}`"
        for mode, of_mode in groups(complete(of_row), "mode").items():
            scores = ("onset_f1", "robot_f1", "robot_robopianist_f1")
            onset, *f1 = (f"{mean_of(of_mode, score):.3f}" for score in scores)
            row(name, mode, right_of_due(of_mode), onset, early(of_mode), *f1)


@command("uncompensated", ROWS)
def uncompensated(options):
    """The runs that measure the lag: commands are sent as early as in the training."""
    head("twin parameters", "mode", "notes right, wrong", *F1)
    for name, of_set in groups(complete(read(options.rows)), "twin_params").items():
        for mode, of_mode in groups(of_set, "mode").items():
            counts = ("uncompensated_right", "notes_due", "uncompensated_wrong")
            right, due, wrong = (sum_of(of_mode, key) for key in counts)
            f1 = (f"{mean_of(of_mode, f'uncompensated_{key}'):.3f}" for key in ("f1", "robopianist_f1"))
            row(f"`{name}`", mode, f"{right:.0f} of {due:.0f}, {wrong:.0f}", *f1)


@command("drawn", ROWS, MEASURE, runs(2), argument("--count", type=int, default=20, help="of sets to measure"))
def drawn(options):
    """Real execution on parameter sets that are drawn, random:1 and so on."""
    every = ((f"random:{seed}", song) for seed in range(1, options.count + 1) for song in THREE)
    rows = rows_of(options, lambda: (performance(name, song, "real", name, options.runs) for name, song in every))
    sets = groups(complete(rows), "twin_params")
    f1 = [mean_of(of_set, "robot_f1") for of_set in sets.values()]
    onset = statistics.mean(mean_of(of_set, "onset_f1_without_lag") for of_set in sets.values())
    head("parameter sets", "onset F1 without the lag", "F1 (articulated plan): mean", "lowest, highest")
    name = f"`{next(iter(sets))}` to `{list(sets)[-1]}`"
    row(name, f"{onset:.3f}", f"{statistics.mean(f1):.3f}", f"{min(f1):.3f}, {max(f1):.3f}")


@command(
    "trained",
    ROWS,
    MEASURE,
    runs(3),
    argument("--twin-params", nargs="+", default=["standard"], help="to measure"),
    argument("--trainings", nargs="+", type=pathlib.Path, default=[], help="their folders, SONG-SEED, or policy files, SONG"),
)
def trained(options):
    """Policies in real execution, nothing fitted. A safety stop counts as F1 0 and no note.

    A range is that of the policies.
    """
    labels = [(run.stem, 0) if run.is_file() else run.name.rsplit("-", 1) for run in options.trainings]
    every = ((name, *each) for name in options.twin_params for each in zip(options.trainings, labels))
    rows = rows_of(
        options,
        lambda: (
            performance(name, song, "real", name, options.runs, run.resolve(), seed)
            for name, run, (song, seed) in every
        ),
    )
    head(
        "twin parameters", "policies", "safety stops", "F1 (RoboPianist's rule), simulation", "twin (range)", "gap",
        "twin, uncompensated", "notes right, wrong",
    )
    for name, of_set in groups(rows, "twin_params").items():
        done = complete(of_set)
        f1 = [float(entry["robot_robopianist_f1"] or 0) for entry in of_set]
        simulated = mean_of(done, "sim_robopianist_f1")
        right, due, wrong = (sum_of(done, key) for key in NOTES)
        twin, uncompensated = statistics.mean(f1), mean_of(done, "uncompensated_robopianist_f1")
        row(
            f"`{name}`", len(of_set), len(of_set) - len(done), f"{simulated:.3f}",
            f"{twin:.3f} ({min(f1):.3f} to {max(f1):.3f})", f"{100 * (1 - twin / simulated):.1f} %",
            f"{uncompensated:.3f}", f"{right:.0f} of {due:.0f}, {wrong:.0f}",
        )


def recorded(recording, *topics):
    """Topic and content of the header and of the messages during the song."""
    from mcap.reader import make_reader

    with open(ROOT / recording, "rb") as file:
        for _, channel, message in make_reader(file).iter_messages(topics=[*topics, "/header"]):
            # Everything before the song has time 0.
            if message.log_time > 0 or channel.topic == "/header":
                yield channel.topic, json.loads(message.data)


def counted(song, mode, twin_params):
    """How many set-points a performance has, how many are clamped, and by which limit."""
    counts = collections.Counter({"all": 0, "clamped": 0})
    with performed(song, mode, twin_params, 1) as report:
        for topic, data in recorded(report["runs"][0]["files"]["recording"], "/setpoint"):
            if topic == "/setpoint":
                counts["all"] += 1
                counts["clamped"] += bool(data["clamps"])
                counts.update({f"{'rail' if joint == RAIL else 'fingers'}, {limit}" for joint, limit in data["clamps"]})
    for what, count in counts.items():
        yield {"twin_params": twin_params, "mode": mode, "song": song, "seed": 0, "what": what, "set_points": count}


@command("clamps", ROWS, MEASURE, TWIN_PARAMS)
def clamps(options):
    """How often the robot's limiter holds a set-point back, and by which limit. Measuring needs mcap.

    A set-point counts if any joint of it is clamped while the song is played; the last column
    counts each set-point once a limit.
    """
    every = ((song, mode, name) for name in options.twin_params for mode in MODES for song in songs())
    rows = rows_of(options, lambda: (entry for each in every for entry in counted(*each)))
    head("twin parameters", "mode", "clamped set-points", "the song with the most", "by limit")
    for twin_params, of_set in groups(rows, "twin_params").items():
        for mode, of_mode in groups(of_set, "mode").items():
            total, shares = collections.Counter(), {}
            for song, entries in groups(of_mode, "song").items():
                counts = {entry["what"]: int(entry["set_points"]) for entry in entries}
                shares[song] = counts["clamped"] / counts["all"]
                total.update(counts)
            worst = max(shares, key=shares.get)
            limits = sorted(((count, what) for what, count in total.items() if ", " in what), reverse=True)
            row(
                f"`{twin_params}`",
                mode,
                f"{total['clamped']} of {total['all']}, {100 * total['clamped'] / total['all']:.2f} %",
                f"{worst}, {100 * shares[worst]:.2f} %" if shares[worst] else "–",
                "; ".join(f"{what}: {count}" for count, what in limits) or "–",
            )


def limits_of(joint):
    rows = {row["path"]: row["value"] for row in etude("model", "params")}
    return [rows[f"joint.{joint}.{limit}_limit"] for limit in LIMITS]


SHARES = ["fingers: velocity", *LIMITS[1:], "rail: velocity", *(f"rail: {limit}" for limit in LIMITS[1:]), "torque", "any joint"]


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
    return map(float, [*shares, is_full.mean(), is_full.any(axis=1).mean()])


@command("limits", ROWS, MEASURE, TWIN_PARAMS)
def limits(options):
    """How often set-points and torques are at their limits in real execution.

    Set-points are shaped within the limits of the simulator. Measuring needs mcap and NumPy.
    """

    def measured():
        of_joints = [limits_of("index_0"), limits_of("rail")]
        for twin_params in options.twin_params:
            for song in songs():
                with performed(song, "real", twin_params, 1) as report:
                    shares = shares_at_limits(report["runs"][0]["files"]["recording"], *of_joints)
                    yield {"twin_params": twin_params, "song": song, "seed": 0} | dict(zip(SHARES, shares))

    rows = rows_of(options, measured)
    head("twin parameters", *SHARES)
    for twin_params, of_set in groups(rows, "twin_params").items():
        row(f"`{twin_params}`", *(f"{100 * mean_of(of_set, column):.2f} %" for column in SHARES))


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


@command("twin-params-costs", ROWS, MEASURE, runs(1))
def twin_params_costs(options):
    """What each difference of the twin costs: the set `mild` with one change at a time.

    Real execution; means over songs and runs.
    """

    def measured():
        with tempfile.TemporaryDirectory() as folder:
            every = []
            for number, (name, change) in enumerate(changes()):
                file = pathlib.Path(folder) / f"{number}.toml"
                file.write_text(toml(changed(change)))
                every.append((name, file))
            every += [(f"all of `{name}`", name) for name in ["standard", "worn"]]
            for name, twin_params in every:
                for song in THREE:
                    yield performance(name, song, "real", twin_params, options.runs)

    rows = rows_of(options, measured)
    head("what is changed", "onset F1 without the lag", "sent early by", "F1 (articulated plan)")
    for name, of_change in groups(complete(rows), "twin_params").items():
        onset, f1 = (f"{mean_of(of_change, key):.3f}" for key in ("onset_f1_without_lag", "robot_f1"))
        row(name, onset, early(of_change), f1)


@command("dynamics", ROWS, MEASURE, runs(4))
def dynamics(options):
    """A piece with loud and soft notes, by its shipped policy: notes, F1, correlation of velocities."""
    song, who = "songs/surprise-symphony.mid", ["--policy", "policies/surprise-symphony.safetensors"]

    def of_run(where, number, run):
        notes = [run["matched"], run["matched"] + run["missed"], run["wrong"]]
        scores = {key: run[key] for key in ("f1", "velocity_correlation")}
        return {"where": where, "seed": 0, "run": number} | dict(zip(NOTES, notes)) | scores

    def measured():
        with tempfile.TemporaryDirectory() as folder:
            report = etude("play", song, *who, "-o", folder)
            yield of_run("simulation", 0, report)
        for twin_params in ["mild", "standard"]:
            with tempfile.TemporaryDirectory() as folder:
                twin = ["--robot", "twin", "--twin-params", twin_params, "--runs", options.runs]
                report = etude("perform", song, *who, *twin, "-o", folder)
            for number, run in enumerate(report["runs"]):
                yield of_run(f"twin `{twin_params}`, real execution", number, run)

    rows = rows_of(options, measured)
    head("where", "runs", "notes right, wrong", "F1 (articulated plan)", "correlation of velocities")
    for where, of_place in groups(rows, "where").items():
        right, due, wrong = (mean_of(of_place, key) for key in NOTES)
        scores = (f"{mean_of(of_place, key):.{digits}f}" for key, digits in (("f1", 3), ("velocity_correlation", 2)))
        row(where, len(of_place), f"{right:g} of {due:g}, {wrong:g}", *scores)
