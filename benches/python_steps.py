#!/usr/bin/env python3
"""Control steps a second through the Python package and in Rust alone, in turns, under random actions on
Twinkle.

    benches/python_steps.py [--rounds N] [--secs S]

Run it by a Python that has the wheel (`make wheel`), beside `target/release/examples/steps`
(`cargo build --release -p etude-task --example steps`), which does the same in Rust: the same
actions, environments and threads, episodes that begin anew at once. The medians of the rounds, and the median of the
rounds' ratios, are printed as JSON.
"""

import argparse
import json
import os
import pathlib
import statistics
import subprocess
import tempfile
import time

import gymnasium
import numpy as np

import etude

STEPS = pathlib.Path(__file__).resolve().parent.parent / "target/release/examples/steps"


def singly(actions, secs):
    """A single environment through `gymnasium.make`, its wrappers included."""
    env = gymnasium.make("etude/Twinkle-v0")
    env.reset(seed=0)
    began, steps = time.perf_counter(), 0
    while time.perf_counter() - began < secs:
        if env.step(actions[steps % len(actions)][0])[3]:
            env.reset()
        steps += 1
    return steps / (time.perf_counter() - began)


def together(actions, threads, secs):
    """A vector."""
    num_envs = actions.shape[1]
    envs = etude.PianoVectorEnv(num_envs, "twinkle", threads=threads)
    envs.reset(seed=0)
    began, rounds = time.perf_counter(), 0
    while time.perf_counter() - began < secs:
        envs.step(actions[rounds % len(actions)])
        rounds += 1
    return rounds * num_envs / (time.perf_counter() - began)


def rust(actions, threads, secs):
    """The same in Rust."""
    with tempfile.NamedTemporaryFile() as file:
        actions.astype("<f4").tofile(file.name)
        command = [STEPS, "twinkle", str(actions.shape[1]), str(threads), str(secs), file.name]
        return float(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--secs", type=float, default=5.0)
    arguments = parser.parse_args()
    cores = len(os.sched_getaffinity(0))
    for name, num_envs, threads in [
        ("one environment, gymnasium.make", 1, 1),
        ("8 environments, 1 thread", 8, 1),
        (f"{4 * cores} environments, {cores} threads", 4 * cores, cores),
        (f"{32 * cores} environments, {cores} threads", 32 * cores, cores),
    ]:
        actions = np.random.default_rng(0).uniform(-1, 1, (200, num_envs, 13)).astype(np.float32)
        python = singly if num_envs == 1 else lambda actions, secs: together(actions, threads, secs)
        rates = [
            (python(actions, arguments.secs), rust(actions, threads, arguments.secs)) for _ in range(arguments.rounds)
        ]
        ours, theirs = (statistics.median(column) for column in zip(*rates))
        ratios = sorted(one / other for one, other in rates)
        print(json.dumps({
            "what": name,
            "python_steps_per_sec": round(ours),
            "rust_steps_per_sec": round(theirs),
            "ratio": round(statistics.median(ratios), 3),
            "ratios": [round(ratio, 3) for ratio in ratios],
        }), flush=True)


if __name__ == "__main__":
    main()
