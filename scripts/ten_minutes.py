#!/usr/bin/env python3
"""Plays by the wall clock for ten minutes while every core is busy, and prints how late commands and the hand's loop were.

   ten_minutes.py ETUDE [--runs 18] [--song are-you-sleeping] [-o DIR]

ETUDE is the built program. It serves a twin (`etude twin`), plays the song on it again and again in real execution with a recording
(`etude perform`), and beside that learns one song a core (`etude train`) and makes pages of a recording (`etude replay`) until the last
run is over. The exit code is 0 if no run was cut short, no command missed its deadline (50 ms) and the hand's period is less than 1 ms over its
median in 99.9 % of all periods; 1 if not.

What the machine itself allows is measured in the same minutes: on each core a process of this script, with a higher real-time priority than
everything of Etude, does nothing but sleep for 3 ms and note how late it wakes up.
"""

import argparse
import contextlib
import ctypes
import json
import multiprocessing
import os
import pathlib
import subprocess
import sys
import tempfile
import threading
import time

GOAL_MS = 1.0
# One sleep of the probe, s, its priority (Etude's highest is 51), and the sleeps in one part: as long as a run of the song.
SLEEP = 0.003
PRIORITY = 90
PART = 11_000
LOCK_ALL = 3


@contextlib.contextmanager
def running(command, log):
    """A program that is ended by SIGTERM when the block is over."""
    with open(log, "w") as file:
        process = subprocess.Popen(command, stdout=file, stderr=subprocess.STDOUT)
    try:
        yield process
    finally:
        process.terminate()
        process.wait(30)


def pages(etude, recording, folder, over):
    """Makes pages until it is over."""
    while not over.is_set():
        subprocess.run([etude, "replay", recording, "-o", folder / "page.html"], capture_output=True)
        over.wait(1.0)


def p999(values):
    """The 99.9th percentile."""
    return sorted(values)[len(values) * 999 // 1000]


def probe(core, over, results):
    """Sleeps again and again on one core; then gives how late it woke up each time, ms, or why it cannot be said."""
    try:
        os.sched_setaffinity(0, [core])
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except OSError as error:
        return results.put((core, str(error)))
    ctypes.CDLL(None).mlockall(LOCK_ALL)
    late = []
    while not over.is_set():
        begun = time.monotonic()
        time.sleep(SLEEP)
        late.append((time.monotonic() - begun - SLEEP) * 1e3)
    results.put((core, late))


@contextlib.contextmanager
def probes(cores, found):
    """A probe on each core until the block is over; adds what they have measured to `found`."""
    over, results = multiprocessing.Event(), multiprocessing.Queue()
    processes = [multiprocessing.Process(target=probe, args=(core, over, results)) for core in range(cores)]
    for process in processes:
        process.start()
    try:
        yield
    finally:
        over.set()
        found.extend(sorted(results.get() for _ in processes))
        for process in processes:
            process.join()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("etude", type=pathlib.Path)
    parser.add_argument("--runs", type=int, default=18)
    parser.add_argument("--song", default="are-you-sleeping")
    parser.add_argument("-o", "--out", type=pathlib.Path, help="keeps report, recordings and logs here")
    args = parser.parse_args()
    etude = args.etude.resolve()
    with contextlib.ExitStack() as stack:
        folder = args.out or pathlib.Path(stack.enter_context(tempfile.TemporaryDirectory()))
        folder = folder.resolve()
        folder.mkdir(parents=True, exist_ok=True)
        stack.enter_context(running([etude, "twin", "-o", folder / "twin"], folder / "twin.log"))
        rig = folder / "twin" / "twin.toml"
        for _ in range(100):
            if rig.exists():
                break
            time.sleep(0.1)
        else:
            sys.exit(f"the twin did not start: see {folder / 'twin.log'}")
        subprocess.run([etude, "play", "twinkle", "-o", folder / "played"], check=True, capture_output=True)
        recording = next((folder / "played").glob("*.mcap"))
        cores = os.cpu_count() or 1
        for core in range(cores):
            train = [etude, "train", "twinkle", "--set", f"trainer.seed={core}", "--set", "trainer.threads=1"]
            train += ["--set", "trainer.total_steps=100_000_000", "-o", folder / f"learning-{core}"]
            stack.enter_context(running(train, folder / f"learning-{core}.log"))
        machine = []
        stack.enter_context(probes(cores, machine))
        over = threading.Event()
        other = threading.Thread(target=pages, args=(etude, recording, folder, over))
        other.start()
        stack.callback(other.join)
        stack.callback(over.set)
        perform = [etude, "perform", args.song, "--robot", rig, "--home", "--runs", str(args.runs), "--json"]
        begun = time.monotonic()
        done = subprocess.run([*perform, "-o", folder / "performance"], capture_output=True, text=True)
        minutes = (time.monotonic() - begun) / 60
    if not done.stdout.strip():
        sys.exit(f"`etude perform` failed: {done.stderr.strip()}")
    report = json.loads(done.stdout)
    runs = report["runs"]
    whole = sum(run["steps"][0] == run["steps"][1] for run in runs)
    timing = [run["timing"] for run in runs]
    commands, missed, late = (sum(run[key] for run in timing) for key in ["commands", "missed", "late"])
    greatest = lambda key: max(run[key] for run in timing)
    over_ms = sorted(run["hand_late_p999_ms"] for run in timing)
    print(f"{minutes:.1f} minutes beside {cores} trainings: {whole} of {args.runs} runs complete")
    print(f"commands: {commands}, {missed} missed their deadline, {late} came later than one set-point, worst {greatest('late_worst_ms'):.1f} ms")
    print(
        f"hand's period over its median, p99.9 of each run: {over_ms[0]:.1f} to {over_ms[-1]:.1f} ms, median "
        f"{over_ms[len(over_ms) // 2]:.1f} ms; worst {greatest('hand_late_worst_ms'):.1f} ms"
    )
    for core, late in machine:
        if isinstance(late, str):
            print(f"a timer alone on core {core}: not measured ({late})")
            continue
        parts = sorted(p999(late[at : at + PART]) for at in range(0, max(1, len(late) - PART // 2), PART))
        print(
            f"a timer alone on core {core}, priority {PRIORITY}: late by p99.9 of each {PART * SLEEP:.0f} s {parts[0]:.1f} to {parts[-1]:.1f} ms, "
            f"median {parts[len(parts) // 2]:.1f} ms; worst {max(late):.1f} ms"
        )
    if done.returncode != 0:
        print(f"it ended with code {done.returncode}: {done.stderr.strip()}")
    sys.exit(not (done.returncode == 0 and whole == args.runs and missed == 0 and over_ms[-1] < GOAL_MS))


if __name__ == "__main__":
    main()
