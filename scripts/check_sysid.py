#!/usr/bin/env python3
"""Solves a problem of crates/identify with MuJoCo's own system identification toolbox and compares the answers.

    cargo run --release -p etude-identify --example outside -- FOLDER
    scripts/check_sysid.py [--venv] FOLDER

The example writes the problem and our answer; FOLDER says nothing of how we came by it. The toolbox (`mujoco.sysid`) gets
the same model, references, readings, start and bounds, and does everything else itself: models, rollouts, slopes, steps,
intervals. Prints Markdown; exits with 1 if the answers differ. `--venv` puts what the toolbox needs into a throw-away virtual
environment first (SYSID_VENV names its folder) and runs there.
"""

import contextlib
import json
import os
import pathlib
import subprocess
import sys
import time

MUJOCO = "3.17.0"
PACKAGES = [
    f"mujoco=={MUJOCO}", "numpy==2.4.6", "scipy==1.17.1", "absl-py==2.5.1", "colorama==0.4.6", "pyyaml==6.0.3",
    "tabulate==0.10.0",
]

# The model with the true numbers must do what our simulator did, rad.
SAME_MOTION = 1e-9
# How far the answers may be apart, in standard errors; and their costs: such a step costs half its square.
SAME_VALUE = 0.1
SAME_COST = 0.5 * SAME_VALUE**2
# Factor between the standard errors.
SAME_ERROR = 1.25

# The toolbox's optimisers: its default, the same with the scaling that it advises for ill-conditioned problems, and SciPy's.
WAYS = {
    "`mujoco` (default)": {},
    "`mujoco`, `x_scale='jac'`": {"x_scale": "jac"},
    "`scipy`, `x_scale='jac'`": {"optimizer": "scipy", "x_scale": "jac"},
}


def run_in_venv():
    """Makes the environment unless it is there, and starts this script anew in it."""
    folder = pathlib.Path(os.environ.get("SYSID_VENV", "/tmp/venv-sysid"))
    python, unfinished = folder / "bin/python", folder / "unfinished"
    if not python.exists() or unfinished.exists():
        subprocess.run([sys.executable, "-m", "venv", "--clear", folder], check=True)
        unfinished.touch()
        subprocess.run([python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *PACKAGES], check=True)
        unfinished.unlink()
    os.execv(python, [str(python), *(argument for argument in sys.argv if argument != "--venv")])


if __name__ == "__main__" and "--venv" in sys.argv[1:]:
    run_in_venv()

import mujoco
import numpy as np
from mujoco import sysid

STATE = mujoco.mjtState.mjSTATE_FULLPHYSICS


def modifier(row):
    """Writes one number into the toolbox's editable model."""
    joint, quantity = row["joint"], row["quantity"]

    def write(spec, parameter):
        value = parameter.value[0]
        match quantity:
            case "stiffness":
                sysid.apply_pgain(spec, joint, value)
            case "damping":
                sysid.apply_dgain(spec, joint, value)
            case "armature":
                spec.joint(joint).armature = value
            case "friction":
                spec.joint(joint).frictionloss = value

    return write


