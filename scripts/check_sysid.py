#!/usr/bin/env python3
"""Compares crates/identify with MuJoCo's own system identification toolbox on one problem.

    cargo run --release -p etude-identify --example outside -- FOLDER
    scripts/check_sysid.py [--venv] FOLDER

The example writes the problem and our answer into FOLDER. The toolbox (`mujoco.sysid`) gets the
same model, references, readings, start and bounds, and makes models, rollouts, slopes, steps and
intervals itself. Prints Markdown; exits with 1 if the answers differ. `--venv` puts what the
toolbox needs into a throw-away virtual environment first (SYSID_VENV names its folder,
/tmp/venv-sysid if not set) and runs there. Measured: benches/sysid-check.md.
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
# Largest difference of the answers, in standard errors, and of their costs: a step of that size
# costs half its square.
SAME_VALUE = 0.1
SAME_COST = 0.5 * SAME_VALUE**2
# Factor between the standard errors.
SAME_ERROR = 1.25

# The toolbox's optimisers: its default, the same with the scaling that it advises for
# ill-conditioned problems, and SciPy's.
WAYS = {
    "toolbox, `mujoco` (default)": {},
    "toolbox, `mujoco`, `x_scale=\"jac\"`": {"x_scale": "jac"},
    "toolbox, `scipy`": {"optimizer": "scipy"},
    "toolbox, `scipy_parallel_fd`": {"optimizer": "scipy_parallel_fd"},
}


def run_in_venv():
    """Creates the virtual environment if it does not exist, and restarts this script in it."""
    folder = pathlib.Path(os.environ.get("SYSID_VENV", "/tmp/venv-sysid"))
    python, unfinished = folder / "bin/python", folder / "unfinished"
    if not python.exists() or unfinished.exists():
        subprocess.run([sys.executable, "-m", "venv", "--clear", folder], check=True)
        unfinished.touch()
        command = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *PACKAGES]
        if subprocess.run(command).returncode != 0:
            sys.exit("pip could not install what MuJoCo's toolbox needs (its message is above)")
        unfinished.unlink()
    os.execv(python, [str(python), *(argument for argument in sys.argv if argument != "--venv")])


if __name__ == "__main__" and "--venv" in sys.argv[1:]:
    run_in_venv()

try:
    import mujoco
    import numpy as np
    from mujoco import sysid

    sysid.optimize  # Without its own packages the toolbox is there and empty.
except (ImportError, AttributeError) as error:
    sys.exit(f"MuJoCo's toolbox is not here ({error}): run with --venv")


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
    """The problem as the toolbox expects it."""

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
        self.replays = 0

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
        """Residuals in standard deviations of the noise. Of the states, which are those after each
        step: what a sensor of a joint's position gives in a rollout is its reading before the
        step."""
        self.replays += 1
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
        """Difference of stock MuJoCo's motion and our simulator's, rad, and the most contacts."""
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
    """Solves the problem with the toolbox; standard errors and intervals are the toolbox's."""
    residual = problem.residual(threads)
    problem.replays = 0
    begun = time.perf_counter()
    with contextlib.redirect_stdout(sys.stderr):
        found, result = sysid.optimize(problem.parameters, residual, verbose=False, **way)
    secs = time.perf_counter() - begun
    evaluations = problem.replays // len(problem.sequences)
    values = found.as_vector()
    residuals, _, _ = residual(values, found.copy())
    covariance, half = sysid.calculate_intervals([block.ravel() for block in residuals], result.jac)
    errors = np.sqrt(np.diag(covariance))
    intervals = np.stack([values - half, values + half], axis=1)
    cost = problem.cost(residual, values)
    return {"values": values, "intervals": intervals, "errors": errors, "cost": cost, "evaluations": evaluations, "secs": secs}


def number(value):
    return f"{value:.4g}" if abs(value) >= 1e-3 else f"{value * 1e6:.1f}e-6"


