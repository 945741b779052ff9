#!/usr/bin/env python3
"""Measures Étude and its peers in turns and prints a Markdown table with ratios.

    benches/run.py [--secs S] [--turns N] [--release DIR]

`make bench` builds what it needs and runs it. Each script in benches/peers makes itself a throw-away virtual environment in
/tmp (or the folder PEERS_VENV), which needs the network and some minutes once, and for all of them 15 GB of disk.

In each turn Étude measures everything once, and then every peer does. The medians of the turns count. A ratio above 1 says
how many times faster, or smaller, Étude is. Rates on a shared machine swing: compare ratios of one run. A peer that fails is
not run again, and the last lines name it with the reason.
"""

import argparse
import json
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time

HERE = pathlib.Path(__file__).resolve().parent
SONG = "c-major-scale"
SBX = ("sbx_droq.sh", "sbx_etude.sh", "sbx_robopianist.sh")
UPDATES = ("jax_update.sh", "torch_update.sh")


def plan(cores):
    """For each figure of Étude: the field of the peers' lines, and the peers as (script, threads)."""
    rows = {
        "train_steps_per_sec_1_core": ("steps_per_sec", [(script, 1) for script in SBX]),
        "train_steps_per_sec": ("steps_per_sec", [(script, cores) for script in SBX]),
        "env_steps_per_sec": ("control_steps_per_sec", [("rollout.sh", 1), ("robopianist.sh", 1)]),
        "env_steps_per_sec_all_cores": ("control_steps_per_sec", [("rollout.sh", cores)]),
        "updates_per_sec": ("updates_per_sec", [(script, 1) for script in UPDATES]),
        "updates_per_sec_2_threads": ("updates_per_sec", [(script, 2) for script in UPDATES] if cores > 1 else []),
        "peak_memory_mib": ("peak_memory_mib", [(script, 1) for script in SBX]),
        "start_up_secs": ("start_up_secs", [(script, 1) for script in (*SBX, "robopianist.sh")]),
    }
    # Étude's figures in bf16 stand beside the same figures of the peers.
    return rows | {f"bf16_{key}": row for key, row in rows.items()}


def run_etude(release, secs):
    """Étude's figures: those of crates/lab/examples/bench.rs, and the time until a training has made its first step."""
    done = subprocess.run([release / "examples" / "bench", str(secs)], check=True, stdout=subprocess.PIPE)
    figures = json.loads(done.stdout)
    with tempfile.TemporaryDirectory(prefix="etude-bench-") as folder:
        begun = time.perf_counter()
        sets = ["--set", "trainer.total_steps=1", "--set", "trainer.evaluate_every_steps=0"]
        train = [release / "etude", "train", SONG, "--preset", "paper", "--json", *sets, "--out", f"{folder}/run"]
        subprocess.run(train, check=True, stdout=subprocess.DEVNULL)
        figures["start_up_secs"] = time.perf_counter() - begun
    figures["rows"].append({"what": "start to the first step, training", "key": "start_up_secs", "unit": "s"})
    return figures


def run_peer(script, secs, threads, files):
    """The JSON lines that a peer prints, and why there are none if it fails."""
    path = HERE / "peers" / script
    print(f"running {path} with {threads} thread(s) …", file=sys.stderr)
    command = ["sh", path, str(secs), str(threads), *(files if script == "rollout.sh" else [])]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        said = [line.strip() for line in done.stderr.splitlines() if line.strip()]
        return [], said[-1] if said else "it does not say why"
    lines = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
    return lines, None if lines else "it has printed no figures"


def measure(release, secs, turns):
    """The figures of Étude of all turns; the lines of all turns, and the reasons of failures, by (script, threads)."""
    ours, lines, failed = [], {}, {}
    with tempfile.TemporaryDirectory(prefix="etude-bench-") as folder:
        files = [pathlib.Path(folder) / name for name in ("model.xml", "trace.txt")]
        subprocess.run([release / "etude", "model", "export", "--preset", "paper", "-o", files[0]], check=True)
        with open(files[1], "w") as trace:
            subprocess.run([release / "examples" / "trace", SONG], check=True, stdout=trace)
        for _ in range(turns):
            ours.append(run_etude(release, secs / turns))
            for peer in dict.fromkeys(peer for _, peers in plan(ours[0]["cores"]).values() for peer in peers):
                if peer not in failed:
                    new, reason = run_peer(peer[0], secs / turns, peer[1], files)
                    lines.setdefault(peer, []).extend(new)
                    if reason:
                        failed[peer] = reason
                        del lines[peer]
    return ours, lines, failed


def medians(lines, field):
    """The medians of a field, one for each name of a peer."""
    found = {}
    for line in lines:
        if field in line:
            found.setdefault(line["peer"], []).append(line[field])
    return {name: statistics.median(values) for name, values in found.items()}


def short(value):
    """A number with three figures or a few more."""
    return f"{value:.{0 if value >= 100 else 1 if value >= 10 else 2}f}"


def rows(ours, lines):
    """The table: what, Étude's figure, and the name, figure and ratio of a peer."""
    table = [["what", "Étude", "peer", "peer's", "ratio"]]
    middle = {key: statistics.median(turn[key] for turn in ours) for key in ours[0] if is_number(ours[0][key])}
    peers_of = plan(ours[0]["cores"])
    for row in ours[0]["rows"]:
        key, unit = row["key"], row["unit"]
        if key == "bare_steps_per_sec":  # A peer of the environment.
            continue
        field, peers = peers_of.get(key, ("", []))
        theirs = {"the bare mj_step calls": middle["bare_steps_per_sec"]} if key == "env_steps_per_sec" else {}
        theirs |= medians([line for peer in peers for line in lines.get(peer, [])], field)
        figure = middle.get(key)
        what = row["what"].replace("the same in bf16,", "the same in bf16 (peers: f32),")
        cells = [what, "unknown" if figure is None else f"{short(figure)} {unit}"]
        for name, value in theirs.items():
            # Seconds and memory are better when they are fewer.
            ratio = None if figure is None else figure / value if unit.endswith("/s") else value / figure
            table.append([*cells, name, short(value), "unknown" if ratio is None else f"{ratio:.2f}"])
            cells = ["", ""]
        if not theirs:
            table.append([*cells, "", "", ""])
    return table


def is_number(value):
    return isinstance(value, (int, float))


def report(ours, lines, failed):
    """The Markdown text."""
    table = rows(ours, lines)
    widths = [max(map(len, column)) for column in zip(*table)]
    table.insert(1, ["-" * width for width in widths])
    text = [f"Machine: {ours[0]['machine']}", ""]
    for cells in table:
        aligned = zip(cells, "<><>>", widths)
        text.append("| " + " | ".join(f"{cell:{side}{width}}" for cell, side, width in aligned) + " |")
    overhead = statistics.median(turn["env_overhead"] for turn in ours)
    text += [
        "",
        f"The environment takes {100 * overhead:.1f} % more time than its mj_step calls.",
        "Peers are kept to the first N processors, since not all of them count threads; Étude has N threads.",
    ]
    text += [f"{script} {threads} did not run: {reason}" for (script, threads), reason in failed.items()]
    return "\n".join(text)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--secs", type=float, default=5.0, help="seconds for each measurement, all turns together")
    parser.add_argument("--turns", type=int, default=3, help="how often everything is measured")
    release = HERE.parent / "target" / "release"
    parser.add_argument("--release", type=pathlib.Path, default=release, help="folder with etude, examples/bench and examples/trace")
    arguments = parser.parse_args()
    print(report(*measure(arguments.release, arguments.secs, arguments.turns)))


if __name__ == "__main__":
    main()
