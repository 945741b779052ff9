"""Installs the pinned Python packages that the tests compare with into .python/. Safe to repeat."""

import pathlib
import shutil
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
REQUIREMENTS = ROOT / "scripts" / "test-requirements.txt"
TARGET = ROOT / ".python"
STAMP = TARGET / ".installed"


def main():
    wanted = REQUIREMENTS.read_text() + sys.version
    if STAMP.is_file() and STAMP.read_text() == wanted:
        return
    shutil.rmtree(TARGET, ignore_errors=True)
    command = [
        sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check",
        "--root-user-action=ignore", "--target", str(TARGET), "--requirement", str(REQUIREMENTS),
    ]
    if subprocess.run(command).returncode != 0:
        sys.exit("test: pip could not install the packages that the tests compare with (its message is above)")
    STAMP.write_text(wanted)


if __name__ == "__main__":
    main()