def table_of_numbers(rows, ours, theirs):
    """One line for each number; differences in the smaller of the two standard errors."""
    apart = (ours["values"] - theirs["values"]) / np.minimum(ours["errors"], theirs["errors"])
    print("| number | true | start | ours | 95 % | toolbox | 95 % | apart, s.e. | s.e., ours over theirs |")
    print("|---|---|---|---|---|---|---|---|---|")
    for index, row in enumerate(rows):
        cells = [f"{row['joint']} {row['quantity']}, {row['unit']}", number(row["truth"]), number(row["start"])]
        for answer in (ours, theirs):
            low, high = answer["intervals"][index]
            cells += [number(answer["values"][index]), f"{number(low)} … {number(high)}"]
        cells += [f"{apart[index]:+.4f}", f"{ours['errors'][index] / theirs['errors'][index]:.3f}"]
        print("| " + " | ".join(cells) + " |")
    truth = np.array([row["truth"] for row in rows])
    for name, answer in (("our", ours), ("the toolbox's", theirs)):
        low, high = np.asarray(answer["intervals"]).T
        print(f"\nOf the {len(truth)} true numbers {int(((low <= truth) & (truth <= high)).sum())} lie in {name} 95 % intervals.")
    return np.abs(apart).max()


def table_of_solvers(problem, answers):
    """One line for each solver: its evaluations, and how far its cost is above the best."""
    readings = sum(len(motion["readings"]) * len(problem["fitted"]) for motion in problem["motions"])
    best = min(answer["cost"] for answer in answers.values())
    print("\n| solver | evaluations | seconds | cost | above the best | rms over noise |\n|---|---|---|---|---|---|")
    for name, answer in answers.items():
        rms = np.sqrt(2 * answer["cost"] / readings)
        print(
            f"| {name} | {answer['evaluations']} | {answer['secs']:.1f} | {answer['cost']:.4f} | {answer['cost'] - best:.4g} "
            f"| {rms:.4f} |"
        )


def main(folder):
    if mujoco.__version__ != MUJOCO:
        sys.exit(f"this is MuJoCo {mujoco.__version__}, and the problem is for {MUJOCO}: run with --venv")
    problem = Problem(folder)
    ours = json.loads((folder / "answer.json").read_text())
    ours["values"], ours["errors"] = np.array(ours["values"]), np.array(ours["standard_errors"])
    furthest, contacts = problem.furthest_from_ours()
    residual = problem.residual(ours["threads"])
    in_theirs = problem.cost(residual, ours["values"])
    print(f"With the true numbers stock MuJoCo is at most {furthest:.1e} rad from our simulator, with {contacts} contacts.")
    print(f"Our answer costs {ours['cost']:.6f} as we reckon and {in_theirs:.6f} as the toolbox does.\n")

    ways = {name: solve(problem, ours["threads"], way) for name, way in WAYS.items()}
    theirs = min(ways.values(), key=lambda answer: answer["cost"])
    apart = table_of_numbers(problem.problem["parameters"], ours, theirs)
    table_of_solvers(problem.problem, {"ours": ours} | ways)

    ratios = ours["errors"] / theirs["errors"]
    wrong = []
    # `not <=` rather than `>`: a NaN must fail too.
    if not (furthest <= SAME_MOTION and contacts == 0):
        wrong.append(f"the two simulate different things: motions may differ by {SAME_MOTION:g} rad, without contacts")
    if not abs(in_theirs - ours["cost"]) <= 1e-6 * ours["cost"]:
        wrong.append("the two reckon the cost of our answer differently")
    if not ours["cost"] - theirs["cost"] <= SAME_COST:
        wrong.append(f"the toolbox found a better optimum, by {ours['cost'] - theirs['cost']:.4g}: ours is wrong")
    elif not theirs["cost"] - ours["cost"] <= SAME_COST:
        wrong.append(
            f"the toolbox ended {theirs['cost'] - ours['cost']:.4g} above us, so it checks nothing; give the example another seed"
        )
    elif not apart <= SAME_VALUE:
        wrong.append(f"values are up to {apart:.3f} standard errors apart; {SAME_VALUE:g} are allowed")
    elif not np.maximum(ratios, 1 / ratios).max() <= SAME_ERROR:
        wrong.append(f"standard errors differ by factors of {ratios.min():.2f} … {ratios.max():.2f}; {SAME_ERROR:g} is allowed")
    print()
    for line in wrong:
        print(f"NOT THE SAME: {line}.")
    if not wrong:
        print(f"The same: values within {apart:.4f} standard errors, costs within {abs(ours['cost'] - theirs['cost']):.1e}.")
    return 1 if wrong else 0


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    sys.exit(main(pathlib.Path(sys.argv[1])))
