"""The examples run."""

import pathlib
import re
import subprocess
import sys

import pytest

EXAMPLES = pathlib.Path(__file__).resolve().parent.parent / "examples"


def run(name, *arguments):
    command = [sys.executable, EXAMPLES / name, *map(str, arguments)]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def test_the_readme_plays_the_song():
    text = (EXAMPLES.parent / "README.md").read_text()
    code = text.split("```python\n")[1].split("```")[0]
    said = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout
    assert float(said.split()[0]) > 0.99, said


def test_random_shooting_plans_with_states():
    said = run("random_shooting.py", "c-major-scale", "--steps", 4, "--tries", 8, "--horizon", 3)
    assert re.search(r"F1 \d\.\d+ after 4 of \d+ control steps", said), said


def test_sbx_trains_through_the_adapter(short_song, tmp_path):
    # `make test-sb3` has it.
    pytest.importorskip("sbx")
    said = run("sbx_droq.py", short_song, "--steps", 6000, "--envs", 4, "--every", 2000, "--curve", tmp_path / "curve.csv")
    assert "best F1" in said
    assert len((tmp_path / "curve.csv").read_text().splitlines()) >= 3
