"""Builds the Python package as a wheel, installs it into a virtual environment, and tests it there.

    python_package.py wheel  an optimised wheel in target/wheels
    python_package.py test   a wheel in target/wheels-test, in .venv; types and python/tests
    python_package.py sb3    the tests that need Stable-Baselines3 and SBX: six gigabytes in
                             target/venv-sb3, which is removed

Safe to repeat; `.venv` is made anew when the packages that it should hold have changed.
"""

import os
import pathlib
import shutil
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
REQUIREMENTS = ROOT / "scripts" / "package-requirements.txt"
SB3 = ROOT / "scripts" / "sb3-requirements.txt"
VENV = ROOT / ".venv"
STAMP = VENV / ".installed"
PYTHON = VENV / "bin" / "python"


def run(*command, **keywords):
    if subprocess.run([str(part) for part in command], **keywords).returncode != 0:
        sys.exit(f"python package: `{pathlib.Path(command[0]).name} {command[1]} …` has failed; its message is above")


def pip(*arguments):
    run(PYTHON, "-m", "pip", "--quiet", "--disable-pip-version-check", *arguments)


def fresh_venv(folder, *packages):
    """An environment with only these packages; returns its Python."""
    if subprocess.run([sys.executable, "-m", "venv", "--clear", str(folder)]).returncode != 0:
        sys.exit("python package: Python cannot make virtual environments (Debian, Ubuntu: apt-get install -y python3-venv)")
    python = folder / "bin" / "python"
    run(python, "-m", "pip", "--quiet", "--disable-pip-version-check", "install", *packages)
    return python


def make_venv():
    wanted = REQUIREMENTS.read_text() + sys.version
    if not STAMP.is_file() or STAMP.read_text() != wanted:
        fresh_venv(VENV, "--requirement", REQUIREMENTS)
        STAMP.write_text(wanted)


def build(out, *options, python=PYTHON):
    shutil.rmtree(out, ignore_errors=True)
    # Not a manylinux wheel: the library that it needs is in the package `mujoco`, which auditwheel
    # does not know.
    run(
        python, "-m", "maturin", "build", "--manifest-path", ROOT / "python" / "Cargo.toml", "--locked", "--out", out,
        "--compatibility", "linux", "--auditwheel", "skip", "--interpreter", python, *options, cwd=ROOT,
    )
    return next(out.glob("*.whl"))


SMOKE = """
import gymnasium, etude
from gymnasium.utils.env_checker import check_env
env = gymnasium.make("etude/Twinkle-v0")
check_env(env.unwrapped, skip_render_check=True)
envs = gymnasium.make_vec("etude/Twinkle-v0", num_envs=2, vectorization_mode="vector_entry_point")
envs.reset(seed=0)
envs.step(envs.action_space.sample())
policy = etude.load_policy("twinkle")
env = etude.PianoEnv("twinkle", config=policy.task)
print("fresh environment:", policy.song, policy.act(env.reset(seed=0)[0]).shape)
"""


def try_fresh(wheel):
    """Installs the wheel into an empty environment, with only the dependencies that it declares."""
    fresh = ROOT / "target" / "venv-fresh"
    python = fresh_venv(fresh, wheel)
    run(python, "-W", "ignore", "-c", SMOKE, cwd=ROOT / "target")
    shutil.rmtree(fresh)


def test():
    wheel = build(ROOT / "target" / "wheels-test", "--profile", "dev")
    try_fresh(wheel)
    pip("install", "--force-reinstall", "--no-deps", wheel)
    pip("install", wheel)
    config = ROOT / "python" / "pyproject.toml"
    run(PYTHON, "-m", "mypy", cwd=config.parent)
    run(PYTHON, "-m", "mypy.stubtest", "etude._native", "--mypy-config-file", config, cwd=ROOT / "target")
    debug = ROOT / "target" / "debug"
    os.environ.setdefault("ETUDE_COMMAND", str(debug / "etude"))
    os.environ.setdefault("ETUDE_EPISODE", str(debug / "examples" / "episode"))
    # In another folder, so that the installed package is tested and not the sources.
    run(PYTHON, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--import-mode=append", ROOT / "python" / "tests", cwd=ROOT / "target")


def test_sb3():
    wheel = build(ROOT / "target" / "wheels-test", "--profile", "dev")
    venv = ROOT / "target" / "venv-sb3"
    python = fresh_venv(venv, "--no-cache-dir", "--constraint", REQUIREMENTS, "--requirement", SB3, "pytest", "hypothesis", "mypy", wheel)
    run(python, "-m", "mypy", cwd=ROOT / "python")
    tests = [ROOT / "python" / "tests" / name for name in ("test_sb3.py", "test_examples.py")]
    run(python, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--import-mode=append", *tests, cwd=ROOT / "target")
    shutil.rmtree(venv)


def wheel():
    """Needs nothing but maturin, which runs on every Python that the wheel is for."""
    venv = ROOT / "target" / "venv-wheel"
    maturin = next(line for line in REQUIREMENTS.read_text().splitlines() if line.startswith("maturin=="))
    python = fresh_venv(venv, maturin)
    print(f"wheel: {build(ROOT / 'target' / 'wheels', '--release', python=python)}")


def main():
    # pip takes packages there for installed.
    os.environ.pop("PYTHONPATH", None)
    what = sys.argv[1:]
    if what == ["wheel"]:
        wheel()
    elif what in (["test"], ["sb3"]):
        make_venv()
        test() if what == ["test"] else test_sb3()
    else:
        sys.exit(__doc__)


if __name__ == "__main__":
    main()
