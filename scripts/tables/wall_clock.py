"""How late commands and the hand's loop are by the wall clock while every core is busy."""

import contextlib
import ctypes
import json
import multiprocessing
import os
import pathlib
import subprocess
import tempfile
import threading
import time

from tables.common import ETUDE, Stopped, argument, command, runs

GOAL_MS = 1.0
# One sleep of the probe, s.
SLEEP_SECS = 0.003
# Étude's highest is 51.
PRIORITY = 90
# Sleeps as long as a run of the song.
PART = 11_000
MCL_CURRENT_AND_FUTURE = 3


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


def pages(recording, folder, over):
    """Makes pages until it is over."""
    while not over.is_set():
        subprocess.run([ETUDE, "replay", recording, "-o", folder / "page.html"], capture_output=True)
        over.wait(1.0)


def p999(values):
    """The 99.9th percentile."""
    return sorted(values)[len(values) * 999 // 1000]


def probe(core, over, results):
    """Sleeps again and again on one core; gives how late it woke up each time, ms, or why not."""
    try:
        os.sched_setaffinity(0, [core])
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except OSError as error:
        return results.put((core, str(error)))
    ctypes.CDLL(None).mlockall(MCL_CURRENT_AND_FUTURE)
    late = []
    while not over.is_set():
        begun = time.monotonic()
        time.sleep(SLEEP_SECS)
        late.append((time.monotonic() - begun - SLEEP_SECS) * 1e3)
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


@contextlib.contextmanager
def busy(cores, folder, rig_file):
    """Learns one song a core and makes pages of a recording beside a twin."""
    with contextlib.ExitStack() as stack:
        stack.enter_context(running([ETUDE, "twin", "-o", rig_file.parent], folder / "twin.log"))
        for _ in range(100):
            if rig_file.exists():
                break
            time.sleep(0.1)
        else:
            raise Stopped(f"the twin did not start: see {folder / 'twin.log'}")
        subprocess.run([ETUDE, "play", "twinkle", "-o", folder / "played"], check=True, capture_output=True)
        recording = next((folder / "played" / "latest").glob("*.mcap"))
        for core in range(cores):
            train = [ETUDE, "train", "twinkle", "--set", f"trainer.seed={core}", "--set", "trainer.threads=1"]
            train += ["--set", "trainer.total_steps=100_000_000", "-o", folder / f"learning-{core}"]
            stack.enter_context(running(train, folder / f"learning-{core}.log"))
        over = threading.Event()
        other = threading.Thread(target=pages, args=(recording, folder, over))
        other.start()
        stack.callback(other.join)
        stack.callback(over.set)
        yield


@command(
    "ten-minutes",
    runs(18),
    argument("--song", default="are-you-sleeping"),
    argument("-o", "--out", type=pathlib.Path, help="keeps report, recordings and logs here"),
)
def ten_minutes(options):
    """How late commands and the hand's loop are in ten minutes on a loaded machine.

    Serves a twin and plays the song on it again and again in real execution. Beside that it learns
    one song a core and makes pages. The exit code is 0 if no run ended early, no command missed its
    deadline (50 ms) and 99.9 % of the hand's periods are less than 1 ms over their median.

    What the machine itself allows is measured in the same minutes: on each core a process with a
    higher real-time priority than all of Étude sleeps for 3 ms and notes how late it wakes up.
    """
    cores, machine = os.cpu_count() or 1, []
    with contextlib.ExitStack() as stack:
        folder = options.out or pathlib.Path(stack.enter_context(tempfile.TemporaryDirectory()))
        folder = folder.resolve()
        folder.mkdir(parents=True, exist_ok=True)
        rig_file = folder / "twin" / "twin.toml"
        stack.enter_context(busy(cores, folder, rig_file))
        stack.enter_context(probes(cores, machine))
        perform = [ETUDE, "perform", options.song, "--robot", rig_file, "--home", "--runs", str(options.runs)]
        begun = time.monotonic()
        done = subprocess.run([*perform, "--json", "-o", folder / "performance"], capture_output=True, text=True)
        minutes = (time.monotonic() - begun) / 60
    if not done.stdout.strip():
        raise Stopped(f"`etude perform` failed: {done.stderr.strip()}")
    runs = json.loads(done.stdout)["runs"]
    whole = sum(run["steps"][0] == run["steps"][1] for run in runs)
    timing = [run["timing"] for run in runs]
    commands, missed, late = (sum(run[key] for run in timing) for key in ["commands", "missed", "late"])
    greatest = lambda key: max(run[key] for run in timing)
    over_ms = sorted(run["hand_late_p999_ms"] for run in timing)
    print(f"{minutes:.1f} minutes beside {cores} trainings: {whole} of {options.runs} runs complete")
    print(
        f"commands: {commands}, {missed} missed their deadline, {late} came later than one set-point, "
        f"worst {greatest('late_worst_ms'):.1f} ms"
    )
    print(
        f"hand's period over its median, p99.9 of each run: {over_ms[0]:.1f} to {over_ms[-1]:.1f} ms, "
        f"median {over_ms[len(over_ms) // 2]:.1f} ms; worst {greatest('hand_late_worst_ms'):.1f} ms"
    )
    for core, late in machine:
        if isinstance(late, str):
            print(f"a timer alone on core {core}: not measured ({late})")
            continue
        parts = sorted(p999(late[at : at + PART]) for at in range(0, max(1, len(late) - PART // 2), PART))
        print(
            f"a timer alone on core {core}, priority {PRIORITY}: late by p99.9 of each {PART * SLEEP_SECS:.0f} s "
            f"{parts[0]:.1f} to {parts[-1]:.1f} ms, median {parts[len(parts) // 2]:.1f} ms; worst {max(late):.1f} ms"
        )
    if done.returncode != 0:
        print(f"it ended with code {done.returncode}: {done.stderr.strip()}")
    return int(not (done.returncode == 0 and whole == options.runs and missed == 0 and over_ms[-1] < GOAL_MS))
