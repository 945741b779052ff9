"""Puts MuJoCo into .mujoco/ from its pinned Python wheel, hash checked. Safe to repeat."""

import os
import pathlib
import platform
import shutil
import subprocess
import sys
import tempfile
import zipfile

VERSION = "3.17.0"
ROOT = pathlib.Path(__file__).resolve().parent.parent
TARGET = ROOT / ".mujoco"
LIBRARY = f"libmujoco.so.{VERSION}"


def fail(message):
    sys.exit(f"setup: {message}")


def wheel_platform():
    machine = platform.machine()
    if sys.platform != "linux" or machine not in ("x86_64", "aarch64"):
        fail(f"MuJoCo is fetched for Linux on x86_64 or aarch64; this is {sys.platform} on {machine}")
    return f"manylinux_2_28_{machine}"


def download(folder):
    # One fixed wheel for any Python version: the library in it does not depend on the interpreter.
    command = [
        sys.executable, "-m", "pip", "download", "--quiet", "--disable-pip-version-check",
        "--no-deps", "--only-binary=:all:", "--require-hashes",
        "--implementation", "cp", "--python-version", "3.12", "--platform", wheel_platform(),
        "--dest", str(folder), "--requirement", str(ROOT / "scripts" / "mujoco-requirements.txt"),
    ]
    try:
        subprocess.run(command, check=True)
    except subprocess.CalledProcessError:
        fail("pip could not fetch the MuJoCo wheel (its message is above); check the network, then run `make setup` again")
    return next(folder.glob("mujoco-*.whl"))


def unpack(wheel, folder):
    (folder / "lib").mkdir()
    with zipfile.ZipFile(wheel) as archive:
        for name in archive.namelist():
            if name == f"mujoco/{LIBRARY}":
                destination = folder / "lib" / LIBRARY
            elif name.startswith("mujoco/include/mujoco/mj") and name.endswith(".h"):
                destination = folder / "include" / "mujoco" / pathlib.Path(name).name
            elif ".dist-info/licenses/" in name and not name.endswith("/"):
                destination = folder / pathlib.Path(name).name
            else:
                continue
            destination.parent.mkdir(parents=True, exist_ok=True)
            with archive.open(name) as source, open(destination, "wb") as out:
                shutil.copyfileobj(source, out)
    if not (folder / "lib" / LIBRARY).is_file():
        fail(f"the wheel holds no {LIBRARY}")
    os.symlink(LIBRARY, folder / "lib" / "libmujoco.so")


def main():
    if (TARGET / "lib" / LIBRARY).is_file():
        print(f"setup: MuJoCo {VERSION} is in .mujoco/")
        return
    if subprocess.run([sys.executable, "-m", "pip", "--version"], capture_output=True).returncode != 0:
        fail("this Python has no pip; install it (Debian, Ubuntu: apt-get install -y python3-pip), then run `make setup` again")
    # Written beside the target and then renamed, so that an interrupted set-up leaves no incomplete
    # folder.
    with tempfile.TemporaryDirectory(dir=ROOT, prefix=".mujoco-") as scratch:
        scratch = pathlib.Path(scratch)
        wheel = download(scratch)
        tree = scratch / "tree"
        tree.mkdir()
        unpack(wheel, tree)
        if TARGET.exists():
            shutil.rmtree(TARGET)
        tree.rename(TARGET)
    print(f"setup: MuJoCo {VERSION} unpacked into .mujoco/")


if __name__ == "__main__":
    main()