class Problem:
    """The problem in the toolbox's terms."""

    def __init__(self, folder):
        self.problem = json.loads((folder / "problem.json").read_text())
        rows, joints, fitted = (self.problem[key] for key in ("parameters", "joints", "fitted"))
        spec = mujoco.MjSpec.from_file(str(folder / "model.xml"))
        for name in fitted:
            spec.add_sensor(
                name=f"{name}_reading", type=mujoco.mjtSensor.mjSENS_JOINTPOS, objtype=mujoco.mjtObj.mjOBJ_JOINT, objname=name
            )
        model = spec.compile()
        self.actuators = [model.actuator(name).id for name in joints]
        self.joints = [model.joint(name).qposadr[0] for name in joints]
        self.fitted = [1 + model.joint(name).qposadr[0] for name in fitted]  # A state begins with the time.
        self.parameters = sysid.ParameterDict()
        for row in rows:
            name = f"{row['joint']}.{row['quantity']}"
            self.parameters.add(sysid.Parameter(name, row["start"], row["low"], row["high"], modifier=modifier(row)))
        self.spec = spec
        self.sequences = [self.sequence(model, motion) for motion in self.problem["motions"]]
        self.candidates = 0

    def sequence(self, model, motion):
        place = np.zeros(model.nq)
        place[self.joints] = motion["start"]
        references = np.array(motion["references"])
        control = np.zeros((len(references) + 1, model.nu))  # The toolbox leaves out the last one.
        control[:-1, self.actuators] = references
        times = np.arange(len(control)) * self.problem["step_secs"]
        names = [model.sensor(index).name for index in range(model.nsensor)]
        readings = sysid.TimeSeries.from_names(np.array(motion["times_secs"]), np.array(motion["readings"]), model, names)
        start = sysid.create_initial_state(model, place)
        return sysid.ModelSequences(
            motion["name"], self.spec, motion["name"], start, sysid.TimeSeries(times, control), readings
        )

    def compare(self, parameters, predicted, measured, model, return_all, *, state):
        """Residuals in standard deviations of the noise. Of the states, which are those after each step: what a sensor
        of a joint's position gives in a rollout is its reading before the step."""
        self.candidates += 1
        predicted = sysid.TimeSeries(state[:, 0], state[:, self.fitted], measured.signal_mapping)
        return (predicted.data - measured.data) / self.problem["noise_rad"], predicted, measured

    def residual(self, threads):
        return sysid.build_residual_fn(
            models_sequences=self.sequences, modify_residual=self.compare, resample_true=False, n_threads=threads
        )

    def cost(self, residual, values):
        residuals, _, _ = residual(np.array(values), self.parameters.copy())
        return 0.5 * float(sum((r**2).sum() for r in residuals))

    def furthest_from_ours(self):
        """How far stock MuJoCo's motion with the true numbers is from that of our simulator, rad, and the most contacts."""
        truth, spec = self.parameters.copy(), self.spec.copy()
        truth.update_from_vector(np.array([row["truth"] for row in self.problem["parameters"]]))
        model = sysid.apply_param_modifiers(truth, spec)
        data, furthest, contacts = mujoco.MjData(model), 0.0, 0
        for motion in self.problem["motions"]:
            mujoco.mj_resetData(model, data)
            data.qpos[self.joints] = motion["start"]
            mujoco.mj_forward(model, data)
            for references, ours in zip(motion["references"], motion["noise_free"], strict=True):
                data.ctrl[self.actuators] = references
                mujoco.mj_step(model, data)
                furthest = max(furthest, np.abs(data.qpos[[place - 1 for place in self.fitted]] - ours).max())
                contacts = max(contacts, data.ncon)
        return furthest, contacts


def solve(problem, threads, way):
    """What the toolbox makes of the problem: values, half intervals, standard errors, cost, candidates, seconds."""
    residual = problem.residual(threads)
    problem.candidates = 0
    begun = time.perf_counter()
    with contextlib.redirect_stdout(sys.stderr):
        found, result = sysid.optimize(problem.parameters, residual, verbose=False, **way)
    secs = time.perf_counter() - begun
    candidates = problem.candidates / len(problem.sequences)
    values = found.as_vector()
    residuals, _, _ = residual(values, found.copy())
    covariance, half = sysid.calculate_intervals([np.concatenate([r.ravel() for r in residuals])], result.jac)
    return {
        "values": values, "half": half, "errors": np.sqrt(np.diag(covariance)), "cost": problem.cost(residual, values),
        "candidates": round(candidates), "secs": secs,
    }


def main(folder):
    if mujoco.__version__ != MUJOCO:
        sys.exit(f"this is MuJoCo {mujoco.__version__}, and the problem is for {MUJOCO}: run with --venv")
    problem = Problem(folder)
    ours = json.loads((folder / "answer.json").read_text())
    furthest, contacts = problem.furthest_from_ours()
    print(f"furthest {furthest:.1e} contacts {contacts}")
    residual = problem.residual(ours["threads"])
    print("cost of ours", ours["cost"], problem.cost(residual, ours["values"]), "truth", problem.cost(residual, [r["truth"] for r in problem.problem["parameters"]]), "start", problem.cost(residual, problem.parameters.as_vector()))
    print("ours", ours["evaluations"], ours["secs"], ours["ended"])
    for name, way in WAYS.items():
        theirs = solve(problem, ours["threads"], way)
        print(name, theirs["cost"], theirs["candidates"], theirs["secs"])
        print((theirs["values"] - ours["values"]) / theirs["errors"])
        print(np.array(ours["standard_errors"]) / theirs["errors"])


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(pathlib.Path(sys.argv[1]))
