"""Builds the Python package as a wheel, installs it into a virtual environment of its own, and runs its tests there.

    python_package.py wheel     an optimised wheel in target/wheels
    python_package.py test      a wheel in target/wheels-test, installed into .venv; its types, and python/tests

Safe to repeat; `.venv` is made anew when the packages that it should hold have changed.
"""

import os
import pathlib
import shutil
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
REQUIREMENTS = ROOT / "scripts" / "package-requirements.txt"
VENV = ROOT / ".venv"
STAMP = VENV / ".installed"
PYTHON = VENV / "bin" / "python"


def run(*command, **keywords):
    if subprocess.run([str(part) for part in command], **keywords).returncode != 0:
        sys.exit(f"python package: `{pathlib.Path(command[0]).name} {command[1]} …` has failed; its message is above")


def pip(*arguments):
    run(PYTHON, "-m", "pip", "--quiet", "--disable-pip-version-check", *arguments)


def make_venv():
    wanted = REQUIREMENTS.read_text() + sys.version
    if STAMP.is_file() and STAMP.read_text() == wanted:
        return
    shutil.rmtree(VENV, ignore_errors=True)
    if subprocess.run([sys.executable, "-m", "venv", str(VENV)]).returncode != 0:
        sys.exit("python package: Python cannot make virtual environments (Debian, Ubuntu: apt-get install -y python3-venv)")
    pip("install", "--requirement", REQUIREMENTS)
    STAMP.write_text(wanted)


def build(out, *options):
    shutil.rmtree(out, ignore_errors=True)
    # Not a manylinux wheel: the library that it needs is in the package `mujoco`, which auditwheel does not know.
    run(
        PYTHON, "-m", "maturin", "build", "--manifest-path", ROOT / "python" / "Cargo.toml", "--locked", "--out", out,
        "--compatibility", "linux", "--auditwheel", "skip", "--interpreter", PYTHON, *options, cwd=ROOT,
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
print("fresh environment:", policy.song, policy.act(env.reset(seed=0)[0]).shape)
"""


def try_fresh(wheel):
    """Installs the wheel into an environment that has nothing, where only what it says it needs comes along."""
    fresh = ROOT / "target" / "venv-fresh"
    run(sys.executable, "-m", "venv", "--clear", fresh)
    python = fresh / "bin" / "python"
    run(python, "-m", "pip", "--quiet", "--disable-pip-version-check", "install", wheel)
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
    # Away from the sources: what is tested is what was installed.
    run(PYTHON, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--import-mode=append", ROOT / "python" / "tests", cwd=ROOT / "target")


def main():
    what = sys.argv[1:]
    if what not in (["wheel"], ["test"]):
        sys.exit(__doc__)
    make_venv()
    if what == ["test"]:
        test()
    else:
        print(f"wheel: {build(ROOT / 'target' / 'wheels', '--release')}")


if __name__ == "__main__":
    main()
