#!/usr/bin/env python3
"""Checks that two builds of `etude` do the same: same_bytes.py BEFORE AFTER [--songs NAME...].

Both play every built-in song with its shipped policy, in simulation and in the three execution
modes on the twin, and train shortly with every preset. Every message of every recording must be the
same, byte for byte, except `/header`; so must every file of a checkpoint. Prints what differs and
exits with 1 then.
"""

import argparse
import hashlib
import struct
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
MODES = ["joint-mirroring", "hybrid", "real"]
TRAININGS = {"fast": 2500, "expressive": 2500, "paper": 1500, "appendix": 1500, "sight-reader": 2500}
TRAINED = ["policy-best.safetensors", "policy-last.safetensors", "checkpoints"]

# Records of the MCAP format: one byte of opcode, eight of length, then the content (mcap.dev/spec).
SCHEMA, CHANNEL, MESSAGE, CHUNK = 0x03, 0x04, 0x05, 0x06


def records(data: bytes):
    at = 0
    while at + 9 <= len(data):
        opcode, length = data[at], struct.unpack_from("<Q", data, at + 1)[0]
        yield opcode, data[at + 9 : at + 9 + length]
        at += 9 + length


def messages(path: Path):
    """Topic, log time and content of every message, in the order of the file, without headers."""
    data = path.read_bytes()
    magic = b"\x89MCAP0\r\n"
    assert data.startswith(magic), f"{path} is not MCAP"
    topics: dict[int, str] = {}
    found = []

    def take(opcode: int, content: bytes):
        if opcode == CHANNEL:
            channel, _schema, length = struct.unpack_from("<HHI", content)
            topics[channel] = content[8 : 8 + length].decode()
        elif opcode == MESSAGE:
            channel, _sequence, log_time, _publish_time = struct.unpack_from("<HIQQ", content)
            if topics[channel] != "/header":
                found.append((topics[channel], log_time, content[22:]))
        elif opcode == CHUNK:
            (length,) = struct.unpack_from("<I", content, 28)
            assert length == 0, "chunks are written without compression"
            for inner in records(content[40 + length :]):
                take(*inner)

    for record in records(data[len(magic) : -len(magic)]):
        take(*record)
    return found


def run(program: Path, arguments: list[str]):
    command = [str(program), *arguments]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    if done.returncode not in (0, 3):
        sys.exit(f"{' '.join(command)} ended with {done.returncode}:\n{done.stderr}")


def recording_in(folder: Path) -> Path:
    """The one recording of a performance, in whichever folder below."""
    return next(folder.rglob("*.mcap"))


def differences(name: str, before: list, after: list):
    for index, (a, b) in enumerate(zip(before, after)):
        if a != b:
            return f"{name}: message {index} differs: {a[0]} at {a[1] * 1e-9} s, {b[0]} at {b[1] * 1e-9} s"
    if len(before) != len(after):
        return f"{name}: {len(before)} messages before, {len(after)} after"
    return None


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("before", type=Path)
    parser.add_argument("after", type=Path)
    parser.add_argument("--songs", nargs="*", default=sorted(p.stem for p in (ROOT / "policies").glob("*.safetensors")))
    arguments = parser.parse_args()
    programs = {"before": arguments.before.resolve(), "after": arguments.after.resolve()}
    wrong, same = [], 0
    with tempfile.TemporaryDirectory() as scratch:
        for song in arguments.songs:
            policy = ["--policy", f"policies/{song}.safetensors"]
            for mode in ["simulation", *MODES]:
                found = {}
                for which, program in programs.items():
                    out = Path(scratch) / which / song / mode
                    if mode == "simulation":
                        run(program, ["play", song, *policy, "-o", str(out)])
                        found[which] = messages(recording_in(out))
                    else:
                        run(program, ["perform", song, *policy, "--robot", "twin", "--mode", mode, "-o", str(out)])
                        found[which] = messages(recording_in(out))
                difference = differences(f"{song}, {mode}", found["before"], found["after"])
                wrong += [difference] if difference else []
                same += not difference
                print(difference or f"{song}, {mode}: {len(found['before'])} messages are the same", flush=True)
        for preset, steps in TRAININGS.items():
            hashes = {}
            for which, program in programs.items():
                out = Path(scratch) / which / f"train-{preset}"
                run(program, ["train", "twinkle", "--preset", preset, "--set", f"trainer.total_steps={steps}", "--out", str(out)])
                files = [p for name in TRAINED for p in ([out / name] if (out / name).is_file() else sorted((out / name).rglob("*"))) if p.is_file()]
                hashes[which] = {str(p.relative_to(out)): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}
            different = sorted(f for f in hashes["before"].keys() | hashes["after"].keys() if hashes["before"].get(f) != hashes["after"].get(f))
            wrong += [f"training, {preset}: {f} differs" for f in different]
            same += not different
            print("\n".join(f"training, {preset}: {f} differs" for f in different) or f"training, {preset}: {len(hashes['before'])} files are the same", flush=True)
    print(f"{same} passed, {len(wrong)} failed")
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
